"""Contacts at one instant: finding them, pressing on them, and rebound where they close.

Impacts follow Newton's or Poisson's law, each contact with its own coefficient, as far as that makes no energy
(`rebound`). Several at once are resolved in rounds: only the contacts that close rebound, those that this makes close
rebound next (generalised reflections, Smith, Kaufman, Vouga, Tamstorf & Grinspun, ACM Trans. Graph. 31, 2012), so a
row of touching balls passes a blow on.

Poisson's law takes two steps (Glocker & Pfeiffer, Nonlinear Dynamics 7, 1995; Anitescu & Potra, Nonlinear Dynamics 14,
1997). Compression: what closes is stopped, as without restitution. Restitution: each contact gets at least e times the
normal impulse that stopped it, more if it would close otherwise. Coulomb's cone holds in each of the two by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from physics.contact import contact_problem as pressing
from physics.contact import penetration_filter as crossing
from physics.contact import points as contact
from physics.contact import rebound
from physics.contact.candidates import within
from physics.contact.contact_problem import NO_CONTACTS, Contacts
from physics.joints.rows import assemble, holding
from physics.model.bodies import FREE, Bodies, Saved, place
from physics.model.shapes import Shapes
from physics.solver.batch import Batch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Wrench = Callable[[Ints, float], Array]
"""(n, 6) N, N·m of the bodies (n,) at a time, world axes, about their centres of mass"""

EXACT = 1e-14
"""1: residual of the contact laws, relative to the largest speed, at which the solver ends"""
MARGIN = 0.05
"""1: contacts with a gap of up to this part of the thinner part's thickness are listed"""
DEEPEST = 0.3
"""1: penetration is looked for to this part of that thickness; deeper, the nearest face may be the other side's"""


class Touching:
    """What contacts do at one instant. It holds scratch and the largest residual since that was last set to 0."""

    def __init__(self, bodies: Bodies, tolerance: Tolerance) -> None:
        self.bodies = bodies
        self.tolerance = tolerance
        self.residual = 0.0
        """m/s, largest that the solver left"""
        self.slips = False
        """whether a dry joint slid in the last kick of a batch with joints"""
        self.shapes: Shapes | None = None
        self.shape_of = np.zeros(0, np.int64)
        self.friction = np.zeros(0)
        self.restitution = np.zeros(0)
        self.poisson = np.zeros(0, bool)
        """(n,) whether an object's restitution is meant by Poisson's law"""
        self._ints = np.empty((256, 6), np.int64)
        self._reals = np.empty((256, 7))
        self._stamps: tuple[Ints, ...] = ()
        self._whole = np.zeros((0, 6))  # box of each shape
        self._faceted = np.zeros(0, bool)  # shapes that reach nowhere beyond their triangles

    def reserve(self, n: int) -> None:
        """Make room for ids below n."""
        more = max(0, n - len(self.friction))
        self.friction = np.concatenate([self.friction, np.full(more, np.nan)])
        self.restitution = np.concatenate([self.restitution, np.full(more, np.nan)])
        self.poisson = np.concatenate([self.poisson, np.zeros(more, bool)])
        self.shape_of = np.concatenate([self.shape_of, np.full(more, -1, np.int64)])

    def use(self, shapes: Shapes) -> None:
        """Take the shapes that bodies may have from now on."""
        self.shapes = shapes
        sizes = len(shapes.vertices), len(shapes.edges), len(shapes.kinds)
        self._stamps = tuple(np.zeros(n + 1, np.int64) for n in sizes)
        ends = np.append(shapes.first_surface[1:], len(shapes.kinds))
        each = [slice(*ends_of) for ends_of in zip(shapes.first_surface, ends, strict=True)]
        self._whole = np.array(
            [[*shapes.boxes[s, :3].min(axis=0), *shapes.boxes[s, 3:].max(axis=0)] for s in each]
        ).reshape(-1, 6)
        self._faceted = np.array([not shapes.kinds[s].any() for s in each], bool)

    def find(self, batch: Batch, way: Array, margin: float = MARGIN) -> Contacts:
        """Contact points as the bodies stand; forces are zero. way: (count,) m that things move in what is looked at.

        margin: gaps up to this part of the thinner part's thickness, and no farther than the way, are listed.
        Penetration is looked for to `DEEPEST` of that thickness.
        """
        if len(batch.pairs) == 0 or self.shapes is None:
            return NO_CONTACTS
        b = self.bodies
        thickness = b.thickness[batch.pairs[:, [0, 2]]].min(axis=1)
        far = way[batch.of_rows(batch.pairs[:, [0, 2]])]
        margins = np.maximum(np.minimum(far, margin * thickness), 1e-6)
        depths = DEEPEST * thickness
        # rows of an object pair that does not come within the margins only lie behind a face
        faceted = self._faceted[self.shape_of[batch.pairs[:, [0, 2]]]].all(axis=1)
        reach = np.maximum(margins, depths)
        near = within(
            batch.pairs, b.center, b.radius, b.rotation, b.origin, self.shape_of, self.shapes.boxes,
            self.shapes.first_surface, self._whole, reach, np.where(faceted, margins, reach),
        )  # fmt: skip
        pairs, margins, depths = batch.pairs[near], margins[near], depths[near]
        while True:
            n = contact.find(
                pairs, b.rotation, b.origin, self.shape_of, self.shapes, margins, depths, self._ints, self._reals,
                *self._stamps,
            )  # fmt: skip
            if n <= len(self._ints):
                return Contacts(self._ints[:n].copy(), self._reals[:n].copy(), np.zeros((n, 3)))
            self._ints = np.empty((2 * n, 6), np.int64)
            self._reals = np.empty((2 * n, 7))

    def inherit(self, now: Contacts, before: Contacts) -> Contacts:
        """Forces of contacts that were there before: the solver's first guess."""
        if len(now.ints) and len(before.ints):
            row = pressing.match(before.ints, now.ints)
            known = row >= 0
            now.force[known] = before.force[row[known]]
        return now

    def touched(self, before: Contacts, now: Contacts) -> NDArray[np.bool_]:
        """(c,) which contacts of `now` touched in `before`."""
        touched = np.zeros(len(now.ints), bool)
        if len(before.ints) and len(now.ints):
            row = pressing.match(before.ints, now.ints)
            known = row >= 0
            touched[known] = before.reals[row[known], 6] <= self.tolerance.touch
        return touched

    def sift(
        self, contacts: Contacts, touched: NDArray[np.bool_], begin: Saved | None = None
    ) -> tuple[Contacts, NDArray[np.bool_]]:
        """Without the rows that only lie behind a face; and which of the others touched, or were inside all along.

        begin: the bodies, and what carries them, a little earlier; None: nothing has moved yet.
        """
        deep = ~touched & (contacts.reals[:, 6] < -self.tolerance.touch)
        if not deep.any():
            return contacts, touched
        b = self.bodies
        rotation, origin = b.rotation, b.origin
        if begin is not None:
            rotation, origin = rotation.copy(), origin.copy()
            rotation[begin.ids], origin[begin.ids] = begin.rotation, begin.origin
        verdict = crossing.sift(
            contacts.ints, contacts.reals, touched, b.rotation, b.origin, rotation, origin, self.shape_of, self.shapes,
            self.tolerance.touch,
        )  # fmt: skip
        real = verdict != crossing.NOTHING
        return rows(contacts, real), (touched | (verdict == crossing.SUNK))[real]

    def pair_values(self, ints: Ints) -> tuple[Array, Array]:
        """Friction and restitution (c,) of contacts, see `behaviours.Reaction`."""
        a, b = ints[:, 0], ints[:, 1]
        fa, fb = self.friction[a], self.friction[b]
        friction = np.where(np.isnan(fa), fb, np.where(np.isnan(fb), fa, np.sqrt(fa * fb)))
        ea, eb = self.restitution[a], self.restitution[b]
        restitution = np.where(np.isnan(ea), eb, np.where(np.isnan(eb), ea, np.fmin(ea, eb)))
        return np.where(np.isnan(friction), 0.5, friction), np.where(np.isnan(restitution), 0.0, restitution)

    def by_poisson(self, ints: Ints) -> NDArray[np.bool_]:
        """(c,) whether contacts follow Poisson's law: that of the lesser restitution; Poisson's, if both are equal."""
        a, b = ints[:, 0], ints[:, 1]
        ea, eb = self.restitution[a], self.restitution[b]
        return (self.poisson[a] & (np.isnan(eb) | (ea <= eb))) | (self.poisson[b] & (np.isnan(ea) | (eb <= ea)))

    def speeds(self, rows: Ints, contacts: Contacts) -> Array:
        """(r,) m/s at which contacts part along their normals."""
        b = self.bodies
        return pressing.normal_speeds(rows, contacts.ints, contacts.reals, b.center, b.velocity)

    # --- forces ---------------------------------------------------------------------------------------------------

    def free(self, batch: Batch, t: float, h: Array, wrench: Wrench) -> Array:
        """Velocities (n, 6) after a kick of h (count,) seconds without constraints."""
        b = self.bodies
        ids = batch.ids
        w = wrench(ids, t)
        each = h[batch.island]
        free = b.velocity[ids].copy()
        free[:, :3] += (each / b.mass[ids])[:, None] * w[:, :3]
        if w[:, 3:].any():
            r = b.rotation[ids]
            free[:, 3:] += each[:, None] * np.einsum("nij,njk,nlk,nl->ni", r, b.inverse[ids], r, w[:, 3:])
        return free

    def kick(
        self, batch: Batch, contacts: Contacts, pressed: Ints, t: float, h: Array, wrench: Wrench, ahead: float = 0.0
    ) -> None:
        """Forces over h (count,) seconds, and what joints and the contacts `pressed` (rows) make of them.

        ahead: see `joints.holding`.
        """
        target = np.zeros(len(contacts.ints))
        self.press(batch, contacts, pressed, self.free(batch, t, h, wrench), h, target, ahead=ahead)

    def press(
        self, batch: Batch, contacts: Contacts, pressed: Ints, free: Array, h: Array, target: Array,
        tolerance: float = EXACT, least: Array | None = None, ahead: float = 0.0,
    ) -> None:  # fmt: skip
        """Solve for the velocities that contacts and joints make of `free` (n, 6).

        target: (c,) m/s at which contacts part at least; least: (c,) N·s, their least normal impulses. Contact forces
        (impulse over h) are kept on `contacts`. Of each patch only the rows that span it are solved at first; others
        that would sink in are added.
        """
        b = self.bodies
        if len(pressed) == 0 and not batch.joints:
            b.velocity[batch.ids] = free
            return
        mu, _ = self.pair_values(contacts.ints)
        each = h[batch.of_rows(contacts.ints)][:, None]
        held = holding(batch.joints, b, batch.ids, self.pair_values, ahead)
        local = self._local(batch)
        chosen = pressed[pressing.spanning(contacts.ints, contacts.reals, pressed)]
        if least is None:
            least = np.zeros(len(contacts.ints))
        else:
            chosen = np.union1d(chosen, pressed[least[pressed] > 0.0])
        for _ in range(8):
            impulse = contacts.force[chosen] * each[chosen]
            residual, self.slips = pressing.press(
                batch.ids, local, free, b.center, b.velocity, b.rotation, b.mass, b.inertia, b.inverse,
                b.kind == FREE, chosen, contacts.ints, contacts.reals, mu, target, least, impulse, held, tolerance,
            )  # fmt: skip
            contacts.force[pressed] = 0.0
            contacts.force[chosen] = impulse / each[chosen]
            if len(chosen) == len(pressed):
                break
            slowest = target[pressed] - 1e-10 * (1.0 + np.abs(target[pressed])) - 2.0 * residual
            sinking = self.speeds(pressed, contacts) < slowest
            sinking[np.searchsorted(pressed, chosen)] = False
            if not sinking.any():
                break
            chosen = np.union1d(chosen, pressed[sinking])
        self.residual = max(self.residual, residual)

    def rebound(
        self, batch: Batch, contacts: Contacts, pressed: Ints, free: Array, h: Array, target: Array,
        tolerance: float = EXACT,
    ) -> None:  # fmt: skip
        """`press` with restitution where `target`, the speed of Newton's law, is not 0, as far as it makes no energy.

        A connected group with a contact by Poisson's law takes its two steps.
        """
        stored = (target > 0.0) & self.by_poisson(contacts.ints)
        if not stored[pressed].any():
            self._reflect(batch, contacts, pressed, free, h, target, tolerance)
            return
        b = self.bodies
        bodies = self._rows(batch, contacts, pressed)[0]
        of_body, group, count = rebound.groups(len(batch.ids), bodies, assemble(batch.joints, b, batch.ids)[0])
        in_two = np.zeros(count, bool)
        in_two[group[stored[pressed]]] = True
        mine = in_two[group]
        reflected = None
        if not mine.all():
            self._reflect(batch, contacts, pressed[~mine], free, h, target, tolerance)
            reflected = b.velocity[batch.ids]
        self._restore(batch, contacts, pressed[mine], free, h, target, stored, tolerance)
        if reflected is not None:
            b.velocity[batch.ids] = np.where(in_two[of_body, None], b.velocity[batch.ids], reflected)

    def _reflect(self, batch, contacts, pressed, free, h, target, tolerance) -> None:
        """`rebound` by Newton's law alone."""
        self.press(batch, contacts, pressed, free, h, target, tolerance)
        if target[pressed].any():
            self._limit(batch, contacts, pressed, free, h, tolerance)

    def _restore(self, batch, contacts, pressed, free, h, target, stored, tolerance) -> None:
        """`rebound` in two steps; `stored` (c,): contacts by Poisson's law, others reach `target` in the second."""
        b = self.bodies
        b.velocity[batch.ids] = free
        mine = pressed[stored[pressed]]
        back = np.zeros(len(target))
        back[mine] = target[mine] / -self.speeds(mine, contacts)
        self.press(batch, contacts, pressed, free, h, np.zeros(len(target)), tolerance)
        velocity, force = b.velocity[batch.ids], contacts.force[pressed]
        each = h[batch.of_rows(contacts.ints[pressed])]
        least = np.zeros(len(target))
        least[pressed] = back[pressed] * force[:, 0] * each
        contacts.force[pressed] = back[pressed, None] * force
        self.press(batch, contacts, pressed, velocity, h, np.where(stored, 0.0, target), tolerance, least)
        contacts.force[pressed] += force
        self._limit(batch, contacts, pressed, free, h, tolerance, (velocity, force))

    def _rows(self, batch: Batch, contacts: Contacts, pressed: Ints):
        """Bodies (c, 2), Jacobian (c, 3, 12) and bias (c, 3) of the rows `pressed`."""
        b = self.bodies
        none = np.zeros(len(contacts.ints))
        return pressing.contact_rows(
            pressed, contacts.ints, contacts.reals, none, none, self._local(batch), batch.ids, b.center, b.velocity,
            b.kind == FREE,
        )[:3]  # fmt: skip

    def _limit(self, batch, contacts, pressed, free, h, tolerance, without=None) -> None:
        """Take back of velocities and forces what makes energy, in each connected group.

        without: velocities (n, 6) and forces (c, 3) without restitution, where they are known.
        """
        b = self.bodies
        cb, cj, bias = self._rows(batch, contacts, pressed)
        jb, *_ = assemble(batch.joints, b, batch.ids)
        of_body, group, count = rebound.groups(len(batch.ids), cb, jb)
        velocity, force = b.velocity[batch.ids], contacts.force[pressed]
        before, after = (rebound.relative(cb, cj, bias, v) for v in (free, velocity))
        each = h[batch.of_rows(contacts.ints[pressed])][:, None]
        wrong = rebound.gained(force * each, before, after, group, count)
        if not wrong.any():
            return
        if without is None:
            self.press(batch, contacts, pressed, free, h, np.zeros(len(contacts.ints)), tolerance)
            without = b.velocity[batch.ids], contacts.force[pressed]
        least, least_force = without
        least_after = rebound.relative(cb, cj, bias, least)
        sigma = rebound.share(force * each, least_force * each, before, after, least_after, group, count)
        sigma[~wrong] = 1.0
        part = sigma[of_body, None]
        b.velocity[batch.ids] = np.where(part < 1.0, least + part * (velocity - least), velocity)
        part = sigma[group, None]
        contacts.force[pressed] = np.where(part < 1.0, least_force + part * (force - least_force), force)

    def correct(self, batch: Batch, contacts: Contacts, chosen: Ints, others: Ints, jb, jj, jr) -> None:
        """The least move that closes the gaps of the rows `chosen` and the joints' residuals; `others` stay open."""
        b = self.bodies
        pressing.correct(
            batch.ids, self._local(batch), b.center, b.attitude, b.velocity, b.rotation, b.mass, b.inertia, b.inverse,
            b.kind == FREE, chosen, others, contacts.ints, contacts.reals, jb, jj, jr,
        )  # fmt: skip
        place(batch.ids, b.center, b.attitude, b.offset, b.rotation, b.origin)

    def push_apart(self, batch: Batch, contacts: Contacts, chosen: Ints, tolerance: float) -> None:
        """The least move after which none of the rows `chosen` has a gap below 0, to `tolerance` of the deepest."""
        b = self.bodies
        pressing.push_apart(
            batch.ids, self._local(batch), b.center, b.attitude, b.velocity, b.rotation, b.mass, b.inertia, b.inverse,
            b.kind == FREE, chosen, contacts.ints, contacts.reals, tolerance,
        )  # fmt: skip
        place(batch.ids, b.center, b.attitude, b.offset, b.rotation, b.origin)

    def _local(self, batch: Batch) -> Ints:
        local = np.full(self.bodies.n, -1)
        local[batch.ids] = np.arange(len(batch.ids))
        return local

    def sticks(self, batch: Batch, contacts: Contacts) -> NDArray[np.bool_]:
        """(count,) whether joints or contacts of an island carry, and none of those that do slides with friction."""
        loaded = contacts.force[:, 0] > 0.0
        mu, _ = self.pair_values(contacts.ints[loaded])
        f = contacts.force[loaded]
        grip = mu * f[:, 0]
        slides = (f[:, 1] ** 2 + f[:, 2] ** 2 >= (0.999 * grip) ** 2) & (grip != 0.0)
        island = batch.of_rows(contacts.ints[loaded])
        # what moves by itself, and forces that change, may pull at a joint otherwise in the next step
        lasting = len(batch.joints) > 0 and batch.constant and len(batch.moved) == 0
        carries = np.full(batch.count, lasting)
        carries[island] = True
        carries[island[slides]] = False
        if batch.joints and self.slips:
            carries[:] = False
        return carries

    def impact(self, batch: Batch, contacts: Contacts, touching: Ints) -> None:
        """Rebound of all of the rows `touching` that close, in rounds, then none closes any more."""
        b = self.bodies
        kept = contacts.force.copy()
        _, restitution = self.pair_values(contacts.ints)
        target = np.zeros(len(contacts.ints))
        island = batch.of_rows(contacts.ints)
        one = np.ones(batch.count)
        most = int(np.bincount(island[touching], minlength=1).max())
        for _ in range(20 + 4 * most):
            speed = self.speeds(touching, contacts)
            hit = touching[(speed < -self.tolerance.rest_speed) & (restitution[touching] > 0.0)]
            if len(hit) == 0:
                break
            target[touching] = -restitution[touching] * speed
            contacts.force[:] = 0.0
            struck = np.zeros(batch.count, bool)
            struck[island[hit]] = True
            part = batch.part(struck)
            self.rebound(part, contacts, hit, b.velocity[part.ids].copy(), one, target)
        contacts.force[:] = 0.0
        self.press(batch, contacts, touching, b.velocity[batch.ids].copy(), one, np.zeros(len(contacts.ints)))
        contacts.force[:] = kept


def rows(contacts: Contacts, mask: NDArray[np.bool_] | slice) -> Contacts:
    """The contacts of a mask, by value."""
    return Contacts(contacts.ints[mask], contacts.reals[mask], contacts.force[mask])


def merged(batch: Batch, parts: list[Contacts]) -> Contacts:
    """Contacts of several parts of a batch, in the order of its islands."""
    if len(parts) == 1:
        return parts[0]
    ints, reals, force = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.argsort(batch.of_rows(ints), kind="stable")
    return Contacts(ints[order], reals[order], force[order])
