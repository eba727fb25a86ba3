"""Two planes face to face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import plane_of
from constraints.kinds.equations import Equation, aligned, on_plane


@dataclass(frozen=True, eq=False)
class Against(Constraint):
    """Planes that coincide with opposed normals: a face rests on a face."""

    kind: ClassVar[str] = "against"
    subgroup: ClassVar[bool] = True
    symbol: ClassVar[str] = "plane"

    def equations(self) -> tuple[Equation, ...]:
        a, b = plane_of(self, 0), plane_of(self, 1)
        return aligned(a, b, -1), on_plane(a, b)
