"""The contact problem: choice of contacts, their rows for the solver, and corrections of positions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from physics.model.bodies import FREE, Bodies
from physics.model.rotations import across, turn
from physics.solver import newton

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STILL = 1e-9
"""1: joints with friction that slide slower than this times the greatest speed are at rest"""


class Contacts(NamedTuple):
    """Contact points at one instant, and their forces."""

    ints: Ints
    """(c, 6) see `narrow_phase.find`"""
    reals: Array
    """(c, 7)"""
    force: Array
    """(c, 3) N in the contact's frame (normal, two tangents), of the last kick; 0 for contacts without load"""


WIDER = 1.25
"""1: overrelaxation of depenetration: where edges slide off one another the next feature pair takes over, and the rest
would shrink slowly"""

NO_CONTACTS = Contacts(np.zeros((0, 6), np.int64), np.zeros((0, 7)), np.zeros((0, 3)))


def joined(parts: Iterable[Contacts]) -> Contacts:
    """The contacts of all parts, in their order; there is at least one part."""
    return Contacts(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@kernel(allocates=True)
def match(old, new):
    """(n,) index in `old` (m, 6) of the row with the bodies and features of each row of `new` (n, 6); -1 if none.

    Rows of an object pair are adjacent in both arrays.
    """
    out = np.full(len(new), -1, np.int64)
    first = {}  # row of `old` where an object pair begins
    for j in range(len(old)):
        if j == 0 or old[j, 0] != old[j - 1, 0] or old[j, 1] != old[j - 1, 1]:
            first[(old[j, 0], old[j, 1])] = j
    for i in range(len(new)):
        a, b = new[i, 0], new[i, 1]
        if (a, b) not in first:
            continue
        j = first[(a, b)]
        while j < len(old) and old[j, 0] == a and old[j, 1] == b:
            if old[j, 5] == new[i, 5] and old[j, 4] == new[i, 4]:
                out[i] = j
                break
            j += 1
    return out


@kernel(allocates=True)
def spanning(ints, reals, chosen):
    """Mask over the rows `chosen` (sorted indices, object pairs adjacent) of those that span each contact patch.

    Rows of one object pair with equal normals (to 1e-6) form a patch; the farthest point in each of eight directions
    within it is kept. Other points lie within the hull of those; the caller adds them if they sink in.
    """
    keep = np.zeros(len(chosen), np.bool_)
    done = np.zeros(len(chosen), np.bool_)
    for i in range(len(chosen)):
        if done[i]:
            continue
        c = chosen[i]
        n = reals[c, 3:6]
        members = [i]
        done[i] = True
        for j in range(i + 1, len(chosen)):
            d = chosen[j]
            if ints[d, 0] != ints[c, 0] or ints[d, 1] != ints[c, 1]:
                break
            if done[j]:
                continue
            x, y, z = reals[d, 3] - n[0], reals[d, 4] - n[1], reals[d, 5] - n[2]
            if x * x + y * y + z * z < 1e-12:
                done[j] = True
                members.append(j)
        if len(members) <= 4:
            for j in members:
                keep[j] = True
            continue
        u = across(n)
        v = np.cross(n, u)
        for direction in range(8):
            angle = 0.25 * np.pi * direction + 0.1
            axis = np.cos(angle) * u + np.sin(angle) * v
            best = -np.inf
            which = 0
            for j in members:
                p = reals[chosen[j]]
                s = p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2]
                if s > best + 1e-9:
                    best = s
                    which = j
            keep[which] = True
    return keep


@inner_kernel(allocates=True)
def surface_speeds(ids, ints, reals, center, velocity, is_free, out):
    """Relative velocity (c, 3), m/s, world, that kinematic bodies add at the contacts `ids`, into `out`."""
    for row in range(len(ids)):
        c = ids[row]
        out[row] = 0.0
        for side in range(2):
            body = ints[c, side]
            if is_free[body]:
                continue
            sign = 1.0 if side == 0 else -1.0
            r = reals[c, :3] - center[body]
            w = velocity[body, 3:6]
            out[row] += sign * (velocity[body, :3] + np.cross(w, r))


@kernel(allocates=True)
def gather(ids, rotation, mass, inertia, inverse):
    """Masses (n,), inverse masses (n,), world inertias (n, 3, 3) and their inverses (n, 3, 3) of the bodies `ids`."""
    n = len(ids)
    m = np.empty(n)
    im = np.empty(n)
    world = np.empty((n, 3, 3))
    inverse_world = np.empty((n, 3, 3))
    for k in range(n):
        i = ids[k]
        m[k] = mass[i]
        im[k] = 1.0 / mass[i]
        r = rotation[i]
        world[k] = r @ inertia[i] @ r.T
        inverse_world[k] = r @ inverse[i] @ r.T
    return m, im, world, inverse_world


@kernel(allocates=True)
def contact_rows(chosen, ints, reals, mu, target, local, ids, center, velocity, is_free):
    """Bodies (c, 2), Jacobians (c, 3, 12), biases (c, 3), friction (c,) of contacts `chosen`, for `newton.solve`."""
    n = len(chosen)
    cb = np.empty((n, 2), np.int64)
    rows = np.empty((n, 7))
    friction = np.empty(n)
    for k in range(n):
        c = chosen[k]
        cb[k, 0] = local[ints[c, 0]] if is_free[ints[c, 0]] else -1
        cb[k, 1] = local[ints[c, 1]] if is_free[ints[c, 1]] else -1
        rows[k] = reals[c]
        friction[k] = mu[c]
    middles = np.empty((len(ids), 3))
    for k in range(len(ids)):
        middles[k] = center[ids[k]]
    cj = np.empty((n, 3, 12))
    newton.rows_of_contacts(cb, rows, middles, cj)
    bias = np.zeros((n, 3))
    moving = np.empty((n, 3))
    surface_speeds(chosen, ints, reals, center, velocity, is_free, moving)
    for k in range(n):
        x, y, z = moving[k]
        if x != 0.0 or y != 0.0 or z != 0.0:
            side = 0 if cb[k, 0] >= 0 else 1
            sign = 1.0 if side == 0 else -1.0
            for i in range(3):  # the rows' linear part is the contact frame
                d = cj[k, i, 6 * side : 6 * side + 3]
                bias[k, i] = sign * (d[0] * x + d[1] * y + d[2] * z)
        bias[k, 0] -= target[chosen[k]]
    return cb, cj, bias, friction


class MovingBodies(NamedTuple):
    """The bodies whose velocities or displacements are solved for."""

    bodies: Bodies
    ids: Ints
    """(n,) free bodies"""
    row: Ints
    """row in `ids` by object id, -1 for others"""
    held: Any = None
    """rows of their joints (`physics.joints.rows`)"""

    def masses(self):
        """Masses, inverse masses, world inertias and their inverses, as `gather` returns them."""
        b = self.bodies
        return gather(self.ids, b.rotation, b.mass, b.inertia, b.inverse)

    def rows_of(self, contacts, chosen, mu=None, target=None):
        """Bodies, Jacobians, biases and friction of contacts, as `contact_rows` returns them; 0 where not given."""
        b, none = self.bodies, np.zeros(len(contacts.ints))
        return contact_rows(
            chosen, contacts.ints, contacts.reals, none if mu is None else mu, none if target is None else target,
            self.row, self.ids, b.center, b.velocity, b.kind == FREE,
        )  # fmt: skip

    def shift(self, move):
        """Move the bodies by small displacements (n, 6)."""
        shift(self.ids, self.bodies.center, self.bodies.attitude, move)


class Targets(NamedTuple):
    """What contacts must reach."""

    speed: Array
    """(c,) m/s: least normal speeds; 0: the contact does not close"""
    impulse: Array | None = None
    """(c,) N·s: least normal impulses; None: 0"""


def solve_contacts(unknowns, contacts, chosen, targets, mu, impulse, free, tolerance):
    """Solve contacts `chosen` and joints from unconstrained velocities `free` (n, 6); writes the bodies' velocities.

    mu: (c,) friction. impulse: (len(chosen), 3) N·s, guess and answer. Returns the solver's residual, m/s, and whether
    a joint with friction slides.
    """
    velocity, ids, held = unknowns.bodies.velocity, unknowns.ids, unknowns.held
    m, im, world, inverse_world = unknowns.masses()
    cb, cj, bias, friction = unknowns.rows_of(contacts, chosen, mu, targets.speed)
    bodies = free, m, world, im, inverse_world
    least = np.zeros(len(chosen)) if targets.impulse is None else targets.impulse[chosen]
    rows = cb, cj, bias, friction, least
    rested = len(held.dry_bodies) > 0 and _at_rest(held, velocity[ids], free)
    v, pushes, residual = _solve_with_friction(bodies, rows, impulse, held, tolerance)
    if rested and not _at_rest(
        held, v, free
    ):  # where a dry joint can stick it does, though in a jam (Painlevé) it might as well slide
        stuck, its_pushes, its_residual, holds = _solve_sticking(bodies, rows, impulse, held, tolerance)
        if holds:
            v, pushes, residual = stuck, its_pushes, its_residual
    velocity[ids], impulse[:] = v, pushes
    return residual, len(held.dry_bodies) > 0 and not _at_rest(held, v, free)


def _at_rest(held, velocity, free):
    """Whether no joint with friction slides at velocities (n, 6), relative to the greatest of those and of `free`."""
    padded = np.vstack([velocity, np.zeros((1, 6))])  # place -1 does not move
    slides = (held.dry_jacobian[:, 2] * padded[held.dry_bodies].reshape(-1, 12)).sum(axis=1) + held.dry_bias[:, 2]
    return bool(np.abs(slides).max() <= STILL * max(np.abs(velocity).max(), np.abs(free).max()))


def _solve_sticking(bodies, contacts, impulse, held, tolerance):
    """Velocities with all joints sticking, contact impulses, residual, and whether friction suffices for that."""
    cb, cj, bias, friction, least = contacts
    free, m, world, im, inverse_world = bodies
    g = len(held.jacobian)
    jb = np.concatenate([held.bodies, np.repeat(held.dry_bodies, 3, axis=0)])
    jj = np.concatenate([held.jacobian, held.dry_jacobian.reshape(-1, 1, 12)])
    jbias = np.concatenate([held.bias, held.dry_bias.reshape(-1, 1)])
    v, pushes, jl = np.empty_like(free), impulse.copy(), np.zeros((len(jj), 1))
    residual = newton.solve(
        free, v, m, world, im, inverse_world, cb, cj, bias, friction, np.zeros(len(cb), np.bool_), least, pushes,
        jb, jj, jbias, jl, tolerance,
    )  # fmt: skip
    load = jl[g:].reshape(-1, 2, 3)  # of each thread, on its flanks and across its axis
    limit = (held.dry_friction.reshape(-1, 2) * np.sqrt(load[:, :, 0] ** 2 + load[:, :, 1] ** 2)).sum(axis=1)
    return v, pushes, residual, bool((np.abs(load[:, :, 2].sum(axis=1)) <= limit).all())


def _solve_with_friction(bodies, contacts, impulse, held, tolerance):
    """Velocities with joints sticking or sliding, contact impulses, and the residual."""
    cb, cj, bias, friction, least = contacts
    free, m, world, im, inverse_world = bodies
    n, d = len(cb), len(held.dry_bodies)
    if d:
        cb, cj = np.concatenate([cb, held.dry_bodies]), np.concatenate([cj, held.dry_jacobian])
        bias, friction = np.concatenate([bias, held.dry_bias]), np.concatenate([friction, held.dry_friction])
        least = np.concatenate([least, np.zeros(d)])
    v, pushes, jl = np.empty_like(free), np.concatenate([impulse, np.zeros((d, 3))]), np.zeros((len(held.jacobian), 1))
    residual = newton.solve(
        free, v, m, world, im, inverse_world, cb, cj, bias, friction, np.arange(n + d) >= n, least, pushes,
        held.bodies, held.jacobian, held.bias, jl, tolerance,
    )  # fmt: skip
    return v, pushes[:n], residual


@kernel(allocates=True)
def normal_speeds(chosen, ints, reals, center, velocity):
    """(c,) m/s: normal speeds of the contacts `chosen`, positive where they part."""
    out = np.empty(len(chosen))
    for k in range(len(chosen)):
        c = chosen[k]
        a, b = ints[c, 0], ints[c, 1]
        p = reals[c, :3]
        n = reals[c, 3:6]
        va = velocity[a, :3] + np.cross(velocity[a, 3:6], p - center[a])
        vb = velocity[b, :3] + np.cross(velocity[b, 3:6], p - center[b])
        out[k] = np.sum(n * (va - vb))
    return out


@kernel
def shift(ids, center, attitude, move):
    """Move the bodies `ids` by small displacements (n, 6): linear (m) and rotation vector (rad), world axes."""
    for k in range(len(ids)):
        i = ids[k]
        for c in range(3):
            center[i, c] += move[k, c]
        turn(attitude[i], move[k, 3], move[k, 4], move[k, 5])


def correct(unknowns, contacts, chosen, others, joints):
    """Move the bodies least (mass metric) to close the gaps of `chosen` and the joints' residuals.

    Gaps of the rows `others` do not become negative, or more negative than they are. joints: bodies (j, 2), Jacobians
    (j, 1, 12) and residuals (j, 1) of their rows.
    """
    reals, n = contacts.reals, len(unknowns.ids)
    m, im, world, inverse_world = unknowns.masses()
    jb, jj, jresidual = joints
    cb, cj, _, _ = unknowns.rows_of(contacts, chosen)
    blocks = np.concatenate([cb, jb])
    jacobian = np.ascontiguousarray(np.concatenate([cj[:, :1], jj]))
    bias = np.concatenate([reals[chosen, 6:], jresidual])
    ob, oj, keep, smooth = unknowns.rows_of(contacts, others)
    keep[:] = 0.0
    keep[:, 0] = np.maximum(reals[others, 6], 0.0)
    held = np.zeros(len(others), bool)
    move = np.empty((n, 6))
    for _ in range(8):
        push = np.zeros((int(held.sum()), 3))
        newton.solve(
            np.zeros((n, 6)), move, m, world, im, inverse_world, ob[held], oj[held], keep[held], smooth[held],
            np.zeros(len(push), np.bool_), np.zeros(len(push)), push, blocks, jacobian, bias,
            np.zeros((len(blocks), 1)), 1e-13,
        )  # fmt: skip
        padded = np.concatenate([move, np.zeros((1, 6))])  # -1: what does not move
        left = keep[:, 0] + np.einsum("cj,cj->c", oj[:, 0], padded[ob].reshape(-1, 12))
        pushed = ~held & (left < -TOUCHING)
        if not pushed.any():
            break
        held |= pushed
    unknowns.shift(move)


TOUCHING = 1e-12
"""m: violation that a correction may leave at other contacts"""


def push_apart(unknowns, contacts, chosen, tolerance):
    """Move the bodies least (mass metric) so that no gap of `chosen` is negative, to first order.

    tolerance: 1, allowed negative gap, relative to the largest gap of `chosen`.
    """
    m, im, world, inverse_world = unknowns.masses()
    cb, cj, bias, friction = unknowns.rows_of(contacts, chosen)
    bias[:] = 0.0  # the bodies are at rest
    gaps = contacts.reals[chosen, 6]
    bias[:, 0] = np.where(gaps < 0.0, WIDER * gaps, gaps)
    move = np.empty((len(unknowns.ids), 6))
    newton.solve(
        np.zeros_like(move), move, m, world, im, inverse_world, cb, cj, bias, friction, np.zeros(len(cb), np.bool_),
        np.zeros(len(cb)), np.zeros((len(cb), 3)), np.zeros((0, 2), np.int64), np.zeros((0, 1, 12)), np.zeros((0, 1)),
        np.zeros((0, 1)), tolerance,
    )  # fmt: skip
    unknowns.shift(move)
