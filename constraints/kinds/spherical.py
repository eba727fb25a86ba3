"""A ball in a socket."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import point_of
from constraints.kinds.equations import Equation, coincident


@dataclass(frozen=True, eq=False)
class Spherical(Constraint):
    """Centres (of spheres, or points) that coincide."""

    kind: ClassVar[str] = "spherical"
    subgroup: ClassVar[bool] = True
    symbol: ClassVar[str] = "point"

    def equations(self) -> tuple[Equation, ...]:
        return (coincident(point_of(self, 0), point_of(self, 1)),)
