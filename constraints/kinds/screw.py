"""A thread in its nut."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pinocchio as pin

from constraints.errors import GeometryError
from constraints.kinds.base import Constraint
from constraints.kinds.elements import axis_of
from constraints.kinds.equations import Equation, aligned, helix, on_line


@dataclass(frozen=True, eq=False)
class Screw(Constraint):
    """Axes that coincide, and b advances `pitch` metres along the axis of a for each turn about it.

    A right-hand thread has a positive pitch. The thread engages at `phase` (m) modulo one pitch, as threads do: no
    turns are counted, so no state is kept. `flank` (rad) is the half-angle of its profile, 30° for metric threads, 0
    for square ones; the motion does not depend on it, but friction does.
    """

    kind: ClassVar[str] = "screw"
    subgroup: ClassVar[bool] = True

    pitch: float = 1e-3
    phase: float = 0.0
    sense: int = 0
    flank: float = 0.0

    def equations(self) -> tuple[Equation, ...]:
        if self.pitch == 0.0:
            raise GeometryError("pitch is 0; give the advance of one turn in metres", "pitch")
        if not 0.0 <= self.flank < 0.5 * np.pi:
            raise GeometryError(f"flank is {self.flank!r}; give the half-angle of the profile, 0 … π/2 rad", "flank")
        a, b = axis_of(self, 0), axis_of(self, 1)
        return aligned(a, b, self.sense), on_line(a, b), helix(a, b, self.pitch, self.phase)

    def engaged(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Screw:
        """The same thread with the phase that holds at these poses."""
        return replace(self, phase=self.phase + float(self.residual(pose_a, pose_b)[-1]))
