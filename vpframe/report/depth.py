"""Where clashing surfaces meet, asked of `collision` at the first moment of each clash."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager
from vpframe.clash_status import ClashKey
from vpframe.report.log import Clash, SessionLog


@dataclass(frozen=True, eq=False)
class Depth:
    """Where a clash is, and how deep."""

    depth: float | None
    """m, as `collision` defines it; None when it is not known"""
    point: NDArray[np.float64]
    """(3,) world, m: where"""


def depths(log: SessionLog) -> dict[ClashKey, Depth]:
    """Place and depth of each clash, at the step at which it was first seen."""
    groups: dict[tuple[int, str, str], list[Clash]] = {}
    for clash in log.clashes.values():
        groups.setdefault((clash.first.step, clash.key.part_a, clash.key.part_b), []).append(clash)
    found: dict[ClashKey, Depth] = {}
    for (_, a, b), clashes in groups.items():
        manager = CollisionManager()
        poses = clashes[0].first.poses
        for name in (a, b):
            manager.add(log.scene[name].mesh, poses[name])
        wanted = {(clash.key.surface_a, clash.key.surface_b): clash.key for clash in clashes}
        for row in manager.contacts(0.0):
            key = wanted.get((int(row["surface_a"]), int(row["surface_b"])))
            if key is not None:
                found[key] = Depth(None, 0.5 * (row["point_a"] + row["point_b"]))
    return found
