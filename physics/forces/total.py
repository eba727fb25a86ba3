"""`Forces`: what the behaviours of objects and the spring hands on them exert, and what they are shown for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from physics.contact.contact_problem import NO_CONTACTS, Contacts
from physics.forces.answers import Answers
from physics.forces.behaviours import Behaviour, Touch, View
from physics.model.bodies import Bodies
from physics.model.body import Body
from physics.stepping.hands import Grip
from physics.stepping.rotations import across

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Forces:
    """Wrenches on the bodies of a world. A constant one is asked for once; the others in every half kick.

    body, grips: by object id; the world's own, which it changes.
    """

    def __init__(self, bodies: Bodies, body: Mapping[int, Body], grips: Mapping[int, Grip], answers: Answers) -> None:
        self.contacts: Contacts = NO_CONTACTS
        """at the end of the last step"""
        self.last_step = 0.0
        """s"""
        self.dt = 0.0
        """s, of the step that is going on"""
        self.constant = np.zeros((0, 6))
        """by object id"""
        self.varying: dict[int, tuple[Behaviour, ...]] = {}
        self._bodies = bodies
        self._body = body
        self._grips = grips
        self._answers = answers

    def reserve(self, n: int) -> None:
        """Make room for ids below n."""
        self.constant = np.concatenate([self.constant, np.zeros((max(0, n - len(self.constant)), 6))])

    def sort(self, behaviours: Sequence[Behaviour], view: View) -> tuple[Array, tuple[Behaviour, ...]]:
        """Of the behaviours of a body: what constant ones exert (6,), and those that are to be asked again."""
        exerting = [behaviour for behaviour in behaviours if type(behaviour).wrench is not Behaviour.wrench]
        constant = np.zeros(6)
        for behaviour in exerting:
            if behaviour.constant:
                constant += self._answers.wrench(behaviour, view)
        return constant, tuple(behaviour for behaviour in exerting if not behaviour.constant)

    def set(self, i: int, constant: Array, varying: tuple[Behaviour, ...]) -> None:
        """What is exerted on object i from now on, as `sort` gives it."""
        self.constant[i] = constant
        self.varying.pop(i, None)
        if varying:
            self.varying[i] = varying

    def remove(self, i: int) -> None:
        """Exert nothing on object i from now on."""
        self.set(i, np.zeros(6), ())

    def wrenches(self, ids: Ints, time: float) -> Array:
        """(n, 6) sums of what behaviours and hands exert, world axes, about the centres of mass."""
        w = self.constant[ids]
        if self.varying or self._grips:
            for k, i in enumerate(ids.tolist()):
                for behaviour in self.varying.get(i, ()):
                    w[k] += self._answers.wrench(behaviour, self.view(i, time))
                grip = self._grips.get(i)
                if grip is not None and grip.hand is not None:
                    w[k] += grip.pull(self.view(i, time), self.dt)
        return w

    def view(self, i: int, time: float) -> View:
        """What a behaviour of body i sees."""
        b = self._bodies
        return View(
            i, time, self._body[i], b.pose(i), b.center[i].copy(), b.velocity[i, :3].copy(), b.velocity[i, 3:].copy(),
            touches(i, self.contacts, self.last_step),
        )  # fmt: skip


def touches(i: int, c: Contacts, dt: float) -> tuple[Touch, ...]:
    """Contact points at which object i is pressed, after a step of `dt` seconds."""
    out = []
    for k in np.flatnonzero(((c.ints[:, 0] == i) | (c.ints[:, 1] == i)) & (c.force[:, 0] > 0.0)):
        sign = 1.0 if c.ints[k, 0] == i else -1.0
        n = c.reals[k, 3:6]
        t1 = across(n)
        t1 /= np.sqrt(t1 @ t1)
        f = c.force[k, 0] * n + c.force[k, 1] * t1 + c.force[k, 2] * np.cross(n, t1)
        other = int(c.ints[k, 1] if sign > 0 else c.ints[k, 0])
        out.append(Touch(other, c.reals[k, :3].copy(), sign * n, sign * dt * f))
    return tuple(out)
