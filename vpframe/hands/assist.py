"""Help for precise manipulation: snapping, slowing near obstacles, locked axes, held orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from vpframe.errors import TaskError
from vpframe.hands.arguments import number


@dataclass(frozen=True)
class Assist:
    """Set it on a hand: `hand.assist = Assist(snap=0.003, slow_within=0.005, hold_orientation=True)`."""

    snap: float = 0.0
    """m: candidates within this reach are previewed, and `hand.snap()` or the session's rule may accept them"""
    snap_angle: float = 0.1
    """rad: directions that differ by less count as meant to be parallel when snapping"""
    slow_within: float = 0.0
    """m: nearer than this to anything but its mates, the hand slows to `slow_to` of its speed (the clearance is
    measured for it at every step, whether the session shows it or not)"""
    slow_to: float = 0.2
    """1, in (0, 1]"""
    hold_orientation: bool = False
    """keep the rotation that the part has when a motion begins"""
    lock: str = ""
    """world axes along which the part does not move: any of "x", "y", "z" """

    def __post_init__(self) -> None:
        for name in ("snap", "snap_angle", "slow_within"):
            number(getattr(self, name), f"Assist: {name}", least=0.0)
        if number(self.slow_to, "Assist: slow_to", above=0.0) > 1.0:
            raise TaskError(f"Assist: slow_to={self.slow_to!r}; the hand slows to a part of its speed, at most 1")
        if not isinstance(self.lock, str) or set(self.lock) - set("xyz"):
            raise TaskError(f"lock={self.lock!r}: name world axes by the letters x, y, z")

    def shape(self, begin: pin.SE3, wanted: pin.SE3) -> pin.SE3:
        """`wanted` with the locked axes and the held orientation taken from where the motion began."""
        if not self.lock and not self.hold_orientation:
            return wanted
        origin = np.array(wanted.translation)
        for letter in self.lock:
            origin["xyz".index(letter)] = begin.translation["xyz".index(letter)]
        return pin.SE3(begin.rotation if self.hold_orientation else wanted.rotation, origin)

    def rate(self, clearance: float | None) -> float:
        """How fast the hand goes, as a fraction of its own speed, with that much room left."""
        near = self.slow_within > 0.0 and clearance is not None and clearance < self.slow_within
        return self.slow_to if near else 1.0
