"""The command line. Exit 0 done, 1 the answer is no, 2 bad usage or bad input (one line on standard error)."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from vpframe import __version__
from vpframe.interrupts import handled
from vpframe.progress import warn
from vpframe.units import length

OK, NO, BAD = 0, 1, 2


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
            return command(arguments)
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # the reader of our output has gone: not our fault, and nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        if os.environ.get("VPFRAME_TRACEBACK"):
            raise
        return _complain(_one_line(error), BAD)


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
        sub.set_defaults(command=command)
        return sub

    sub = add("demo", _demo, "the main job on a bundled example: a stepped shaft into a bored housing and out again")
    sub.add_argument("--out", metavar="DIR", default="vpframe-demo", help="where model, recording and report go")
    sub.add_argument("--view", action="store_true", help="watch it in meshcat while it runs")

    sub = add("run", _run, "run a task script")
    sub.add_argument("task", metavar="TASK.py")
    sub.add_argument("--view", action="store_true", help="watch it in meshcat while it runs")
    sub.add_argument("--record", metavar="RUN.rrd", help="write a rerun recording")
    sub.add_argument("--report", metavar="DIR", help="write report.json, a page with pictures, and the clashes as CSV")
    sub.add_argument("--checkpoint", metavar="FILE", help="save where the run is, once a second")
    sub.add_argument("--resume", action="store_true", help="go on from the checkpoint of a run that was cut off")

    sub = add("new", _new, "write a first task script for the parts of a model")
    sub.add_argument("task", metavar="TASK.py")
    sub.add_argument("--from", dest="file", metavar="FILE", required=True, help="the model")

    sub = add("clash", _clash, "clash, contact, clearance and containment by surface pair; exit 1 if there is a clash")
    sub.add_argument("files", metavar="FILE", nargs="+", help="models; several are put into one scene as they stand")
    sub.add_argument("--clearance", metavar="LENGTH", type=_length, default=0.0, help="also list pairs nearer than it")
    sub.add_argument("--authorise", metavar="A:B", action="append", default=[], help="a pair of parts meant to clash")
    sub.add_argument("--status", metavar="FILE", help="keep what is new, accepted and resolved in this file, over runs")
    sub.add_argument("--accept", metavar="A:B", action="append", default=[], help="accept the clashes of two parts")
    sub.add_argument("--remark", metavar="TEXT", default="", help="why they are accepted")
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
    _add_loading(sub)
    sub.add_argument("--json", action="store_true")

    sub = add("view", _view, "look at a model in meshcat")
    sub.add_argument("file", metavar="FILE")
    sub.add_argument("--html", metavar="OUT", help="write a self-contained page and end")
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


SUITES = ("collision", "constraints", "physics")


def _length(text: str) -> float:
    try:
        return length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _add_loading(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--deflection", metavar="LENGTH", type=_length, help="greatest sag of a triangle")
    sub.add_argument("--angular", metavar="RADIANS", type=float, help="greatest angle between neighbouring facets")
    sub.add_argument("--unit", metavar="UNIT", help="length unit of STL, OBJ and PLY files: m, cm, mm, um, in, ft")


def _load(path: str, arguments: argparse.Namespace) -> Any:
    import vpframe as vp
    from vpframe.progress import Progress

    given = {name: getattr(arguments, name) for name in ("deflection", "angular", "unit")}
    with Progress("loading " + os.path.basename(path), uses=["load"]) as progress:
        return vp.load(path, progress=progress, **{name: value for name, value in given.items() if value is not None})


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
    from vpframe import demo

    return demo.run(arguments.out, view=arguments.view)


def _run(arguments: argparse.Namespace) -> int:
    from vpframe import study

    return study.run_task(
        arguments.task,
        view=arguments.view,
        record=arguments.record,
        report=arguments.report,
        checkpoint=arguments.checkpoint,
        resume=arguments.resume,
    )


def _new(arguments: argparse.Namespace) -> int:
    from vpframe import study

    stops = study.new_task(arguments.task, arguments.file)
    print(f"wrote {arguments.task}; run it with: vpframe run {arguments.task} --view")
    if stops:
        print(f"no part came out by itself; as written it stops: {stops}")
    return OK


def _clash(arguments: argparse.Namespace) -> int:
    from vpframe import clash
    from vpframe.progress import Progress

    if arguments.accept and arguments.status is None:
        raise UsageError("--accept needs --status FILE, where it is kept")
    with _document(arguments.json) as emit:
        scene = clash.merged([_load(path, arguments) for path in arguments.files])
        authorised = clash.authorised_pairs(arguments.authorise)
        with Progress("looking for clashes", uses=["clash"]) as progress:
            document = clash.clash(scene, arguments.clearance, authorised=authorised, progress=progress)
        if arguments.status is not None:
            clash.with_status(document, arguments.status, arguments.accept, arguments.remark)
        emit(document)
        if not arguments.json:
            print(clash.table(document))
        for note in scene.notes:
            print(f"note: {note}", file=sys.stderr)
    return NO if any(map(clash.is_open, document["pairs"])) else OK


def _accept(arguments: argparse.Namespace) -> int:
    from vpframe import clash_status

    keys = clash_status.accept_named(arguments.report, arguments.names, arguments.remark, arguments.authorise)
    for key in keys:
        print(f"accepted: {key.part_a} surface {key.surface_a} with {key.part_b} surface {key.surface_b}")
    print("the next run with this report folder counts them as accepted")
    return OK


def _mates(arguments: argparse.Namespace) -> int:
    from vpframe import mates
    from vpframe.progress import Progress

    with _document(arguments.json) as emit:
        scene = _load(arguments.file, arguments)
        with Progress("recognising constraints", uses=["mates"]) as progress:
            document = mates.mates(scene, progress=progress)
        emit(document)
        if not arguments.json:
            print(mates.table(document))
        for note in scene.notes:
            print(f"note: {note}", file=sys.stderr)
        if arguments.urdf:
            mates.write_urdf(scene, arguments.urdf)
            print(f"wrote {arguments.urdf}", file=sys.stderr)
    return OK


def _view(arguments: argparse.Namespace) -> int:
    from vpframe.visualization.meshcat_viewer import view

    view(_load(arguments.file, arguments), static=arguments.html, host=arguments.host)
    return OK


def _replay(arguments: argparse.Namespace) -> int:
    from vpframe.visualization.replay import replay

    return replay(arguments.recording, script=arguments.script)


def _bench(arguments: argparse.Namespace) -> int:
    from vpframe import bench
    from vpframe.progress import Progress

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
