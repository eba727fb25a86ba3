"""Penetration depth of clashing surfaces, computed at some steps of each clash."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from vpframe.analysis.clash_status import ClashKey
from vpframe.console import Progress
from vpframe.events import Frame
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene, Shape
from vpframe.session.log import SessionLog


@dataclass(frozen=True, eq=False)
class Depth:
    """The deepest penetration of a clash."""

    depth: float
    """penetration depth, m, as in `collision.query.penetration`"""
    point: NDArray[np.float64]
    """(3,) world, m: deepest point"""
    time: float
    """s"""
    first: float = 0.0
    """depth at the first of the steps, m"""
    slack: float = 0.0
    """uncertainty of the depth, m: deflections of the two surfaces and linear tolerance"""

    @property
    def clashes(self) -> bool:
        """Whether the depth exceeds that of a contact."""
        return self.depth > self.slack


def depths(log: SessionLog, progress: Progress | None = None) -> dict[ClashKey, Depth]:
    """Return the greatest depth of each clash over the steps that the log kept."""
    questions: dict[tuple[str, str, int], tuple[Frame, set[ClashKey]]] = {}
    for clash in log.clashes.values():
        for frame in clash.samples:
            question = questions.setdefault((clash.key.part_a, clash.key.part_b, frame.step), (frame, set()))
            question[1].add(clash.key)
    found: dict[ClashKey, Depth] = {}
    first: dict[ClashKey, float] = {}
    linear, sags = Tolerance().linear, Deflections()
    last: tuple[str, str, pin.SE3, pin.SE3] | None = None
    rows: NDArray[Any] | None = None
    for number, ((a, b, _), (frame, keys)) in enumerate(sorted(questions.items(), key=lambda item: item[0])):
        if progress is not None:
            progress(number / len(questions), f"depth of {a} and {b}")
        asked = (a, b, frame.poses[a], frame.poses[b])
        if rows is None or asked != last:  # same relative pose, same depth
            manager = CollisionManager()
            for name in (a, b):
                manager.add(log.scene[name].mesh, frame.poses[name])
            rows, last = manager.penetration(0, 1), asked
        for row in rows:
            key = ClashKey.of(a, int(row["surface_a"]), b, int(row["surface_b"]))
            if key not in keys:
                continue
            depth = float(row["depth"])
            first.setdefault(key, depth)
            if key not in found or depth > found[key].depth:
                slack = linear + (sags.of(log.scene, key) if depth > linear else 0.0)
                found[key] = Depth(depth, np.array(row["point"]), frame.time, first[key], slack)
    return found


class Deflections:
    """Deflections of surfaces, computed once for each shape."""

    def __init__(self) -> None:
        self._of: dict[Shape, NDArray[np.float64]] = {}

    def of(self, scene: Scene, key: ClashKey) -> float:
        """Sum of the deflections of both surfaces, m."""
        total = 0.0
        for name, surface in ((key.part_a, key.surface_a), (key.part_b, key.surface_b)):
            shape = scene[name].shape
            if shape not in self._of:
                self._of[shape] = deflections(shape)
            of = self._of[shape]
            total += float(of[surface]) if surface < len(of) else 0.0  # a shape may be a mesh without faces
        return total
