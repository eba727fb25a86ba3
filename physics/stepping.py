"""One island over one step: kicks and free flight, contacts that press, impacts at their time.

A sub-step of length h is half a kick, free flight, half a kick. Each kick solves for the impulses of joints and of the
contacts that touch, so that a constant force, resting and sliding with friction are exact. Flight ends early at the
first new contact: its time is found to rounding, the impact happens there, and the rest of the step goes on from it.

Where bodies roll or turn in contact without sliding, the first half kick of a step is the mirror image of the last
half kick of the step before, so that it is the velocity between the two that obeys the contacts (the reversible
nonholonomic leapfrog of McLachlan & Perlmutter, J. Nonlinear Sci. 16, 2006): no energy is lost to the turning of the
contact frame.

Impacts follow Newton's law, each contact with its own coefficient. Several at once are resolved in rounds: only the
contacts that close are reflected, those that this makes close are reflected next (generalised reflections, Smith,
Kaufman, Vouga, Tamstorf & Grinspun, ACM Trans. Graph. 31, 2012), so a row of touching balls passes a blow on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from physics import contact, crossing, pressing
from physics.bodies import FREE, Bodies, coast, drift, place
from physics.integrators import METHODS
from physics.joints import Joint, assemble
from physics.mechanism import Mechanism
from physics.pressing import NO_CONTACTS, Contacts
from physics.rotations import exponential, multiply
from physics.shapes import Shapes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

IMPACTS = 64
"""impacts an island may have in one step; after that the rest of the step is taken without rebound"""
MOVING = 1e-6
"""m/s, rad/s: islands slower than this are at rest, and solved anew in each half kick"""
ROUNDING = 1e-13
"""m: to which impacts are located and pressed contacts are kept closed (plus the rounding of the coordinates)"""


@dataclass(eq=False)
class Island:
    """What one step moves together."""

    ids: Ints
    """free bodies, ascending"""
    pairs: Ints
    """(k, 4) near surface pairs with at least one of them"""
    moved: Ints
    """kinematic bodies among the pairs and joints"""
    joints: Sequence[Joint] = ()
    mechanism: Mechanism | None = None
    """the same bodies in joint coordinates, where that is possible"""
    constant: bool = True
    """whether no force on it depends on anything that changes"""
    first_rate: Array | None = None
    """(n, 6) of the half kick that the present sub-step began with"""
    impacts: int = 0
    """counted in the present step"""
    residual: float = 0.0
    """m/s, largest of the solver in the present step"""


class Stepper:
    """Moves islands. It holds no state of its own but scratch arrays; the state is in `bodies` and the contacts."""

    def __init__(self, bodies: Bodies, tolerance: Tolerance, integrator: str) -> None:
        self.bodies = bodies
        self.tolerance = tolerance
        self.method = METHODS[integrator]
        self.shapes: Shapes | None = None
        self.shape_of = np.zeros(0, np.int64)
        self.friction = np.zeros(0)
        self.restitution = np.zeros(0)
        self._ints = np.empty((256, 6), np.int64)
        self._reals = np.empty((256, 7))
        self._stamps: tuple[Ints, ...] = ()

    def use(self, shapes: Shapes) -> None:
        """Take the shapes that bodies may have from now on."""
        self.shapes = shapes
        sizes = len(shapes.vertices), len(shapes.edges), len(shapes.kinds)
        self._stamps = tuple(np.zeros(n + 1, np.int64) for n in sizes)

    # --- contacts ---------------------------------------------------------------------------------------------------

    def find(self, island: Island, reach: float) -> Contacts:
        """Contact points of the island as it stands, with gaps up to `reach` (m); forces are zero.

        Penetration is looked for to 3/10 of the thinnest part: deeper, the nearest face may be that of the other side.
        """
        if len(island.pairs) == 0 or self.shapes is None:
            return NO_CONTACTS
        b = self.bodies
        thickness = float(b.thickness[island.pairs[:, [0, 2]]].min())
        margin, depth = reach, max(0.1 * thickness, min(reach, 0.3 * thickness))
        while True:
            n = contact.find(
                island.pairs, b.rotation, b.origin, self.shape_of, self.shapes, margin, depth, self._ints, self._reals,
                *self._stamps,
            )  # fmt: skip
            if n <= len(self._ints):
                return Contacts(self._ints[:n].copy(), self._reals[:n].copy(), np.zeros((n, 3)))
            self._ints = np.empty((2 * n, 6), np.int64)
            self._reals = np.empty((2 * n, 7))

    def _pair_values(self, ints: Ints) -> tuple[Array, Array]:
        """Friction and restitution (c,) of contacts, see `behaviours.Reaction`."""
        a, b = ints[:, 0], ints[:, 1]
        fa, fb = self.friction[a], self.friction[b]
        friction = np.where(np.isnan(fa), fb, np.where(np.isnan(fb), fa, np.sqrt(fa * fb)))
        ea, eb = self.restitution[a], self.restitution[b]
        restitution = np.where(np.isnan(ea), eb, np.where(np.isnan(eb), ea, np.fmin(ea, eb)))
        return np.where(np.isnan(friction), 0.5, friction), np.where(np.isnan(restitution), 0.0, restitution)

    def coast(self, ids: Ints, wrench: Array, dt: float) -> None:
        """A step of bodies that are near to nothing and under constant wrenches (n, 6)."""
        b = self.bodies
        coast(
            ids, b.center, b.attitude, b.velocity, b.momentum, b.mass, b.inertia, b.inverse, b.offset, b.rotation,
            b.origin, wrench, dt, self.method,
        )  # fmt: skip

    # --- one step ---------------------------------------------------------------------------------------------------

    def advance(
        self,
        island: Island,
        before: Contacts,
        kept: bool,
        time: float,
        dt: float,
        wrench: Callable[[Ints, float], Array],
    ) -> Contacts:
        """Move an island from `time` over `dt` seconds; the contacts at the end. `wrench(ids, t)`: (n, 6) N, N·m.

        before: contacts at the end of the last step; `kept` says that they still are what `find` would find.
        """
        b = self.bodies
        island.impacts = 0
        island.residual = 0.0
        rest = Saved(b, island.moved)
        t = 0.0
        if kept and len(island.moved) == 0:
            mine = np.isin(before.ints[:, 0], island.ids) | np.isin(before.ints[:, 1], island.ids)
            now = Contacts(before.ints[mine], before.reals[mine], before.force[mine])
        else:
            now = self._inherit(self.find(island, self._reach(island, dt)), before)
            now = self._sift(now, self._touched(before, now), None, None, 0.0, 0.0)[0]
        while dt - t > 1e-12 * dt:
            h = dt - t
            limit = self._limit(island)
            if h > limit:
                h /= np.ceil(h / limit)
            if island.impacts >= IMPACTS:
                now = self._blunt(island, now, rest, time, t, dt - t, wrench)
                t = dt
            else:
                free = len(island.moved) == 0 and _least(now, slice(None)) > self.tolerance.touch
                if free and island.mechanism is not None:
                    after = self._smooth(island, island.mechanism, rest, time, t, h, wrench)
                    if after is not None:
                        t, now = t + h, after
                        continue
                taken, now = self._substep(island, now, rest, time, t, h, wrench)
                t += taken
        return now

    def _smooth(self, island, mechanism: Mechanism, rest, time, t, h, wrench) -> Contacts | None:
        """h seconds without contact, at high order; None (and nothing moved) if it would touch something."""
        b = self.bodies
        start = Saved(b, island.ids)
        reach = self._reach(island, h)
        mechanism.advance(b, time + t, h, wrench, island.constant)
        after = self.find(island, reach)
        after, _ = self._sift(after, np.zeros(len(after.ints), bool), start, rest, t, h)
        if _least(after, slice(None)) > self.tolerance.touch and self._limit(island) >= 0.5 * h:
            return after
        start.restore(b)
        return None

    def _reach(self, island: Island, h: float) -> float:
        """m: how far any point of the island, or what meets it, may move in h seconds."""
        b = self.bodies
        ids = np.concatenate([island.ids, island.moved])
        v = b.velocity[ids]
        speed = np.sqrt((v[:, :3] ** 2).sum(axis=1)) + np.sqrt((v[:, 3:] ** 2).sum(axis=1)) * b.radius[ids]
        return 2.0 * h * float(speed.max()) + 10.0 * h * h + 1e-6

    def _limit(self, island: Island) -> float:
        """s: the longest sub-step in which nothing near passes through anything unseen."""
        if len(island.pairs) == 0:
            return np.inf
        b = self.bodies
        ids = np.unique(island.pairs[:, [0, 2]])
        v = b.velocity[ids]
        speed = np.sqrt((v[:, :3] ** 2).sum(axis=1)) + np.sqrt((v[:, 3:] ** 2).sum(axis=1)) * b.radius[ids]
        fastest = float(speed.max())
        return 0.25 * float(b.thickness[ids].min()) / fastest if fastest > 0.0 else np.inf

    def _inherit(self, now: Contacts, before: Contacts) -> Contacts:
        """Forces of contacts that were there before: the solver's first guess."""
        if len(now.ints) and len(before.ints):
            row = pressing.match(before.ints, now.ints)
            known = row >= 0
            now.force[known] = before.force[row[known]]
        return now

    def _touched(self, before: Contacts, now: Contacts) -> NDArray[np.bool_]:
        """Which contacts of `now` touched in `before`."""
        touched = np.zeros(len(now.ints), bool)
        if len(before.ints) and len(now.ints):
            row = pressing.match(before.ints, now.ints)
            known = row >= 0
            touched[known] = before.reals[row[known], 6] <= self.tolerance.touch
        return touched

    def _sift(self, contacts, touched, start, rest, t, h):
        """Without the rows that only lie behind a face; and which of the others touched, or have been inside all along.

        start: the island h seconds ago, rest: what carries it, at the step's start (t before that); None: just begun.
        """
        deep = ~touched & (contacts.reals[:, 6] < -self.tolerance.touch)
        if not deep.any():
            return contacts, touched
        b = self.bodies
        rotation, origin = b.rotation.copy(), b.origin.copy()
        if start is not None:
            rotation[start.ids], origin[start.ids] = start.rotation, start.origin
            rest.carry(b, t)
            rotation[rest.ids], origin[rest.ids] = b.rotation[rest.ids], b.origin[rest.ids]
            rest.carry(b, t + h)
        verdict = crossing.sift(
            contacts.ints, contacts.reals, touched, b.rotation, b.origin, rotation, origin, self.shape_of, self.shapes,
            self.tolerance.touch,
        )  # fmt: skip
        real = verdict != crossing.NOTHING
        return Contacts(*(column[real] for column in contacts)), (touched | (verdict == crossing.SUNK))[real]

    def _substep(self, island, now, rest, time, t, h, wrench):
        """One sub-step of at most h, cut short at the first impact; the time taken and the contacts at its end."""
        b = self.bodies
        start = Saved(b, island.ids)
        after, fresh = self._fly(island, now, rest, time, t, h, wrench)
        tolerance = self._rounding(island)
        gap = _least(after, fresh)
        if gap < -tolerance:
            island.impacts += 1
            low, high = 0.0, h
            low_gap = np.inf
            for k in range(60):
                speed = self._closing(after, fresh, gap)
                cut = high + gap / speed if speed > 0.0 else low
                if k % 3 == 2 and low_gap < np.inf and high > low:
                    cut = low + (high - low) * low_gap / (low_gap - gap)
                if not low < cut < high:
                    cut = 0.5 * (low + high)
                if not low < cut < high:
                    break
                start.restore(b)
                trial, trial_fresh = self._fly(island, now, rest, time, t, cut, wrench)
                g = _least(trial, trial_fresh)
                if g < -tolerance:
                    high, after, fresh, gap = cut, trial, trial_fresh, g
                elif g <= tolerance:
                    high, after, fresh = cut, trial, trial_fresh
                    break
                else:
                    low, low_gap = cut, g
            else:
                start.restore(b)
                after, fresh = self._fly(island, now, rest, time, t, high, wrench)
            h = high
        mirrored = b.steady[island.ids].all()
        self._arrive(island, after, fresh, time + t + h, 0.5 * h, wrench)
        if (
            not mirrored
            and b.steady[island.ids].all()
            and not (fresh & (after.reals[:, 6] <= self.tolerance.touch)).any()
        ):
            # the first of mirrored half kicks has none to mirror: the mean of both halves serves, to second order
            rate = 0.5 * (b.rate[island.ids] + island.first_rate)
            start.restore(b)
            b.rate[island.ids] = rate
            after, fresh = self._fly(island, now, rest, time, t, h, wrench)
            self._arrive(island, after, fresh, time + t + h, 0.5 * h, wrench)
        return h, after

    def _rounding(self, island: Island) -> float:
        return ROUNDING + 1e-15 * float(np.abs(self.bodies.center[island.ids]).max())

    def _closing(self, contacts: Contacts, fresh, gap: float) -> float:
        """m/s at which the deepest fresh contact closes."""
        which = np.flatnonzero(fresh & (contacts.reals[:, 6] == gap))[:1]
        b = self.bodies
        return -float(pressing.normal_speeds(which, contacts.ints, contacts.reals, b.center, b.velocity)[0])

    def _fly(self, island, now, rest, time, t, h, wrench):
        """Half a kick and free flight over h; contacts there, and which of them did not touch before."""
        b = self.bodies
        touch = self.tolerance.touch
        pressed = np.flatnonzero(now.reals[:, 6] <= touch)
        if b.steady[island.ids].all():
            b.velocity[island.ids] += 0.5 * h * b.rate[island.ids]
        else:
            before = b.velocity[island.ids]
            self._kick(island, now, pressed, time + t, 0.5 * h, wrench)
            island.first_rate = (b.velocity[island.ids] - before) / (0.5 * h)
        start = Saved(b, island.ids)
        self._drift(island, rest, t + h, h)
        reach = self._reach(island, h)
        for _ in range(6):
            after = self._inherit(self.find(island, reach), now)
            after, touched = self._sift(after, self._touched(now, after), start, rest, t, h)
            carried = after.force[:, 0] > 0.0
            gaps = after.reals[:, 6]
            off = touched & ((carried & (gaps != 0.0)) | (gaps < 0.0))
            jb, jj, jr = assemble(island.joints, b, island.ids)
            worst = max(np.abs(gaps[off]).max(initial=0.0), np.abs(jr).max(initial=0.0))
            if worst <= self._rounding(island):
                break
            self._correct(island, after, np.flatnonzero(off), jb, jj, jr)
        return after, ~touched

    def _drift(self, island, rest, time, h):
        b = self.bodies
        drift(
            island.ids, b.center, b.attitude, b.velocity, b.momentum, b.inertia, b.inverse, b.offset, b.rotation,
            b.origin, h, self.method,
        )  # fmt: skip
        rest.carry(b, time)

    def _correct(self, island, contacts, chosen, jb, jj, jr):
        b = self.bodies
        pressing.correct(
            island.ids, self._local(island), b.center, b.attitude, b.rotation, b.mass, b.inertia, b.inverse,
            b.kind == FREE, chosen, contacts.ints, contacts.reals, jb, jj, jr,
        )  # fmt: skip
        place(island.ids, b.center, b.attitude, b.offset, b.rotation, b.origin)

    def _local(self, island):
        local = np.full(self.bodies.n, -1)
        local[island.ids] = np.arange(len(island.ids))
        return local

    def _free(self, island, t, h, wrench):
        """Velocities (n, 6) after a kick of h seconds without constraints."""
        b = self.bodies
        ids = island.ids
        w = wrench(ids, t)
        free = b.velocity[ids].copy()
        free[:, :3] += h / b.mass[ids][:, None] * w[:, :3]
        if w[:, 3:].any():
            r = b.rotation[ids]
            free[:, 3:] += h * np.einsum("nij,njk,nlk,nl->ni", r, b.inverse[ids], r, w[:, 3:])
        return free

    def _kick(self, island, contacts, pressed, t, h, wrench):
        """Forces over h seconds, and what joints and the touching contacts make of them."""
        self._press(island, contacts, pressed, self._free(island, t, h, wrench), h, np.zeros(len(contacts.ints)))

    def _press(self, island, contacts, pressed, free, h, target):
        """Solve; contact forces (impulse over h) are kept on `contacts`. Rows left out that would sink in are added."""
        b = self.bodies
        if len(pressed) == 0 and not island.joints:
            b.velocity[island.ids] = free
            return
        mu, _ = self._pair_values(contacts.ints)
        jb, jj, _ = assemble(island.joints, b, island.ids)
        chosen = pressed[pressing.spanning(contacts.ints, contacts.reals, pressed)]
        for _ in range(8):
            impulse = contacts.force[chosen] * h
            jl = np.zeros((len(jj), 1))
            residual = pressing.press(
                island.ids, self._local(island), free, b.center, b.velocity, b.rotation, b.mass, b.inertia, b.inverse,
                b.kind == FREE, chosen, contacts.ints, contacts.reals, mu, target, impulse, jb, jj,
                np.zeros((len(jj), 1)), jl, 1e-14,
            )  # fmt: skip
            island.residual = max(island.residual, residual)
            contacts.force[pressed] = 0.0
            contacts.force[chosen] = impulse / h
            if len(chosen) == len(pressed):
                break
            speed = pressing.normal_speeds(pressed, contacts.ints, contacts.reals, b.center, b.velocity)
            sinking = speed < target[pressed] - 1e-10 * (1.0 + np.abs(target[pressed]))
            sinking[np.isin(pressed, chosen)] = False
            if not sinking.any():
                break
            chosen = np.union1d(chosen, pressed[sinking])

    def _arrive(self, island, contacts, fresh, t, h, wrench):
        """The second half of the kick, then impacts of what has just come to touch."""
        b = self.bodies
        touching = contacts.reals[:, 6] <= self.tolerance.touch
        closing = np.zeros(len(touching), bool)
        new = np.flatnonzero(touching & fresh)
        if len(new):
            speed = pressing.normal_speeds(new, contacts.ints, contacts.reals, b.center, b.velocity)
            closing[new] = speed < -self.tolerance.rest_speed
        before = b.velocity[island.ids]
        self._kick(island, contacts, np.flatnonzero(touching & ~closing), t, h, wrench)
        now = b.velocity[island.ids]
        b.rate[island.ids] = (now - before) / h
        b.steady[island.ids] = not closing.any() and np.abs(now).max() > MOVING and self._sticks(contacts)
        if closing.any():
            self._impact(island, contacts, np.flatnonzero(touching))

    def _sticks(self, contacts: Contacts) -> bool:
        """Whether contacts carry, and none of those that do slides with friction."""
        loaded = contacts.force[:, 0] > 0.0
        mu, _ = self._pair_values(contacts.ints[loaded])
        f = contacts.force[loaded]
        grip = mu * f[:, 0]
        return bool(loaded.any() and ((f[:, 1] ** 2 + f[:, 2] ** 2 < (0.999 * grip) ** 2) | (grip == 0.0)).all())

    def _impact(self, island, contacts, touching):
        """Newton's law for all contacts that close, in rounds, then none closes any more."""
        b = self.bodies
        kept = contacts.force.copy()
        _, restitution = self._pair_values(contacts.ints)
        target = np.zeros(len(contacts.ints))
        for _ in range(20 + 4 * len(touching)):
            speed = pressing.normal_speeds(touching, contacts.ints, contacts.reals, b.center, b.velocity)
            hit = touching[(speed < -self.tolerance.rest_speed) & (restitution[touching] > 0.0)]
            if len(hit) == 0:
                break
            target[touching] = -restitution[touching] * speed
            contacts.force[:] = 0.0
            self._press(island, contacts, hit, b.velocity[island.ids].copy(), 1.0, target)
        contacts.force[:] = 0.0
        self._press(island, contacts, touching, b.velocity[island.ids].copy(), 1.0, np.zeros(len(contacts.ints)))
        contacts.force[:] = kept

    def _blunt(self, island, now, rest, time, t, h, wrench):
        """A step without rebound and without looking for impacts: nothing closes more than its gap allows."""
        found = self._inherit(self.find(island, self._reach(island, h)), now)
        now, _ = self._sift(found, self._touched(now, found), None, None, 0.0, 0.0)
        start = Saved(self.bodies, island.ids)
        gaps = now.reals[:, 6]
        target = -np.maximum(gaps, 0.0) / h
        near = np.arange(len(gaps))
        self._press(island, now, near, self._free(island, time + t, h, wrench), h, target)
        self._drift(island, rest, t + h, h)
        reach = self._reach(island, h)
        after = self.find(island, reach)
        after, _ = self._sift(after, self._touched(now, after), start, rest, t, h)
        jb, jj, jr = assemble(island.joints, self.bodies, island.ids)
        sunk = np.flatnonzero(after.reals[:, 6] < 0.0)
        if len(sunk) or len(jr):
            self._correct(island, after, sunk, jb, jj, jr)
            after = self.find(island, reach)
            after, _ = self._sift(after, self._touched(now, after), start, rest, t, h)
        return self._inherit(after, now)


def _least(contacts: Contacts, fresh) -> float:
    gaps = contacts.reals[fresh, 6]
    return float(gaps.min()) if len(gaps) else np.inf


class Saved:
    """State of some bodies at the start of a step, to go back to, or (kinematic ones) to carry on from at any time."""

    def __init__(self, bodies: Bodies, ids: Ints) -> None:
        self.ids = ids
        self.center = bodies.center[ids]
        self.attitude = bodies.attitude[ids]
        self.velocity = bodies.velocity[ids]
        self.rotation = bodies.rotation[ids]
        self.origin = bodies.origin[ids]

    def restore(self, bodies: Bodies) -> None:
        bodies.center[self.ids] = self.center
        bodies.attitude[self.ids] = self.attitude
        bodies.velocity[self.ids] = self.velocity
        bodies.rotation[self.ids] = self.rotation
        bodies.origin[self.ids] = self.origin

    def carry(self, bodies: Bodies, time: float) -> None:
        """Where bodies of constant velocity and angular velocity are `time` seconds after they were saved."""
        if len(self.ids) == 0:
            return
        for k, i in enumerate(self.ids):
            v = self.velocity[k]
            bodies.center[i] = self.center[k] + time * v[:3]
            bodies.attitude[i] = multiply(exponential(*(time * v[3:])), self.attitude[k])
        place(self.ids, bodies.center, bodies.attitude, bodies.offset, bodies.rotation, bodies.origin)
