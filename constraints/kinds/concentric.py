"""Two surfaces of revolution on one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.jacobians import ALIGNED, ON_LINE
from constraints.kinds.base import Constraint, Equation, element
from constraints.kinds.elements import axis_of


@dataclass(frozen=True, eq=False)
class Concentric(Constraint):
    """Axes that coincide: a shaft in a bore. `sense` +1 or -1 holds the axes parallel or opposed, 0 takes the nearer.

    Features: cylinders, cones, tori, circles or lines.
    """

    kind: ClassVar[str] = "concentric"
    freedom: ClassVar[int] = 2

    sense: int = 0

    def equations(self) -> tuple[Equation, ...]:
        a, b = (element(*axis_of(self, body)) for body in (0, 1))
        return (Equation(ALIGNED, a, b, (float(self.sense), 0.0)), Equation(ON_LINE, a, b))
