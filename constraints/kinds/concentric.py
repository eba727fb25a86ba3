"""Two surfaces of revolution on one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import axis_of
from constraints.kinds.equations import Equation, aligned, on_line


@dataclass(frozen=True, eq=False)
class Concentric(Constraint):
    """Axes that coincide: a shaft in a bore. `sense` +1 or -1 holds the axes parallel or opposed, 0 takes the nearer.

    Features: cylinders, cones, tori, circles or lines.
    """

    kind: ClassVar[str] = "concentric"
    subgroup: ClassVar[bool] = True

    sense: int = 0

    def equations(self) -> tuple[Equation, ...]:
        a, b = axis_of(self, 0), axis_of(self, 1)
        return aligned(a, b, self.sense), on_line(a, b)
