"""Run task scripts: `vpframe run` and `vpframe new`.

A task script is a Python file that defines:

- the parts: `FILE = "model.step"` (beside the script), or `def scene() -> vpframe.Scene`;
- `def task(session)`: the task, with verbs of hands and expectations.

Optional `OPTIONS = {...}` are passed to `vpframe.Session` (`rule`, `dt`, `tolerance`, …); the clearance of moving parts
is measured unless they say `"clearance": False`. With the ending

    if __name__ == "__main__":
        vp.main(__file__)

the script can also be run directly, with the options of `vpframe run`.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from vpframe import console
from vpframe.analysis import clash_status
from vpframe.app.progress import Terminal, say, warn
from vpframe.errors import CheckpointError, OutputError, TaskError, VpframeError
from vpframe.outputs import CHECKPOINT, RECORDING, REPORT_FILES, SCRIPT, Output, OutputFolder
from vpframe.scene.names import ignored_words
from vpframe.scripts import ON_REQUEST, imported, located, print_traceback
from vpframe.session.interrupts import between_steps, handled
from vpframe.text import plain

if TYPE_CHECKING:
    from vpframe.scene.scene import Scene
    from vpframe.session.session import Session
    from vpframe.view.meshcat_viewer import MeshcatViewer

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
    force: bool = False,
    wait: bool = False,
    access: bool = False,
) -> int:
    """Run a task script; return 0 if the task can be done, 1 if not (or the script failed), 130 if interrupted.

    Parameters
    ----------
    path: the script.
    view: open the live view.
    record: a `.rrd` file to record to.
    report: a folder for the report.
    checkpoint: a file for the progress of the run; `resume` continues from it.
    force: replace any existing output; otherwise only files written by vpframe.
    wait: with `view`, wait for the first browser, and show the end until Ctrl-C.
    access: whether a straight tool must reach what hands grab and turn, unless the script sets it.

    Raises
    ------
    VpframeError: bad input, in one line with file and place. OutputError: a file cannot be written.
    """
    from vpframe.session.session import Session

    if resume and checkpoint is None:
        raise VpframeError("--resume needs --checkpoint FILE, the one that the earlier run wrote")
    script = Path(path)
    if not script.is_file():
        raise VpframeError(f"{script}: no such task script")
    with contextlib.ExitStack() as claims:
        recording = None if record is None else claims.enter_context(Output(record, RECORDING, force, [script]))
        saved = None if checkpoint is None else claims.enter_context(Output(checkpoint, CHECKPOINT, force, [script]))
        folder = None if report is None else claims.enter_context(OutputFolder(report, REPORT_FILES, force, [script]))
        module: Any = claims.enter_context(imported(script))
        if hasattr(module, "VARIANTS"):  # the script of a study: use nominal values
            from vpframe.studies.variants import bound, nominal, variables_of

            module = bound(module, script, nominal(variables_of(module, script)))
        with located(script):
            scene = _scene(module, script)
        for output in (recording, saved, folder):
            if output is not None and scene.source:
                output.spare(scene.source)
        options = dict(getattr(module, "OPTIONS", {}))
        if saved is not None:
            options.update(checkpoint=saved, resume=resume, run={"script": _digest(script)})
        if access:
            options.setdefault("access", True)
        began = time.perf_counter()
        viewer = _viewer(wait) if view else None
        with located(script):
            given = {"name": script.stem, "clearance": True, **options}
            session = Session(scene, viewer=viewer, record=recording, **given)
        for note in session.scene.all_notes():
            say(f"note: {note}")
        session.on_event(_print_event)
        if folder is not None:  # pairs authorised after an earlier run
            for a, b in clash_status.read_authorised(folder.path / clash_status.FILE):
                if a in scene and b in scene:
                    session.authorise(a, b)
        try:
            code, word = _perform(module, session, script)
        finally:
            try:
                session.close()
            finally:
                if folder is not None:
                    session.report(folder)
    spent = time.perf_counter() - began
    for fit in session.log.press_fits:
        say(str(fit))
    ignored = ignored_words(session.ignored, len(session.scene))
    word += f", {ignored}" if ignored else ""
    say(f"{word}: {session.time:.2f} s of the task in {session.step_count} steps, {spent:.1f} s to compute")
    for what, where in (("recording", record), ("report", report), ("checkpoint", checkpoint)):
        if where is not None:
            say(f"{what}: {where}")
    if wait and viewer is not None and code != INTERRUPTED:
        viewer.stay()
    return code


def _viewer(wait: bool) -> MeshcatViewer:
    from vpframe.view.meshcat_viewer import watched

    return watched(wait)


def _perform(module: ModuleType, session: Session, script: Path) -> tuple[int, str]:
    """Run the task; print the reason of a failure and return exit code and result.

    Raises
    ------
    CheckpointError, OutputError: a file of the run, not the script, is at fault.
    """
    try:
        with between_steps(session):
            module.task(session)
        session.conclude()
    except BaseException as error:  # also SystemExit: `sys.exit` in a script is no success
        if isinstance(error, TaskError) and session.step_count == 0:
            with contextlib.suppress(VpframeError):
                session.step()  # so that the report shows the model as it stands
        session.conclude(error, script)
        if isinstance(error, CheckpointError | OutputError):
            raise
        if not isinstance(error, TaskError | KeyboardInterrupt):
            print_traceback(error)
    if session.failure:
        warn(f"failed: {session.failure}")
        return FAILED, "failed"
    if session.undecided == ON_REQUEST:
        warn("interrupted; what was done so far is kept")
        return INTERRUPTED, "interrupted"
    if session.undecided:
        warn(f"not decided: {session.undecided}")
        return FAILED, "not decided"
    return OK, "done"


def main(script: str, argv: Sequence[str] | None = None) -> NoReturn:
    """Run a task script as a program; never returns."""
    parser = argparse.ArgumentParser(prog=os.path.basename(script))
    parser.add_argument(
        "--view", action="store_true", help="open the live view, wait for a browser, show the end until Ctrl-C"
    )
    parser.add_argument("--no-wait", dest="wait", action="store_false", help="with --view: do not wait for anybody")
    parser.add_argument("--record", metavar="RUN.rrd", help="record to this file")
    parser.add_argument("--report", metavar="DIR", help="write the report to this folder")
    parser.add_argument("--access", action="store_true", help="a straight tool must reach what hands grab and turn")
    parser.add_argument("--checkpoint", metavar="FILE", help="save the progress of the run, once a second")
    parser.add_argument("--resume", action="store_true", help="continue from the checkpoint of an interrupted run")
    parser.add_argument("--force", action="store_true", help="also replace files that vpframe did not write")
    given = parser.parse_args(argv)
    try:
        with handled(), console.installed(Terminal()):
            code = run_task(script, **vars(given))
    except KeyboardInterrupt:
        warn("interrupted")
        code = INTERRUPTED
    except VpframeError as error:
        warn(str(error))
        code = BAD
    sys.exit(code)


def new_task(
    path: str | Path, from_file: str | Path, force: bool = False, part: str | None = None, budget: float | None = None
) -> str:
    """Write a first task script for a model; return why it takes no part out, empty if it does.

    part: name of the part to remove; None: the first one that can be removed.
    budget: of planning what has to be removed before that part, s; None: a minute.

    Raises
    ------
    OutputError: the script exists already (without `force`), or cannot be written; LoadError: the model cannot be read;
        UnknownPartError, TaskError: no part has that name.
    """
    with Output(path, SCRIPT, force, [from_file]) as script:
        from vpframe.app.scaffold import ALL
        from vpframe.app.scaffold import new_task as write

        scene = loaded(from_file)
        for note in scene.all_notes():
            say(f"note: {note}")
        return write(script, scene, Path(from_file), part, ALL if budget is None else budget)


def loaded(path: str | Path) -> Scene:
    """`vpframe.load` with a progress line."""
    from vpframe.app.progress import Progress
    from vpframe.importers import load

    with Progress(f"loading {Path(path).name}") as progress:
        return load(path, progress=progress)


def _scene(module: ModuleType, script: Path) -> Any:
    make: Callable[[], Any] | None = getattr(module, "scene", None)
    file = getattr(module, "FILE", None)
    if callable(make):
        return make()
    if isinstance(file, str | Path):
        return loaded(script.parent / file)
    raise VpframeError(f"{script}: defines no model; write FILE = 'model.step' or `def scene(): …`")


def _print_event(event: Any) -> None:
    if event.kind in _SHOWN:
        say(f"{event.time:8.3f} s  {event.kind:<11} {plain(event.text)}")


def _digest(script: Path) -> str:
    return hashlib.sha256(script.read_bytes()).hexdigest()
