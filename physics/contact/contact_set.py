"""`ContactSet`: find contacts at one instant, solve for their forces, and resolve impacts.

Impacts follow Newton's or Poisson's law. Each contact has its own coefficient of restitution, lowered where an
impact would gain energy (`impact_energy`). Simultaneous impacts are resolved in rounds: contacts that close rebound,
then contacts that this makes close (generalised reflections, Smith, Kaufman, Vouga, Tamstorf & Grinspun, ACM Trans.
Graph. 31, 2012). A row of touching balls so passes an impulse on.

Poisson's law has two phases (Glocker & Pfeiffer, Nonlinear Dynamics 7, 1995; Anitescu & Potra, Nonlinear Dynamics 14,
1997). Compression stops contacts that close, as without restitution. Restitution gives each contact at least e times
the normal impulse of its compression, and more if the contact would close otherwise. Each phase obeys Coulomb's cone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from physics.contact import contact_problem, impact_energy, penetration_filter
from physics.contact.contact_problem import NO_CONTACTS, Contacts, MovingBodies, Targets, joined
from physics.contact.narrow_phase import find
from physics.contact.surface_pairs import within
from physics.joints.rows import assemble, joint_rows
from physics.model.bodies import Bodies, Saved, place
from physics.model.shapes import Shapes
from physics.solver.batch import Batch

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Wrench = Callable[[Ints, float], Array]
"""(n, 6) N, N·m of the bodies (n,) at a time, world axes, about their centres of mass"""

EXACT = 1e-14
"""1: residual of the contact laws, relative to the largest speed, at which the solver ends"""
MARGIN = 0.05
"""1: gaps up to this fraction of the thinner body's thickness are listed"""
DEEPEST = 0.3
"""1: depths up to this fraction of that thickness are listed; beyond it the nearest face may be on the far side"""


class ContactSet:
    """Contacts of the bodies at their poses. Holds workspace, pair coefficients and the largest solver residual."""

    def __init__(self, bodies: Bodies, tolerance: Tolerance) -> None:
        self.bodies = bodies
        self.tolerance = tolerance
        self.residual = 0.0
        """m/s: largest residual of the solver since this was last set to 0"""
        self.slips = False
        """whether a joint with friction slid in the last kick of a batch with joints"""
        self.shapes: Shapes | None = None
        self.shape_of = np.zeros(0, np.int64)
        self.friction = np.zeros(0)
        self.restitution = np.zeros(0)
        self.poisson = np.zeros(0, bool)
        """(n,) whether an object's restitution is meant by Poisson's law"""
        self.material = np.zeros((0, 2), np.int64)
        """(n, 2) number of an object's material in the table of pairs for friction, and for restitution; 0: none"""
        self.pair_table = np.full((1, 1, 2), np.nan)
        """(m, m, 2) friction and restitution of pairs of materials, nan where they are combined"""
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
        self.material = np.concatenate([self.material, np.zeros((more, 2), np.int64)])
        self.shape_of = np.concatenate([self.shape_of, np.full(more, -1, np.int64)])

    def use(self, shapes: Shapes) -> None:
        """Use these shapes from now on; `shape_of` refers to them."""
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
        """Contact points of a batch as the bodies stand, with zero forces.

        way: (count,) m, the most that a point of each island moves in the time considered. margin: gaps are listed up
        to this fraction of the thinner body's thickness, and up to `way`; depths up to `DEEPEST` of that thickness.
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
            n = find(
                pairs, b.rotation, b.origin, self.shape_of, self.shapes, margins, depths, self._ints, self._reals,
                *self._stamps,
            )  # fmt: skip
            if n <= len(self._ints):
                return Contacts(self._ints[:n].copy(), self._reals[:n].copy(), np.zeros((n, 3)))
            self._ints = np.empty((2 * n, 6), np.int64)
            self._reals = np.empty((2 * n, 7))

    def inherit(self, now: Contacts, before: Contacts) -> Contacts:
        """Copy the forces of contacts in `before` to the same contacts in `now`: the solver's warm start."""
        if len(now.ints) and len(before.ints):
            row = contact_problem.match(before.ints, now.ints)
            known = row >= 0
            now.force[known] = before.force[row[known]]
        return now

    def touched(self, before: Contacts, now: Contacts) -> NDArray[np.bool_]:
        """(c,) mask of the contacts of `now` that touched in `before`."""
        touched = np.zeros(len(now.ints), bool)
        if len(before.ints) and len(now.ints):
            row = contact_problem.match(before.ints, now.ints)
            known = row >= 0
            touched[known] = before.reals[row[known], 6] <= self.tolerance.touch
        return touched

    def without_false_penetrations(
        self, contacts: Contacts, touched: NDArray[np.bool_], begin: Saved | None = None
    ) -> tuple[Contacts, NDArray[np.bool_]]:
        """The contacts that touch or penetrate, and a mask of those that did before (see `penetration_filter`).

        touched: (c,) contacts known to have touched. begin: bodies a little earlier; None: nothing has moved yet.
        """
        deep = ~touched & (contacts.reals[:, 6] < -self.tolerance.touch)
        if not deep.any():
            return contacts, touched
        b = self.bodies
        rotation, origin = b.rotation, b.origin
        if begin is not None:
            rotation, origin = rotation.copy(), origin.copy()
            rotation[begin.ids], origin[begin.ids] = begin.rotation, begin.origin
        verdict = penetration_filter.classify(
            contacts.ints, contacts.reals, touched, b.rotation, b.origin, rotation, origin, self.shape_of, self.shapes,
            self.tolerance.touch,
        )  # fmt: skip
        real = verdict != penetration_filter.OUTSIDE
        return rows(contacts, real), (touched | (verdict == penetration_filter.INSIDE))[real]

    def pair_values(self, ints: Ints) -> tuple[Array, Array]:
        """Friction and restitution (c,) of contacts, combined as `behaviours.Reaction` says."""
        a, b = ints[:, 0], ints[:, 1]
        fa, fb = self.friction[a], self.friction[b]
        friction = np.where(np.isnan(fa), fb, np.where(np.isnan(fb), fa, np.sqrt(fa * fb)))
        ea, eb = self.restitution[a], self.restitution[b]
        restitution = np.where(np.isnan(ea), eb, np.where(np.isnan(eb), ea, np.fmin(ea, eb)))
        own = np.where(np.isnan(friction), 0.5, friction), np.where(np.isnan(restitution), 0.0, restitution)
        if len(self.pair_table) == 1:
            return own
        by_pair = (self.pair_table[self.material[a, k], self.material[b, k], k] for k in range(2))
        first, second = (np.where(np.isnan(p), o, p) for p, o in zip(by_pair, own, strict=True))
        return first, second

    def by_poisson(self, ints: Ints) -> NDArray[np.bool_]:
        """(c,) mask of contacts under Poisson's law: the law of the lesser restitution, Poisson's if both are equal."""
        a, b = ints[:, 0], ints[:, 1]
        ea, eb = self.restitution[a], self.restitution[b]
        own = (self.poisson[a] & (np.isnan(eb) | (ea <= eb))) | (self.poisson[b] & (np.isnan(ea) | (eb <= ea)))
        by_pair = ~np.isnan(self.pair_table[self.material[a, 1], self.material[b, 1], 1])
        return np.where(by_pair, self.poisson[a] | self.poisson[b], own)

    def speeds(self, rows: Ints, contacts: Contacts) -> Array:
        """(r,) m/s: normal speeds of contacts, positive where they part."""
        b = self.bodies
        return contact_problem.normal_speeds(rows, contacts.ints, contacts.reals, b.center, b.velocity)

    # --- forces ---------------------------------------------------------------------------------------------------

    def free(self, batch: Batch, t: float, h: Array, wrench: Wrench) -> Array:
        """Velocities (n, 6) after applied forces have acted for h (count,) seconds, without constraints."""
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
        self, batch: Batch, contacts: Contacts, active: Ints, t: float, h: Array, wrench: Wrench, ahead: float = 0.0
    ) -> None:
        """Apply forces for h (count,) seconds under joints and the contacts `active` (rows); writes velocities.

        ahead: see `joints.rows.joint_rows`.
        """
        targets = Targets(np.zeros(len(contacts.ints)))
        self.solve(batch, contacts, active, self.free(batch, t, h, wrench), h, targets, ahead=ahead)

    def solve(
        self, batch: Batch, contacts: Contacts, active: Ints, free: Array, h: Array, targets: Targets,
        tolerance: float = EXACT, ahead: float = 0.0,
    ) -> None:  # fmt: skip
        """Solve for velocities under contacts and joints, from unconstrained ones `free` (n, 6).

        Contact forces (impulse over h) are stored in `contacts`. Each contact patch starts with the rows that span it;
        rows that would sink in follow.
        """
        b = self.bodies
        if len(active) == 0 and not batch.joints:
            b.velocity[batch.ids] = free
            return
        mu, _ = self.pair_values(contacts.ints)
        each = h[batch.of_rows(contacts.ints)][:, None]
        unknowns = self._unknowns(batch)._replace(held=joint_rows(batch.joints, b, batch.ids, self.pair_values, ahead))
        chosen = active[contact_problem.spanning(contacts.ints, contacts.reals, active)]
        if targets.impulse is not None:
            chosen = np.union1d(chosen, active[targets.impulse[active] > 0.0])
        for _ in range(8):
            impulse = contacts.force[chosen] * each[chosen]
            residual, self.slips = contact_problem.solve_contacts(
                unknowns, contacts, chosen, targets, mu, impulse, free, tolerance
            )
            contacts.force[active] = 0.0
            contacts.force[chosen] = impulse / each[chosen]
            if len(chosen) == len(active):
                break
            slowest = targets.speed[active] - 1e-10 * (1.0 + np.abs(targets.speed[active])) - 2.0 * residual
            sinking = self.speeds(active, contacts) < slowest
            sinking[np.searchsorted(active, chosen)] = False
            if not sinking.any():
                break
            chosen = np.union1d(chosen, active[sinking])
        self.residual = max(self.residual, residual)

    def rebound(
        self, batch: Batch, contacts: Contacts, active: Ints, free: Array, h: Array, target: Array,
        tolerance: float = EXACT,
    ) -> None:  # fmt: skip
        """`solve` with restitution, lowered where it would gain energy. target: (c,) m/s, speeds of Newton's law.

        A connected group that has a contact under Poisson's law goes through compression and restitution.
        """
        stored = (target > 0.0) & self.by_poisson(contacts.ints)
        if not stored[active].any():
            self._reflect(batch, contacts, active, free, h, target, tolerance)
            return
        b = self.bodies
        bodies = self._rows(batch, contacts, active)[0]
        of_body, group, count = impact_energy.groups(len(batch.ids), bodies, assemble(batch.joints, b, batch.ids)[0])
        in_two = np.zeros(count, bool)
        in_two[group[stored[active]]] = True
        mine = in_two[group]
        reflected = None
        if not mine.all():
            self._reflect(batch, contacts, active[~mine], free, h, target, tolerance)
            reflected = b.velocity[batch.ids]
        self._restore(batch, contacts, active[mine], free, h, target, stored, tolerance)
        if reflected is not None:
            b.velocity[batch.ids] = np.where(in_two[of_body, None], b.velocity[batch.ids], reflected)

    def _reflect(self, batch, contacts, active, free, h, target, tolerance) -> None:
        """`rebound` by Newton's law alone."""
        self.solve(batch, contacts, active, free, h, Targets(target), tolerance)
        if target[active].any():
            self._limit(batch, contacts, active, free, h, tolerance)

    def _restore(self, batch, contacts, active, free, h, target, stored, tolerance) -> None:
        """Compression, then restitution. stored: (c,) contacts under Poisson's law; others reach `target`."""
        b = self.bodies
        b.velocity[batch.ids] = free
        mine = active[stored[active]]
        back = np.zeros(len(target))
        back[mine] = target[mine] / -self.speeds(mine, contacts)
        self.solve(batch, contacts, active, free, h, Targets(np.zeros(len(target))), tolerance)
        velocity, force = b.velocity[batch.ids], contacts.force[active]
        each = h[batch.of_rows(contacts.ints[active])]
        least = np.zeros(len(target))
        least[active] = back[active] * force[:, 0] * each
        contacts.force[active] = back[active, None] * force
        self.solve(batch, contacts, active, velocity, h, Targets(np.where(stored, 0.0, target), least), tolerance)
        contacts.force[active] += force
        self._limit(batch, contacts, active, free, h, tolerance, (velocity, force))

    def _rows(self, batch: Batch, contacts: Contacts, active: Ints):
        """Bodies (c, 2), Jacobians (c, 3, 12) and biases (c, 3) of the rows `active`."""
        return self._unknowns(batch).rows_of(contacts, active)[:3]

    def _limit(self, batch, contacts, active, free, h, tolerance, without=None) -> None:
        """Scale restitution down in connected groups that gain energy; writes velocities and forces.

        without: velocities (n, 6) and forces (c, 3) without restitution, if known.
        """
        b = self.bodies
        cb, cj, bias = self._rows(batch, contacts, active)
        jb, *_ = assemble(batch.joints, b, batch.ids)
        of_body, group, count = impact_energy.groups(len(batch.ids), cb, jb)
        velocity, force = b.velocity[batch.ids], contacts.force[active]
        before, after = (impact_energy.relative(cb, cj, bias, v) for v in (free, velocity))
        each = h[batch.of_rows(contacts.ints[active])][:, None]
        wrong = impact_energy.gained(force * each, before, after, group, count)
        if not wrong.any():
            return
        if without is None:
            self.solve(batch, contacts, active, free, h, Targets(np.zeros(len(contacts.ints))), tolerance)
            without = b.velocity[batch.ids], contacts.force[active]
        least, least_force = without
        least_after = impact_energy.relative(cb, cj, bias, least)
        sigma = impact_energy.share(force * each, least_force * each, before, after, least_after, group, count)
        sigma[~wrong] = 1.0
        part = sigma[of_body, None]
        b.velocity[batch.ids] = np.where(part < 1.0, least + part * (velocity - least), velocity)
        part = sigma[group, None]
        contacts.force[active] = np.where(part < 1.0, least_force + part * (force - least_force), force)

    def correct(self, batch: Batch, contacts: Contacts, chosen: Ints, others: Ints, joints: tuple[Any, ...]) -> None:
        """Move bodies as little as closes the gaps of rows `chosen` and the joints' residuals; `others` stay open."""
        contact_problem.correct(self._unknowns(batch), contacts, chosen, others, joints)
        self._place(batch)

    def push_apart(self, batch: Batch, contacts: Contacts, chosen: Ints, tolerance: float) -> None:
        """Move bodies as little as lifts all gaps of rows `chosen` to 0, within `tolerance` of the deepest."""
        contact_problem.push_apart(self._unknowns(batch), contacts, chosen, tolerance)
        self._place(batch)

    def _place(self, batch: Batch) -> None:
        b = self.bodies
        place(batch.ids, b.center, b.attitude, b.offset, b.rotation, b.origin)

    def _unknowns(self, batch: Batch) -> MovingBodies:
        row = np.full(self.bodies.n, -1)
        row[batch.ids] = np.arange(len(batch.ids))
        return MovingBodies(self.bodies, batch.ids, row)

    def sticks(self, batch: Batch, contacts: Contacts) -> NDArray[np.bool_]:
        """(count,) mask of islands in which joints or contacts bear load and no loaded one slides with friction."""
        loaded = contacts.force[:, 0] > 0.0
        mu, _ = self.pair_values(contacts.ints[loaded])
        f = contacts.force[loaded]
        grip = mu * f[:, 0]
        slides = (f[:, 1] ** 2 + f[:, 2] ** 2 >= (0.999 * grip) ** 2) & (grip != 0.0)
        island = batch.of_rows(contacts.ints[loaded])
        # kinematic bodies and varying forces may load a joint differently in the next step
        lasting = len(batch.joints) > 0 and batch.constant and len(batch.moved) == 0
        carries = np.full(batch.count, lasting)
        carries[island] = True
        carries[island[slides]] = False
        if batch.joints and self.slips:
            carries[:] = False
        return carries

    def impact(self, batch: Batch, contacts: Contacts, touching: Ints) -> None:
        """Resolve impacts of the rows `touching` in rounds, until none closes."""
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
        targets = Targets(np.zeros(len(contacts.ints)))
        self.solve(batch, contacts, touching, b.velocity[batch.ids].copy(), one, targets)
        contacts.force[:] = kept


def rows(contacts: Contacts, which: NDArray[np.bool_] | Ints | slice) -> Contacts:
    """The contacts of a mask, of row numbers or of a slice."""
    return Contacts(contacts.ints[which], contacts.reals[which], contacts.force[which])


def merged(batch: Batch, parts: list[Contacts]) -> Contacts:
    """Concatenated contacts of parts of a batch, in the order of its islands."""
    if len(parts) == 1:
        return parts[0]
    out = joined(parts)
    return rows(out, np.argsort(batch.of_rows(out.ints), kind="stable"))
