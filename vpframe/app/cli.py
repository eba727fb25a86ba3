"""The command line. Exit code 0: done, 1: the answer is no, 2: bad usage or input (one line on standard error)."""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NoReturn

from vpframe import __version__, console
from vpframe.app import disassemble, press_fit
from vpframe.app.progress import Terminal, say, warn
from vpframe.outputs import BCF, PAGE, SCRIPT, STATUS, URDF, Kind, Output
from vpframe.scene.units import NAMES, length, seconds
from vpframe.session.interrupts import handled
from vpframe.text import plain

OK, NO, BAD = 0, 1, 2
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""error codes of a full disk"""
_KERNELS = {
    "demo": "session",
    "run": "session",
    "new": "session",
    "clash": "clash",
    "disassemble": "disassemble",
    "mates": "mates",
    "export": "mates",
    "view": "session",
}
"""use in `vpframe.warm_up` of each command"""


class UsageError(Exception):
    """The command line is invalid; the message is printed."""


ACCEPT = "clash accept"
EXPORTS = (".step", ".stp", ".glb", ".urdf", ".mjcf", ".xml", ".usd", ".usda", ".usdc", ".csv", ".parquet")


_ERRORS = (
    ("collision.errors", "CollisionError"), ("constraints.errors", "ConstraintsError"),
    ("physics.errors", "PhysicsError"), ("vpframe.errors", "VpframeError"),
)  # fmt: skip
"""roots of the errors printed in one line, by module; a module that is not loaded has raised none"""
_LIBRARY = re.compile(r"(lib\S+\.so\S*): cannot open shared object file")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # set before numpy is imported: our matrices are small, and waiting threads slow down a busy machine
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # set before numba is imported: colorama would write an escape sequence at exit
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    try:
        words = list(sys.argv[1:] if argv is None else argv)
        if words[:2] == ACCEPT.split():  # argparse accepts no second word before a list of files
            words[:2] = [ACCEPT]
        arguments = _parser().parse_args(words)
        command: Callable[[argparse.Namespace], int] = arguments.command
        with handled(), console.installed(Terminal()):
            code = _helped(command, arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # the reader of standard output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        if isinstance(error, OSError) and error.errno in FULL and error.filename is None:
            # the rest of the output buffer would fail again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return _complain(f"what was found cannot be printed: {error.strerror}", BAD)
        if os.environ.get("VPFRAME_TRACEBACK"):
            raise
        return _complain(_one_line(error), BAD)


def _helped(command: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Run the command while other processes compile the kernels that it needs."""
    if arguments.kernels is None:
        return command(arguments)
    from vpframe import warm_up

    warm_up.start(arguments.kernels)
    code = command(arguments)
    if code in (OK, NO):
        warm_up.note_enough(arguments.kernels)
    return code


def _complain(text: str, code: int) -> int:
    warn(f"vpframe: {text}")
    return code


def _one_line(error: Exception) -> str:
    known = (UsageError, *(getattr(sys.modules[module], name) for module, name in _ERRORS if module in sys.modules))
    text = " ".join(str(error).split())
    if isinstance(error, known):
        return text
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, ImportError) and (library := _LIBRARY.match(text)):
        return f"{library[1]} is missing, a library of the system: install it (Debian: apt install libgl1 libgomp1)"
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
        sub.add_argument("--force", action="store_true", help="also replace files that vpframe did not write")

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
    sub.add_argument("--access", action="store_true", help="a straight tool must reach what hands grab and turn")
    sub.add_argument("--checkpoint", metavar="FILE", help="save the progress of the run, once a second")
    sub.add_argument("--resume", action="store_true", help="continue from the checkpoint of an interrupted run")
    add_force(sub)

    sub = add("new", _new, "write a first task script for the parts of a model")
    sub.add_argument("task", metavar="TASK.py")
    sub.add_argument("--from", dest="file", metavar="FILE", required=True, help="the model")
    sub.add_argument("--part", metavar="NAME", help="the part to take out (default: the first that comes out)")
    sub.add_argument(
        "--budget",
        metavar="TIME",
        type=_seconds,
        help="of searching what comes out before it, such as 5min (default: 60s)",
    )
    add_force(sub)

    sub = add("clash", _clash, "clash, press fit, contact, clearance, containment by pair of parts; exit 1 on a clash")
    sub.add_argument("files", metavar="FILE", nargs="+", help="models; several are put into one scene as they stand")
    sub.add_argument("--clearance", metavar="LENGTH", type=_length, default=0.0, help="also list pairs nearer than it")
    sub.add_argument("--authorise", metavar="A:B", action="append", default=[], help="a pair of parts meant to clash")
    press_fit.add_argument(sub)
    sub.add_argument(
        "--tolerance", metavar="LENGTH", type=_positive_length,
        help="surfaces nearer than it touch, and overlaps up to it are no clash (default: 10um)",
    )  # fmt: skip
    sub.add_argument("--status", metavar="FILE", help="keep what is new, accepted and resolved in this file, over runs")
    sub.add_argument("--bcf", metavar="OUT", help="write the clashes as BCF 3.0: a topic a pair, with view and picture")
    sub.add_argument("--table", metavar="OUT", help="write all pairs of surfaces as CSV or Parquet")
    sub.add_argument("--surfaces", action="store_true", help="list pairs of surfaces instead of pairs of parts")
    sub.add_argument("--contacts", action="store_true", help="list parts that only touch, too, instead of their count")
    add_force(sub)
    _add_loading(sub)
    sub.add_argument("--json", action="store_true")

    sub = add(ACCEPT, _accept, "accept clashes by name: the next runs of a task, or of `clash --status`, count them so")
    sub.add_argument("file", metavar="FILE", help="the file that clash --status wrote, or the folder of run --report")
    sub.add_argument("names", metavar="A:B", nargs="+", help="two parts, or with a surface of each: A:3:B:12")
    sub.add_argument("--remark", metavar="TEXT", default="", help="why they are accepted")
    sub.add_argument(
        "--authorise", action="store_true", help="the overlap as drawn is meant: it does not block along its fit's axis"
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

    sub = add(
        "export", _export, "write a model in another format, its parts where a recording has them; names what is lost"
    )
    sub.add_argument("files", metavar="FILE", nargs="+", help="models; several are put into one scene as they stand")
    sub.add_argument("--to", metavar="OUT", required=True, help=f"one of {', '.join(EXPORTS)}, by its ending")
    sub.add_argument(
        "--poses", metavar="RUN[@TIME]",
        help="a recording (.rrd) or table of poses (.csv, .parquet): its state at a time (run.rrd@12.5s); without one "
        "the motion where the format carries it, else its end",
    )  # fmt: skip
    add_force(sub)
    _add_loading(sub)
    sub.add_argument("--json", action="store_true")

    sub = add("disassemble", _disassemble, "which parts come out, in which order, along which way; exit 1 if one stays")
    disassemble.add_arguments(sub, _length)
    _add_loading(sub)

    sub = add("view", _view, "look at a model in the browser, and take its parts in hand")
    sub.add_argument("file", metavar="FILE")
    sub.add_argument("--html", metavar="OUT", help="write a self-contained page and end")
    sub.add_argument("--save", metavar="TASK.py", help="keep what is done at the page as a task script")
    add_force(sub)
    sub.add_argument("--host", default="127.0.0.1", help="address to serve on (default: this machine only)")
    _add_loading(sub)

    sub = add("replay", _replay, "open a recording in rerun")
    sub.add_argument("recording", metavar="RUN.rrd")
    sub.add_argument("--script", action="store_true", help="print the recorded events instead")
    sub.add_argument("--events", metavar="OUT", help="write the recorded events as CSV or Parquet instead")
    add_force(sub)

    sub = add("study", _study, "run a task over many variants: in how many it can be done, and which variables matter")
    sub.add_argument("task", metavar="TASK.py", help="a task script with VARIANTS, `scene(v)` and `task(session, v)`")
    which = sub.add_mutually_exclusive_group()
    which.add_argument("--samples", metavar="N", type=int, help="number of variants (default: 100)")
    which.add_argument(
        "--grid", metavar="LEVELS", type=int, nargs="?", const=5,
        help="all combinations, of each continuous variable so many values (5)",
    )  # fmt: skip
    sub.add_argument("--sobol", action="store_true", help="sample Sobol' sequences: steadier than chance")
    sub.add_argument("--seed", metavar="N", type=int, default=0, help="of the samples (default: 0)")
    sub.add_argument("--jobs", metavar="N", type=int, help="processes on this machine (default: one a core)")
    sub.add_argument("--cluster", metavar="ADDRESS", help="run on the workers of a Dask scheduler: tcp://HOST:8786")
    sub.add_argument("--retries", metavar="N", type=int, default=2, help="repetitions of a variant that crashed (2)")
    sub.add_argument("--timeout", metavar="TIME", type=_seconds, default=600.0, help="of one variant (600s)")
    sub.add_argument("--out", metavar="DIR", default="runs", help="where results and report go (default: runs)")
    sub.add_argument("--resume", action="store_true", help="run what is missing of the study in DIR")
    add_force(sub)
    sub.add_argument("--dashboard", action="store_true", help="Dask's dashboard, on this machine only (needs bokeh)")
    sub.add_argument("--json", action="store_true")

    sub = add("bench", _bench, "speed against error, side by side with named peers")
    sub.add_argument("suite", nargs="?", choices=SUITES, help="one suite (default: all)")
    sub.add_argument("--all", action="store_true", help="every suite, as without SUITE")
    sub.add_argument("--plot", metavar="DIR", help="draw the plots (needs matplotlib)")
    sub.add_argument("--html", metavar="PAGE", help="write tables, plots, machine and versions as one page")
    add_force(sub)
    sub.add_argument("--quick", action="store_true", help="fewer repetitions")
    sub.add_argument(
        "--only", metavar="TEXT", action="append", default=[],
        help="cases whose names contain it (load, planning, service); may be given again",
    )  # fmt: skip
    sub.add_argument("--corpus", metavar="DIR", help="files of a folder instead of the suite's own (load: STEP files)")
    sub.add_argument(
        "--number", metavar="WHAT=N", action="append", default=[],
        help="so many of what a suite counts (load: instances; planning: orientations, segments, sets; study: "
        "variants)",
    )  # fmt: skip
    sub.add_argument("--json", action="store_true")
    return parser


SUITES = ("collision", "constraints", "load", "physics", "planning", "service", "session", "study", "truth")


def _length(text: str) -> float:
    try:
        return length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _positive_length(text: str) -> float:
    if not (metres := _length(text)) > 0.0:
        raise argparse.ArgumentTypeError(f"length {text!r}: give more than 0")
    return metres


def _degrees(text: str) -> float:
    """Convert degrees to radians."""
    return math.radians(float(text))


_degrees.__name__ = "number of degrees"  # for argparse's message


def _seconds(text: str) -> float:
    try:
        return seconds(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _add_loading(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--deflection", metavar="LENGTH", type=_length, help="greatest deflection of a triangle")
    sub.add_argument("--angular", metavar="DEGREES", type=_degrees, help="greatest angle between neighbouring facets")
    sub.add_argument(
        "--timeout", metavar="SECONDS", type=float, help="limit of reading a CAD file (a minute a megabyte)"
    )
    sub.add_argument("--unit", metavar="UNIT", help="length unit of STL, OBJ and PLY files: " + NAMES)
    sub.add_argument(
        "--bodies", choices=("split", "whole"),
        help="make each solid a part, or each product (default: products in files with assemblies)",
    )  # fmt: skip


def _load(path: str, arguments: argparse.Namespace) -> Any:
    import vpframe as vp
    from vpframe.app.progress import Progress

    began = time.monotonic()
    with Progress("loading " + os.path.basename(path)) as progress:
        scene = vp.load(path, progress=progress, **_given(arguments))
    if sys.stderr.isatty():
        print(f"{os.path.basename(path)}: {scene.summary()}, {time.monotonic() - began:.1f} s", file=sys.stderr)
    return scene


def _given(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given options of `vp.load`."""
    given = {name: getattr(arguments, name) for name in ("deflection", "angular", "timeout", "unit", "bodies")}
    return {name: value for name, value in given.items() if value is not None}


@contextlib.contextmanager
def _claimed(arguments: argparse.Namespace, name: str, kind: Kind, inputs: Sequence[str]) -> Iterator[Output | None]:
    """Claim the file of an option before the work begins; None if the option was not given."""
    path = getattr(arguments, name)
    if path is None:
        yield None
        return
    with Output(path, kind, arguments.force, inputs) as output:
        yield output


@contextlib.contextmanager
def _document(wanted: bool) -> Iterator[Callable[[Any], None]]:
    """Yield a function that prints one JSON document; redirect all other output to standard error.

    The file descriptor is redirected because C++ libraries such as the CAD kernel write to it directly.
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
        # converts numpy scalars; NaN is not JSON
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
        access=arguments.access,
    )


def _new(arguments: argparse.Namespace) -> int:
    from vpframe.app import task_runner as study

    stops = study.new_task(arguments.task, arguments.file, arguments.force, arguments.part, arguments.budget)
    print(f"wrote {arguments.task}; run it with: vpframe run {arguments.task} --view")
    if stops:
        what = f"{arguments.part} was not" if arguments.part else "no part was"
        say(f"{what} taken out; the script only takes a part in hand, and says what was tried: {stops}")
    return OK


def _clash(arguments: argparse.Namespace) -> int:
    from collision import Tolerance
    from vpframe.analysis import clash
    from vpframe.analysis.bodies import overlap_notes
    from vpframe.app.progress import Progress

    tolerance = press_fit.tolerance(arguments.press_fit)
    if arguments.tolerance is not None:
        tolerance = replace(tolerance or Tolerance(), linear=arguments.tolerance)
    with (
        _document(arguments.json) as emit,
        _claimed(arguments, "status", STATUS, arguments.files) as status,
        _claimed(arguments, "bcf", BCF, arguments.files) as bcf,
    ):
        scene = clash.merged([_load(path, arguments) for path in arguments.files])
        authorised = clash.authorised_pairs(arguments.authorise, scene)
        with Progress("looking for clashes") as progress:
            found = clash.clash(scene, arguments.clearance, tolerance, authorised, progress)
        if status is not None:
            clash.with_status(found, status)
        scene.notes = (*scene.notes, *overlap_notes(scene, tolerance))
        emit(clash.document(found, notes=list(scene.all_notes())))
        if not arguments.json:
            print(clash.table(found, arguments.surfaces, arguments.contacts))
            _print_notes(scene)
        if bcf is not None:
            from vpframe.exporters.bcf import write_bcf

            with Progress("drawing the clashes") as progress:
                left = write_bcf(bcf, scene, found, progress=progress)
            _print_written(arguments.bcf, left)
        if arguments.table is not None:
            from vpframe.exporters.tables import clash_rows, write_table

            write_table(arguments.table, clash_rows(found), force=arguments.force)
            _print_written(arguments.table, ())
    return NO if any(map(clash.is_open, found["pairs"])) else OK


def _print_written(path: str, left: Sequence[str]) -> None:
    say(f"wrote {path}")
    for line in left:
        say(f"not carried: {plain(line)}")


def _print_notes(scene: Any) -> None:
    """Print losses, repairs and assumptions of the import."""
    from vpframe.app.progress import say

    for note in scene.all_notes():
        say(f"note: {note}")


def _accept(arguments: argparse.Namespace) -> int:
    from vpframe.analysis import clash_status

    keys = clash_status.accept_named(arguments.file, arguments.names, arguments.remark, arguments.authorise)
    for line in clash_status.accepted_words(keys):
        say(f"accepted: {line}")
    print(f"the next run with {arguments.file} counts them as accepted")
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
            for note in mates.write_urdf(scene, urdf, tolerance):
                warn(f"vpframe: note: {note}")
            print(f"wrote {urdf}", file=sys.stderr)
    return OK


def _export(arguments: argparse.Namespace) -> int:
    from vpframe.analysis import clash
    from vpframe.exporters.export import export, kind_of
    from vpframe.exporters.motion import read_motion

    source, time = _poses(arguments.poses)
    with _document(arguments.json) as emit:
        kind = kind_of(arguments.to)
        inputs = [*arguments.files, *([source] if source else [])]
        with Output(arguments.to, kind, arguments.force, inputs) as output:
            motion = read_motion(source) if source else None
            scene = clash.merged([_load(path, arguments) for path in arguments.files])
            left = export(scene, output, motion, time)
        emit({"written": arguments.to, "parts": len(scene), "left_out": list(left), "notes": list(scene.all_notes())})
        if not arguments.json:
            print(f"wrote {arguments.to}: {len(scene)} parts")
            _print_notes(scene)
            for line in left:
                say(f"not carried: {plain(line)}")
    return OK


def _poses(given: str | None) -> tuple[str | None, float | None]:
    """Split the argument of `--poses` into file and time (after the last @)."""
    if given is None:
        return None, None
    path, at, time = given.rpartition("@")
    if not at or os.path.exists(given):
        return given, None
    try:
        return path, seconds(time)
    except ValueError as error:
        raise UsageError(f"--poses {given}: {error}") from None


def _disassemble(arguments: argparse.Namespace) -> int:
    with _document(arguments.json) as emit:
        return disassemble.run(arguments, lambda path: _load(path, arguments), emit)


def _view(arguments: argparse.Namespace) -> int:
    from vpframe.app.workbench import Workbench
    from vpframe.view.meshcat_viewer import write_page
    from vpframe.view.screen import has_screen

    if arguments.html is not None and arguments.save is not None:
        raise UsageError("--save is for the live page; leave out --html")
    with (
        _claimed(arguments, "html", PAGE, [arguments.file]) as page,
        _claimed(arguments, "save", SCRIPT, [arguments.file]) as script,
    ):
        scene = _load(arguments.file, arguments)
        _print_notes(scene)
        if page is not None:
            write_page(scene, (), page.path)
            return OK
        bench = Workbench(scene, arguments.file, _given(arguments), script, arguments.host, open_browser=has_screen())
        print(f"{bench.viewer.url}  (Ctrl-C ends)", flush=True)
        if bench.viewer.outside:
            print(f"from other machines: {bench.viewer.outside}", flush=True)
        bench.run()
    return OK


def _replay(arguments: argparse.Namespace) -> int:
    from vpframe.view.replay import lines, replay

    if arguments.events is not None:
        from vpframe.exporters.tables import write_table

        columns = ("step", "time", "kind", "text")
        rows = ({name: getattr(line, name) for name in columns} for line in lines(arguments.recording))
        write_table(arguments.events, rows, columns, force=arguments.force)
        _print_written(arguments.events, ())
        return OK
    return replay(arguments.recording, script=arguments.script)


def _study(arguments: argparse.Namespace) -> int:
    from vpframe.studies import report
    from vpframe.studies.job import Machines
    from vpframe.studies.run import SAMPLES, Sampling, run_study

    if arguments.sobol and arguments.grid is not None:
        raise UsageError("--sobol is a way to sample; leave out --grid")
    if arguments.cluster is not None and (arguments.jobs is not None or arguments.dashboard):
        raise UsageError("--jobs and --dashboard are for this machine; leave out --cluster")
    samples = SAMPLES if arguments.samples is None else arguments.samples
    sampling = Sampling(samples, arguments.sobol, arguments.grid, arguments.seed)
    jobs = len(os.sched_getaffinity(0)) if arguments.jobs is None else arguments.jobs
    machines = Machines(jobs, arguments.cluster, arguments.dashboard)
    with _document(arguments.json) as emit:
        document, interrupted = run_study(
            arguments.task, arguments.out, sampling, machines, arguments.timeout, arguments.retries, arguments.resume,
            arguments.force,
        )  # fmt: skip
        emit(document)
        if not arguments.json:
            print(report.rate_text(document))
            if rest := report.rest_text(document):
                print(rest)
            for line in report.basis_lines(document):
                print(line)
            print(f"report: {os.path.join(arguments.out, 'index.html')}")
    if document["repeated"]["different"]:
        warn(f"variants {document['repeated']['different']} gave another answer when they were run again")
    if document["repeated"]["unanswered"]:
        warn(f"variants {document['repeated']['unanswered']} crashed or timed out when they were run again")
    if interrupted:
        warn("interrupted; what was finished is kept, --resume runs what is missing")
        return 130
    return OK if document["statuses"]["ok"] == document["variants"] else NO


def _bench(arguments: argparse.Namespace) -> int:
    from vpframe.app import bench, bench_page
    from vpframe.app.progress import Progress
    from vpframe.errors import VpframeError
    from vpframe.outputs import PAGE

    if arguments.all and arguments.suite:
        raise UsageError(f"--all is every suite; leave out {arguments.suite}")
    if (arguments.only or arguments.number or arguments.corpus) and not arguments.suite:
        raise UsageError("--only, --number and --corpus choose within one suite; name it")
    with _document(arguments.json) as emit, _claimed(arguments, "html", PAGE, []) as page:
        results: dict[str, bench_page.Result] = {}
        for suite in [arguments.suite] if arguments.suite else SUITES:
            try:
                module = bench.suite(suite)
                options = bench.options(suite, module, arguments.only, arguments.number, arguments.corpus)
                began = time.monotonic()
                with Progress(f"benchmark {suite}"):
                    found = module.run(quick=arguments.quick, **options)
                spent, text = time.monotonic() - began, module.table(found)
            except Exception as error:
                if arguments.suite:
                    raise
                known = isinstance(error, VpframeError | ImportError)
                results[suite] = str(error) if known else f"{type(error).__name__}: {error}"
                warn(f"vpframe: {suite}: {results[suite]}")  # continue with the other suites
            else:
                results[suite] = module, found, spent
                if not arguments.json:
                    print(text, end="\n\n", flush=True)
                if arguments.plot:
                    module.plot(found, arguments.plot)
            if page is not None:  # after each suite, so that an interrupted run keeps its results
                page.path.write_text(bench_page.page(results), encoding="utf-8")
        documents = [bench.finite(result[1]) for result in results.values() if not isinstance(result, str)]
        emit(documents[0] if arguments.suite else {"suites": documents})
        failed = len(documents) < len(results)
    return BAD if failed else OK
