"""Planes held apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import plane_of
from constraints.kinds.equations import Equation, Limits, aligned, on_plane


@dataclass(frozen=True, eq=False)
class Offset(Constraint):
    """Parallel planes, that of b `at` metres (or within limits) above that of a. `sense` as for `Parallel`."""

    kind: ClassVar[str] = "offset"
    symbol: ClassVar[str] = "plane"

    at: Limits = 0.0
    sense: int = -1

    def equations(self) -> tuple[Equation, ...]:
        a, b = plane_of(self, 0), plane_of(self, 1)
        return aligned(a, b, self.sense), on_plane(a, b, self.at)
