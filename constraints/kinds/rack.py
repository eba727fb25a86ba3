"""A rack and its pinion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import pinocchio as pin

from constraints.errors import GeometryError
from constraints.kinds.base import Constraint
from constraints.kinds.elements import axis_of, direction_of
from constraints.kinds.equations import Equation, rack


@dataclass(frozen=True, eq=False)
class RackAndPinion(Constraint):
    """Pinion a of pitch `radius` and `teeth` moves rack b along its direction by `sense`·radius for each radian.

    Feature a is the pinion's axis, feature b the rack's direction (a line, or anything with an axis); the pinion's
    turn is counted from the normal to the rack. Teeth engage at `phase` (m) modulo one tooth. With `teeth` 1 it is a
    wheel that rolls without slip.
    """

    kind: ClassVar[str] = "rack-and-pinion"

    radius: float = 0.01
    teeth: int = 20
    sense: int = 1
    phase: float = 0.0

    def equations(self) -> tuple[Equation, ...]:
        if not self.radius > 0.0:
            raise GeometryError(f"radius is {self.radius!r}; give the pitch radius in metres", "radius")
        if int(self.teeth) != self.teeth or self.teeth < 1:
            raise GeometryError(f"teeth is {self.teeth!r}; give a whole number of teeth", "teeth")
        if self.sense not in (-1, 1):
            raise GeometryError(f"sense is {self.sense!r}; give 1 or -1", "sense")
        pinion, direction = axis_of(self, 0), direction_of(self, 1)
        return (rack(pinion, direction, self.radius, self.teeth, self.sense, self.phase),)

    def engaged(self, pose_a: pin.SE3, pose_b: pin.SE3) -> RackAndPinion:
        """The same pair with the phase that holds at these poses."""
        return replace(self, phase=self.phase + float(self.residual(pose_a, pose_b)[-1]))
