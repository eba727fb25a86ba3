"""A cone seated in a cone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.geometry.surfaces import Cone
from constraints.kinds.base import Constraint
from constraints.kinds.equations import Equation, aligned, element, on_line, on_plane


@dataclass(frozen=True, eq=False)
class Conical(Constraint):
    """Cones on one axis that open the same way, apex of b `offset` metres along the axis from that of a."""

    kind: ClassVar[str] = "conical"
    subgroup: ClassVar[bool] = True

    offset: float = 0.0

    def equations(self) -> tuple[Equation, ...]:
        a, b = (element(c.apex, c.axis) for c in (self.feature(0, Cone), self.feature(1, Cone)))
        return aligned(a, b, 1), on_line(a, b), on_plane(a, b, self.offset)
