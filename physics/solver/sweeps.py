"""Contacts of large islands: accelerated projected Gauss-Seidel sweeps, whose cost is linear in the contacts.

A sweep sets the impulse of each contact by its own law, forward and then backward. The symmetric sweep replaces the
gradient step of Nesterov's method, with extrapolation from the last two iterates and restarts where that leads uphill
(Mazhar, Heyn, Negrut & Tasora, ACM Trans. Graph. 34, 2015; restarts: O'Donoghue & Candès, Found. Comput. Math. 15,
2015). Forward sweeps alone, or alternating ones, diverge.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel


@inner_kernel(allocates=True)
def _prepare(cb, cj, inverse_mass, inverse_inertia):
    """M⁻¹ Jᵀ (c, 3, 12) by rows, and the inverse weights (c, 2) of the normal and of both tangents.

    The tangents' weight is the larger eigenvalue of their block of J M⁻¹ Jᵀ; 0 where no impulse moves either body.
    """
    count = cj.shape[0]
    kicks = np.zeros((count, 3, 12))
    gains = np.zeros((count, 2))
    block = np.empty((3, 3))
    for c in range(count):
        for i in range(3):
            for side in range(2):
                b = cb[c, side]
                if b < 0:
                    continue
                o = 6 * side
                for k in range(3):
                    kicks[c, i, o + k] = inverse_mass[b] * cj[c, i, o + k]
                    kicks[c, i, o + 3 + k] = (
                        inverse_inertia[b, k, 0] * cj[c, i, o + 3]
                        + inverse_inertia[b, k, 1] * cj[c, i, o + 4]
                        + inverse_inertia[b, k, 2] * cj[c, i, o + 5]
                    )
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(12):
                    total += cj[c, i, k] * kicks[c, j, k]
                block[i, j] = total
        if block[0, 0] > 0.0:
            gains[c, 0] = 1.0 / block[0, 0]
        half = 0.5 * (block[1, 1] + block[2, 2])
        most = half + np.sqrt((0.5 * (block[1, 1] - block[2, 2])) ** 2 + block[1, 2] ** 2)
        if most > 0.0:
            gains[c, 1] = 1.0 / most
    return kicks, gains


@inner_kernel
def _speed(row, va, vb):
    """J v of one row of a contact."""
    total = 0.0
    for k in range(6):
        total += row[k] * va[k] + row[6 + k] * vb[k]
    return total


@inner_kernel
def _move(va, vb, kick, d):
    for k in range(6):
        va[k] += kick[k] * d
        vb[k] += kick[6 + k] * d


@inner_kernel
def _sweep(v, bodies, cj, kicks, gains, bias, mu, least, impulse, back):
    """One pass over the contacts, backwards if `back`; the largest change of an impulse, as a speed."""
    change = 0.0
    count = cj.shape[0]
    for at in range(count):
        c = count - 1 - at if back else at
        gain = gains[c, 0]
        if gain == 0.0:
            continue
        va, vb = v[bodies[c, 0]], v[bodies[c, 1]]
        old = impulse[c, 0]
        new = max(least[c], old - gain * (_speed(cj[c, 0], va, vb) + bias[c, 0]))
        d = new - old
        if d != 0.0:
            impulse[c, 0] = new
            change = max(change, abs(d) / gain)
            _move(va, vb, kicks[c, 0], d)
        limit = mu[c] * new
        t1, t2 = impulse[c, 1], impulse[c, 2]
        if limit == 0.0 and t1 == 0.0 and t2 == 0.0:
            continue
        gain = gains[c, 1]
        y1 = t1 - gain * (_speed(cj[c, 1], va, vb) + bias[c, 1])
        y2 = t2 - gain * (_speed(cj[c, 2], va, vb) + bias[c, 2])
        size = np.sqrt(y1 * y1 + y2 * y2)
        if size > limit:
            y1, y2 = y1 * limit / size, y2 * limit / size
        impulse[c, 1], impulse[c, 2] = y1, y2
        change = max(change, max(abs(y1 - t1), abs(y2 - t2)) / gain)
        _move(va, vb, kicks[c, 1], y1 - t1)
        _move(va, vb, kicks[c, 2], y2 - t2)
    return change


@inner_kernel(allocates=True)
def relax(free, v, inverse_mass, inverse_inertia, cb, cj, bias, mu, least, impulse, goal, limit):
    """Sweeps forth and back until no impulse changes by more than `goal` (m/s), at most `limit`.

    In place: impulses (c, 3), which come in as the guess, and velocities v (n, 6). The rest as in `solver.solve`.
    """
    n, count = free.shape[0], cj.shape[0]
    kicks, gains = _prepare(cb, cj, inverse_mass, inverse_inertia)
    bodies = np.empty((count, 2), np.int64)
    for c in range(count):
        for side in range(2):
            bodies[c, side] = cb[c, side] if cb[c, side] >= 0 else n  # the last row, of all fixed bodies
    now = np.zeros((n + 1, 6))
    _velocities(free, bodies, kicks, impulse, now)
    before = now.copy()
    last, guess = impulse.copy(), impulse.copy()
    t = 1.0
    slightest = np.inf
    for _ in range(limit):
        # forth and back: together they are symmetric, as the extrapolation needs it
        change = max(
            _sweep(now, bodies, cj, kicks, gains, bias, mu, least, impulse, False),
            _sweep(now, bodies, cj, kicks, gains, bias, mu, least, impulse, True),
        )
        if change <= goal:
            break
        uphill = 0.0
        for c in range(count):
            for i in range(3):
                if gains[c, 0] > 0.0:
                    gain = gains[c, 0] if i == 0 else gains[c, 1]
                    uphill += (guess[c, i] - impulse[c, i]) * (impulse[c, i] - last[c, i]) / gain
        if uphill > 0.0 or change > 10.0 * slightest:
            t = 1.0
        slightest = min(slightest, change)
        t_next = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * t * t))
        beta = (t - 1.0) / t_next
        t = t_next
        # velocities are linear in the impulses: both are extrapolated alike
        for c in range(count):
            for i in range(3):
                new = impulse[c, i]
                guess[c, i] = new + beta * (new - last[c, i])
                last[c, i] = new
                impulse[c, i] = guess[c, i]
        for b in range(n):
            for i in range(6):
                new = now[b, i]
                now[b, i] = new + beta * (new - before[b, i])
                before[b, i] = new
    else:
        impulse[:] = last
    _velocities(free, bodies, kicks, impulse, now)  # without the rounding of all sweeps
    v[:] = now[:n]


@inner_kernel(allocates=True)
def _velocities(free, bodies, kicks, impulse, out):
    """v = v* + M⁻¹ Jᵀ λ, into `out` (n + 1, 6), whose last row stays 0."""
    n = free.shape[0]
    out[:n] = free
    out[n] = 0.0
    for c in range(len(bodies)):
        for i in range(3):
            if impulse[c, i] != 0.0:
                _move(out[bodies[c, 0]], out[bodies[c, 1]], kicks[c, i], impulse[c, i])
