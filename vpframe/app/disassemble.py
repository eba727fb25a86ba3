"""`vpframe disassemble FILE`: removable parts, their order and paths; `--part X`: what must be removed before X."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from vpframe import console, files
from vpframe.app import options
from vpframe.app.options import INTERRUPTED
from vpframe.errors import VpframeError
from vpframe.outputs import PAGE, RECORDING, REPORT, SCRIPT, Claims, Kind, Output, OutputFolder
from vpframe.scene.units import length

PLAN = "plan.json"
TERMINATED = 143
HEADER = b"t,x,y,z,qx,qy,qz,qw\n0.0,"


def _is_track(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(HEADER)) == HEADER


TRACK = Kind("a track", _is_track)


def add_arguments(sub: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    sub.add_argument("--part", metavar="X", help="take out this part or subassembly only: the fewest removals")
    sub.add_argument(
        "--base", metavar="P", action="append", default=[], help="a part that stays (default: the largest)"
    )
    sub.add_argument("--carry", metavar="A,B", action="append", default=[], help="parts that come out as one")
    sub.add_argument(
        "--authorise", metavar="A:B", action="append", default=[], help="parts whose overlap as drawn is meant"
    )
    sub.add_argument(
        "--ignore", metavar="A:B", action="append", default=[], help="parts that may pass through each other (a cable)"
    )
    sub.add_argument(
        "--thread", metavar="A=PITCH", action="append", default=[],
        help="a part whose snug fits are threads drawn without them, and metres a turn with a unit: nut=1.25mm",
    )  # fmt: skip
    options.add_press_fit(sub)
    sub.add_argument("--clearance", metavar="LENGTH", type=options.metres, default=0.0, help="kept all the way")
    sub.add_argument(
        "--motion", choices=("straight", "mates", "free"), default="free",
        help="straight ways alone; threads and pushes, too; six freedoms, too (default)",
    )  # fmt: skip
    sub.add_argument(
        "--budget", metavar="TIME", type=options.duration,
        help="60s, 5min: 500 questions a second, and at most as much processor time after the analysis (default: "
        "2.5s a part, from 60s to 300s)",
    )  # fmt: skip
    sub.add_argument("--seed", metavar="N", type=int, default=0, help="of the sampling")
    sub.add_argument("--jobs", metavar="N", type=int, default=1, help="processes; the plan is the same for any number")
    sub.add_argument("--tracks", metavar="DIR", help=f"write each part's way as CSV, and {PLAN}")
    sub.add_argument("--task", metavar="OUT.py", help="write a task script that does it")
    sub.add_argument("--record", metavar="RUN.rrd", help="write a rerun recording of a hand that does it")
    options.add_view(sub)
    sub.add_argument("--report", metavar="DIR", help=f"write a page with pictures, and {PLAN}")
    sub.add_argument("--resume", action="store_true", help=f"go on from the ways in {PLAN} of --tracks or --report")
    options.add_model(sub)


def run(arguments: argparse.Namespace, emit: Callable[[Any], None]) -> int:
    """Plan, write the requested outputs and print the result; return 0 if all requested parts can be removed, else 1.

    Ctrl-C and SIGTERM end the search; what was found until then is written and printed, and 130 or 143 is returned.

    emit: receives the JSON document.
    """
    from vpframe.analysis.clash import authorised_pairs
    from vpframe.planning import document, plan
    from vpframe.planning.assembly import LINEAR
    from vpframe.scene.subassembly import listed

    authorised, ignored = authorised_pairs(arguments.authorise), authorised_pairs(arguments.ignore)
    tolerance = options.press_fit(arguments)
    threads = dict(_thread(text) for text in arguments.thread)
    carry = [_names(text) for text in arguments.carry]
    if arguments.resume and not (arguments.tracks or arguments.report):
        raise VpframeError("--resume goes on from a plan; name its folder with --tracks or --report")
    with Claims(arguments.force, arguments.file) as claims:
        tracks = claims.folder(arguments.tracks, {PLAN: REPORT})
        report = claims.folder(arguments.report, {PLAN: REPORT, "index.html": PAGE})
        record, task = claims.file(arguments.record, RECORDING), claims.file(arguments.task, SCRIPT)
        known = _known(document, tracks, report) if arguments.resume else ()
        scene = options.scene_of(arguments, arguments.file)
        with _sigterm_interrupts() as terminated, console.progress("taking apart") as progress:
            found = plan.disassembly(
                scene, arguments.part, base=arguments.base, carry=carry, authorise=authorised, ignore=ignored,
                threads=threads, clearance=arguments.clearance, motion=arguments.motion, budget=arguments.budget,
                seed=arguments.seed, jobs=arguments.jobs, tolerance=tolerance, known=known, progress=progress,
                found=lambda parts, text: progress(None, f"{listed(parts)}: {text}"),
            )  # fmt: skip
        names = document.track_files(found)
        written = {name: names[name] for name in names} if tracks is not None else {}
        answer = document.document(found, arguments.seed, LINEAR, written)
        answer["budget"]["spent"] = found.seconds
        answer["notes"] = list(scene.all_notes())
        text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
        if tracks is not None:
            _write_tracks(tracks, found, names)
            files.replace(tracks.file(PLAN), text)
        if report is not None:
            from vpframe.report import plan_page

            with console.progress("drawing") as progress:
                files.replace(
                    report.file("index.html"), plan_page.html(found, scene, Path(arguments.file).name, progress)
                )
            files.replace(report.file(PLAN), text)
        if task is not None:
            _write_task(task, tracks, found, names, arguments.file, arguments.force)
        viewer = options.viewer_of(arguments.view, arguments.wait)
        if record is not None or viewer is not None:
            _perform(scene, found, record, viewer)
        emit(answer)
        if not arguments.json:
            console.say(document.table(found))
            options.print_notes(scene)
        if viewer is not None and arguments.wait and not found.interrupted:
            viewer.stay()
    if found.interrupted:
        return TERMINATED if terminated else INTERRUPTED
    return 0 if found else 1


@contextlib.contextmanager
def _sigterm_interrupts() -> Iterator[list[int]]:
    """Interrupt the block by SIGTERM as by Ctrl-C; yield a list that is not empty once that happened.

    Raises SystemExit with 143 where the block has no answer to it.
    """
    from vpframe.session.interrupts import at_once

    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():  # signals are handled in the main thread only
        yield came
        return

    def interrupt(number: int, frame: Any) -> None:
        came.append(number)
        at_once(number, frame)

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield came
    except KeyboardInterrupt:
        if not came:
            raise
        console.warn("vpframe: terminated")
        raise SystemExit(TERMINATED) from None
    finally:
        signal.signal(signal.SIGTERM, before)


def _names(text: str) -> tuple[str, ...]:
    names = tuple(filter(None, (name.strip() for name in text.split(","))))
    if len(names) < 2:
        raise VpframeError(f"--carry {text}: name two parts or more, with commas between them")
    return names


def _thread(text: str) -> tuple[str, float]:
    name, sign, pitch = text.rpartition("=")
    try:
        if not (name and sign):
            raise ValueError("write it as PART=PITCH")
        return name, (-1.0 if pitch.startswith("-") else 1.0) * length(pitch.removeprefix("-"))
    except ValueError as error:
        raise VpframeError(f"--thread {text}: {error}") from None


def _known(document: Any, *folders: OutputFolder | None) -> Any:
    for folder in folders:
        if folder is not None and (Path(folder) / PLAN).exists():
            path = Path(folder) / PLAN
            try:
                return document.known_ways(path.read_text(encoding="utf-8"), str(path))
            except UnicodeDecodeError as error:
                raise VpframeError(f"{path}: is not text ({error}); leave out --resume") from None
    return ()


def _write_tracks(folder: OutputFolder, found: Any, names: dict[str, str]) -> None:
    for step in found.steps:
        for name, track in step.tracks.items():
            files.replace(folder.file(names[name], TRACK), track.text())


def _write_task(
    task: Output, tracks: OutputFolder | None, found: Any, names: dict[str, str], model: str, force: bool
) -> None:
    """Write the script; its tracks go to the folder of --tracks, or to a folder beside the script."""
    from vpframe.planning import document

    beside = task.path.parent.resolve()
    folder = tracks
    curved = [step for step in found.steps if step.motion != "straight"]
    if folder is None and curved:
        with OutputFolder(task.path.with_name(task.path.stem + "_tracks"), {}, force) as folder:
            _write_tracks(folder, found, names)
    where = "." if folder is None else os.path.relpath(Path(folder).resolve(), beside)
    relative = os.path.relpath(Path(model).resolve(), beside)
    files.replace(task.path, document.script(found, Path(relative).as_posix(), Path(where).as_posix(), names))


def _perform(scene: Any, found: Any, record: Output | None, viewer: Any) -> None:
    """Perform the plan with a hand on a copy of the scene, for a recording, a viewer or both."""
    from vpframe.planning.replay import perform, rule_of
    from vpframe.session.session import Session

    words = "recording" if viewer is None else "a hand does it"
    kept = {"rule": rule_of(found), "tolerance": found.tolerance}
    with console.progress(words), Session(scene.copy(), viewer=viewer, record=record, **kept) as session:
        perform(session, found)
        session.conclude()
