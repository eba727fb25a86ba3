"""Task scripts as modules, and errors that end a script: its line, one-line message, and a traceback without frames of
this program."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType

from vpframe import console
from vpframe.errors import VpframeError

TRACEBACK = "VPFRAME_TRACEBACK"
"""environment variable that enables full tracebacks"""
ON_REQUEST = "interrupted"
"""reason why a task that the user ended is undecided"""
PACKAGES = ("collision", "constraints", "physics", "vpframe")
_ROOT = Path(__file__).resolve().parents[1]
_OURS = tuple(str(_ROOT / package) + os.sep for package in PACKAGES)
_STANDARD = sysconfig.get_path("stdlib") + os.sep


def is_ours(error: BaseException) -> bool:
    """Whether an error has a type of this program, so that its message names a remedy."""
    return type(error).__module__.partition(".")[0] in PACKAGES


def in_one_line(error: BaseException) -> str:
    """Return the message of an error; with its type if that is not ours."""
    text = " ".join(str(error).split())
    if is_ours(error):
        return text
    if isinstance(error, SystemExit):
        return f"sys.exit({'' if error.code is None else repr(error.code)}) before the end of the task"
    return ": ".join(filter(None, [type(error).__name__, text]))


def place(error: BaseException, script: Path | None = None) -> str:
    """Return `task.py:12: `, the last line of the script in an error's traceback; empty if there is none.

    script: its file; by default any file that belongs neither to this program nor to a library.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if script is None:
        own = [(Path(frame.filename).name, frame.lineno) for frame in _without_ours(frames)]
    else:
        own = [(str(script), frame.lineno) for frame in frames if Path(frame.filename).name == script.name]
    return f"{own[-1][0]}:{own[-1][1]}: " if own else ""


def script_traceback(error: BaseException) -> str:
    """Return the traceback of an error as Python prints it, without frames of this program and its callees."""
    report = traceback.TracebackException.from_exception(error, compact=True)
    _strip(report)
    return "".join(report.format()).rstrip("\n")


def raised_inside(error: BaseException) -> bool:
    """Whether an error was raised by this program or a library that it called, not by the script."""
    frames = traceback.extract_tb(error.__traceback__)
    return bool(frames) and frames[-1] not in _without_ours(frames)


@contextlib.contextmanager
def imported(script: Path) -> Iterator[ModuleType]:
    """Yield the module of a task script; inside, it is in `sys.modules` and `import` searches the script's folder."""
    name = f"vpframe_task_{script.stem}"
    spec = importlib.util.spec_from_file_location(name, script)
    if spec is None or spec.loader is None:
        raise VpframeError(f"{script}: not a Python file; a task script ends in .py")
    module = importlib.util.module_from_spec(spec)
    folder = str(script.resolve().parent)
    sys.path.insert(0, folder)
    sys.modules[name] = module
    try:
        with located(script):
            spec.loader.exec_module(module)
        if not callable(getattr(module, "task", None)):
            raise VpframeError(f"{script}: defines no task; write `def task(session): …`")
        yield module
    finally:
        sys.modules.pop(name, None)
        with contextlib.suppress(ValueError):  # removed by the script
            sys.path.remove(folder)


@contextlib.contextmanager
def located(script: Path) -> Iterator[None]:
    """Convert errors of a script that is being read to VpframeError with its line."""
    try:
        yield
    except SyntaxError as error:
        raise VpframeError(f"{error.filename or script}:{error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        if not os.environ.get(TRACEBACK):  # otherwise the caller shows the full traceback
            print_traceback(error)
        raise VpframeError(f"{place(error, script)}{in_one_line(error)}") from error


def print_traceback(error: BaseException) -> None:
    """Print the traceback of a script's fault; our frames only if `TRACEBACK` is set."""
    if os.environ.get(TRACEBACK):
        console.warn("".join(traceback.format_exception(error)).rstrip())
    elif not is_ours(error):
        console.warn(script_traceback(error))
        if raised_inside(error):
            console.warn(f"(raised inside vpframe; set {TRACEBACK}=1 to see where)")


def _strip(report: traceback.TracebackException) -> None:
    report.stack[:] = _without_ours(report.stack)
    for other in (report.__cause__, report.__context__, *(report.exceptions or ())):
        if other is not None:
            _strip(other)


def _without_ours(frames: Iterable[traceback.FrameSummary]) -> list[traceback.FrameSummary]:
    kept, inside = [], False
    for frame in frames:
        if frame.filename.startswith(_OURS):
            inside = True
        elif not (inside and _of_a_library(frame.filename)):
            inside = False
            kept.append(frame)
    return kept


def _of_a_library(file: str) -> bool:
    return "-packages" + os.sep in file or file.startswith((_STANDARD, "<frozen ", "<string>", "<__array"))
