"""`write`: create the report folder from the data of a `SessionLog`."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collision import Tolerance
from constraints.geometry.surfaces import Plane
from vpframe import __version__, console, files
from vpframe.analysis import clash_status
from vpframe.analysis.clash_status import ClashKey, ClashRecord
from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.pairs import SurfacePair, by_parts
from vpframe.analysis.swept import SweptVolume
from vpframe.console import Progress
from vpframe.events import Frame
from vpframe.outputs import GENERATOR, MESH, REPORT_FILES, claimed_folder
from vpframe.report import page
from vpframe.report.depth import Depth, depths
from vpframe.report.origins import EARLIER, ORIGINS, TASK, origins
from vpframe.report.pictures import pair_picture, scene_picture
from vpframe.report.where import LeastGap, least_gap
from vpframe.scene.names import face_words
from vpframe.scene.scene import Scene
from vpframe.scene.stl import write_stl
from vpframe.session.log import SessionLog
from vpframe.text import csv_text
from vpframe.view.camera import frame_scene
from vpframe.view.meshcat_viewer import write_page
from vpframe.view.snapshot import png
from vpframe.view.symbols import SceneSymbol, gap_symbol, trail_symbol

CLASH_PICTURES = 24
MOMENT_PICTURES = 12
MILLIMETRES = 1e3
"""scale of STL files, which most readers take as millimetres"""
CSV_COLUMNS = (
    "status", "part_a", "surface_a", "part_b", "surface_b", "face_a", "face_b", "origin", "kind", "surface_pairs",
    "first_time_s", "last_time_s", "steps", "depth_m", "x_m", "y_m", "z_m", "remark", "runs",
)  # fmt: skip


@dataclass(frozen=True)
class Account:
    """What the report says of a run besides its log."""

    failure: str = ""
    """why the task cannot be done; empty if it has not failed"""
    undecided: str = ""
    """why the result is unknown; with neither, the task can be done"""
    complete: bool = True
    """whether the task ran to its end; only then the status of known clashes changes"""
    task: str = ""
    """name on the page; by default that of the model"""
    authorised: Sequence[tuple[str, str]] = ()
    """pairs of part names whose overlap as drawn is meant (press fits), for a list"""
    ignored: Sequence[tuple[str, str]] = ()
    """pairs of part names that may pass through each other: the verdict names them"""
    swept: Sequence[SweptVolume] = ()
    """swept volumes, written as STL"""
    tolerance: Tolerance | None = None
    """of the session, by which clashes are judged"""


def write(directory: str | os.PathLike[str], log: SessionLog, **account: Any) -> Path:
    """Write the report of `log` into `directory` (a path, or an `OutputFolder`) and return its path.

    account: fields of `Account`: failure, undecided, complete, task, authorised, ignored, swept, tolerance.

    Raises
    ------
    VpframeError: the folder cannot be written or is locked by another run, a file to be replaced was not written by an
        earlier report, or `clashes.json` cannot be read.
    """
    run = Account(**account)
    with claimed_folder(directory, REPORT_FILES) as folder:
        file = folder.file
        status = file(clash_status.FILE)
        meshes = [(volume, file(_stl_name(volume), MESH)) for volume in run.swept]
        known = clash_status.read_authorised(status)
        records = clash_status.updated(clash_status.read(status), log.clashes, run.complete)
        with console.progress("measuring clashes and clearance") as progress:
            found = depths(log, progress, run.tolerance)
            gap = least_gap(log)
        document = _document(log, run, records, found, gap)
        with console.progress("drawing the report") as progress:
            pictures = _pictures(log, document["clashes"], gap, progress)
        for volume, path in meshes:
            write_stl(path, volume.vertices, volume.triangles, MILLIMETRES, "vpframe swept volume, millimetres")
        files.replace(file("clashes.csv"), _csv(document["clashes"]))
        files.replace(file("report.json"), _json(document))
        left_out = log.uninvolved()
        shown = ((_without(frame, left_out), events) for frame, events in log.history)
        write_page(log.scene, shown, file("scene.html"), log.start)
        files.replace(file("index.html"), page.html(document, log, pictures))
        clash_status.write(status, records, known)  # last, when all else is written
    return folder.path


def _document(
    log: SessionLog, run: Account, records: Sequence[ClashRecord], found: dict[ClashKey, Depth], gap: LeastGap | None
) -> dict[str, Any]:
    least = log.least
    begun = origins(log, found)
    clashes = (ReportedClash.of(log, record, found.get(record.key), begun) for record in records)
    return {
        "generator": GENERATOR,
        "version": __version__,
        "task": run.task or (Path(log.scene.source).stem if log.scene.source else "session"),
        "model": log.scene.source,
        "parts": len(log.scene),
        "notes": list(log.scene.all_notes()),
        "verdict": "cannot be done" if run.failure else "not decided" if run.undecided else "can be done",
        "can_be_done": not run.failure and not run.undecided,
        "reason": run.failure or run.undecided,
        "duration": log.duration,
        "steps": log.steps,
        "stages": [_fields(stage, "text", "start", "end") for stage in log.stages],
        "events": [_fields(e, "step", "time", "kind", "parts", "surfaces", "text") for e in log.events],
        "clashes": _by_origin(clashes),
        "authorised": [list(pair) for pair in run.authorised],
        "ignored": [list(pair) for pair in run.ignored],
        "press_fits": [fit.document() for fit in log.press_fits],
        "clearance": None if least is None else _clearance(log.scene, least, gap),
        "freedom": {
            part: [{"time": t, "freedom": n, "joint": joint} for t, n, joint in changes]
            for part, changes in log.freedom.items()
        },
        "constraints": [
            {
                **_fields(mate, "id", "kind", "parts", "surfaces", "residual", "why"),
                "states": [{"state": state, "from": start, "to": end} for state, start, end in mate.spans],
            }
            for mate in log.mates.values()
        ],
        "timings": {
            name: {
                "median": float(np.median(list(values))),
                "p99": float(np.quantile(list(values), 0.99)),
                "total": log.totals[name],
            }
            for name, values in log.timings.items()
        },
        "swept": [
            {
                **_fields(volume, "part", "error"),
                "file": _stl_name(volume),
                "triangles": len(volume.triangles),
                "clashes": list(volume.clashes),
            }
            for volume in run.swept
        ],
    }


def _clearance(scene: Scene, least: Frame, gap: LeastGap | None) -> dict[str, Any]:
    """Return the entry of the step of least clearance."""
    places: dict[str, Any] = {"parts": None, "surfaces": None, "faces": None, "points": None}
    if gap is not None:
        faces = [face_words(scene[part], surface) for part, surface in zip(gap.parts, gap.surfaces, strict=True)]
        points = [point.tolist() for point in gap.points]
        places = {"parts": gap.parts, "surfaces": gap.surfaces, "faces": faces, "points": points}
    poses = {name: least.poses[name] for name in least.freedom if name in least.poses}
    return {
        "least": least.clearance,
        **_fields(least, "time", "step"),
        **places,
        "poses": {
            name: {"translation": pose.translation.tolist(), "rotation": pose.rotation.tolist()}
            for name, pose in poses.items()
        },
    }


def _fields(value: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def _by_origin(rows: Iterable[ReportedClash]) -> list[dict[str, Any]]:
    """Group surface pairs by origin and pair of parts, with the common times of their surface pairs."""
    pairs = [pair.document() for pair in by_parts(rows, lambda row: row.origin)]
    for pair in pairs:
        seen = [row for row in pair["surface_pairs"] if row["steps"]]
        if seen:
            pair["first_time"] = min(row["first_time"] for row in seen)
            pair["last_time"] = max(row["last_time"] for row in seen)
            pair["steps"] = max(row["steps"] for row in seen)
    return sorted(pairs, key=lambda pair: ORIGINS.index(pair["origin"]))


def _json(document: Mapping[str, Any]) -> str:
    """Format the document with one line for each field and list item; deeper indentation would take a second."""

    def text(value: Any) -> str:
        if isinstance(value, list) and value:
            return "[\n" + ",\n".join(f"    {json.dumps(item, allow_nan=False)}" for item in value) + "\n  ]"
        return json.dumps(value, allow_nan=False)

    fields = ",\n".join(f"  {json.dumps(name)}: {text(value)}" for name, value in document.items())
    return f"{{\n{fields}\n}}\n"


@dataclass(frozen=True)
class ReportedClash(SurfacePair):
    """A known clash, with what this run found of it: a row of the report; times in s, lengths in m."""

    origin: str
    kind: str
    status: str
    parts: tuple[str, str]
    surfaces: tuple[int, int]
    faces: tuple[str, ...]
    first_time: float | None
    last_time: float | None
    steps: int
    depth: float | None
    deepest_time: float | None
    point: list[float] | None
    remark: str
    runs: int
    planes: int = 0
    """number of plane faces"""
    distance: float = 0.0

    @staticmethod
    def of(log: SessionLog, record: ClashRecord, found: Depth | None, begun: Mapping[ClashKey, str]) -> ReportedClash:
        """Return the row of a known clash. begun: origins of the clashes of this run."""
        key, seen = record.key, log.clashes.get(record.key)
        parts, surfaces = (key.part_a, key.part_b), (key.surface_a, key.surface_b)
        ends = [(log.scene.get(part), surface) for part, surface in zip(parts, surfaces, strict=True)]
        faces = tuple(f"face {surface}" if part is None else face_words(part, surface) for part, surface in ends)
        known = [part.surfaces[s].geometry for part, s in ends if part is not None and 0 <= s < len(part.surfaces)]
        return ReportedClash(
            begun.get(key, EARLIER), found.kind if found else "contact", record.status, parts, surfaces, faces,
            seen.first.time if seen else None, seen.last_time if seen else None, seen.steps if seen else 0,
            found.depth if found else None, found.time if found else None, found.point.tolist() if found else None,
            record.remark, record.runs, sum(isinstance(g, Plane) for g in known),
        )  # fmt: skip

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {name: value for name, value in vars(self).items() if name not in ("planes", "distance")}


def _pictures(
    log: SessionLog, clashes: Sequence[dict[str, Any]], gap: LeastGap | None, progress: Progress
) -> dict[Any, bytes]:
    """Return PNG data by content: (origin, part, part) for a pair, number of a moment, "end", or "least".

    Initially touching parts have none. Pictures of the scene mark surfaces that collide because of the task, and show
    constraints that changed or belong to a held part.
    """
    camera = frame_scene(log.scene, log.start, *(frame.poses for frame, _ in log.history.sample(40)))
    seen = [pair for pair in clashes if pair["origin"] != EARLIER]
    shown = [p for p in seen if p["kind"] in BAD_KINDS or p["origin"] == TASK][:CLASH_PICTURES]
    moments = log.moments[:MOMENT_PICTURES]
    total = len(shown) + len(moments) + 2
    left_out = log.uninvolved(0)
    caused = {
        ClashKey(*row["parts"], *row["surfaces"]) for p in seen if p["origin"] == TASK for row in p["surface_pairs"]
    }
    drawn: dict[Any, bytes] = {}
    for number, pair in enumerate(shown):
        progress(number / total, "clashes")
        key = ClashKey(*pair["parts"], *pair["surfaces"])
        marked = [
            (part, surface)
            for row in pair["surface_pairs"]
            for part, surface in zip(row["parts"], row["surfaces"], strict=True)
        ]
        clash = log.clashes[key]
        at = next((frame for frame in clash.samples if frame.time == pair["deepest_time"]), clash.first)
        faces = list(zip(pair["parts"], pair["surfaces"], strict=True))
        drawn[pair["origin"], *pair["parts"]] = png(pair_picture(log.scene, at, faces, marked))
    steps: dict[int, bytes] = {}
    for number, (_, frame) in enumerate(moments):
        progress((len(shown) + number) / total, "what happened")
        if frame.step not in steps:
            steps[frame.step] = png(
                scene_picture(log.scene, _without(frame, left_out), camera, marked=_colliding(log, frame, caused))
            )
        drawn[number] = steps[frame.step]
    marks = {"end": _trails(log), "least": [gap_symbol(*gap.points, camera.radius)] if gap else []}
    for name, last in (("end", log.history.last), ("least", log.least)):
        if last is not None:
            red = _colliding(log, last, caused)
            drawn[name] = png(scene_picture(log.scene, _without(last, left_out), camera, (640, 480), marks[name], red))
    return drawn


def _colliding(log: SessionLog, frame: Frame, keys: Set[ClashKey]) -> list[tuple[str, int]]:
    """Return the colliding surfaces of a step, for the given clashes."""
    names = log.scene.names
    rows = [(names[a], s, names[b], t) for a, s, b, t in frame.colliding.tolist()] if keys else []
    return [face for a, s, b, t in rows if ClashKey.of(a, s, b, t) in keys for face in ((a, s), (b, t))]


def _without(frame: Frame, left_out: frozenset[int]) -> Frame:
    """Return the frame without some constraints."""
    if not left_out:
        return frame
    return dataclasses.replace(frame, constraints=tuple(view for view in frame.constraints if view.id not in left_out))


def _trails(log: SessionLog) -> list[SceneSymbol]:
    """Return the paths of the hands."""
    places: dict[str, list[Any]] = {}
    for frame, _ in log.history:
        for name, pose in frame.hands.items():
            places.setdefault(name, []).append(pose.translation)
    return [trail_symbol(name, points) for name, points in places.items() if len(points) > 1]


def _csv(clashes: Sequence[dict[str, Any]]) -> str:
    rows: list[list[Any]] = [list(CSV_COLUMNS)]
    for clash in clashes:
        (part_a, part_b), (surface_a, surface_b) = clash["parts"], clash["surfaces"]
        rows.append(
            [
                clash["status"], part_a, surface_a, part_b, surface_b, *clash["faces"], clash["origin"], clash["kind"],
                clash["count"], clash["first_time"], clash["last_time"], clash["steps"], clash["depth"],
                *(clash["point"] or (None, None, None)), clash["remark"], clash["runs"],
            ]
        )  # fmt: skip
    return csv_text(rows)


def _stl_name(volume: SweptVolume) -> str:
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in volume.part)
    return f"swept_{safe}.stl"
