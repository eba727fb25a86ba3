"""`ArticulatedMotion`: the motion of an articulated body over a step, in joint coordinates.

The eighth-order method of Dormand and Prince (Hairer, Nørsett & Wanner, "Solving Ordinary Differential Equations I",
II.5) in the tangent space at the start (Munthe-Kaas), with loops held by Gauss's principle and closed after the step.
Threads with friction stick or slide (`screw_friction`); a step of the method ends where a thread changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.joints.articulated_body import ArticulatedBody
from physics.joints.rows import RANK, Law
from physics.joints.screw_friction import Rates, ScrewFriction, chosen, friction_torques, when
from physics.model.bodies import Bodies, Saved

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TURN = 0.15
"""rad: steps in which a joint would turn by more are split"""
STILL = 1e-13
"""1: a thread that turns slower than this times the fastest joint is at rest"""
STEPS = 20_000
"""sub-steps of a step, of at most `TURN`"""
EVENTS = 40
"""bound of changes between sticking and sliding in one step"""


@cache
def _dormand_prince() -> tuple[Array, Array, Array]:
    """Nodes, weights of the stages and weights of the step (Hairer, Nørsett and Wanner, Solving ODEs I, II.5)."""
    from scipy.integrate import DOP853  # at first use: half a second

    return DOP853.C, np.ascontiguousarray(DOP853.A), np.ascontiguousarray(DOP853.B)


class ArticulatedMotion:
    """One step of an articulated body under `wrench`.

    constant: the wrenches depend on neither state nor time. law: friction of pairs, see `joints.rows`.
    """

    def __init__(
        self, mechanism: ArticulatedBody, bodies: Bodies, time: float, wrench: Callable[[Ints, float], Array],
        constant: bool, law: Law,
    ) -> None:  # fmt: skip
        self.mechanism = mechanism
        self.model, self.data, self.loops = mechanism.model, mechanism.data, mechanism.loops
        self.bodies = bodies
        self.time = time
        self.wrench = wrench
        self.dry = ScrewFriction.of(mechanism.threads, law)
        self.turning = np.array([self.model.idx_vs[i] for i in self._screws()], np.int64)
        """(d,) indices of the threads with friction in the velocities"""
        self.fixed = wrench(mechanism.ids, time) if constant else None
        """(n, 6) constant wrenches without the part that is the model's gravity; None if they vary"""
        self.model.gravity.linear = np.zeros(3)
        if self.fixed is not None and (field := self._field(self.fixed)) is not None:
            self.model.gravity.linear, self.fixed = field, np.zeros_like(self.fixed)
        self.pulled = self.fixed is None or bool(self.fixed.any())
        """whether there are wrenches beside the model's gravity"""
        self.no_forces = pin.StdVec_Force()
        self.no_forces.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        self.no_torques = np.zeros(self.model.nv)

    def _screws(self) -> list[int]:
        """Pinocchio's joint ids of the threads with friction."""
        return [self.mechanism.screws[k].joint for k in self.dry.of_thread]

    def advance(self, dt: float) -> bool:
        """Move the bodies by `dt` seconds.

        On False, body state is undefined and the caller must restore it: friction admits no motion without an impulse,
        or changes between sticking and sliding too often.
        """
        mechanism, bodies = self.mechanism, self.bodies
        start = Saved(bodies, mechanism.ids)
        q, v = mechanism.read(bodies)
        turns = dt * float(np.abs(v).max(initial=0.0)) / TURN
        if not turns <= STEPS:  # also NaN
            raise ArithmeticError(f"its joints need more than {STEPS} sub-steps")
        steps = max(1, int(np.ceil(turns)))
        began, k, events = q, 0, 0
        t, end = 0.0, dt / steps
        while k < steps:
            slip = self._slip(q, v, t)
            if slip is None:
                return False
            if self.fixed is not None and len(slip) == len(v) and not slip.any() and not v.any():
                break  # at rest
            taken = self._smooth(q, v, end - t, t, slip)
            if taken is None:
                return False
            q, v, h = taken
            if h < end - t:
                t += h
                events += 1
                if events > EVENTS:
                    return False
                continue
            k += 1
            t, end = k * dt / steps, (k + 1) * dt / steps
        if self.loops:
            q, v = self._close(q, v)
        if len(self.turning) and not v.any() and np.array_equal(q, began):
            start.restore(bodies)  # to the bit: reading coordinates off poses rounds
            bodies.velocity[mechanism.ids] = 0.0
            return True
        mechanism.write(q, v, bodies)
        return True

    def _slip(self, q: Array, v: Array, time: float) -> Array | None:
        """(d,) sign of sliding of each thread with friction, 0 where it sticks; sets `v` of threads at rest to 0."""
        if len(self.turning) == 0:
            return np.zeros(0)
        rest = np.abs(v[self.turning]) <= STILL * np.abs(v).max()
        v[self.turning[rest]] = 0.0
        slip = np.sign(v[self.turning])
        return chosen(self.dry, slip, self._rates(q, v, time)) if rest.any() else slip

    def _smooth(self, q: Array, v: Array, h: float, time: float, slip: Array) -> tuple[Array, Array, float] | None:
        """Integrate up to h seconds, or until a thread begins or ends to slide: q, v, and the time taken."""

        def go(h: float) -> tuple[Array, Array, float] | None:
            """State after h seconds, and the least of the event functions, which stay positive without an event."""
            after = self._step(q, v, h, time, slip)
            if after is None:
                return None
            least = np.inf
            if len(slip):
                slides = slip != 0.0
                least = float((slip * after[1][self.turning])[slides].min(initial=np.inf))
                if not slides.all():
                    now = self._rates(*after, time + h)
                    x = friction_torques(self.dry, slip, now)
                    if x is None:
                        return None
                    least = min(least, float((now.bound(self.dry, x) - np.abs(x))[~slides].min()))
            return *after, least

        found = go(h)
        if found is None or found[2] >= 0.0:
            return None if found is None else (found[0], found[1], h)
        at = when(lambda h: None if (after := go(h)) is None else after[2], found[2], h)
        if at is None or (after := go(at)) is None:
            return None
        q, v, _ = after
        ends = (slip != 0.0) & (slip * v[self.turning] <= 0.0)
        v[self.turning[ends]] = 0.0
        return q, v, at

    def _field(self, w: Array) -> Array | None:
        """Uniform acceleration (3,) that accounts for all wrenches (n, 6): the model's gravity; None if none."""
        a = w[:, :3] / self.bodies.mass[self.mechanism.ids][:, None]
        if w[:, 3:].any() or np.abs(a - a[0]).max() > 1e-15 * np.abs(a[0]).max():
            return None
        return a[0]

    def _forces(self, q: Array, v: Array, time: float) -> pin.StdVec_Force:
        """Applied wrenches by joint, in its frame."""
        forces = self.no_forces.copy()
        if not self.pulled:
            return forces
        w = self.fixed
        if w is None:
            self.mechanism.write(q, v, self.bodies)
            w = self.wrench(self.mechanism.ids, self.time + time)
        else:
            pin.forwardKinematics(self.model, self.data, q)
        for k, link in enumerate(self.mechanism.links):
            turn = self.data.oMi[link.joint].rotation.T
            forces[link.joint] += self.mechanism.center[k].act(pin.Force(turn @ w[k, :3], turn @ w[k, 3:]))
        return forces

    def _rates(self, q: Array, v: Array, time: float) -> Rates:
        """Accelerations, and rates and loads of threads as functions of the friction torques."""
        model, data = self.model, self.data
        d = len(self.turning)
        if model.nv == 0:
            return Rates.without_friction(np.zeros(0))
        forces = self._forces(q, v, time)
        a: Array = pin.aba(model, data, q, v, self.no_torques, forces).copy()
        if not self.loops and d == 0:
            return Rates.without_friction(a)
        lower = np.linalg.cholesky(pin.crba(model, data, q, pin.Convention.WORLD))
        by_torque = np.zeros((model.nv, d))
        if d:
            by_torque[self.turning, np.arange(d)] = 1.0
            by_torque = np.asarray(np.linalg.solve(lower.T, np.linalg.solve(lower, by_torque)), np.float64)
        pushes: Array | None = None
        if self.loops:
            # Gauss's principle: the least change of `a` (mass metric) that leaves the anchors no relative acceleration
            drift = self._drift(q, v)
            _, jacobian = self._gaps(q)
            wrong = np.column_stack([drift + jacobian @ a, jacobian @ by_torque])
            off = np.linalg.lstsq(np.linalg.solve(lower, jacobian.T).T, wrong, rcond=RANK)[0]
            change = np.linalg.solve(lower.T, off)
            a -= change[:, 0]
            by_torque -= change[:, 1:]
            if d:
                pushes = np.asarray(np.linalg.lstsq(jacobian.T, -lower @ off, rcond=RANK)[0], np.float64)
        if d == 0:
            return Rates.without_friction(a)
        frames = [data.oMi[i].copy() for i in range(model.njoints)]
        self._push(forces, frames, pushes, 0)
        pin.rnea(model, data, q, v, a, forces)
        loads, by_load = self._loads(), np.empty((d, 4, d))
        gravity = model.gravity.linear.copy()
        model.gravity.linear = np.zeros(3)
        for k in range(d):
            forces = self.no_forces.copy()
            self._push(forces, frames, pushes, 1 + k)
            pin.rnea(model, data, q, self.no_torques, by_torque[:, k].copy(), forces)
            by_load[:, :, k] = self._loads()
        model.gravity.linear = gravity
        return Rates(a, by_torque, a[self.turning], by_torque[self.turning], loads, by_load)

    def _loads(self) -> Array:
        """(d, 4) N and N·m transmitted by each thread: along the axis, about it, twice across it."""
        f = [self.data.f[i].vector for i in self._screws()]
        return np.array(f)[:, [2, 5, 0, 1]]

    def _push(self, forces: pin.StdVec_Force, frames: Sequence[pin.SE3], pushes: Array | None, column: int) -> None:
        """Add the forces of loop anchors (3 · loops, …), world axes, to the joints' forces."""
        if pushes is None:
            return
        for loop, push in zip(self.loops, pushes[:, column].reshape(-1, 3), strict=True):
            for (joint, point), sign in zip(loop, (-1.0, 1.0), strict=True):
                if joint != 0:
                    force = pin.Force(sign * (frames[joint].rotation.T @ push), np.zeros(3))
                    forces[joint] += point.act(force)

    def _acceleration(self, q: Array, v: Array, time: float, slip: Array) -> Array | None:
        """(nv,) accelerations with threads sliding as `slip`; None where friction admits none."""
        rates = self._rates(q, v, time)
        if len(slip) == 0:
            return rates.acceleration
        x = friction_torques(self.dry, slip, rates)
        if x is None:
            return None
        a = rates.acceleration + rates.by_torque @ x
        a[self.turning[slip == 0.0]] = 0.0
        return a

    def _step(self, q: Array, v: Array, h: float, time: float, slip: Array) -> tuple[Array, Array] | None:
        nv = self.model.nv
        nodes, weights, b = _dormand_prince()
        k = np.empty((len(b), 2 * nv))
        y = np.concatenate([np.zeros(nv), v])
        for i in range(len(b)):
            at = y + h * (weights[i, :i] @ k[:i]) if i else y
            u, vi = at[:nv], at[nv:]
            qi = q + u if self.mechanism.flat else pin.integrate(self.model, q, u)
            a = self._acceleration(qi, vi, time + nodes[i] * h, slip)
            if a is None:
                return None
            k[i, nv:] = a
            if self.mechanism.flat:
                k[i, :nv] = vi
            else:  # u' = (∂(q ⊕ u)/∂u)⁻¹ v
                k[i, :nv] = np.linalg.solve(pin.dIntegrate(self.model, q, u, pin.ARG1), vi)
        y = y + h * (b @ k)
        return (q + y[:nv] if self.mechanism.flat else pin.integrate(self.model, q, y[:nv])), y[nv:]

    def _close(self, q, v):
        """Close the loops: Newton's method on the anchors, then velocities projected on closed loops."""
        for _ in range(4):
            gap, jacobian = self._gaps(q)
            if np.abs(gap).max() < 1e-15:
                break
            q = pin.integrate(self.model, q, -np.linalg.lstsq(jacobian, gap, rcond=RANK)[0])
        _, jacobian = self._gaps(q)
        return q, v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=RANK)[0]

    def _drift(self, q, v):
        """(3k,) relative acceleration of the anchors when the joint accelerations are zero, world axes."""
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        out = []
        for loop in self.loops:
            ends = []
            for joint, point in loop:
                if joint == 0:
                    ends.append(np.zeros(3))
                    continue
                local = pin.classicAcceleration(data.v[joint], data.a[joint], point)
                ends.append(data.oMi[joint].rotation @ local)
            out.append(ends[1] - ends[0])
        return np.concatenate(out)

    def _gaps(self, q):
        """Distances (3k,) between the anchors of each loop and their Jacobian (3k, nv), world axes."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        jacobians = {0: np.zeros((6, model.nv))}
        gaps, rows = [], []
        for loop in self.loops:
            ends = []
            for joint, local in loop:
                if joint not in jacobians:
                    jacobians[joint] = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                place, j = data.oMi[joint], jacobians[joint]
                point = place.act(local.translation)
                ends.append((point, j[:3] - pin.skew(point - place.translation) @ j[3:]))
            gaps.append(ends[1][0] - ends[0][0])
            rows.append(ends[1][1] - ends[0][1])
        return np.concatenate(gaps), np.concatenate(rows)
