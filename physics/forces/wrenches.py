"""`Forces`: sums of the wrenches of gravity, behaviours and spring hands; and contact forces for read-out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from physics.contact.contact_problem import NO_CONTACTS, Contacts
from physics.forces.behaviours import Behaviour, Touch, View
from physics.forces.checked_behaviours import CheckedBehaviours
from physics.forces.hands import Grip
from physics.model.bodies import Bodies
from physics.model.body import Body
from physics.model.rotations import across

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Forces:
    """Applied wrenches on the bodies of a world. Constant behaviours are called once, others in every half kick.

    body, grips: by object id, shared with the world.
    """

    def __init__(
        self, bodies: Bodies, body: Mapping[int, Body], grips: Mapping[int, Grip], checked: CheckedBehaviours
    ) -> None:
        self.contacts: Contacts = NO_CONTACTS
        """at the end of the last step"""
        self.last_step = 0.0
        """s"""
        self.dt = 0.0
        """s, of the current step"""
        self.gravity = np.zeros(3)
        """m/s², of the world"""
        self.own = np.zeros((0, 6))
        """by object id: wrench of constant behaviours"""
        self.heavy = np.zeros(0)
        """kg, by object id: the mass on which the world's gravity acts; 0 if the object has a `Gravity` of its own"""
        self.constant = np.zeros((0, 6))
        """by object id: `own` and the weight"""
        self.varying: dict[int, tuple[Behaviour, ...]] = {}
        self._bodies = bodies
        self._body = body
        self._grips = grips
        self._checked = checked

    def reserve(self, n: int) -> None:
        """Grow the arrays to hold ids below n."""
        more = max(0, n - len(self.heavy))
        self.own = np.concatenate([self.own, np.zeros((more, 6))])
        self.heavy = np.concatenate([self.heavy, np.zeros(more)])
        self.constant = np.concatenate([self.constant, np.zeros((more, 6))])

    def sort(self, behaviours: Sequence[Behaviour], view: View) -> tuple[Array, tuple[Behaviour, ...]]:
        """Wrench (6,) of the constant behaviours of a body, and the behaviours whose wrench varies."""
        exerting = [behaviour for behaviour in behaviours if type(behaviour).wrench is not Behaviour.wrench]
        constant = np.zeros(6)
        for behaviour in exerting:
            if behaviour.constant:
                constant += self._checked.wrench(behaviour, view)
        return constant, tuple(behaviour for behaviour in exerting if not behaviour.constant)

    def set(self, i: int, constant: Array, varying: tuple[Behaviour, ...], heavy: float) -> None:
        """Set the constant wrench (6,), varying behaviours and `heavy` (kg) of object i, see `sort`, `self.heavy`."""
        self.own[i], self.heavy[i] = constant, heavy
        self._weigh(slice(i, i + 1))
        self.varying.pop(i, None)
        if varying:
            self.varying[i] = varying

    def remove(self, i: int) -> None:
        """Remove all behaviours of object i."""
        self.set(i, np.zeros(6), (), 0.0)

    def set_gravity(self, gravity: Array) -> None:
        """Change the world's gravity (3,), m/s²."""
        self.gravity = gravity
        self._weigh(slice(None))

    def _weigh(self, ids: slice) -> None:
        self.constant[ids] = self.own[ids]
        self.constant[ids, :3] += self.heavy[ids, None] * self.gravity

    def wrenches(self, ids: Ints, time: float) -> Array:
        """(n, 6) sums of applied wrenches at `time`, world axes, about the centres of mass, N and N·m."""
        w = self.constant[ids]
        if self.varying or self._grips:
            for k, i in enumerate(ids.tolist()):
                for behaviour in self.varying.get(i, ()):
                    w[k] += self._checked.wrench(behaviour, self.view(i, time))
                grip = self._grips.get(i)
                if grip is not None and grip.hand is not None:
                    w[k] += grip.pull(self.view(i, time), self.dt)
        return w

    def view(self, i: int, time: float) -> View:
        """The view that behaviours of body i get."""
        b = self._bodies
        return View(
            i, time, self._body[i], b.pose(i), b.center[i].copy(), b.velocity[i, :3].copy(), b.velocity[i, 3:].copy(),
            touches(i, self.contacts, self.last_step),
        )  # fmt: skip


def touches(i: int, c: Contacts, dt: float) -> tuple[Touch, ...]:
    """Loaded contact points of object i, after a step of `dt` seconds."""
    out = []
    rows = np.flatnonzero(((c.ints[:, 0] == i) | (c.ints[:, 1] == i)) & (c.force[:, 0] > 0.0))
    for k, f in zip(rows.tolist(), _forces(c, rows), strict=True):
        sign = 1.0 if c.ints[k, 0] == i else -1.0
        other = int(c.ints[k, 1] if sign > 0 else c.ints[k, 0])
        out.append(Touch(other, c.reals[k, :3].copy(), sign * c.reals[k, 3:6], sign * dt * f))
    return tuple(out)


def wrenches_by_pair(c: Contacts) -> tuple[Ints, Array]:
    """Pairs (k, 2) of objects, i < j, sorted; forces and torques about the world's origin (k, 6), N and N·m, on i by j.

    World axes; only pairs with a contact point that presses.
    """
    rows = np.flatnonzero(c.force[:, 0] > 0.0)
    force = _forces(c, rows)
    wrench = np.hstack([force, np.cross(c.reals[rows, :3], force)])
    wrench[c.ints[rows, 0] > c.ints[rows, 1]] *= -1.0
    pairs, of = np.unique(np.sort(c.ints[rows, :2], axis=1), axis=0, return_inverse=True)
    out = np.zeros((len(pairs), 6))
    np.add.at(out, of.ravel(), wrench)
    return pairs, out


def _forces(c: Contacts, rows: Ints) -> Array:
    """(r, 3) N, world axes, on the first object of some contact points."""
    out = np.empty((len(rows), 3))
    for k, row in enumerate(rows.tolist()):
        n = c.reals[row, 3:6]
        t1 = across(n)
        t1 /= np.sqrt(t1 @ t1)
        out[k] = c.force[row, 0] * n + c.force[row, 1] * t1 + c.force[row, 2] * np.cross(n, t1)
    return out
