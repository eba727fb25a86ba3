"""Errors that end a script: the line of the script, the message in one line, the traceback without our own frames."""

from __future__ import annotations

import os
import sysconfig
import traceback
from collections.abc import Iterable
from pathlib import Path

ON_REQUEST = "interrupted"
"""why a task that a person ended is not decided"""
PACKAGES = ("collision", "constraints", "physics", "vpframe")
_ROOT = Path(__file__).resolve().parents[2]
_OURS = tuple(str(_ROOT / package) + os.sep for package in PACKAGES)
_STANDARD = sysconfig.get_path("stdlib") + os.sep


def is_ours(error: BaseException) -> bool:
    """Whether an error is of a type that this program raises on purpose: its message says what to mend."""
    return type(error).__module__.partition(".")[0] in PACKAGES


def in_one_line(error: BaseException) -> str:
    """The message of one of our errors; of any other its type, too."""
    text = " ".join(str(error).split())
    if is_ours(error):
        return text
    if isinstance(error, SystemExit):
        return f"sys.exit({'' if error.code is None else repr(error.code)}) before the end of the task"
    return ": ".join(filter(None, [type(error).__name__, text]))


def place(error: BaseException, script: Path | None = None) -> str:
    """`task.py:12: `, the last line of the script that an error went through; empty if it went through none.

    script: the file meant; without one, whichever file is neither of this program nor of a library.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if script is None:
        own = [(Path(frame.filename).name, frame.lineno) for frame in _without_ours(frames)]
    else:
        own = [(str(script), frame.lineno) for frame in frames if Path(frame.filename).name == script.name]
    return f"{own[-1][0]}:{own[-1][1]}: " if own else ""


def script_traceback(error: BaseException) -> str:
    """The traceback of an error as Python prints it, without frames of this program (and of what they called)."""
    told = traceback.TracebackException.from_exception(error, compact=True)
    _cut(told)
    return "".join(told.format()).rstrip("\n")


def raised_inside(error: BaseException) -> bool:
    """Whether it was this program that raised an error, or a library that it called, not the script."""
    frames = traceback.extract_tb(error.__traceback__)
    return bool(frames) and frames[-1] not in _without_ours(frames)


def _cut(told: traceback.TracebackException) -> None:
    told.stack[:] = _without_ours(told.stack)
    for other in (told.__cause__, told.__context__, *(told.exceptions or ())):
        if other is not None:
            _cut(other)


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
