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
UPRIGHT: Final = 0.1
"""1: least height of the unit normal of a contact that holds what is on it"""


class Supports:
    """Which part holds which: fits, threads and overlaps hold both parts, and a part holds what rests on it.

    A part is held if a chain of these leads to the base. Tilting is not checked.
    """

    def __init__(self, assembly: Assembly, base: Iterable[int]) -> None:
        self.assembly, self.base = assembly, frozenset(base)
        self._held_by: dict[int, tuple[int, ...]] = {}

    def lost(self, present: Set[int], leaving: Iterable[int]) -> frozenset[int]:
        """Parts present that are supported by the base, and no longer without those that leave."""
        left = set(present) - set(leaving)
        return frozenset((self.held(present) & left) - self.held(left))

    def held(self, present: Set[int]) -> set[int]:
        """Parts present that are supported by the base."""
        if not self._held_by:
            found: dict[int, list[int]] = {j: [] for j in range(len(self.assembly))}
            for i in range(len(self.assembly)):
                for j in self._near(i):
                    if self.holds(i, j):
                        found[j].append(i)
            self._held_by = {j: tuple(held) for j, held in found.items()}
        reached = set(self.base & present)
        queue = list(reached)
        while queue:
            new = [i for i in self._held_by[queue.pop()] if i in present and i not in reached]
            reached.update(new)
            queue += new
        return reached

    def _near(self, i: int) -> Iterable[int]:
        """The parts that may hold part i."""
        sweeps, down = self.assembly.sweeps, (pin.SE3.Identity(), self._down(i))
        return sorted(self.assembly.partners[i].union(sweeps.beside(i, down).tolist()))

    def holds(self, i: int, j: int) -> bool:
        """Whether part j holds part i."""
        assembly = self.assembly
        if assembly.mates_of(i, j) or frozenset((i, j)) in assembly.clashing or self._stands_on(i, j):
            return True
        return self._rests(i, j) or assembly.pressed(i, j)

    def _stands_on(self, i: int, j: int) -> bool:
        """Whether contacts of part i with part j hold it from below."""
        return any(float((patch.normals @ DOWN).min()) < -UPRIGHT for patch in self.assembly.patches(i, j))

    def _down(self, i: int) -> pin.SE3:
        return translation(SETTLES * self.assembly.size(i) * DOWN)

    def _rests(self, i: int, j: int) -> bool:
        return self.assembly.stop(i, j, (pin.SE3.Identity(), self._down(i))) is not None
