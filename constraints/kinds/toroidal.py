"""A torus seated in a torus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.geometry.surfaces import Torus
from constraints.kinds.base import Constraint
from constraints.kinds.equations import Equation, aligned, coincident, element


@dataclass(frozen=True, eq=False)
class Toroidal(Constraint):
    """Tori on one axis with one centre: an O-ring in its groove. `sense` as for `Concentric`."""

    kind: ClassVar[str] = "toroidal"
    subgroup: ClassVar[bool] = True

    sense: int = 0

    def equations(self) -> tuple[Equation, ...]:
        a, b = (element(t.center, t.axis) for t in (self.feature(0, Torus), self.feature(1, Torus)))
        return aligned(a, b, self.sense), coincident(a, b)
