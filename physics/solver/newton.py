"""Velocities under joints and contacts with Coulomb's exact cone, by a proximal semismooth Newton method.

Given free velocities v* find v and impulses λ with

    M (v - v*) = Jᵀ λ,
    joint rows:      J v + b = 0,
    contact normal:  l ≤ λ_n  ⊥  J_n v + b_n ≥ 0    (l > 0 only in the restitution phase of Poisson's law),
    friction:        λ_t = argmax of dissipation over the disc |λ_t| ≤ μ λ_n  (a cone, not a pyramid),
    joint friction:  J_n v + b_n = 0 (one or two rows),  |λ_t| ≤ μ |λ_n|: bilateral, sliding along one row.

Alart and Curnier (Comput. Methods Appl. Mech. Eng. 92, 1991) write the contact law as λ = Π(λ - ρ (J v + b)), where Π
clips the normal part at l and the tangential part to the disc of radius μ λ_n. With λ inside Π frozen at the iterate
before, this is a proximal step whose unknown is v alone (6 numbers a body, however many contacts). It is well posed for
any number of redundant contacts, because it picks the λ nearest to the iterate before. Newton's method solves each
step; a nonlinear Gauss-Seidel pass over the contacts prepares it when its guess of open, sticking and sliding is wrong.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from physics.model.rotations import across
from physics.solver.block_elimination import solve_blocks, structure
from physics.solver.islands import components
from physics.solver.sweeps import relax

STIFFNESS = 1e5
"""1: the proximal step ρ, in units of the inverse of each row's own 1/(J M⁻¹ Jᵀ)"""
STIFFEST = 1e12
"""1: the same when progress stalls (a heavy body on a light one)"""
MANY = 64
"""bodies: larger groups begin with Gauss-Seidel sweeps, which cost less than Newton's first iterations"""
SWEEPS = 60
ROUGH = 1e-5
"""1: at this tolerance or above, groups of more than `SOME` bodies are solved by accelerated sweeps alone"""
SOME = 16
SWEPT = 1e-4
"""1: change, relative to the largest speed, at which these sweeps end"""
ROUGH_SWEEPS = 150
"""bound of their number, each forward and backward"""
OUTER = 60


@kernel(allocates=True)
def rows_of_contacts(bodies, reals, centers, jacobian):
    """Jacobian (c, 3, 12) of the relative velocity of contacts in their frames (normal, two tangents).

    bodies: (c, 2) local body numbers, -1 for bodies that do not move. reals: (c, 7) rows of `narrow_phase.find`.
    centers: (n, 3) centres of mass. Columns: linear and angular velocity (world axes) of both.
    """
    frame = np.empty((3, 3))
    for c in range(bodies.shape[0]):
        n = reals[c, 3:6]
        frame[0] = n
        t = across(n)  # tangents follow the normal alone, so that impulses can be kept from step to step
        frame[1] = t / np.sqrt(np.sum(t * t))
        frame[2] = np.cross(n, frame[1])
        for side in range(2):
            body = bodies[c, side]
            sign = 1.0 if side == 0 else -1.0
            if body < 0:
                jacobian[c, :, 6 * side : 6 * side + 6] = 0.0
                continue
            r = reals[c, :3] - centers[body]
            for i in range(3):
                d = frame[i]
                jacobian[c, i, 6 * side] = sign * d[0]
                jacobian[c, i, 6 * side + 1] = sign * d[1]
                jacobian[c, i, 6 * side + 2] = sign * d[2]
                jacobian[c, i, 6 * side + 3] = sign * (r[1] * d[2] - r[2] * d[1])
                jacobian[c, i, 6 * side + 4] = sign * (r[2] * d[0] - r[0] * d[2])
                jacobian[c, i, 6 * side + 5] = sign * (r[0] * d[1] - r[1] * d[0])


@inner_kernel
def _speed(bias, bodies, row, v):
    """J v + b of one row (12,)."""
    for side in range(2):
        body = bodies[side]
        if body >= 0:
            for k in range(6):
                bias += row[6 * side + k] * v[body, k]
    return bias


@inner_kernel
def _speeds(bodies, jacobian, v, bias, out):
    """J v + b of blocks of rows (c, r, 12), into `out` (c, r)."""
    for c in range(jacobian.shape[0]):
        for i in range(jacobian.shape[1]):
            out[c, i] = _speed(bias[c, i], bodies[c], jacobian[c, i], v)


@inner_kernel
def _push(bodies, jacobian, impulse, out):
    """Add Jᵀ λ to `out` (n, 6)."""
    for c in range(jacobian.shape[0]):
        for i in range(jacobian.shape[1]):
            f = impulse[c, i]
            if f == 0.0:
                continue
            for side in range(2):
                body = bodies[c, side]
                if body >= 0:
                    for k in range(6):
                        out[body, k] += jacobian[c, i, 6 * side + k] * f


@inner_kernel(allocates=True)
def _pushed(free, cb, cj, impulse, jb, jj, jl, inverse_mass, inverse_inertia, v):
    """v (n, 6) = v* + M⁻¹ Jᵀ λ of all contacts and joints."""
    w = np.zeros(free.shape)
    _push(cb, cj, impulse, w)
    _push(jb, jj, jl, w)
    for b in range(len(w)):
        for i in range(3):
            v[b, i] = free[b, i] + inverse_mass[b] * w[b, i]
            v[b, 3 + i] = free[b, 3 + i] + (
                inverse_inertia[b, i, 0] * w[b, 3]
                + inverse_inertia[b, i, 1] * w[b, 4]
                + inverse_inertia[b, i, 2] * w[b, 5]
            )


@inner_kernel
def _effective(bodies, jacobian, inverse_mass, inverse_inertia, out):
    """Largest diagonal entry of each block's J M⁻¹ Jᵀ, into `out` (c,)."""
    for c in range(jacobian.shape[0]):
        largest = 0.0
        for i in range(jacobian.shape[1]):
            total = 0.0
            for side in range(2):
                body = bodies[c, side]
                if body < 0:
                    continue
                o = 6 * side
                for k in range(3):
                    total += inverse_mass[body] * jacobian[c, i, o + k] ** 2
                    for m in range(3):
                        total += jacobian[c, i, o + 3 + k] * inverse_inertia[body, k, m] * jacobian[c, i, o + 3 + m]
            largest = max(largest, total)
        out[c] = largest


@inner_kernel
def _project(y, mu, dry, least, impulse, slope, rho):
    """λ = Π(y) for one contact or joint with friction, and H = -∂λ/∂(J v) = ρ Π'(y) (3, 3)."""
    slope[:] = 0.0
    if dry:
        impulse[0], impulse[1], impulse[2] = y[0], y[1], y[2]
        slope[0, 0] = slope[1, 1] = slope[2, 2] = rho
        load = np.sqrt(y[0] * y[0] + y[1] * y[1])
        if abs(y[2]) > mu * load:
            sign = 1.0 if y[2] > 0.0 else -1.0
            impulse[2] = sign * mu * load
            slope[2, 2] = 0.0
            if load > 0.0:
                slope[2, 0], slope[2, 1] = rho * sign * mu * y[0] / load, rho * sign * mu * y[1] / load
        return
    impulse[0] = max(y[0], least)
    if impulse[0] == 0.0:
        impulse[1] = impulse[2] = 0.0
        return
    if y[0] > least:
        slope[0, 0] = rho
    size = np.sqrt(y[1] * y[1] + y[2] * y[2])
    limit = mu * impulse[0]
    if size <= limit:
        impulse[1], impulse[2] = y[1], y[2]
        slope[1, 1] = slope[2, 2] = rho
        return
    d1, d2 = y[1] / size, y[2] / size
    impulse[1], impulse[2] = limit * d1, limit * d2
    slope[1, 0], slope[2, 0] = slope[0, 0] * mu * d1, slope[0, 0] * mu * d2
    turn = rho * limit / size
    slope[1, 1] = turn * d2 * d2
    slope[2, 2] = turn * d1 * d1
    slope[1, 2] = slope[2, 1] = -turn * d1 * d2


@inner_kernel
def _add_block(values, slot, bodies, jacobian, slope):
    """A += Jᵀ H J for one block of rows; A by 6x6 blocks as `blocks.structure` lays them out."""
    r = jacobian.shape[0]
    for side in range(2):
        i = bodies[side]
        if i < 0:
            continue
        for k in range(6):
            for q in range(r):
                left = 0.0
                for p in range(r):
                    left += jacobian[p, 6 * side + k] * slope[p, q]
                if left == 0.0:
                    continue
                for other in range(2):
                    j = bodies[other]
                    if j < 0:
                        continue
                    at = slot[i, j]
                    for m in range(6):
                        values[at, k, m] += left * jacobian[q, 6 * other + m]


@inner_kernel
def _sweep(v, inverse_mass, inverse_inertia, cb, cj, bias, mu, dry, least, weight, impulse, jb, jj, jbias, jw, jl):
    """One nonlinear Gauss-Seidel pass over joints and contacts; the largest change of a row's impulse · weight."""
    change = 0.0
    for c in range(jj.shape[0]):
        for i in range(jj.shape[1]):
            if jw[c] == 0.0:
                continue
            d = -_speed(jbias[c, i], jb[c], jj[c, i], v) / jw[c]
            jl[c, i] += d
            change = max(change, abs(d) * jw[c])
            _kick(v, jb[c], jj[c, i], d, inverse_mass, inverse_inertia)
    for c in range(cj.shape[0]):
        if weight[c] == 0.0:
            continue
        if dry[c]:
            change = max(
                change,
                _sweep_dry(v, inverse_mass, inverse_inertia, cb[c], cj[c], bias[c], mu[c], weight[c], impulse[c]),
            )
            continue
        new = max(least[c], impulse[c, 0] - _speed(bias[c, 0], cb[c], cj[c, 0], v) / weight[c])
        d = new - impulse[c, 0]
        impulse[c, 0] = new
        change = max(change, abs(d) * weight[c])
        _kick(v, cb[c], cj[c, 0], d, inverse_mass, inverse_inertia)
        y1 = impulse[c, 1] - _speed(bias[c, 1], cb[c], cj[c, 1], v) / weight[c]
        y2 = impulse[c, 2] - _speed(bias[c, 2], cb[c], cj[c, 2], v) / weight[c]
        size = np.sqrt(y1 * y1 + y2 * y2)
        limit = mu[c] * new
        if size > limit:
            y1, y2 = y1 * limit / size, y2 * limit / size
        d1, d2 = y1 - impulse[c, 1], y2 - impulse[c, 2]
        impulse[c, 1], impulse[c, 2] = y1, y2
        change = max(change, max(abs(d1), abs(d2)) * weight[c])
        _kick(v, cb[c], cj[c, 1], d1, inverse_mass, inverse_inertia)
        _kick(v, cb[c], cj[c, 2], d2, inverse_mass, inverse_inertia)
    return change


@inner_kernel
def _sweep_dry(v, inverse_mass, inverse_inertia, bodies, jacobian, bias, mu, weight, impulse):
    """`_sweep` over one joint with friction."""
    change = 0.0
    for i in range(3):
        new = impulse[i] - _speed(bias[i], bodies, jacobian[i], v) / weight
        if i == 2:
            limit = mu * np.sqrt(impulse[0] * impulse[0] + impulse[1] * impulse[1])
            new = min(max(new, -limit), limit)
        d = new - impulse[i]
        impulse[i] = new
        change = max(change, abs(d) * weight)
        _kick(v, bodies, jacobian[i], d, inverse_mass, inverse_inertia)
    return change


@inner_kernel
def _kick(v, bodies, row, d, inverse_mass, inverse_inertia):
    """v += M⁻¹ Jᵀ d of one row."""
    if d == 0.0:
        return
    for side in range(2):
        b = bodies[side]
        if b < 0:
            continue
        o = 6 * side
        for k in range(3):
            v[b, k] += inverse_mass[b] * row[o + k] * d
            v[b, 3 + k] += d * (
                inverse_inertia[b, k, 0] * row[o + 3]
                + inverse_inertia[b, k, 1] * row[o + 4]
                + inverse_inertia[b, k, 2] * row[o + 5]
            )


@inner_kernel(allocates=True)
def _newton(
    free, v, mass, inertia, cb, cj, bias, mu, dry, least, rho, center, impulse, jb, jj, jbias, jrho, jcenter, jl,
    order, start, later, slot, blocks, limit,
):  # fmt: skip
    """Newton iterations on v in one proximal step about (center, jcenter); returns the last relative change of v."""
    n = v.shape[0]
    values = np.empty((blocks, 6, 6))
    speeds = np.empty((cj.shape[0], 3))
    jspeeds = np.empty((jj.shape[0], jj.shape[1]))
    slope = np.empty((3, 3))
    jslope = np.zeros((jj.shape[1], jj.shape[1]))
    y = np.empty(3)
    f = np.empty((n, 6))
    last = np.inf
    largest = 0.0
    for iteration in range(limit):
        values[:] = 0.0
        for b in range(n):
            at = slot[b, b]
            for i in range(3):
                values[at, i, i] = mass[b]
                f[b, i] = mass[b] * (free[b, i] - v[b, i])
                total = 0.0
                for k in range(3):
                    values[at, 3 + i, 3 + k] = inertia[b, i, k]
                    total += inertia[b, i, k] * (free[b, 3 + k] - v[b, 3 + k])
                f[b, 3 + i] = total
        _speeds(cb, cj, v, bias, speeds)
        for c in range(cj.shape[0]):
            for i in range(3):
                y[i] = center[c, i] - rho[c] * speeds[c, i]
            _project(y, mu[c], dry[c], least[c], impulse[c], slope, rho[c])
            _add_block(values, slot, cb[c], cj[c], slope)
        _speeds(jb, jj, v, jbias, jspeeds)
        for c in range(jj.shape[0]):
            for i in range(jj.shape[1]):
                jl[c, i] = jcenter[c, i] - jrho[c] * jspeeds[c, i]
                jslope[i, i] = jrho[c]
            _add_block(values, slot, jb[c], jj[c], jslope)
        _push(cb, cj, impulse, f)
        _push(jb, jj, jl, f)
        step = solve_blocks(values, order, start, later, slot, f)
        size = 0.0
        largest = 0.0
        for b in range(n):
            for i in range(6):
                v[b, i] += step[b, i]
                size = max(size, abs(step[b, i]))
                largest = max(largest, abs(v[b, i]), abs(free[b, i]))
        if size <= 1e-15 * largest:
            return 0.0
        if iteration > 1 and size >= last and size < 1e-11 * largest:
            return 0.0  # rounding
        last = size
    return 0.0 if last < 1e-9 * largest else last


@inner_kernel
def residual(speeds, mu, dry, least, rho, impulse):
    """Largest violation of the laws of contacts and joint friction, m/s: |λ - Π(λ - ρ (J v + b))| / ρ."""
    worst = 0.0
    for c in range(speeds.shape[0]):
        if rho[c] == 0.0:  # between bodies that no impulse moves
            continue
        if dry[c]:
            limit = mu[c] * np.sqrt(impulse[c, 0] ** 2 + impulse[c, 1] ** 2)
            t = min(max(impulse[c, 2] - rho[c] * speeds[c, 2], -limit), limit)
            worst = max(worst, abs(speeds[c, 0]), abs(speeds[c, 1]), abs(impulse[c, 2] - t) / rho[c])
            continue
        n = max(least[c], impulse[c, 0] - rho[c] * speeds[c, 0])
        y1, y2 = impulse[c, 1] - rho[c] * speeds[c, 1], impulse[c, 2] - rho[c] * speeds[c, 2]
        size = np.sqrt(y1 * y1 + y2 * y2)
        limit = mu[c] * max(impulse[c, 0], 0.0)
        if size > limit:
            y1, y2 = y1 * limit / size, y2 * limit / size
        worst = max(worst, abs(impulse[c, 0] - n) / rho[c])
        worst = max(worst, max(abs(impulse[c, 1] - y1), abs(impulse[c, 2] - y2)) / rho[c])
    return worst


@kernel(allocates=True)
def solve(
    free, v, mass, inertia, inverse_mass, inverse_inertia, cb, cj, bias, mu, dry, least, impulse, jb, jj, jbias, jl,
    tolerance,
):  # fmt: skip
    """Solve for velocities `v` (n, 6) and impulses `impulse` (c, 3), `jl` (g, r), in place; returns the residual, m/s.

    free: (n, 6) velocities without constraints (linear, angular; world axes). mass (n,), inertia (n, 3, 3) and their
    inverses. cb (c, 2), cj (c, 3, 12), bias (c, 3), mu (c,), least (c,) N·s, least normal impulses: contacts, and
    joints with friction where `dry` (c,) (rows: two normals, slide). jb (g, 2), jj (g, r, 12), jbias (g, r):
    ideal joints. `impulse` and `jl` hold the guess on entry. tolerance: 1, relative to the largest speed.
    Connected groups are solved separately.
    """
    n = free.shape[0]
    label, count = components(n, np.concatenate((cb, jb)))
    of_contact = _label_of(label, cb)
    of_joint = _label_of(label, jb)
    bodies, first_body = _sorted(label, count)
    contacts, first_contact = _sorted(of_contact, count)
    joints, first_joint = _sorted(of_joint, count)
    place = np.empty(n, np.int64)
    worst = 0.0
    for group in range(count):
        mine = bodies[first_body[group] : first_body[group + 1]]
        rows = contacts[first_contact[group] : first_contact[group + 1]]
        jrows = joints[first_joint[group] : first_joint[group + 1]]
        if len(rows) == 0 and len(jrows) == 0:
            for b in mine:
                v[b] = free[b]
            continue
        for k in range(len(mine)):
            place[mine[k]] = k
        own_v = np.empty((len(mine), 6))
        own_impulse = impulse[rows]
        own_jl = jl[jrows]
        left = _solve_joined(
            free[mine], own_v, mass[mine], inertia[mine], inverse_mass[mine], inverse_inertia[mine],
            _renumbered(cb, rows, place), cj[rows], bias[rows], mu[rows], dry[rows], least[rows], own_impulse,
            _renumbered(jb, jrows, place), jj[jrows], jbias[jrows], own_jl, tolerance,
        )  # fmt: skip
        worst = max(worst, left)
        for k in range(len(mine)):
            v[mine[k]] = own_v[k]
        for k in range(len(rows)):
            impulse[rows[k]] = own_impulse[k]
        for k in range(len(jrows)):
            jl[jrows[k]] = own_jl[k]
    return worst


@inner_kernel(allocates=True)
def _label_of(label, bodies):
    """(c,) group of each block of rows, -1 for blocks that move no body."""
    out = np.empty(bodies.shape[0], np.int64)
    for c in range(bodies.shape[0]):
        b = max(bodies[c, 0], bodies[c, 1])
        out[c] = label[b] if b >= 0 else -1
    return out


@inner_kernel(allocates=True)
def _sorted(label, count):
    """Row numbers sorted by label (stable, without -1), and the start of each label's rows (count + 1,)."""
    start = np.zeros(count + 1, np.int64)
    for i in label:
        if i >= 0:
            start[i + 1] += 1
    for i in range(count):
        start[i + 1] += start[i]
    at = start.copy()
    out = np.empty(start[count], np.int64)
    for row in range(len(label)):
        i = label[row]
        if i >= 0:
            out[at[i]] = row
            at[i] += 1
    return out, start


@inner_kernel(allocates=True)
def _renumbered(bodies, rows, place):
    """(r, 2) bodies of the rows, as `place` numbers them."""
    out = np.empty((len(rows), 2), np.int64)
    for k in range(len(rows)):
        for side in range(2):
            b = bodies[rows[k], side]
            out[k, side] = place[b] if b >= 0 else -1
    return out


@inner_kernel(allocates=True)
def _solve_joined(
    free, v, mass, inertia, inverse_mass, inverse_inertia, cb, cj, bias, mu, dry, least, impulse, jb, jj, jbias, jl,
    tolerance,
):  # fmt: skip
    """`solve` for one connected group."""
    n = free.shape[0]
    v[:] = free
    if cj.shape[0] == 0 and jj.shape[0] == 0:
        return 0.0
    weight = np.empty(cj.shape[0])
    jw = np.empty(jj.shape[0])
    _effective(cb, cj, inverse_mass, inverse_inertia, weight)
    _effective(jb, jj, inverse_mass, inverse_inertia, jw)
    rho = np.empty(cj.shape[0])
    jrho = np.empty(jj.shape[0])
    _pushed(free, cb, cj, impulse, jb, jj, jl, inverse_mass, inverse_inertia, v)
    scale = max(np.abs(free).max(), 1e-300)
    for c in range(cj.shape[0]):
        scale = max(scale, abs(bias[c, 0]))
    for c in range(jj.shape[0]):
        for i in range(jj.shape[1]):
            scale = max(scale, abs(jbias[c, i]))
    speeds = np.empty((cj.shape[0], 3))
    jspeeds = np.empty((jj.shape[0], jj.shape[1]))
    best = np.inf
    best_v = v.copy()
    best_impulse = impulse.copy()
    best_jl = jl.copy()
    if n > SOME and tolerance >= ROUGH and jj.shape[0] == 0 and not dry.any():
        goal = max(tolerance, SWEPT) * max(np.abs(free[:, :3]).max(), np.abs(bias).max())
        relax(free, v, inverse_mass, inverse_inertia, cb, cj, bias, mu, least, impulse, goal, ROUGH_SWEEPS)
        _speeds(cb, cj, v, bias, speeds)
        for c in range(len(rho)):
            rho[c] = 1.0 / weight[c] if weight[c] > 0.0 else 0.0
        return residual(speeds, mu, dry, least, rho, impulse)
    if n > MANY:
        for _ in range(SWEEPS):
            change = _sweep(
                v, inverse_mass, inverse_inertia, cb, cj, bias, mu, dry, least, weight, impulse, jb, jj, jbias, jw, jl
            )
            if change <= tolerance * scale:
                break
    order, start, later, slot, blocks = structure(n, np.concatenate((cb, jb)))
    stiffness = STIFFNESS
    center = impulse.copy()
    jcenter = jl.copy()
    before = np.inf
    for _ in range(OUTER):
        for c in range(len(rho)):
            rho[c] = stiffness / weight[c] if weight[c] > 0.0 else 0.0
        for c in range(len(jrho)):
            jrho[c] = stiffness / jw[c] if jw[c] > 0.0 else 0.0
        left = _newton(
            free, v, mass, inertia, cb, cj, bias, mu, dry, least, rho, center, impulse, jb, jj, jbias, jrho, jcenter,
            jl, order, start, later, slot, blocks, 12,
        )  # fmt: skip
        _speeds(cb, cj, v, bias, speeds)
        _speeds(jb, jj, v, jbias, jspeeds)
        worst = residual(speeds, mu, dry, least, rho, impulse)
        for c in range(jj.shape[0]):
            for i in range(jj.shape[1]):
                worst = max(worst, abs(jspeeds[c, i]))
        if left > 0.0:  # too stiff for Newton from here: go back and take smaller proximal steps
            stiffness = max(1.0, stiffness * 0.01)
            impulse[:] = center
            jl[:] = jcenter
            _pushed(free, cb, cj, impulse, jb, jj, jl, inverse_mass, inverse_inertia, v)
            for _ in range(20):
                _sweep(
                    v, inverse_mass, inverse_inertia, cb, cj, bias, mu, dry, least, weight, impulse, jb, jj, jbias,
                    jw, jl,
                )  # fmt: skip
            center[:] = impulse
            jcenter[:] = jl
            continue
        if worst < best:
            best = worst
            best_v[:] = v
            best_impulse[:] = impulse
            best_jl[:] = jl
        if worst <= tolerance * scale:
            break
        if worst > 0.5 * before and stiffness >= STIFFEST:
            break  # rounding
        if stiffness < STIFFNESS or worst > 0.1 * before:
            stiffness = min(STIFFEST, stiffness * 10.0)
        before = worst
        center[:] = impulse
        jcenter[:] = jl
    impulse[:] = best_impulse
    jl[:] = best_jl
    v[:] = best_v
    return best
