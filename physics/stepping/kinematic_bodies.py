"""`KinematicBodies`: bodies that hands and scripted paths move, and the wrenches that this takes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.contact.contact_problem import Contacts
from physics.forces.behaviours import Behaviour
from physics.forces.checked_behaviours import CheckedBehaviours
from physics.forces.hands import Grip
from physics.forces.wrenches import Forces, touches
from physics.model.bodies import FREE, KINEMATIC, STATIC, Bodies

Array = NDArray[np.float64]


class KinematicBodies:
    """Moves kinematic bodies. grips: hands by object id, shared with the world."""

    def __init__(self, bodies: Bodies, forces: Forces, grips: Mapping[int, Grip], checked: CheckedBehaviours) -> None:
        self.path: dict[int, Behaviour] = {}
        """by object id: the behaviour that gives its pose"""
        self._bodies = bodies
        self._forces = forces
        self._grips = grips
        self._checked = checked

    def targets(self, time: float) -> tuple[dict[int, pin.SE3], bool]:
        """Target poses at `time` by object id, and whether a path began or ended since the last call.

        An object whose path has ended becomes free, or static if it has no body.
        """
        b = self._bodies
        out = {i: grip.target for i, grip in self._grips.items() if grip.hand is None}
        ways = {i: self._checked.pose(i, path, time) for i, path in self.path.items() if i not in self._grips}
        changed = False
        for i, target in ways.items():
            kind = KINEMATIC if target is not None else FREE if b.mass[i] > 0.0 else STATIC
            if b.kind[i] != kind:
                b.kind[i] = kind
                b.wake(i)
                changed = True
            if target is not None:
                out[i] = target
        return dict(sorted(out.items())), changed

    def begin(self, targets: Mapping[int, pin.SE3], dt: float) -> list[int]:
        """Set the velocities that reach the targets in `dt` seconds; returns the ids that move, ascending."""
        b = self._bodies
        moving = []
        for i, target in targets.items():
            if i in self._grips:
                self._grips[i].before = b.velocity[i].copy()
            if b.stands_at(i, target):
                b.velocity[i] = 0.0
                continue
            turn = pin.log3(target.rotation @ b.rotation[i].T)
            shift = target.rotation @ b.offset[i] + target.translation - b.center[i]
            b.velocity[i, :3] = shift / dt
            b.velocity[i, 3:] = turn / dt
            if b.velocity[i].any():
                moving.append(i)
        return moving

    def end(self, targets: Mapping[int, pin.SE3], contacts: Contacts, time: float, dt: float) -> None:
        """Snap kinematic bodies to their targets; store the reaction wrench of each grip.

        contacts: of the step, which began at `time` and took `dt` seconds.
        """
        felt = {i: self._felt(i, self._grips[i], contacts, time, dt) for i in targets if i in self._grips}
        for i, target in targets.items():
            if self._bodies.velocity[i].any():
                self._bodies.set_pose(i, target)
            if i in felt:
                self._grips[i].wrench = felt[i]

    def _felt(self, i: int, grip: Grip, contacts: Contacts, time: float, dt: float) -> Array:
        """(6,) wrench that moved object i through the step: inertial, less contacts' and behaviours'."""
        b = self._bodies
        change = (b.velocity[i] - grip.before) / dt
        r = b.rotation[i]
        w = np.concatenate([b.mass[i] * change[:3], r @ b.inertia[i] @ r.T @ change[3:]])
        omega = b.velocity[i, 3:]
        w[3:] += np.cross(omega, r @ b.inertia[i] @ r.T @ omega)
        w -= self._forces.wrenches(np.array([i]), time)[0]
        for touch in touches(i, contacts, dt):
            w[:3] -= touch.impulse / dt
            w[3:] -= np.cross(touch.point - b.center[i], touch.impulse / dt)
        return w
