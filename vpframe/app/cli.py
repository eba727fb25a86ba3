"""The command line. Exit 0 done, 1 the answer is no, 2 bad usage or bad input (one line on standard error)."""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from vpframe import __version__
from vpframe.app.outputs import PAGE, STATUS, URDF, Kind, Output
from vpframe.app.progress import say, warn
from vpframe.scene.units import NAMES, length
from vpframe.session.interrupts import handled

OK, NO, BAD = 0, 1, 2
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""the disk has no room"""
_KERNELS = {"demo": "session", "run": "session", "new": "session", "clash": "clash", "mates": "mates"}
"""what of `vpframe.app.warm_up` a command needs"""


class UsageError(Exception):
    """The command line itself is wrong; the message is the line to print."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # before numpy is imported: our matrices are small, and threads that wait for each other on a busy machine are slow
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        arguments = _parser().parse_args(argv)
        command: Callable[[argparse.Namespace], int] = arguments.command
        with handled():
            code = _helped(command, arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # the reader of our output has gone: not our fault, and nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL and error.filename is None:
            # what is left in the buffer of standard output would fail again when the interpreter ends
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return _complain(f"what was found cannot be printed: {error.strerror}", BAD)
        if os.environ.get("VPFRAME_TRACEBACK"):
            raise
        return _complain(_one_line(error), BAD)


def _helped(command: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Run the command while other processes compile the kernels that it will need."""
    if arguments.kernels is None:
        return command(arguments)
    from vpframe.app import warm_up

    warm_up.start(arguments.kernels)
    code = command(arguments)
    if code in (OK, NO):
        warm_up.note_enough(arguments.kernels)
    return code


def _complain(text: str, code: int) -> int:
    warn(f"vpframe: {text}")
    return code


def _one_line(error: Exception) -> str:
    from collision.errors import CollisionError
    from constraints.errors import ConstraintsError
    from vpframe.errors import VpframeError

    known: tuple[type[Exception], ...] = (UsageError, VpframeError, CollisionError, ConstraintsError)
    if "physics" in sys.modules:
        from physics.errors import PhysicsError

        known = (*known, PhysicsError)
    text = " ".join(str(error).split())
    if isinstance(error, known):
        return text
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return f"internal error: {type(error).__name__}: {text} (set VPFRAME_TRACEBACK=1 to see where)"


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vpframe", description="Can the part be put in, taken out, serviced? Find out by script.")
    parser.add_argument("--version", action="version", version=f"vpframe {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    def add(name: str, command: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(command=command, kernels=_KERNELS.get(name))
        return sub

    def add_force(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("--force", action="store_true", help="write also over what vpframe did not write")

    def add_view(sub: argparse.ArgumentParser) -> None:
        text = "watch it in meshcat: waits for the first browser, shows the end until Ctrl-C"
        sub.add_argument("--view", action="store_true", help=text)
        sub.add_argument("--no-wait", dest="wait", action="store_false", help="with --view: do not wait for anybody")

    sub = add("demo", _demo, "the main job on a bundled example: a stepped shaft into a bored housing and out again")
    sub.add_argument("--out", metavar="DIR", default="vpframe-demo", help="where model, recording and report go")
    add_view(sub)
    add_force(sub)

    sub = add("run", _run, "run a task script")
    sub.add_argument("task", metavar="TASK.py")
    add_view(sub)
    sub.add_argument("--record", metavar="RUN.rrd", help="write a rerun recording")
    sub.add_argument("--report", metavar="DIR", help="write report.json, a page with pictures, and the clashes as CSV")
    sub.add_argument("--checkpoint", metavar="FILE", help="save where the run is, once a second")
    sub.add_argument("--resume", action="store_true", help="go on from the checkpoint of a run that was cut off")
    add_force(sub)

    sub = add("new", _new, "write a first task script for the parts of a model")
    sub.add_argument("task", metavar="TASK.py")
    sub.add_argument("--from", dest="file", metavar="FILE", required=True, help="the model")
    add_force(sub)

    sub = add("clash", _clash, "clash, contact, clearance and containment by surface pair; exit 1 if there is a clash")
    sub.add_argument("files", metavar="FILE", nargs="+", help="models; several are put into one scene as they stand")
    sub.add_argument("--clearance", metavar="LENGTH", type=_length, default=0.0, help="also list pairs nearer than it")
    sub.add_argument("--authorise", metavar="A:B", action="append", default=[], help="a pair of parts meant to clash")
    sub.add_argument("--status", metavar="FILE", help="keep what is new, accepted and resolved in this file, over runs")
    sub.add_argument("--accept", metavar="A:B", action="append", default=[], help="accept the clashes of two parts")
    sub.add_argument("--remark", metavar="TEXT", default="", help="why they are accepted")
    add_force(sub)
    _add_loading(sub)
    sub.add_argument("--json", action="store_true")

    sub = add("accept", _accept, "accept clashes of a report by name: the next runs of its task no longer count them")
    sub.add_argument("report", metavar="DIR", help="the folder that --report wrote")
    sub.add_argument("names", metavar="A:B", nargs="+", help="two parts, or with a surface of each: A:3:B:12")
    sub.add_argument("--remark", metavar="TEXT", default="", help="why they are accepted")
    sub.add_argument(
        "--authorise", action="store_true", help="the parts are meant to overlap: from now on they do not block either"
    )

    sub = add("mates", _mates, "every constraint of an assembly as it stands, each part's joint and freedom")
    sub.add_argument("file", metavar="FILE")
    sub.add_argument("--urdf", metavar="OUT", help="write the mechanism as URDF")
    add_force(sub)
    sub.add_argument(
        "--fit", metavar="LENGTH", type=_length,
        help="greatest radial clearance of a shaft in its bore (default: 0.25mm, or a tenth of its diameter up to 4mm)",
    )  # fmt: skip
    _add_loading(sub)
    sub.add_argument("--json", action="store_true")

    sub = add("view", _view, "look at a model in meshcat")
    sub.add_argument("file", metavar="FILE")
    sub.add_argument("--html", metavar="OUT", help="write a self-contained page and end")
    add_force(sub)
    sub.add_argument("--host", default="127.0.0.1", help="address to serve on (default: this machine only)")
    _add_loading(sub)

    sub = add("replay", _replay, "open a recording in rerun")
    sub.add_argument("recording", metavar="RUN.rrd")
    sub.add_argument("--script", action="store_true", help="print the recorded events instead")

    sub = add("bench", _bench, "speed against error, side by side with named peers")
    sub.add_argument("suite", nargs="?", choices=SUITES, help="one suite (default: all)")
    sub.add_argument("--plot", metavar="DIR", help="draw the plots (needs matplotlib)")
    sub.add_argument("--quick", action="store_true", help="fewer repetitions")
    sub.add_argument("--json", action="store_true")
    return parser


SUITES = ("collision", "constraints", "physics", "session")


def _length(text: str) -> float:
    try:
        return length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _add_loading(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--deflection", metavar="LENGTH", type=_length, help="greatest sag of a triangle")
    sub.add_argument("--angular", metavar="RADIANS", type=float, help="greatest angle between neighbouring facets")
    sub.add_argument(
        "--timeout", metavar="SECONDS", type=float, help="limit of reading a CAD file (a minute a megabyte)"
    )
    sub.add_argument("--unit", metavar="UNIT", help="length unit of STL, OBJ and PLY files: " + NAMES)


def _load(path: str, arguments: argparse.Namespace) -> Any:
    import vpframe as vp
    from vpframe.app.progress import Progress

    given = {name: getattr(arguments, name) for name in ("deflection", "angular", "timeout", "unit")}
    with Progress("loading " + os.path.basename(path)) as progress:
        return vp.load(path, progress=progress, **{name: value for name, value in given.items() if value is not None})


@contextlib.contextmanager
def _claimed(arguments: argparse.Namespace, name: str, kind: Kind, inputs: Sequence[str]) -> Iterator[Output | None]:
    """The file that an option names, claimed before the work begins; None where it was not given."""
    path = getattr(arguments, name)
    if path is None:
        yield None
        return
    with Output(path, kind, arguments.force, inputs) as output:
        yield output


@contextlib.contextmanager
def _document(wanted: bool) -> Iterator[Callable[[Any], None]]:
    """Give a function that prints one JSON document; whatever else is printed meanwhile goes to standard error.

    The CAD kernel and other C++ libraries write to file descriptor 1 directly, so it is the descriptor that is moved.
    """
    if not wanted:
        yield lambda document: None
        return
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    documents: list[Any] = []
    try:
        yield documents.append
    finally:
        sys.stdout.flush()
        os.dup2(saved, 1)
        os.close(saved)
    for document in documents:
        # numpy scalars are numbers too; NaN is not JSON
        print(json.dumps(document, indent=2, allow_nan=False, default=lambda value: value.item()), flush=True)


def _demo(arguments: argparse.Namespace) -> int:
    from vpframe.app import demo

    return demo.run(arguments.out, view=arguments.view, force=arguments.force, wait=arguments.wait)


def _run(arguments: argparse.Namespace) -> int:
    from vpframe.app import task_runner as study

    return study.run_task(
        arguments.task,
        view=arguments.view,
        record=arguments.record,
        report=arguments.report,
        checkpoint=arguments.checkpoint,
        resume=arguments.resume,
        force=arguments.force,
        wait=arguments.wait,
    )


def _new(arguments: argparse.Namespace) -> int:
    from vpframe.app import task_runner as study

    stops = study.new_task(arguments.task, arguments.file, arguments.force)
    print(f"wrote {arguments.task}; run it with: vpframe run {arguments.task} --view")
    if stops:
        say(f"no part came out by itself; as written it stops: {stops}")
    return OK


def _clash(arguments: argparse.Namespace) -> int:
    from vpframe.analysis import clash
    from vpframe.app.progress import Progress

    if arguments.accept and arguments.status is None:
        raise UsageError("--accept needs --status FILE, where it is kept")
    with _document(arguments.json) as emit, _claimed(arguments, "status", STATUS, arguments.files) as status:
        scene = clash.merged([_load(path, arguments) for path in arguments.files])
        authorised = clash.authorised_pairs(arguments.authorise)
        with Progress("looking for clashes") as progress:
            document = clash.clash(scene, arguments.clearance, authorised=authorised, progress=progress)
        if status is not None:
            clash.with_status(document, status, arguments.accept, arguments.remark)
        emit({**document, "notes": list(scene.all_notes())})
        if not arguments.json:
            print(clash.table(document))
            _print_notes(scene)
    return NO if any(map(clash.is_open, document["pairs"])) else OK


def _print_notes(scene: Any) -> None:
    """What was lost, repaired or guessed of the model: part of every answer about it."""
    from vpframe.app.progress import say

    for note in scene.all_notes():
        say(f"note: {note}")


def _accept(arguments: argparse.Namespace) -> int:
    from vpframe.analysis import clash_status

    keys = clash_status.accept_named(arguments.report, arguments.names, arguments.remark, arguments.authorise)
    for key in keys:
        say(f"accepted: {key.part_a} surface {key.surface_a} with {key.part_b} surface {key.surface_b}")
    print("the next run with this report folder counts them as accepted")
    return OK


def _mates(arguments: argparse.Namespace) -> int:
    from collision import Tolerance
    from vpframe.analysis import mates
    from vpframe.app.progress import Progress

    tolerance = None if arguments.fit is None else Tolerance(clearance=arguments.fit, clearance_relative=0.0)
    with _document(arguments.json) as emit, _claimed(arguments, "urdf", URDF, [arguments.file]) as urdf:
        scene = _load(arguments.file, arguments)
        with Progress("recognising constraints") as progress:
            document = mates.mates(scene, tolerance, progress=progress)
        emit({**document, "notes": list(scene.all_notes())})
        if not arguments.json:
            print(mates.table(document))
            _print_notes(scene)
        if urdf is not None:
            mates.write_urdf(scene, urdf, tolerance)
            print(f"wrote {urdf}", file=sys.stderr)
    return OK


def _view(arguments: argparse.Namespace) -> int:
    from vpframe.view.meshcat_viewer import view

    with _claimed(arguments, "html", PAGE, [arguments.file]) as page:
        scene = _load(arguments.file, arguments)
        _print_notes(scene)
        view(scene, static=page, host=arguments.host)
    return OK


def _replay(arguments: argparse.Namespace) -> int:
    from vpframe.view.replay import replay

    return replay(arguments.recording, script=arguments.script)


def _bench(arguments: argparse.Namespace) -> int:
    from vpframe.app import bench
    from vpframe.app.progress import Progress

    with _document(arguments.json) as emit:
        results = {}
        for suite in [arguments.suite] if arguments.suite else SUITES:
            module = bench.suite(suite)
            with Progress(f"benchmark {suite}"):
                results[suite] = module.run(quick=arguments.quick)
            if not arguments.json:
                print(module.table(results[suite]), end="\n\n")
            if arguments.plot:
                module.plot(results[suite], arguments.plot)
        emit(results[arguments.suite] if arguments.suite else {"suites": list(results.values())})
    return OK
