"""Directions at a given angle."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from constraints.errors import GeometryError
from constraints.kinds.base import Constraint
from constraints.kinds.elements import direction_of
from constraints.kinds.equations import Equation, Limits, angle


@dataclass(frozen=True, eq=False)
class Angle(Constraint):
    """Normals or axes at the angle `at` (rad, within (0, π)), or within limits (low, high) of [0, π]."""

    kind: ClassVar[str] = "angle"

    at: Limits = pi / 2

    def equations(self) -> tuple[Equation, ...]:
        if not isinstance(self.at, tuple) and not 0.0 < self.at < pi:
            raise GeometryError(f"angle is {self.at}; give one between 0 and π, or use Parallel", "at")
        return (angle(direction_of(self, 0), direction_of(self, 1), self.at),)
