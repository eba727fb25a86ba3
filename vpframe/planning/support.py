"""Support of the parts of an assembly at their initial poses, and its loss by removals."""

from __future__ import annotations

from collections.abc import Iterable, Set
from typing import Final

import numpy as np
import pinocchio as pin

from vpframe.planning.assembly import Assembly, translation

DOWN: Final = np.array([0.0, 0.0, -1.0])
"""(3,) unit, world: gravity"""
SETTLES: Final = 0.1
"""1: of a part's size: it rests on parts that it reaches within this distance downwards"""


class Supports:
    """Which part holds which: fits, threads and overlaps hold both parts, and a part holds what rests on it.

    A part is held if a chain of these leads to the base. Tilting is not checked.
    """

    def __init__(self, assembly: Assembly, base: Iterable[int]) -> None:
        self.assembly, self.base = assembly, frozenset(base)
        self._holds: dict[tuple[int, int], bool] = {}

    def lost(self, present: Set[int], leaving: Iterable[int]) -> frozenset[int]:
        """Parts present that are supported by the base, and no longer without those that leave."""
        left = set(present) - set(leaving)
        return frozenset((self.held(present) & left) - self.held(left))

    def held(self, present: Set[int]) -> set[int]:
        """Parts present that are supported by the base."""
        reached = set(self.base & present)
        queue = list(reached)
        while queue:
            j = queue.pop()
            new = {i for i in set(present) - reached if self.holds(i, j)}
            reached |= new
            queue += sorted(new)
        return reached

    def holds(self, i: int, j: int) -> bool:
        """Whether part j holds part i."""
        if (i, j) not in self._holds:
            fitted = bool(self.assembly.mates_of(i, j))
            self._holds[i, j] = fitted or self._rests(i, j) or self.assembly.pressed(i, j)
        return self._holds[i, j]

    def _rests(self, i: int, j: int) -> bool:
        knots = pin.SE3.Identity(), translation(SETTLES * self.assembly.size(i) * DOWN)
        return self.assembly.stop(i, j, knots) is not None
