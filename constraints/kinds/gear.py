"""Two wheels in mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import pinocchio as pin

from constraints.errors import GeometryError
from constraints.kinds.base import Constraint
from constraints.kinds.elements import axis_of
from constraints.kinds.equations import Equation, mesh


@dataclass(frozen=True, eq=False)
class Gear(Constraint):
    """Wheel a of `teeth_a` drives wheel b of `teeth_b`, spur, bevel or worm.

    Turns are counted about each wheel's own axis from the line that joins the features' origins, so a planet carrier
    may turn as it likes; put the origins in the pitch circles' planes. `sense` +1: the wheels turn against each other
    about their axes as given (external mesh, parallel axes); -1: the same way (internal mesh, or opposed axes). Teeth
    engage at `phase` (rad of wheel a) modulo one tooth.
    """

    kind: ClassVar[str] = "gear"

    teeth_a: int = 20
    teeth_b: int = 20
    sense: int = 1
    phase: float = 0.0

    def equations(self) -> tuple[Equation, ...]:
        for name in ("teeth_a", "teeth_b"):
            teeth = getattr(self, name)
            if int(teeth) != teeth or teeth < 1:
                raise GeometryError(f"{name} is {teeth!r}; give a whole number of teeth", name)
        if self.sense not in (-1, 1):
            raise GeometryError(f"sense is {self.sense!r}; give 1 or -1", "sense")
        return (mesh(axis_of(self, 0), axis_of(self, 1), self.teeth_a, self.teeth_b, self.sense, self.phase),)

    def engaged(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Gear:
        """The same pair with the phase that holds at these poses."""
        return replace(self, phase=self.phase + float(self.residual(pose_a, pose_b)[-1]))
