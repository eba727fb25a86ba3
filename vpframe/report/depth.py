"""How deep clashing surfaces reach into one another, and where, asked of `collision` at some steps of each clash."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager
from vpframe.analysis.clash_status import ClashKey
from vpframe.app.progress import Progress
from vpframe.report.log import SessionLog
from vpframe.session.events import Frame


@dataclass(frozen=True, eq=False)
class Depth:
    """The deepest known moment of a clash."""

    depth: float
    """m, as `collision.query.penetration` defines it"""
    point: NDArray[np.float64]
    """(3,) world, m: the deepest point"""
    time: float
    """s"""


def depths(log: SessionLog, progress: Progress | None = None) -> dict[ClashKey, Depth]:
    """The greatest depth of each clash, of the steps that the log kept of it."""
    questions: dict[tuple[str, str, int], tuple[Frame, set[ClashKey]]] = {}
    for clash in log.clashes.values():
        for frame in clash.samples:
            question = questions.setdefault((clash.key.part_a, clash.key.part_b, frame.step), (frame, set()))
            question[1].add(clash.key)
    found: dict[ClashKey, Depth] = {}
    last: tuple[str, str, pin.SE3, pin.SE3] | None = None
    rows: NDArray[Any] | None = None
    for number, ((a, b, _), (frame, keys)) in enumerate(sorted(questions.items(), key=lambda item: item[0])):
        if progress is not None:
            progress(number / len(questions), f"depth of {a} and {b}")
        asked = (a, b, frame.poses[a], frame.poses[b])
        if rows is None or asked != last:  # parts that stood still reach as deep as before
            manager = CollisionManager()
            for name in (a, b):
                manager.add(log.scene[name].mesh, frame.poses[name])
            rows, last = manager.penetration(0, 1), asked
        for row in rows:
            key = ClashKey.of(a, int(row["surface_a"]), b, int(row["surface_b"]))
            if key in keys and (key not in found or row["depth"] > found[key].depth):
                found[key] = Depth(float(row["depth"]), np.array(row["point"]), frame.time)
    return found
