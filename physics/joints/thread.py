"""Friction in threads: the law of Coulomb on the flanks of a `Screw`, as an incline that is wound about an axis.

A thread of effective radius r and lead p has the lead angle λ, tan λ = p / (2π r). Unrolled, what the flanks bear is a
force N across the thread and a force f along it (axis z, load F along it and T about it):

    N = F cos λ - (T / r) sin λ,    f = F sin λ + (T / r) cos λ,    |f| ≤ μ' |N| + μ R,    μ' = μ / cos α,

with α the half-angle of the flanks (Shigley, Mechanical Engineering Design, "The mechanics of power screws"), and R
the force across the axis, which the thread bears as a pin of radius r in its bore. N has either sign, as a thread has
two flanks. A thread that bears an axial load holds it by itself as long as tan λ ≤ μ', and gives way upwards or
downwards at the torques F r tan(φ ± λ), tan φ = μ'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.geometry.surfaces import perpendicular
from constraints.kinds.elements import axis_of
from constraints.kinds.screw import Screw

Array = NDArray[np.float64]

STRAIGHT = 1e-9
"""m/rad, 1: a joint's rows that change by no more along a thread do not stop it"""


@dataclass(frozen=True, eq=False)
class ThreadFriction:
    """Geometry of a screw joint for friction. Its axis is that of the joint's first body."""

    bodies: tuple[int, int]
    origin: Array
    """(3,) m, on the axis, frame of the first body"""
    axis: Array
    """(3,) unit, frame of the first body"""
    radius: float
    """m, effective: the mean of the two features' radii"""
    lead: float
    """m/rad: translation of the second body along the axis per rotation about it, negative for a left-hand thread"""
    flank: float
    """rad, half-angle of the flanks: 0 for a square thread"""

    @classmethod
    def of(cls, joint: object) -> ThreadFriction | None:
        """The thread of a joint, or None if it is no screw, or one whose features tell no radius."""
        if not isinstance(joint, Screw):
            return None
        radii = [r for f in joint.features if (r := getattr(f, "radius", getattr(f, "major", 0.0))) > 0.0]
        if not radii:
            return None
        axis = axis_of(joint, 0)
        return cls(joint.bodies, axis[:3], axis[9:], sum(radii) / len(radii), joint.pitch / (2.0 * np.pi), joint.flank)

    @property
    def angle(self) -> float:
        """rad: the lead angle λ, negative for a left-hand thread."""
        return float(np.arctan2(self.lead, self.radius))

    def friction(self, coefficient: float) -> tuple[float, float]:
        """The coefficients μ' on the flanks and μ across the axis, of a pair of bodies with the coefficient μ."""
        return coefficient / float(np.cos(self.flank)), coefficient

    def rows(self, pose: pin.SE3) -> tuple[Array, Array, Array]:
        """Speeds of the second body against the first that the thread forbids and allows, as linear forms.

        Linear parts (4, 3) and angular parts (4, 3) m, world axes, of: across the flanks, two across the axis, along
        the flanks; each in m/s of what slides at the radius. They take the velocity of the point (3,), which is on the
        axis. pose: of the first body.
        """
        z = pose.rotation @ self.axis
        x = pose.rotation @ perpendicular(self.axis)
        y = np.cross(z, x)
        c, s = np.cos(self.angle), np.sin(self.angle)
        linear = np.array([c * z, x, y, s * z])
        angular = self.radius * np.array([-s * z, 0.0 * z, 0.0 * z, c * z])
        return linear, angular, pose.act(self.origin)

    def lets(self, jacobian: Array, pose_a: pin.SE3, pose_b: pin.SE3) -> bool:
        """Whether rows (r, 6) of a joint, by the local twist of the second body, leave the thread its motion.

        Of joints on the same pair, those that do are implied by the thread (a shaft in its bore) or are slack; one that
        does not (a nut that is welded on) stops it.
        """
        z = pose_a.rotation @ self.axis
        twist = pin.Motion(self.lead * z + np.cross(pose_a.act(self.origin), z), z)
        return bool(np.abs(jacobian @ pose_b.actInv(twist).vector).max(initial=0.0) < STRAIGHT)
