"""Options that several commands share: how they are declared, what they mean, and how results are printed."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from vpframe import console
from vpframe.scene.units import NAMES, length, seconds
from vpframe.text import plain

if TYPE_CHECKING:
    from collision import Tolerance
    from vpframe.scene.scene import Scene
    from vpframe.view.meshcat_viewer import MeshcatViewer

OK, NO, BAD, INTERRUPTED = 0, 1, 2, 130
"""exit codes: done, the answer is no, bad usage or input, Ctrl-C"""


class UsageError(Exception):
    """The command line is invalid; the message is printed."""


# ---- values


def metres(text: str) -> float:
    """Convert a length with unit to m."""
    try:
        return length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def positive_metres(text: str) -> float:
    """Convert a length with unit, more than 0, to m."""
    if not (value := metres(text)) > 0.0:
        raise argparse.ArgumentTypeError(f"length {text!r}: give more than 0")
    return value


def duration(text: str) -> float:
    """Convert "60s", "5min" or "90", more than 0, to seconds."""
    try:
        value = seconds(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"time {text!r}: give more than 0")
    return value


def degrees(text: str) -> float:
    """Convert degrees to radians."""
    return math.radians(float(text))


degrees.__name__ = "number of degrees"  # for argparse's message


# ---- groups of options


def add_force(sub: argparse.ArgumentParser) -> None:
    """Add `--force`."""
    sub.add_argument("--force", action="store_true", help="also replace files that vpframe did not write")


def add_view(sub: argparse.ArgumentParser) -> None:
    """Add `--view` and `--no-wait`; `viewer_of` returns what they mean."""
    text = "watch it in meshcat: waits for the first browser, shows the end until Ctrl-C"
    sub.add_argument("--view", action="store_true", help=text)
    sub.add_argument("--no-wait", dest="wait", action="store_false", help="with --view: do not wait for anybody")


def viewer_of(view: bool, wait: bool) -> MeshcatViewer | None:
    """Return the viewer of `--view`; None without it. wait: for the first browser."""
    if not view:
        return None
    from vpframe.view.meshcat_viewer import watched

    return watched(wait)


def add_run(sub: argparse.ArgumentParser) -> None:
    """Add the options of `vpframe run`."""
    add_view(sub)
    sub.add_argument("--record", metavar="RUN.rrd", help="write a rerun recording")
    sub.add_argument("--report", metavar="DIR", help="write report.json, a page with pictures, and the clashes as CSV")
    sub.add_argument("--access", action="store_true", help="a straight tool must reach what hands grab and turn")
    sub.add_argument("--checkpoint", metavar="FILE", help="save the progress of the run, once a second")
    sub.add_argument("--resume", action="store_true", help="continue from the checkpoint of an interrupted run")
    add_force(sub)


def add_press_fit(sub: argparse.ArgumentParser) -> None:
    """Add `--press-fit`; `press_fit` returns what it means."""
    sub.add_argument(
        "--press-fit", metavar="CLASS",
        help="ISO 286 class of the tightest shaft that may be pressed into a hole H, such as u8 (default: s7)",
    )  # fmt: skip


def press_fit(arguments: argparse.Namespace) -> Tolerance | None:
    """Return the tolerance of a class; None if none is given. Raises FitClassError for an unknown class."""
    if arguments.press_fit is None:
        return None
    from collision import Tolerance
    from constraints.recognition.iso286 import greatest_interference

    greatest_interference(arguments.press_fit, 0.01)  # a class that is not known is refused before models are read
    return Tolerance(press_fit=arguments.press_fit)


def add_model(sub: argparse.ArgumentParser, several: bool = False, json: bool = True) -> None:
    """Add the model (`several`: or models) that a command reads, how it is loaded, `--force` and `--json`."""
    if several:
        sub.add_argument(
            "files", metavar="FILE", nargs="+", help="models; several are put into one scene as they stand"
        )
    else:
        sub.add_argument("file", metavar="FILE")
    add_force(sub)
    if json:
        sub.add_argument("--json", action="store_true")
    sub.add_argument(
        "--rule", metavar="A:B=KIND", action="append", default=[],
        help="what the overlap of two parts is: thread, press fit, soft, glue or clash; A=KIND for one with any other, "
        "thread=clash for all of a kind; it comes before the rules in FILE.vpframe.toml beside the model",
    )  # fmt: skip
    sub.add_argument("--deflection", metavar="LENGTH", type=metres, help="greatest deflection of a triangle")
    sub.add_argument("--angular", metavar="DEGREES", type=degrees, help="greatest angle between neighbouring facets")
    sub.add_argument(
        "--timeout", metavar="SECONDS", type=float, help="limit of reading a CAD file (a minute a megabyte)"
    )
    sub.add_argument("--unit", metavar="UNIT", help="length unit of STL, OBJ and PLY files: " + NAMES)
    sub.add_argument(
        "--bodies", choices=("split", "whole"),
        help="make each solid a part, or each product (default: products in files with assemblies)",
    )  # fmt: skip


def loading(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the given options of `vp.load`."""
    given = {name: getattr(arguments, name) for name in ("deflection", "angular", "timeout", "unit", "bodies")}
    return {name: value for name, value in given.items() if value is not None}


# ---- models and results


def load(path: str | os.PathLike[str], **options: Any) -> Scene:
    """`vpframe.load` with a progress line."""
    from vpframe.importers import load as read

    with console.progress("loading " + os.path.basename(path)) as progress:
        return read(path, progress=progress, **options)


def scene_of(arguments: argparse.Namespace, *files: str) -> Scene:
    """Load the model of a command, several files as one scene; print its size on a terminal."""
    from vpframe.analysis.clash import merged
    from vpframe.scene.overlap_rules import parsed

    rules = parsed(arguments.rule)
    scenes = []
    for file in files:
        began = time.monotonic()
        scenes.append(load(file, **loading(arguments)))
        if sys.stderr.isatty():
            text = f"{os.path.basename(file)}: {scenes[-1].summary()}, {time.monotonic() - began:.1f} s"
            print(text, file=sys.stderr)
    scene = merged(scenes) if len(scenes) > 1 else scenes[0]
    scene.rules = (*rules, *scene.rules)
    return scene


@contextlib.contextmanager
def document(wanted: bool) -> Iterator[Callable[[Any], None]]:
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


def print_notes(scene: Scene) -> None:
    """Print losses, repairs and assumptions of the import."""
    for note in scene.all_notes():
        console.say(f"note: {note}")


def print_written(text: str, left: Iterable[str] = ()) -> None:
    """Print what was written, and the information that the format does not carry."""
    console.say(f"wrote {text}")
    for line in left:
        console.say(f"not carried: {plain(line)}")
