"""The command line. Exit code 0: done, 1: the answer is no, 2: bad usage or input (one line on standard error)."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

from vpframe import __version__
from vpframe.app import commands, disassemble, options
from vpframe.app.commands import SUITES
from vpframe.app.exit_code import exit_code
from vpframe.app.options import NO, OK, UsageError, duration, metres, positive_metres

ACCEPT = "clash accept"
EXPORTS = (".step", ".stp", ".glb", ".urdf", ".mjcf", ".xml", ".usd", ".usda", ".usdc", ".csv", ".parquet")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # set before numpy is imported: our matrices are small, and waiting threads slow down a busy machine
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # set before numba is imported: colorama would write an escape sequence at exit
    os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    if words[:2] == ACCEPT.split():  # argparse accepts no second word before a list of files
        words[:2] = [ACCEPT]
    return exit_code(lambda: _helped(_parser().parse_args(words)), "vpframe: ")


def _helped(arguments: argparse.Namespace) -> int:
    """Run the command while other processes compile the kernels that it needs."""
    command: Callable[[argparse.Namespace], int] = arguments.command
    if arguments.kernels is None:
        return command(arguments)
    from vpframe import warm_up

    warm_up.start(arguments.kernels)
    code = command(arguments)
    if code in (OK, NO):
        warm_up.note_enough(arguments.kernels)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vpframe", description="Can the part be put in, taken out, serviced? Find out by script.")
    parser.add_argument("--version", action="version", version=f"vpframe {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    def add(name: str, text: str, kernels: str | None = None) -> argparse.ArgumentParser:
        """Add a command; kernels: its use in `vpframe.warm_up`."""
        sub = subparsers.add_parser(name, help=text, description=text)
        sub.set_defaults(command=getattr(commands, name.split()[-1]), kernels=kernels)
        return sub

    sub = add(
        "demo", "the main job on a bundled example: a stepped shaft into a bored housing and out again", "session"
    )
    sub.add_argument("--out", metavar="DIR", default="vpframe-demo", help="where model, recording and report go")
    options.add_view(sub)
    options.add_force(sub)

    sub = add("run", "run a task script", "session")
    sub.add_argument("task", metavar="TASK.py")
    options.add_run(sub)

    sub = add("new", "write a first task script for the parts of a model", "session")
    sub.add_argument("task", metavar="TASK.py")
    sub.add_argument("--from", dest="file", metavar="FILE", required=True, help="the model")
    sub.add_argument("--part", metavar="NAME", help="the part to take out (default: the first that comes out)")
    text = "of searching what comes out before it, such as 5min (default: 60s)"
    sub.add_argument("--budget", metavar="TIME", type=duration, help=text)
    options.add_force(sub)

    sub = add("clash", "clash, press fit, contact, clearance, containment by pair of parts; exit 1 on a clash", "clash")
    sub.add_argument("--clearance", metavar="LENGTH", type=metres, default=0.0, help="also list pairs nearer than it")
    sub.add_argument("--authorise", metavar="A:B", action="append", default=[], help="a pair of parts meant to clash")
    options.add_press_fit(sub)
    sub.add_argument(
        "--tolerance", metavar="LENGTH", type=positive_metres,
        help="surfaces nearer than it touch, and overlaps up to it are no clash (default: 10um)",
    )  # fmt: skip
    sub.add_argument("--as-drawn", action="store_true", help="overlaps that are meant count as clashes, too")
    sub.add_argument(
        "--write-rules", action="store_true", help="draft FILE.vpframe.toml beside the model: what overlaps mean"
    )
    sub.add_argument("--status", metavar="FILE", help="keep what is new, accepted and resolved in this file, over runs")
    sub.add_argument("--bcf", metavar="OUT", help="write the clashes as BCF 3.0: a topic a pair, with view and picture")
    sub.add_argument("--table", metavar="OUT", help="write all pairs of surfaces as CSV or Parquet")
    sub.add_argument("--surfaces", action="store_true", help="list pairs of surfaces instead of pairs of parts")
    sub.add_argument("--contacts", action="store_true", help="list parts that only touch, too, instead of their count")
    options.add_model(sub, several=True)

    sub = add(ACCEPT, "accept clashes by name: the next runs of a task, or of `clash --status`, count them so")
    sub.add_argument("file", metavar="FILE", help="the file that clash --status wrote, or the folder of run --report")
    sub.add_argument("names", metavar="A:B", nargs="+", help="two parts, or with a surface of each: A:3:B:12")
    sub.add_argument("--remark", metavar="TEXT", default="", help="why they are accepted")
    sub.add_argument(
        "--authorise", action="store_true", help="the overlap as drawn is meant: it does not block along its fit's axis"
    )

    sub = add("mates", "every constraint of an assembly as it stands, each part's joint and freedom", "mates")
    sub.add_argument("--urdf", metavar="OUT", help="write the mechanism as URDF")
    sub.add_argument(
        "--fit", metavar="LENGTH", type=metres,
        help="greatest radial clearance of a shaft in its bore (default: 0.25mm, or a tenth of its diameter up to 4mm)",
    )  # fmt: skip
    options.add_model(sub)

    sub = add(
        "export", "write a model in another format, its parts where a recording has them; names what is lost", "mates"
    )
    sub.add_argument("--to", metavar="OUT", required=True, help=f"one of {', '.join(EXPORTS)}, by its ending")
    sub.add_argument(
        "--poses", metavar="RUN[@TIME]",
        help="a recording (.rrd) or table of poses (.csv, .parquet): its state at a time (run.rrd@12.5s); without one "
        "the motion where the format carries it, else its end",
    )  # fmt: skip
    options.add_model(sub, several=True)

    sub = add(
        "disassemble", "which parts come out, in which order, along which way; exit 1 if one stays", "disassemble"
    )
    disassemble.add_arguments(sub)

    sub = add("view", "look at a model in the browser, and take its parts in hand", "session")
    sub.add_argument("--html", metavar="OUT", help="write a self-contained page and end")
    sub.add_argument("--save", metavar="TASK.py", help="keep what is done at the page as a task script")
    sub.add_argument("--host", default="127.0.0.1", help="address to serve on (default: this machine only)")
    options.add_model(sub, json=False)

    sub = add("replay", "open a recording in rerun")
    sub.add_argument("recording", metavar="RUN.rrd")
    sub.add_argument("--script", action="store_true", help="print the recorded events instead")
    sub.add_argument("--events", metavar="OUT", help="write the recorded events as CSV or Parquet instead")
    options.add_force(sub)

    sub = add("study", "run a task over many variants: in how many it can be done, and which variables matter")
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
    sub.add_argument("--timeout", metavar="TIME", type=duration, default=600.0, help="of one variant (600s)")
    sub.add_argument("--out", metavar="DIR", default="runs", help="where results and report go (default: runs)")
    sub.add_argument("--resume", action="store_true", help="run what is missing of the study in DIR")
    options.add_force(sub)
    sub.add_argument("--dashboard", action="store_true", help="Dask's dashboard, on this machine only (needs bokeh)")
    sub.add_argument("--json", action="store_true")

    sub = add("bench", "speed against error, side by side with named peers")
    sub.add_argument("suite", nargs="?", choices=SUITES, help="one suite (default: all)")
    sub.add_argument("--all", action="store_true", help="every suite, as without SUITE")
    sub.add_argument("--plot", metavar="DIR", help="draw the plots (needs matplotlib)")
    sub.add_argument("--html", metavar="PAGE", help="write tables, plots, machine and versions as one page")
    options.add_force(sub)
    sub.add_argument("--quick", action="store_true", help="fewer repetitions")
    sub.add_argument(
        "--only", metavar="TEXT", action="append", default=[],
        help="cases whose names contain it (load, planning, service); may be given again",
    )  # fmt: skip
    sub.add_argument(
        "--corpus", metavar="DIR", help="files of a folder instead of the suite's own (load, planning: STEP)"
    )
    sub.add_argument(
        "--number", metavar="WHAT=N", action="append", default=[],
        help="so many of what a suite counts (load: instances; planning: orientations, segments, sets; study: "
        "variants)",
    )  # fmt: skip
    sub.add_argument("--json", action="store_true")
    return parser
