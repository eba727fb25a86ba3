"""Two planes flush with one another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.geometry import Plane
from constraints.jacobians import ALIGNED, ON_PLANE
from constraints.kinds.base import Constraint, Equation, element


@dataclass(frozen=True, eq=False)
class Coplanar(Constraint):
    """Planes that coincide with normals to the same side: two faces flush."""

    kind: ClassVar[str] = "coplanar"
    freedom: ClassVar[int] = 3
    symbol: ClassVar[str] = "plane"

    def equations(self) -> tuple[Equation, ...]:
        a, b = self._feature(0, Plane), self._feature(1, Plane)
        ea, eb = element(a.origin, a.normal), element(b.origin, b.normal)
        return (Equation(ALIGNED, ea, eb, (1.0, 0.0)), Equation(ON_PLANE, ea, eb))
