"""Hands: a target pose that is reached against any resistance, or a spring of limited force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.errors import PhysicsError
from physics.forces.behaviours import View

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpringHand:
    """A hand that pulls the object's frame towards `target` with springs and dampers, up to a force and a torque.

    In a step of h seconds stiffness is limited to m/h² and damping to m/h (m: the object's mass, or its least moment of
    inertia), so that the motion is stable for any gains. Joints only add inertia.
    """

    target: pin.SE3
    stiffness: float = 2000.0
    """N/m"""
    damping: float = 60.0
    """N·s/m"""
    angular_stiffness: float = 5.0
    """N·m/rad"""
    angular_damping: float = 0.1
    """N·m·s/rad"""
    force: float = 100.0
    """N: the most it pulls with"""
    torque: float = 5.0
    """N·m: the most it turns with"""

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "angular_stiffness", "angular_damping", "force", "torque"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise PhysicsError(f"SpringHand: {name} is {value!r}; give zero or more")
        if not np.isfinite(self.target.homogeneous).all():
            raise PhysicsError("SpringHand: target is not finite; give a rigid pose")


class Grip:
    """A hand on one object, and its wrench in the last step."""

    def __init__(self, hold: pin.SE3 | SpringHand) -> None:
        self.hand = hold if isinstance(hold, SpringHand) else None
        self.target: pin.SE3 = hold.target if isinstance(hold, SpringHand) else hold
        self.wrench: Array = np.zeros(6)
        self.before: Array = np.zeros(6)
        """(6,) velocity of the object one step ago"""

    def pull(self, view: View, dt: float) -> Array:
        """(6,) force and torque about the centre of mass, world axes, in a step of `dt` seconds."""
        hand = self.hand
        assert hand is not None
        goal = self.target.act(view.body.center)
        stiffness, damping = _followed(hand.stiffness, hand.damping, view.body.mass, dt)
        pull = stiffness * (goal - view.center) - damping * view.velocity
        least = float(np.linalg.eigvalsh(view.body.inertia)[0])
        stiffness, damping = _followed(hand.angular_stiffness, hand.angular_damping, least, dt)
        turn = stiffness * pin.log3(self.target.rotation @ view.pose.rotation.T) - damping * view.angular_velocity
        self.wrench = np.concatenate([_limited(pull, hand.force), _limited(turn, hand.torque)])
        return self.wrench

    def data(self) -> tuple[object, ...]:
        """The data that `of` takes."""
        return (self.hand, self.target.homogeneous.copy(), self.wrench.copy())

    @classmethod
    def of(cls, data: tuple) -> Grip:
        """The grip that `data` described."""
        hand, target, wrench = data
        grip = cls(hand if hand is not None else pin.SE3(target))
        grip.wrench = wrench
        return grip


def _followed(stiffness: float, damping: float, inertia: float, dt: float) -> tuple[float, float]:
    """Gains limited to what is stable: one step with the limits halves the remaining error and speed."""
    return min(stiffness, inertia / dt**2), min(damping, inertia / dt)


def _limited(vector: Array, limit: float) -> Array:
    size = float(np.sqrt(vector @ vector))
    return vector * (limit / size) if size > limit else vector
