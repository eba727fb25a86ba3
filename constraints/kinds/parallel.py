"""Directions that are parallel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import direction_of
from constraints.kinds.equations import Equation, aligned


@dataclass(frozen=True, eq=False)
class Parallel(Constraint):
    """Normals or axes that are parallel. `sense` +1 same way, -1 opposed, 0 whichever is nearer."""

    kind: ClassVar[str] = "parallel"
    subgroup: ClassVar[bool] = True

    sense: int = 0

    def equations(self) -> tuple[Equation, ...]:
        return (aligned(direction_of(self, 0), direction_of(self, 1), self.sense),)
