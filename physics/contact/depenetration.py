"""Depenetration: bodies that were placed deep inside others are moved out before a step.

Contact search ends at `contact_set.DEEPEST` of the thinner wall; a deeper overlap would not be seen, and the body would
fall through. Depth and direction come from the exact meshes (`CollisionManager.penetration`). The deepest pair is moved
apart first, the lighter body more. Velocities do not change: the work done is that of lifting.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager
from physics.contact.contact_set import DEEPEST
from physics.model.bodies import FREE, Bodies

NEARLY = 0.98
"""1: depths are measured to 1 %"""
PASSES = 16
"""searches for the deepest overlap, per object pair"""


def depenetrate(
    bodies: Bodies,
    collision: CollisionManager,
    place: Callable[[int, pin.SE3], None],
    objects: Iterable[tuple[int, int]],
    bound: frozenset[int],
) -> bool:
    """Move free bodies out of overlaps that are too deep for contact search; returns whether any moved.

    place: sets the pose of an object, in `bodies` and in `collision`. objects: pairs of objects that may meet. bound:
    bodies on joints, which stay where their joints have them.
    """
    b = bodies
    pairs = [(i, j) for i, j in objects if any(b.kind[k] == FREE and k not in bound for k in (i, j))]
    moved = False
    for _ in range(PASSES * len(pairs)):
        deepest = [_deepest(collision, i, j) for i, j in pairs]
        excess = [
            way @ way / (NEARLY * DEEPEST * min(b.thickness[i], b.thickness[j])) ** 2
            for (i, j), way in zip(pairs, deepest, strict=True)
        ]
        worst = int(np.argmax(excess)) if excess else 0
        if not excess or excess[worst] <= 1.0:
            return moved
        i, j = pairs[worst]
        ease = np.array([1.0 / b.mass[k] if b.kind[k] == FREE and k not in bound else 0.0 for k in (i, j)])
        for k, share in zip((i, j), (-1.0, 1.0) * ease / ease.sum(), strict=True):
            if share != 0.0:
                pose = b.pose(k)
                pose.translation = pose.translation + share * deepest[worst]
                place(k, pose)
        moved = True
    return moved


def _deepest(collision: CollisionManager, i: int, j: int) -> NDArray[np.float64]:
    """(3,) m, world: translation that takes object j out of i where they overlap deepest; 0 if they do not."""
    rows = collision.penetration(i, j)
    if len(rows) == 0:
        return np.zeros(3)
    row = rows[int(np.argmax(rows["depth"]))]
    way: NDArray[np.float64] = row["depth"] * row["direction"]
    return way if row["object_a"] == i else -way
