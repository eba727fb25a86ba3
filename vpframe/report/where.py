"""Surfaces and points of the least clearance of a session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager
from vpframe.session.log import SessionLog


@dataclass(frozen=True, eq=False)
class LeastGap:
    """The two nearest surfaces and their nearest points."""

    parts: tuple[str, str]
    surfaces: tuple[int, int]
    points: tuple[NDArray[np.float64], NDArray[np.float64]]
    """(3,) each, world, m"""


def least_gap(log: SessionLog) -> LeastGap | None:
    """Return the gap of the least clearance; None if no clearance was measured or no part was held."""
    frame = log.least
    if frame is None or frame.clearance is None or not frame.held:
        return None
    manager = CollisionManager()
    names = log.scene.names
    for name in names:
        manager.add(log.scene[name].mesh, frame.poses[name])
    held = [log.scene.index(name) for name in frame.held]
    near = manager.object_pairs(held, within=frame.clearance * (1.0 + 1e-9) + manager.tolerance.linear)
    rows = [row for i, j in near for row in manager.clearance(int(i), int(j))]
    if not rows:
        return None
    row = min(rows, key=lambda row: abs(float(row["distance"]) - float(frame.clearance or 0.0)))
    return LeastGap(
        (names[int(row["object_a"])], names[int(row["object_b"])]),
        (int(row["surface_a"]), int(row["surface_b"])),
        (np.array(row["point_a"]), np.array(row["point_b"])),
    )
