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
from typing import TYPE_CHECKING, Any, NoReturn, TypedDict, Unpack

from vpframe import console
from vpframe.analysis import clash_status
from vpframe.app.exit_code import exit_code
from vpframe.app.options import INTERRUPTED, NO, OK, add_run, load, print_notes, viewer_of
from vpframe.errors import CheckpointError, OutputError, TaskError, VpframeError
from vpframe.outputs import CHECKPOINT, RECORDING, REPORT_FILES, SCRIPT, Claims, Output
from vpframe.scene.names import ignored_words
from vpframe.scripts import ON_REQUEST, imported, located, print_traceback
from vpframe.session.interrupts import between_steps
from vpframe.text import plain

if TYPE_CHECKING:
    from vpframe.session.session import Session

_SHOWN = (
    "grabbed", "released", "accepted", "refused", "removed", "collided", "blocked", "landed", "expectation", "note",
)  # fmt: skip


class RunOptions(TypedDict, total=False):
    """Options of `run_task`."""

    view: bool
    """open the live view"""
    wait: bool
    """with `view`, wait for the first browser, and show the end until Ctrl-C"""
    record: str | Path | None
    """a `.rrd` file to record to"""
    report: str | Path | None
    """a folder for the report"""
    checkpoint: str | Path | None
    """a file for the progress of the run"""
    resume: bool
    """continue from `checkpoint`"""
    force: bool
    """replace any existing output; otherwise only files written by vpframe"""
    access: bool
    """a straight tool must reach what hands grab and turn, unless the script sets it"""


def run_task(path: str | Path, **options: Unpack[RunOptions]) -> int:
    """Run a task script; return 0 if the task can be done, 1 if not (or the script failed), 130 if interrupted.

    Raises
    ------
    VpframeError: bad input, in one line with file and place. OutputError: a file cannot be written.
    """
    from vpframe.session.session import Session

    record, report, checkpoint = options.get("record"), options.get("report"), options.get("checkpoint")
    if options.get("resume") and checkpoint is None:
        raise VpframeError("--resume needs --checkpoint FILE, the one that the earlier run wrote")
    script = Path(path)
    if not script.is_file():
        raise VpframeError(f"{script}: no such task script")
    with Claims(options.get("force", False), script) as claims:
        recording, saved = claims.file(record, RECORDING), claims.file(checkpoint, CHECKPOINT)
        folder = claims.folder(report, REPORT_FILES)
        module: Any = claims.enter_context(imported(script))
        if hasattr(module, "VARIANTS"):  # the script of a study: use nominal values
            from vpframe.studies.variants import bound, nominal, variables_of

            module = bound(module, script, nominal(variables_of(module, script)))
        with located(script):
            scene = _scene(module, script)
        for output in (recording, saved, folder):
            if output is not None and scene.source:
                output.spare(scene.source)
        given = {"name": script.stem, "clearance": True, **getattr(module, "OPTIONS", {})}
        if saved is not None:
            digest = hashlib.sha256(script.read_bytes()).hexdigest()
            given.update(checkpoint=saved, resume=options.get("resume", False), run={"script": digest})
        if options.get("access"):
            given.setdefault("access", True)
        began = time.perf_counter()
        viewer = viewer_of(options.get("view", False), options.get("wait", False))
        with located(script):
            session = Session(scene, viewer=viewer, record=recording, **given)
        print_notes(session.scene)
        session.on_event(_print_event)
        if folder is not None:  # pairs authorised after an earlier run
            for a, b in clash_status.read_authorised(folder.path / clash_status.FILE):
                if a in scene and b in scene:
                    session.authorise(a, b)
        try:
            code, word = perform(session, module.task, script)
        finally:
            try:
                session.close()
            finally:
                if folder is not None:
                    session.report(folder)
    spent = time.perf_counter() - began
    for fit in session.log.press_fits:
        console.say(str(fit))
    ignored = ignored_words(session.ignored, len(session.scene))
    word += f", {ignored}" if ignored else ""
    console.say(f"{word}: {session.time:.2f} s of the task in {session.step_count} steps, {spent:.1f} s to compute")
    for what, where in (("recording", record), ("report", report), ("checkpoint", checkpoint)):
        if where is not None:
            console.say(f"{what}: {where}")
    if viewer is not None and options.get("wait") and code != INTERRUPTED:
        viewer.stay()
    return code


def perform(session: Session, task: Callable[[Session], object], script: Path | None = None) -> tuple[int, str]:
    """Run the task (of a script); print the reason of a failure and return exit code and result.

    Raises
    ------
    CheckpointError, OutputError: a file of the run, not the script, is at fault.
    """
    try:
        with between_steps(session):
            task(session)
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
        console.warn(f"failed: {session.failure}")
        return NO, "failed"
    if session.undecided == ON_REQUEST:
        console.warn("interrupted; what was done so far is kept")
        return INTERRUPTED, "interrupted"
    if session.undecided:
        console.warn(f"not decided: {session.undecided}")
        return NO, "not decided"
    return OK, "done"


def main(script: str, argv: Sequence[str] | None = None) -> NoReturn:
    """Run a task script as a program; never returns."""
    parser = argparse.ArgumentParser(prog=os.path.basename(script))
    add_run(parser)
    given = vars(parser.parse_args(argv))
    sys.exit(exit_code(lambda: run_task(script, **given)))


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

        scene = load(from_file)
        print_notes(scene)
        return write(script, scene, Path(from_file), part, ALL if budget is None else budget)


def _scene(module: ModuleType, script: Path) -> Any:
    make: Callable[[], Any] | None = getattr(module, "scene", None)
    file = getattr(module, "FILE", None)
    if callable(make):
        return make()
    if isinstance(file, str | Path):
        return load(script.parent / file)
    raise VpframeError(f"{script}: defines no model; write FILE = 'model.step' or `def scene(): …`")


def _print_event(event: Any) -> None:
    if event.kind in _SHOWN:
        console.say(f"{event.time:8.3f} s  {event.kind:<11} {plain(event.text)}")
