"""Running task scripts: what `vpframe run` and `vpframe new` do.

A task script is a Python file with two names in it:

- where the parts come from: `FILE = "model.step"` (beside the script), or `def scene() -> vpframe.Scene`;
- `def task(session)`: the task, in the hands' verbs, with what it expects.

`OPTIONS = {...}`, if there, goes to `vpframe.Session` (`rule`, `dt`, `tolerance`, …). Ending the file with

    if __name__ == "__main__":
        vpframe.study.main(__file__)

lets it run by itself too, with the options of `vpframe run`.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from vpframe import clash_status
from vpframe.errors import TaskError, VpframeError
from vpframe.interrupts import between_steps, handled
from vpframe.progress import say, warn

if TYPE_CHECKING:
    from vpframe.scene import Scene

OK, FAILED, BAD, INTERRUPTED = 0, 1, 2, 130

_SHOWN = (
    "grabbed",
    "released",
    "accepted",
    "refused",
    "removed",
    "collided",
    "blocked",
    "landed",
    "expectation",
    "note",
)


def run_task(
    path: str | Path,
    view: bool = False,
    record: str | Path | None = None,
    report: str | Path | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
) -> int:
    """Run one task script; 0 it can be done, 1 it cannot (the reason on standard error), 130 interrupted.

    Parameters
    ----------
    path: the script.
    view: open the live view.
    record: a `.rrd` file to record to.
    report: a folder for the report.
    checkpoint: a file that keeps where the run is; `resume` goes on from it.

    Raises
    ------
    VpframeError: bad input, in one line that names the file and the place.
    """
    from vpframe.session import Session

    if resume and checkpoint is None:
        raise VpframeError("--resume needs --checkpoint FILE, the one that the earlier run wrote")
    script = Path(path)
    module = _imported(script)
    with _located(script):
        scene = _scene(module, script)
    options = dict(getattr(module, "OPTIONS", {}))
    if checkpoint is not None:
        options.update(checkpoint=checkpoint, resume=resume, run={"script": _digest(script)})
    began = time.perf_counter()
    with _located(script):
        session = Session(
            scene,
            viewer="meshcat" if view else None,
            record=None if record is None else str(record),
            **{"name": script.stem, **options},
        )
    session.on_event(_print_event)
    if report is not None:  # what a person authorised after an earlier run
        for a, b in clash_status.read_authorised(Path(report) / clash_status.FILE):
            if a in scene and b in scene:
                session.authorise(a, b)
    code = OK
    try:
        with session, between_steps(session), _located(script):
            module.task(session)
    except TaskError as error:
        warn(f"failed: {error}")
        session.fail(str(error))
        code = FAILED
    except KeyboardInterrupt:
        warn("interrupted; what was done so far is kept")
        session.fail("interrupted")
        code = INTERRUPTED
    finally:
        session.close()
        if report is not None:
            session.report(report)
    spent = time.perf_counter() - began
    word = {OK: "done", FAILED: "failed", INTERRUPTED: "interrupted"}[code]
    print(f"{word}: {session.time:.2f} s of the task in {session.step_count} steps, {spent:.1f} s to compute")
    for what, where in (("recording", record), ("report", report), ("checkpoint", checkpoint)):
        if where is not None:
            print(f"{what}: {where}")
    return code


def main(script: str, argv: Sequence[str] | None = None) -> NoReturn:
    """Run a task script as a program of its own; never returns."""
    parser = argparse.ArgumentParser(prog=os.path.basename(script))
    parser.add_argument("--view", action="store_true", help="open the live view")
    parser.add_argument("--record", metavar="RUN.rrd", help="record to this file")
    parser.add_argument("--report", metavar="DIR", help="write the report to this folder")
    parser.add_argument("--checkpoint", metavar="FILE", help="save where the run is, once a second")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint of a run that was cut off")
    given = parser.parse_args(argv)
    try:
        with handled():
            code = run_task(script, given.view, given.record, given.report, given.checkpoint, given.resume)
    except KeyboardInterrupt:
        warn("interrupted")
        code = INTERRUPTED
    except VpframeError as error:
        print(error, file=sys.stderr)
        code = BAD
    sys.exit(code)


def new_task(path: str | Path, from_file: str | Path) -> str:
    """Write a first task script for the parts of a model; returns why it stops, empty when it runs to its end.

    Raises
    ------
    VpframeError: the script exists already, or cannot be written; LoadError: the model cannot be read.
    """
    if Path(path).exists():
        raise VpframeError(f"{path}: exists already; give another name or remove it")
    from vpframe.first_task import new_task as write

    return write(path, loaded(from_file), Path(from_file))


def loaded(path: str | Path) -> Scene:
    """`vpframe.load`, with a line of progress on the terminal."""
    from vpframe.importers import load
    from vpframe.progress import Progress

    with Progress(f"loading {Path(path).name}", uses=["load"]) as progress:
        return load(path, progress=progress)


def _imported(script: Path) -> ModuleType:
    if not script.is_file():
        raise VpframeError(f"{script}: no such task script")
    spec = importlib.util.spec_from_file_location(f"vpframe_task_{script.stem}", script)
    if spec is None or spec.loader is None:
        raise VpframeError(f"{script}: not a Python file; a task script ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(script.resolve().parent))  # scripts share helpers that lie beside them
    try:
        with _located(script):
            spec.loader.exec_module(module)
    finally:
        sys.path.pop(0)
    if not callable(getattr(module, "task", None)):
        raise VpframeError(f"{script}: defines no task; write `def task(session): …`")
    return module


def _scene(module: ModuleType, script: Path) -> Any:
    make: Callable[[], Any] | None = getattr(module, "scene", None)
    file = getattr(module, "FILE", None)
    if callable(make):
        return make()
    if isinstance(file, str | Path):
        return loaded(script.parent / file)
    raise VpframeError(f"{script}: says not what to work on; write FILE = 'model.step' or `def scene(): …`")


@contextlib.contextmanager
def _located(script: Path) -> Iterator[None]:
    """Give errors raised from a script the line they come from, and turn foreign ones into one line."""
    try:
        yield
    except TaskError as error:
        raise TaskError(f"{_place(script, error)}{error}") from error
    except VpframeError as error:
        raise VpframeError(f"{_place(script, error)}{error}") from error
    except SyntaxError as error:
        raise VpframeError(f"{error.filename or script}:{error.lineno}: {error.msg}") from error
    except Exception as error:
        if os.environ.get("VPFRAME_TRACEBACK"):
            raise
        raise VpframeError(f"{_place(script, error)}{type(error).__name__}: {error}") from error


def _place(script: Path, error: BaseException) -> str:
    """`script.py:12: `, the last line of the script that the error went through; empty if it did not."""
    same = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename).name == script.name]
    return f"{script}:{same[-1].lineno}: " if same else ""


def _print_event(event: Any) -> None:
    if event.kind in _SHOWN:
        say(f"{event.time:8.3f} s  {event.kind:<11} {event.text}")


def _digest(script: Path) -> str:
    return hashlib.sha256(script.read_bytes()).hexdigest()
