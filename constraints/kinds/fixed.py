"""Two bodies held as one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pinocchio as pin

from constraints.kinds.base import Constraint
from constraints.kinds.elements import Point
from constraints.kinds.equations import Equation, coincident, element, oriented


@dataclass(frozen=True, eq=False)
class Fixed(Constraint):
    """Body b at the pose `relative` in body a's frame: welded, glued, pressed in."""

    kind: ClassVar[str] = "fixed"
    subgroup: ClassVar[bool] = True
    symbol: ClassVar[str] = "rigid"

    relative: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @classmethod
    def between(cls, bodies: tuple[int, int], pose_a: pin.SE3, pose_b: pin.SE3, size: float = 0.01) -> Fixed:
        """Hold two bodies as they stand."""
        relative = pose_a.inverse() * pose_b
        return cls(bodies, (Point(relative.translation), Point(np.zeros(3))), size=size, relative=relative)

    def equations(self) -> tuple[Equation, ...]:
        rotation = self.relative.rotation
        a = element(self.relative.translation, rotation[:, 2], rotation[:, 0])
        b = element([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        return oriented(a, b), coincident(a, b)
