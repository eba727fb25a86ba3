"""Penetration depth of clashing surfaces, computed at some steps of each clash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from vpframe.analysis.clash import KINDS, between
from vpframe.analysis.clash_status import ClashKey
from vpframe.analysis.fits import BAD_KINDS
from vpframe.console import Progress
from vpframe.events import Frame
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene
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
    kind: str = "contact"
    """as `vpframe.analysis.clash` has it: "clash", "press fit", "thread", "contact", …; the gravest one found"""

    @property
    def clashes(self) -> bool:
        """Whether it is more than a contact, a thread or a press fit."""
        return self.kind in BAD_KINDS


def depths(
    log: SessionLog, progress: Progress | None = None, tolerance: Tolerance | None = None
) -> dict[ClashKey, Depth]:
    """Return the greatest depth of each clash over the steps that the log kept, and its kind by `clash`."""
    questions: dict[tuple[str, str, int], tuple[Frame, set[ClashKey]]] = {}
    for clash in log.clashes.values():
        for frame in clash.samples:
            question = questions.setdefault((clash.key.part_a, clash.key.part_b, frame.step), (frame, set()))
            question[1].add(clash.key)
    found: dict[ClashKey, Depth] = {}
    first: dict[ClashKey, float] = {}
    linear = (tolerance or Tolerance()).linear
    last: tuple[str, str, pin.SE3, pin.SE3] | None = None
    rows: Mapping[tuple[int, ...], Row] = {}
    for number, ((a, b, _), (frame, keys)) in enumerate(sorted(questions.items(), key=lambda item: item[0])):
        if progress is not None:
            progress(number / len(questions), f"depth of {a} and {b}")
        placed = (a, b, frame.poses[a], frame.poses[b])
        if placed != last:  # same relative pose, same depth
            rows, last = _rows(log.scene, (a, b), placed[2:], tolerance), placed
        for key in sorted(keys):
            if (key.surface_a, key.surface_b) not in rows:
                continue
            kind, depth, point = rows[key.surface_a, key.surface_b]
            first.setdefault(key, depth)
            slack = linear + (_deflections(log.scene, key) if depth > linear else 0.0)
            kind = kind or ("clash" if depth > slack else "contact")
            known = found.get(key)
            if known is not None:
                kind = min(kind, known.kind, key=KINDS.index)
            if known is None or depth > known.depth:
                found[key] = Depth(depth, point, frame.time, first[key], slack, kind)
            elif kind != known.kind:
                found[key] = replace(known, kind=kind)
    return found


Row = tuple[str, float, NDArray[np.float64]]
"""kind, empty if it is not known, depth (m), and deepest point (3,), world, m"""


def _rows(
    scene: Scene, names: tuple[str, str], poses: tuple[pin.SE3, pin.SE3], tolerance: Tolerance | None
) -> dict[tuple[int, ...], Row]:
    """What two parts are to each other, by their surfaces; of meshes without faces the depths alone."""
    first, second = (scene[name] for name in names)
    if all(len(part.surfaces) == part.mesh.n_surfaces for part in (first, second)):
        judged = between(first, second, poses, tolerance, scene.rules)
        return {s: (row.kind, row.depth, np.array(row.point)) for s, row in judged.items()}
    manager = CollisionManager()
    for part, pose in zip((first, second), poses, strict=True):
        manager.add(part.mesh, pose)
    deep = manager.penetration(0, 1)
    return {
        (int(row["surface_a"]), int(row["surface_b"])): ("", float(row["depth"]), np.array(row["point"]))
        for row in deep
    }


def _deflections(scene: Scene, key: ClashKey) -> float:
    """Sum of the deflections of both surfaces, m; 0 for those of a mesh without faces."""
    ends = ((key.part_a, key.surface_a), (key.part_b, key.surface_b))
    return float(sum(deflections(scene[name].shape)[s : s + 1].sum() for name, s in ends))
