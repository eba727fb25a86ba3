"""Bodies that are put deep into others: brought out of them before anything moves.

Contacts are looked for to `touching.DEEPEST` of the thinner wall, and what is found there is closed as the step is
taken. What is placed deeper would not be seen at all and fall through. Its depth and the way out are measured on the
exact meshes (`CollisionManager.penetration`); it is moved that far, the lighter body more, deepest first. It gets no
velocity: the work done is that of lifting it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager
from physics.contact.contact_set import DEEPEST
from physics.model.bodies import FREE, Bodies

NEARLY = 0.98
"""1: depths are measured to 1 %"""
PASSES = 16
"""times that the deepest overlap is looked for anew, an object pair"""


def part(
    bodies: Bodies, collision: CollisionManager, objects: Iterable[tuple[int, int]], bound: frozenset[int]
) -> bool:
    """Move free bodies out of what they are too deep in; whether any was. Poses are set in `collision` too.

    objects: pairs of objects that may meet. bound: bodies on joints, which stay where their joints have them.
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
                b.set_pose(k, pose)
                collision.set_pose(k, pose)
        moved = True
    return moved


def _deepest(collision: CollisionManager, i: int, j: int) -> NDArray[np.float64]:
    """(3,) m, world: the shortest way out of object i for object j where it is deepest; 0 if they do not overlap."""
    rows = collision.penetration(i, j)
    if len(rows) == 0:
        return np.zeros(3)
    row = rows[int(np.argmax(rows["depth"]))]
    way: NDArray[np.float64] = row["depth"] * row["direction"]
    return way if row["object_a"] == i else -way
