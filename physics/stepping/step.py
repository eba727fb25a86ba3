"""Time stepping of islands: kicks and free flight, contact forces, impacts at their time of impact.

A sub-step of length h is half a kick, free flight, half a kick. Each kick solves for the impulses of joints and of
touching contacts: constant forces, resting and sliding with friction are exact. Flight ends early at the first new
contact: its time of impact is found to rounding, the impact is resolved there, and the step continues from it.

Islands are advanced side by side, each with its own clock: one call does a sub-step for all of them, and an impact
interrupts only its own island.

Where bodies hang on joints, or roll or turn in contact, and none slides with friction, the first half kick of a step
mirrors the last half kick of the step before, so that the velocity between the two obeys joints and contacts (the
reversible nonholonomic leapfrog of McLachlan & Perlmutter, J. Nonlinear Sci. 16, 2006). No energy is lost.

`_impact_budget` bounds the impacts of an island in a step. The rest of the step is then taken in one piece (Moreau's
time stepping): everything moves as far as gaps allow, then all touching contacts rebound at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from collision.numeric.kernel import kernel
from physics.contact.contact_features import end_of_pair
from physics.contact.contact_problem import NO_CONTACTS, Contacts, Targets, joined, match
from physics.contact.contact_set import ContactSet, Wrench, merged, rows
from physics.contact.surface_pairs import closing_speed, separation
from physics.joints.articulated_body import ArticulatedBody
from physics.joints.articulated_motion import ArticulatedMotion
from physics.joints.rows import assemble
from physics.model.bodies import Bodies, Saved, coast, drift, followed, point_speeds
from physics.model.free_rotation import METHODS
from physics.solver.batch import Batch, SweptBounds, same_objects, split
from physics.solver.newton import MANY

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

IMPACTS = 32
"""impacts of an island of up to `FEW` bodies in one step, each at its time of impact"""
FEW = 8
"""bodies: larger scenes and larger islands get fewer impacts in a step"""
CROWD = 64
"""bodies: among more, islands are formed as if every body were about to be struck"""
CLOSE = 1e-6
"""m: gaps at loaded contacts that are closed after a step in one piece"""
PASSES = 12
"""position corrections after a step in one piece"""
TRIALS = 24
"""iterations of the search for a time of impact; the last one counts, however deep"""
SUBSTEPS = 4_000
"""the most sub-steps of a step"""
EARLY = 100
"""sub-steps after which a step ends that, at this rate, would take ten times `SUBSTEPS`"""
STRAY = 0.025
"""1: fraction of the thinnest wall by which forces may divert a body within a sub-step"""
MOVING = 1e-6
"""m/s, rad/s: islands slower than this are at rest, and their half kicks are not mirrored"""
ROUNDING = 1e-13
"""m: accuracy of times of impact and of closed contacts (plus the rounding of the coordinates)"""
COARSE = 1e-5
"""1: solver tolerance, relative to the largest speed, of steps in one piece"""
ROUGH_WAY = 1e-3
"""1: the same for displacements of large islands, and for depenetration"""


class Flight(NamedTuple):
    """A flight of islands between contacts, from its start to its end."""

    batch: Batch
    now: Contacts
    """at its start"""
    after: Contacts
    """at its end"""
    fresh: Mask
    """(c,) contacts at its end that are new"""
    start: Saved
    """the bodies at its start"""
    rest: Saved
    """the kinematic bodies at the start of the step"""
    time: float
    """s: of the step's start"""
    t: Array
    """(count,) s: start of the flight within the step"""
    h: Array
    """(count,) s: its length"""
    wrench: Wrench


class Stepper:
    """Moves islands. Holds workspace of the current step; state is in `bodies` and the contacts.

    Raises ArithmeticError (also numpy's LinAlgError, of articulated bodies) where a motion cannot be followed: faster
    than light, not finite, or in too many sub-steps. The state is undefined then.
    """

    def __init__(self, bodies: Bodies, tolerance: Tolerance, integrator: str) -> None:
        self.bodies = bodies
        self.tolerance = tolerance
        self.contact_set = ContactSet(bodies, tolerance)
        self.method = METHODS[integrator]
        self._impacts = np.zeros(0, np.int64)
        self._in_one_piece = np.zeros(0, bool)
        self.near = 0
        """number of bodies that are near to something in this step"""
        self._first_rate = np.zeros((0, 6))
        self._left = np.zeros(0)  # m by which bodies have left their free flight in this step, and now do a second
        self._off = np.zeros(0)
        self._flight = np.zeros((0, 6))

    def coast(self, ids: Ints, wrench: Array, dt: float) -> None:
        """Move bodies that are near to nothing by `dt` seconds under constant wrenches (n, 6)."""
        b = self.bodies
        coast(
            ids, b.center, b.attitude, b.velocity, b.momentum, b.mass, b.inertia, b.inverse, b.offset, b.rotation,
            b.origin, wrench, dt, self.method,
        )  # fmt: skip
        b.steady[ids] = False
        self._check(ids)

    def _check(self, ids: Ints) -> None:
        """Raise ArithmeticError if a body has got faster than light, or its motion is not finite."""
        if not followed(self.bodies.velocity[ids], self.bodies.radius[ids]):
            raise ArithmeticError("it gets faster than light or turns too fast")

    # --- one step ---------------------------------------------------------------------------------------------------

    def advance_apart(
        self, ids: Ints, pairs: Ints, moved: Ints, before: Contacts, kept: bool, time: float, dt: float,
        forces: tuple[Wrench, Array],
    ) -> Contacts:  # fmt: skip
        """`advance` bodies that have no joints and constant forces, in the islands that they form in this step.

        forces: the wrench, and (n,) m, the most that it alone moves the bodies `ids` off their free flight.
        """
        wrench, gain = forces
        b = self.bodies
        spread = np.zeros(b.n)
        spread[ids] = gain + self.tolerance.linear
        if len(ids) > CROWD:  # guess high: the islands' impacts are few anyway, and a second run costs as much again
            spread[ids] += 2.0 * dt * _speeds_near(b, ids, pairs)
        shapes = self.contact_set.shapes
        assert shapes is not None
        way = SweptBounds(b, self.contact_set.shape_of, shapes, dt)
        start, steady, rate = Saved(b, ids), b.steady[ids], b.rate[ids]
        near = way.meeting(pairs, spread)
        left_out = ~same_objects(pairs, pairs[near])
        if left_out.any():
            way.keep()
        batch = split(ids, pairs[near], moved, b)
        out = self.advance(batch, before, kept, time, dt, wrench)
        while True:
            spread[batch.ids] = np.maximum(spread[batch.ids], self._left[batch.ids])
            unseen = np.flatnonzero(left_out)
            unseen = unseen[way.meeting(pairs[unseen], spread)]
            if len(unseen) == 0:
                return out
            near[unseen] = True
            left_out[same_objects(pairs, pairs[unseen])] = False
            batch = split(ids, pairs[near], moved, b)
            again = np.zeros(batch.count, bool)
            again[batch.of_rows(pairs[unseen][:, [0, 2]])] = True
            out = rows(out, ~again[batch.of_rows(out.ints)])
            batch = batch.part(again)
            redone = np.isin(ids, batch.ids)
            start.restore(b, redone)
            b.steady[batch.ids], b.rate[batch.ids] = steady[redone], rate[redone]
            ended = self.advance(batch, before, kept, time, dt, wrench)
            out = joined([out, ended])

    def advance(self, batch: Batch, before: Contacts, kept: bool, time: float, dt: float, wrench: Wrench) -> Contacts:
        """Move islands from `time` by `dt` seconds; returns the contacts at the end.

        before: contacts at the end of the last step; kept: a new search would find the same.
        """
        b = self.bodies
        self._begin(batch)
        rest = Saved(b, batch.moved)
        mine = rows(before, batch.of_rows(before.ints) >= 0)
        if kept and len(batch.moved) == 0:
            now = merged(batch, [mine, NO_CONTACTS])
        else:
            now = self.contact_set.inherit(
                self.contact_set.find(batch, self._way(batch, np.full(batch.count, dt))), mine
            )
            now, _ = self.contact_set.without_false_penetrations(now, self.contact_set.touched(mine, now))
        t = np.zeros(batch.count)
        count = 0
        while (active := dt - t > 1e-12 * dt).any():
            part = batch.part(active)
            own = now if part is batch else rows(now, part.of_rows(now.ints) >= 0)
            h = dt - t[active]
            limit = self._limit(part, h)
            shorter = limit < h
            h[shorter] /= np.ceil(h[shorter] / limit[shorter])
            taken, after = self._take(part, own, rest, time, t[active], h, wrench)
            t[active] += taken
            self._left[part.ids] += taken[part.island] * self._off[part.ids]
            count += 1
            if count >= SUBSTEPS or (count == EARLY and t.min() * 10 * SUBSTEPS < dt * EARLY):
                raise ArithmeticError(f"it needs more than {SUBSTEPS} sub-steps")
            now = after if part is batch else merged(batch, [rows(now, ~active[batch.of_rows(now.ints)]), after])
        return now

    def _begin(self, batch: Batch) -> None:
        b = self.bodies
        n = b.n
        self._impacts = np.zeros(n, np.int64)  # by an island's first body, like the next
        self._in_one_piece = np.zeros(n, bool)
        self._first_rate = np.zeros((n, 6))
        self._left = np.zeros(n)
        self._off = np.zeros(n)
        self._flight = np.zeros((n, 6))
        self._flight[batch.ids] = b.velocity[batch.ids]

    def _take(self, batch: Batch, now: Contacts, rest: Saved, time: float, t: Array, h: Array, wrench):
        """Take one sub-step of up to h (count,) seconds; returns its lengths (count,) and the contacts at its end."""
        b = self.bodies
        if batch.mechanism is not None and len(batch.moved) == 0 and self._least(batch, now)[0] > self.tolerance.touch:
            smooth = self._smooth(batch, batch.mechanism, time + float(t[0]), float(h[0]), wrench)
            if smooth is not None:
                return h, smooth
        moving = batch.largest(point_speeds(b.velocity[batch.ids], b.radius[batch.ids])) > self.tolerance.sleep_speed
        one_piece = self._in_one_piece[batch.ids[batch.start]] | (_large_islands(batch) & moving)
        if one_piece.all():
            return self._one_piece_step(batch, now, rest, time, t, h, wrench)
        if one_piece.any():
            ended = []
            for chosen in (one_piece, ~one_piece):
                part = batch.part(chosen)
                own = rows(now, part.of_rows(now.ints) >= 0)
                h[chosen], after = self._take(part, own, rest, time, t[chosen], h[chosen], wrench)
                ended.append(after)
            return h, merged(batch, ended)
        start = Saved(b, batch.ids)
        after, fresh = self._fly(batch, now, rest, time, t, h, wrench)
        while (
            off_course := self._off_course(batch, start, h)
        ).any():  # forces were greater than the first speed could tell
            h[off_course] *= 0.5
            start.restore(b)
            after, fresh = self._fly(batch, now, rest, time, t, h, wrench)
        hit = self._least(batch, after, fresh) < -self._rounding(batch)
        if not hit.any():
            return h, self._arrive(Flight(batch, now, after, fresh, start, rest, time, t, h, wrench))
        spent = hit & (self._impacts[batch.ids[batch.start]] >= _impact_budget(batch, self.near))
        self._in_one_piece[batch.ids[batch.start[spent]]] = True
        ended = []
        for chosen, how in ((~hit, "whole"), (hit & ~spent, "impact"), (spent, "one_piece")):
            if not chosen.any():
                continue
            part = batch.part(chosen)
            own = now if part is batch else rows(now, part.of_rows(now.ints) >= 0)
            of = chosen[batch.island]
            if how == "one_piece":
                start.restore(b, of)
                h[chosen], own_after = self._one_piece_step(part, own, rest, time, t[chosen], h[chosen], wrench)
                ended.append(own_after)
                continue
            mine = slice(None) if part is batch else part.of_rows(after.ints) >= 0
            own_after, own_fresh = rows(after, mine), fresh[mine]
            flight = Flight(part, own, own_after, own_fresh, start.of(of), rest, time, t[chosen], h[chosen], wrench)
            if how == "impact":
                self._impacts[part.ids[part.start]] += 1
                h[chosen], own_after, own_fresh = self._first_impact(flight)
                flight = flight._replace(h=h[chosen], after=own_after, fresh=own_fresh)
            ended.append(self._arrive(flight))
        return h, merged(batch, ended)

    def _smooth(
        self, batch: Batch, mechanism: ArticulatedBody, time: float, h: float, wrench: Wrench
    ) -> Contacts | None:
        """Move an island in joint coordinates by h seconds; returns None and moves no body if a contact would begin."""
        b = self.bodies
        start = Saved(b, batch.ids)
        way = self._way(batch, np.array([h]))
        if not ArticulatedMotion(mechanism, b, time, wrench, batch.constant, self.contact_set.pair_values).advance(h):
            start.restore(b)
            return None
        self._check(batch.ids)
        after = self.contact_set.find(batch, way)
        after, _ = self.contact_set.without_false_penetrations(after, np.zeros(len(after.ints), bool), start)
        half = np.array([0.5 * h])
        if self._least(batch, after)[0] > self.tolerance.touch and self._limit(batch, half)[0] >= half[0]:
            b.steady[batch.ids] = False
            return after
        start.restore(b)
        return None

    def _way(self, batch: Batch, h: Array) -> Array:
        """(count,) m: bound of the way of any point of an island, or of kinematic bodies near it, in h (count,) s."""
        b = self.bodies
        speed = batch.largest(point_speeds(b.velocity[batch.ids], b.radius[batch.ids]))
        moved = point_speeds(b.velocity[batch.moved], b.radius[batch.moved])
        np.maximum.at(speed, batch.moved_island, moved)
        return 2.0 * h * speed + 10.0 * h * h + 1e-6

    def _limit(self, batch: Batch, h: Array, gaps: bool = True) -> Array:
        """(count,) s: the longest sub-step in which no contact is missed, at most h (count,).

        gaps: whether the distance that bodies have to move before they meet is added to the allowed motion.
        """
        b = self.bodies
        out = h.copy()
        shapes = self.contact_set.shapes
        if shapes is not None:
            _limits(
                batch.pairs, batch.of, b.velocity, b.radius, b.thickness, b.rotation, b.origin,
                self.contact_set.shape_of, shapes.first_surface, shapes.boxes, gaps, out,
            )  # fmt: skip
        return out

    def _off_course(self, batch: Batch, start: Saved, h: Array) -> Mask:
        """(count,) mask of islands that left the motion assumed by `_limit`, so that contacts may have been missed."""
        b = self.bodies
        off = h[batch.island] * point_speeds(b.velocity[batch.ids] - start.velocity, b.radius[batch.ids])
        thinnest = np.full(batch.count, np.inf)
        island = np.maximum(batch.of[batch.pairs[:, 0]], batch.of[batch.pairs[:, 2]])
        for side in (0, 2):
            np.minimum.at(thinnest, island, b.thickness[batch.pairs[:, side]])
        return batch.largest(off) > STRAY * thinnest

    def _rounding(self, batch: Batch) -> Array:
        return ROUNDING + 1e-15 * batch.largest(np.abs(self.bodies.center[batch.ids]).max(axis=1))

    def _least(self, batch: Batch, contacts: Contacts, mask: Mask | slice = slice(None)) -> Array:
        """(count,) m: least gap of each island among the contacts of a mask."""
        out = np.full(batch.count, np.inf)
        np.minimum.at(out, batch.of_rows(contacts.ints[mask]), contacts.reals[mask, 6])
        return out

    # --- flight -----------------------------------------------------------------------------------------------------

    def _fly(self, batch: Batch, now: Contacts, rest: Saved, time: float, t: Array, h: Array, wrench: Wrench):
        """Half a kick and free flight over h; returns the contacts there, and a mask of those that are new."""
        b = self.bodies
        touch = self.tolerance.touch
        ids = batch.ids
        mirrored = batch.all(b.steady[ids])
        if mirrored.any():
            of = mirrored[batch.island]
            b.velocity[ids[of]] += 0.5 * h[batch.island][of, None] * b.rate[ids[of]]
        if not mirrored.all():
            part = batch.part(~mirrored)
            half = 0.5 * h[~mirrored]
            before = b.velocity[part.ids]
            active = np.flatnonzero((now.reals[:, 6] <= touch) & ~mirrored[batch.of_rows(now.ints)])
            self.contact_set.kick(part, now, active, time + float(t[0]), half, wrench, 2.0 * float(half.max()))
            self._first_rate[part.ids] = (b.velocity[part.ids] - before) / half[part.island][:, None]
        begin = Saved(b, np.concatenate([ids, batch.moved]))
        self._drift(batch, rest, t + h, h)
        way = self._way(batch, h)
        rounding = self._rounding(batch)
        to_find = batch
        after, touched, off = self._matched(batch, now, begin, way)
        for _ in range(5):
            worst = np.zeros(batch.count)
            np.maximum.at(worst, batch.of_rows(after.ints[off]), np.abs(after.reals[off, 6]))
            jb, jj, jr, _ = assemble(batch.joints, b, ids)
            worst = np.maximum(worst, np.abs(jr).max(initial=0.0))
            # an island that ended too deep is flown again: its active contacts need no closing, if that is too
            # little to undo the depth (else the time of impact is looked for where the gap jumps)
            deep = self._least(batch, after, ~touched) < -np.maximum(1e-6, 20.0 * worst)
            open_ = (worst > rounding) & ~deep
            if not open_.any():
                break
            to_find = batch.part(open_)
            own = open_[batch.of_rows(after.ints)]
            self.contact_set.correct(
                to_find, after, np.flatnonzero(off & own), np.flatnonzero(~off & own), (jb, jj, jr)
            )
            if to_find is batch:
                after, touched, off = self._matched(batch, now, begin, way)
            else:
                again, again_touched, again_off = self._matched(to_find, now, begin, way[open_])
                flags = np.concatenate(
                    [np.stack([touched, off], axis=1)[~own], np.stack([again_touched, again_off], 1)]
                )
                after = joined([rows(after, ~own), again])
                order = np.argsort(batch.of_rows(after.ints), kind="stable")
                after, (touched, off) = rows(after, order), flags[order].T
        return after, ~touched

    def _matched(self, batch: Batch, now: Contacts, begin: Saved, way: Array):
        """Contacts as the bodies stand, a mask of those that touched in `now`, and a mask of those to be closed.

        begin: the bodies at the start of the flight.
        """
        contact_set = self.contact_set
        after = contact_set.inherit(contact_set.find(batch, way), now)
        after, touched = contact_set.without_false_penetrations(after, contact_set.touched(now, after), begin)
        gaps = after.reals[:, 6]
        return after, touched, touched & (((after.force[:, 0] > 0.0) & (gaps != 0.0)) | (gaps < 0.0))

    def _drift(self, batch: Batch, rest: Saved, time: Array, h: Array) -> None:
        """Free flight over h (count,) seconds, up to `time` (count,) in the step."""
        b = self.bodies
        ids = batch.ids
        each = h[batch.island]
        off = b.velocity[ids] - self._flight[ids]
        self._off[ids] = point_speeds(off, b.radius[ids])
        drift(
            ids, b.center, b.attitude, b.velocity, b.momentum, b.inertia, b.inverse, b.offset, b.rotation, b.origin,
            each, self.method,
        )  # fmt: skip
        self._check(ids)
        if len(batch.moved):
            rest.carry(b, batch.moved, time[batch.moved_island])

    def _first_impact(self, flight: Flight) -> tuple[Array, Contacts, Mask]:
        """Times (count,) of first impact of islands that penetrate at the end of a flight, and the contacts then.

        Newton's method from above on the gap of the deepest contact, safeguarded by false position and bisection.
        """
        batch, now, after, fresh, start, rest, time, t, h, wrench = flight
        low, high = np.zeros(batch.count), h.copy()
        low_gap = np.full(batch.count, np.inf)
        gap = self._least(batch, after, fresh)
        found: list[tuple[Contacts, Mask]] = []
        part, names = batch, np.arange(batch.count)  # islands that are still searched
        for k in range(TRIALS):
            cut = high + gap / np.maximum(self._closing(part, after, fresh, gap), 1e-300)
            if k % 3 == 2:
                with np.errstate(invalid="ignore"):
                    cut = np.where(low_gap < np.inf, low + (high - low) * low_gap / (low_gap - gap), cut)
            # a contact that penetrates from the very start (a feature that comes into view) is not worth bisecting
            cut = np.where((low < cut) & (cut < high), cut, np.where((low == 0.0) & (k > 1), 1e-3, 0.5) * (low + high))
            last = ~((low < cut) & (cut < high)) | (high < 1e-9 * h[names]) | (k == TRIALS - 1)
            cut = np.where(last, high, cut)
            of = np.isin(batch.island, names)
            start.restore(self.bodies, of)
            own = rows(now, part.of_rows(now.ints) >= 0)
            trial, trial_fresh = self._fly(part, own, rest, time, t[names], cut, wrench)
            g = self._least(part, trial, trial_fresh)
            tolerance = self._rounding(part)
            over, done = g < -tolerance, last | (np.abs(g) <= tolerance)
            h[names[done]] = cut[done]
            of_done = done[part.of_rows(trial.ints)]
            found.append((rows(trial, of_done), trial_fresh[of_done]))
            if done.all():
                break
            early = ~over & ~done
            low, low_gap = np.where(early, cut, low), np.where(early, g, low_gap)
            # an island that stopped early keeps the contacts of its last flight too far
            high, gap = np.where(over, cut, high), np.where(over, g, gap)
            keep_old = early[part.of_rows(after.ints)]
            take_new = over[part.of_rows(trial.ints)] & ~of_done
            after = joined([rows(after, keep_old), rows(trial, take_new)])
            fresh = np.concatenate([fresh[keep_old], trial_fresh[take_new]])
            going = ~done
            part, names = part.part(going), names[going]
            low, high, low_gap, gap = low[going], high[going], low_gap[going], gap[going]
        contacts = joined(c for c, _ in found)
        fresh = np.concatenate([f for _, f in found])
        order = np.argsort(batch.of_rows(contacts.ints), kind="stable")
        return h, rows(contacts, order), fresh[order]

    def _closing(self, batch: Batch, contacts: Contacts, fresh: Mask, gap: Array) -> Array:
        """(count,) m/s: closing speed of the deepest new contact of each island."""
        island = batch.of_rows(contacts.ints)
        which = np.flatnonzero(fresh & (contacts.reals[:, 6] == gap[island]))
        _, first = np.unique(island[which], return_index=True)
        out = np.zeros(batch.count)
        out[island[which[first]]] = -self.contact_set.speeds(which[first], contacts)
        return out

    # --- arrival ----------------------------------------------------------------------------------------------------

    def _arrive(self, flight: Flight) -> Contacts:
        """End a flight: second half kick, and impacts; returns the contacts."""
        batch, now, after, fresh, start, rest, time, t, h, wrench = flight
        b = self.bodies
        mirrored = batch.all(b.steady[batch.ids])
        self._land(batch, after, fresh, time + float(t[0]), 0.5 * h, wrench)
        new = np.zeros(batch.count, bool)
        new[batch.of_rows(after.ints[fresh & (after.reals[:, 6] <= self.tolerance.touch)])] = True
        again = ~mirrored & batch.all(b.steady[batch.ids]) & ~new
        if not again.any():
            return after
        # the first of mirrored half kicks has none to mirror: the mean of both halves serves, to second order
        part = batch.part(again)
        rate = 0.5 * (b.rate[part.ids] + self._first_rate[part.ids])
        start.restore(b, again[batch.island])
        if part.joints:  # the added impulse acts along the joints at their poses of the start (as in RATTLE)
            added = rate - self._first_rate[part.ids]
            velocity = b.velocity[part.ids]
            self.contact_set.solve(part, NO_CONTACTS, np.zeros(0, np.int64), added, h, Targets(np.zeros(0)))
            rate -= b.velocity[part.ids]
            b.velocity[part.ids] = velocity
        b.rate[part.ids] = rate
        own = rows(now, part.of_rows(now.ints) >= 0)
        flown, fresh = self._fly(part, own, rest, time, t[again], h[again], wrench)
        self._land(part, flown, fresh, time + float(t[again][0]), 0.5 * h[again], wrench)
        return merged(batch, [rows(after, part.of_rows(after.ints) < 0), flown])

    def _land(self, batch: Batch, contacts: Contacts, fresh: Mask, t: float, h: Array, wrench: Wrench) -> None:
        """Second half kick of h (count,) seconds, then the impacts of new contacts."""
        b = self.bodies
        ids = batch.ids
        touching = contacts.reals[:, 6] <= self.tolerance.touch
        closing = np.zeros(len(touching), bool)
        new = np.flatnonzero(touching & fresh)
        if len(new):
            closing[new] = self.contact_set.speeds(new, contacts) < -self.tolerance.rest_speed
        before = b.velocity[ids]
        self.contact_set.kick(batch, contacts, np.flatnonzero(touching & ~closing), t, h, wrench)
        now = b.velocity[ids]
        b.rate[ids] = (now - before) / h[batch.island][:, None]
        struck = np.zeros(batch.count, bool)
        struck[batch.of_rows(contacts.ints[closing])] = True
        steady = ~struck & (batch.largest(np.abs(now).max(axis=1)) > MOVING) & self.contact_set.sticks(batch, contacts)
        b.steady[ids] = steady[batch.island]
        if struck.any():
            part = batch.part(struck)
            self.contact_set.impact(part, contacts, np.flatnonzero(touching & struck[batch.of_rows(contacts.ints)]))

    def _one_piece_step(self, batch: Batch, now: Contacts, rest: Saved, time: float, t: Array, h: Array, wrench):
        """Moreau's time stepping: move as far as gaps allow, then resolve the rebound of all touching contacts.

        Steps at most h (count,) seconds, less where rotation would make the gaps inexact; returns the seconds stepped
        (count,) and the contacts at their end.
        """
        b = self.bodies
        h = self._limit(batch, h, gaps=False)
        contact_set = self.contact_set
        way = self._way(batch, h)
        found = contact_set.inherit(contact_set.find(batch, way, 1.0), now)
        now, _ = contact_set.without_false_penetrations(found, contact_set.touched(now, found))
        begin = Saved(b, np.concatenate([batch.ids, batch.moved]))
        free = contact_set.free(batch, time + float(t[0]), h, wrench)
        before = b.velocity[batch.ids]
        b.velocity[batch.ids] = free
        near = np.arange(len(now.ints))
        came = contact_set.speeds(near, now)
        each = h[batch.of_rows(now.ints)]
        target = (
            -np.maximum(now.reals[:, 6], -CLOSE) / each
        )  # deeper penetration is corrected afterwards, without speed
        near = np.flatnonzero(target > came - 0.5 * way[batch.of_rows(now.ints)] / each)
        left = contact_set.residual  # of velocities: errors of displacements are corrected after the motion
        tolerance = ROUGH_WAY if _large_islands(batch).any() else COARSE
        contact_set.solve(batch, now, near, free, h, Targets(target), tolerance)
        contact_set.residual = left
        reached = now.force[:, 0] > 0.0
        self._drift(batch, rest, t + h, h)
        after = self._depenetrated(batch, now, begin, way)
        row = match(now.ints, after.ints)
        known = row >= 0
        met = (
            after.reals[:, 6] <= np.where(_large_islands(batch), CLOSE, self.tolerance.touch)[batch.of_rows(after.ints)]
        )
        met[known] |= reached[row[known]]
        _, restitution = contact_set.pair_values(after.ints)
        every = np.arange(len(after.ints))
        b.velocity[batch.ids] = before
        began = contact_set.speeds(every, after)
        b.velocity[batch.ids] = free
        came = contact_set.speeds(every, after)
        # contacts with a small gap do not arrive with the speed that forces add over the whole step
        near = np.flatnonzero(known & (came < np.minimum(began, 0.0)))
        gap = np.maximum(now.reals[row[near], 6], 0.0)
        pull = (began - came)[near] / h[batch.of_rows(after.ints[near])]
        came[near] = np.maximum(came[near], -np.sqrt(began[near] ** 2 + 2.0 * pull * gap))
        back = np.where(came < -self.tolerance.rest_speed, -restitution * came, 0.0)
        contact_set.rebound(batch, after, np.flatnonzero(met), free, h, back, COARSE)
        b.rate[batch.ids] = (b.velocity[batch.ids] - before) / h[batch.island][:, None]
        b.steady[batch.ids] = False
        return h, after

    def _depenetrated(self, batch: Batch, now: Contacts, begin: Saved, way: Array) -> Contacts:
        """Correct positions until loaded contacts just touch and joints hold, in a few passes; returns the contacts.

        In large islands only penetrations deeper than `tolerance.linear` are corrected.
        """
        contact_set = self.contact_set
        done: list[Contacts] = []
        part = batch
        for k in range(PASSES + 1):
            after = contact_set.inherit(contact_set.find(part, way), now)
            after, _ = contact_set.without_false_penetrations(after, contact_set.touched(now, after), begin)
            own = part.of_rows(after.ints)
            jb, jj, jr, _ = assemble(part.joints, self.bodies, part.ids)
            gaps = after.reals[:, 6]
            off = (gaps < 0.0) | ((gaps != 0.0) & (gaps < CLOSE) & (after.force[:, 0] > 0.0))
            wrong = np.full(part.count, len(jr) > 0 and np.abs(jr).max() > ROUNDING)
            allowed = np.where(_large_islands(part), self.tolerance.linear, self._rounding(part))
            wrong[own[off & (np.abs(gaps) > allowed[own])]] = True
            if k == PASSES or not wrong.any():
                break
            done.append(rows(after, ~wrong[own]))
            after, off = rows(after, wrong[own]), off[wrong[own]]
            part, way = part.part(wrong), way[wrong]
            own = part.of_rows(after.ints)
            deepest = -self._least(part, after)
            sunk = (deepest > self.tolerance.linear) & (len(jr) == 0)
            if sunk.any():
                near = sunk[own] & (after.reals[:, 6] < 2.0 * deepest[own])
                contact_set.push_apart(part.part(sunk), after, np.flatnonzero(near), ROUGH_WAY)
            if not sunk.all():
                rest = ~sunk[own]
                few = part.part(~sunk)
                contact_set.correct(few, after, np.flatnonzero(off & rest), np.flatnonzero(~off & rest), (jb, jj, jr))
        return merged(batch, [*done, after])


def _speeds_near(b: Bodies, ids: Ints, pairs: Ints) -> Array:
    """(n,) m/s: bound of the speeds of points of the bodies `ids` and of bodies near to them, as after an impact."""
    speed = np.zeros(b.n)
    speed[ids] = point_speeds(b.velocity[ids], b.radius[ids])
    out = speed.copy()
    near = pairs[:, [0, 2]]
    near = near[np.append(True, (near[1:] != near[:-1]).any(axis=1))] if len(near) else near
    np.maximum.at(out, near[:, 0], speed[near[:, 1]])
    np.maximum.at(out, near[:, 1], speed[near[:, 0]])
    return out[ids]


def _large_islands(batch: Batch) -> Mask:
    """(count,) mask of islands that are stepped in one piece while they move, with contacts solved by sweeps."""
    return (np.bincount(batch.island) > MANY) & (len(batch.joints) == 0)


def _impact_budget(batch: Batch, total: int) -> Ints:
    """(count,) impacts that each island may have in a step, `total` being the bodies that are near to something."""
    return IMPACTS * FEW // (np.bincount(batch.island) * max(total, FEW))


@kernel
def _limits(pairs, of, velocity, radius, thickness, rotations, origins, shape_of, first_surface, boxes, gaps, out):
    """Lower `out` (s, by island) to the least time in which two bodies could overlap by a quarter of the thinner."""
    first = 0
    while first < len(pairs):
        a, b = pairs[first, 0], pairs[first, 2]
        last = end_of_pair(pairs, first)
        speed = closing_speed(velocity, radius, a, b)
        island = max(of[a], of[b])
        way = 0.25 * min(thickness[a], thickness[b])
        if way < out[island] * speed:  # then it matters how far they have to go before they meet
            gap = np.inf if gaps else 0.0
            for i in range(first, last):
                if gap <= 0.0:
                    break
                box_a = boxes[first_surface[shape_of[a]] + pairs[i, 1]]
                box_b = boxes[first_surface[shape_of[b]] + pairs[i, 3]]
                gap = min(gap, separation(box_a, rotations[a], origins[a], box_b, rotations[b], origins[b], gap))
            out[island] = min(out[island], (way + max(gap, 0.0)) / speed)
        first = last
