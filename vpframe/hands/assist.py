"""Aids for precise manipulation: snapping, slowing near obstacles, locked axes, fixed orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from vpframe.errors import TaskError
from vpframe.hands.arguments import number
from vpframe.hands.paths import Path


@dataclass(frozen=True)
class Assist:
    """Settings of a hand: `hand.assist = Assist(snap=0.003, slow_within=0.005, hold_orientation=True)`."""

    snap: float = 0.0
    """reach within which candidates are previewed and `hand.snap()` or the session's rule may accept them, m"""
    snap_angle: float = 0.1
    """maximum angle between directions that snap to parallel, rad"""
    slow_within: float = 0.0
    """clearance below which the hand slows to `slow_to` of its speed, m; it is then measured at every step"""
    slow_to: float = 0.2
    """fraction of the hand's speed, in (0, 1]"""
    hold_orientation: bool = False
    """keep the rotation that the part has when a motion begins"""
    lock: str = ""
    """letters (x, y, z) of the world axes along which the part does not move"""

    def __post_init__(self) -> None:
        for name in ("snap", "snap_angle", "slow_within"):
            number(getattr(self, name), f"Assist: {name}", least=0.0)
        if number(self.slow_to, "Assist: slow_to", above=0.0) > 1.0:
            raise TaskError(f"Assist: slow_to={self.slow_to!r}; the hand slows to a part of its speed, at most 1")
        if not isinstance(self.lock, str) or set(self.lock) - set("xyz"):
            raise TaskError(f"lock={self.lock!r}: name world axes by the letters x, y, z")

    def shape(self, path: Path, wanted: pin.SE3) -> pin.SE3:
        """Return `wanted` with locked coordinates and fixed orientation taken from where the path begins."""
        if not self.lock and not self.hold_orientation:
            return wanted
        begin = path.pose(0.0)
        origin = np.array(wanted.translation)
        for letter in self.lock:
            origin["xyz".index(letter)] = begin.translation["xyz".index(letter)]
        return pin.SE3(begin.rotation if self.hold_orientation else wanted.rotation, origin)

    def rate(self, clearance: float | None) -> float:
        """Return the fraction of the hand's speed allowed at a clearance, m."""
        near = self.slow_within > 0.0 and clearance is not None and clearance < self.slow_within
        return self.slow_to if near else 1.0
