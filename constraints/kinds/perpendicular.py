"""Directions at right angles."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from constraints.kinds.base import Constraint
from constraints.kinds.elements import direction_of
from constraints.kinds.equations import Equation, angle


@dataclass(frozen=True, eq=False)
class Perpendicular(Constraint):
    """Normals or axes at right angles."""

    kind: ClassVar[str] = "perpendicular"

    def equations(self) -> tuple[Equation, ...]:
        return (angle(direction_of(self, 0), direction_of(self, 1), pi / 2),)
