"""Levenberg-Marquardt on SE(3)^N with restarts, as numba kernels."""

from __future__ import annotations

import math

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from constraints.solve.block_cholesky import factor, substitute
from constraints.solve.jacobians import evaluate
from constraints.solve.pose_kernels import move

SOLVED = 0
STATIONARY = 1
EXHAUSTED = 2
EPSILON = 2.0**-52
ASTRAY = 1e-3
"""rad, or fraction of the parts' length: a greater residual at the end leads to a restart"""
CAUTION = (1e2, 1e4)
"""1: damping of the second and third attempt, relative to the first"""
BESIDE = 6
"""number of further attempts, from starts displaced by up to PUSH rad (or fractions of a part's size)"""
STUCK = 4
"""number of further attempts, each from the displaced end of the attempt before: a bolt upside down in its hole gets
stuck perpendicular to it, where the nearer sense of its axis changes"""
PUSH = 0.15
GOLDEN = 0.6180339887498949
DAMPING_FLOOR = 1e-13
"""1: least damping relative to the scaled Jacobian, so that a rank-deficient JᵀJ is factorisable in float64"""


@inner_kernel
def _copy2(x, out):
    """out = x, two-dimensional (numba compiles an array assignment for seconds)."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            out[i, j] = x[i, j]


@inner_kernel
def _copy3(x, out):
    """out = x, three-dimensional."""
    for i in range(len(x)):
        _copy2(x[i], out[i])


@inner_kernel
def _scaled_row(J, k, v, w):
    """Row k of J as a tuple (see `constraints.solve.jacobians` for why), linear part times v, angular times w."""
    return v * J[k, 0], v * J[k, 1], v * J[k, 2], w * J[k, 3], w * J[k, 4], w * J[k, 5]


@inner_kernel
def _add_outer(blocks, b, x, y):
    """blocks[b] += x yᵀ."""
    for i in range(6):
        for j in range(6):
            blocks[b, i, j] += x[i] * y[j]


@inner_kernel
def assemble(body, start, weight, extent, column_of, target, r, Ja, Jb, blocks, gradient):
    """Compute JᵀJ (blocks) and Jᵀr (gradient) of the weighted, scaled rows; column_of (n,): body -> column or -1."""
    for b in range(len(blocks)):
        for i in range(6):
            for j in range(6):
                blocks[b, i, j] = 0.0
    for k in range(len(gradient)):
        for i in range(6):
            gradient[k, i] = 0.0
    for e in range(len(body)):
        last = start[e + 1] if e + 1 < len(start) else len(r)
        ia, ib = body[e, 0], body[e, 1]
        a, b, c = column_of[ia], column_of[ib], target[e]
        for k in range(start[e], last):
            w = weight[k]
            f = w * r[k]
            x, y = _scaled_row(Ja, k, w, w / extent[ia]), _scaled_row(Jb, k, w, w / extent[ib])
            if a >= 0:
                for i in range(6):
                    gradient[a, i] += x[i] * f
                _add_outer(blocks, a, x, x)
            if b >= 0:
                for i in range(6):
                    gradient[b, i] += y[i] * f
                _add_outer(blocks, b, y, y)
            if c >= 0:
                if a > b:
                    _add_outer(blocks, c, x, y)
                else:
                    _add_outer(blocks, c, y, x)


@inner_kernel
def _cost(r, weight):
    cost = 0.0
    worst = 0.0
    for k in range(len(r)):
        x = r[k] * weight[k]
        cost += x * x
        worst = max(worst, abs(r[k]))
    return cost, worst


@kernel
def resolution(element, translation, tolerance):
    """The residual at which a system counts as solved: at least four roundings of the largest coordinate."""
    largest = 0.0
    for i in range(len(translation)):
        for j in range(3):
            largest = max(largest, abs(translation[i, j]))
    for e in range(len(element)):
        for j in range(3):
            largest = max(largest, max(abs(element[e, j]), abs(element[e, 12 + j])))
    return max(tolerance, 4.0 * EPSILON * largest)


@inner_kernel(allocates=True)
def levenberg_marquardt(
    code, body, element, param, start, weight, extent, column_of, target, column, row, update, update_start,
    rotation, translation, length, tolerance, max_iterations, caution,
):  # fmt: skip
    """Move the bodies (in place) until max|r| <= `resolution`, or to a local least-squares pose.

    The damping follows the square of the residual (Yamashita and Fukushima, Computing Suppl. 15, 2001): quadratic
    convergence on consistent systems even if J is rank-deficient, and steps of least norm. `caution` scales it.
    Returns (status, iterations, max|r|).
    """
    m = len(weight)
    n = len(column) - 1
    r, r_new = np.empty(m), np.empty(m)
    Ja, Jb = np.empty((m, 6)), np.empty((m, 6))
    evaluate(code, body, element, param, start, rotation, translation, r, Ja, Jb)
    cost, worst = _cost(r, weight)
    limit = resolution(element, translation, tolerance)
    if worst <= limit:
        return SOLVED, 0, worst
    blocks = np.empty((n + len(row), 6, 6))
    factored = np.empty_like(blocks)
    gradient = np.empty((n, 6))
    step = np.empty((n, 6))
    R, t = rotation.copy(), translation.copy()
    mu = caution
    slow = 0
    for iteration in range(1, max_iterations + 1):
        assemble(body, start, weight, extent, column_of, target, r, Ja, Jb, blocks, gradient)
        largest = 1.0
        for k in range(n):
            for i in range(6):
                largest = max(largest, blocks[k, i, i])
        while True:
            damping = max(mu * min(1.0, cost / (m * length * length)), DAMPING_FLOOR) * largest
            _copy3(blocks, factored)
            for k in range(n):
                for i in range(6):
                    factored[k, i, i] += damping
            if not factor(factored, column, row, update, update_start):
                mu = max(10.0 * mu, 100.0 * damping / largest / min(1.0, cost / (m * length * length)))
                continue
            for k in range(n):
                for i in range(6):
                    step[k, i] = -gradient[k, i]
            substitute(factored, column, row, step)
            size = 0.0
            predicted = 0.0
            for k in range(n):
                for i in range(6):
                    size = max(size, abs(step[k, i]))
                    predicted += step[k, i] * (damping * step[k, i] - gradient[k, i])
            move(rotation, translation, extent, column_of, step, R, t)
            evaluate(code, body, element, param, start, R, t, r_new, Ja, Jb)
            cost_new, worst_new = _cost(r_new, weight)
            if cost_new < cost:
                break
            if predicted <= 1e-15 * cost or size <= 1e-16 * length or mu > 1e12:
                return STATIONARY, iteration, worst
            mu = max(8.0 * mu, 8.0 * damping / largest / min(1.0, cost / (m * length * length)))
        gain = (cost - cost_new) / predicted
        if gain > 0.75:
            mu = max(0.2 * mu, 1e-8)
        elif gain < 0.25:
            mu *= 4.0
        slow = slow + 1 if cost_new > 0.99 * cost else 0
        _copy3(R, rotation)
        _copy2(t, translation)
        r, r_new = r_new, r
        cost, worst = cost_new, worst_new
        if worst <= limit:
            return SOLVED, iteration, worst
        if slow >= 4:
            return STATIONARY, iteration, worst
    return EXHAUSTED, max_iterations, worst


@kernel(allocates=True)
def solve_system(
    code, body, element, param, start, weight, extent, column_of, target, column, row, update, update_start,
    rotation, translation, length, tolerance, max_iterations,
):  # fmt: skip
    """Run `levenberg_marquardt`, with restarts while it ends far from a solution; the first solution is kept.

    Restarts have more damping, then displaced starts (a fixed sequence): a start 30° off may lead to a local minimum,
    and one next to it to a solution. The last ones start near the end of the attempt before.
    """
    R, t = rotation.copy(), translation.copy()
    status, iterations, worst = levenberg_marquardt(
        code, body, element, param, start, weight, extent, column_of, target, column, row, update, update_start,
        rotation, translation, length, tolerance, max_iterations, 1.0,
    )  # fmt: skip
    R_new, t_new = R, t
    for attempt in range(1, 1 + len(CAUTION) + BESIDE + STUCK):
        if status == SOLVED or worst <= ASTRAY * min(1.0, length):
            break
        R_old, t_old = (R, t) if attempt <= len(CAUTION) + BESIDE else (R_new, t_new)
        R_new, t_new = R_old.copy(), t_old.copy()
        caution = 1.0
        if attempt <= len(CAUTION):
            caution = CAUTION[attempt - 1]
        else:
            _push_aside(R_old, t_old, extent, column_of, len(column) - 1, attempt, R_new, t_new)
        status_new, more, worst_new = levenberg_marquardt(
            code, body, element, param, start, weight, extent, column_of, target, column, row, update, update_start,
            R_new, t_new, length, tolerance, max_iterations, caution,
        )  # fmt: skip
        iterations += more
        if status_new == SOLVED:
            status, worst = status_new, worst_new
            _copy3(R_new, rotation)
            _copy2(t_new, translation)
    return status, iterations, worst


@inner_kernel(allocates=True)
def _push_aside(rotation, translation, extent, column_of, n, attempt, new_rotation, new_translation):
    """Displace poses slightly, by multiples of the golden ratio: different in each attempt, equal in each run."""
    push = np.empty((n, 6))
    for k in range(n):
        for i in range(6):
            x = (attempt * 6 * n + 6 * k + i) * GOLDEN
            push[k, i] = PUSH * (2.0 * (x - math.floor(x)) - 1.0)
    for i in range(len(column_of)):
        for j in range(6):
            if column_of[i] >= 0:
                push[column_of[i], j] *= extent[i]
    move(rotation, translation, extent, column_of, push, new_rotation, new_translation)


@kernel
def solve_all(
    code, body, element, param, start, weight, extent, column_of, target, column, row, update, update_start, offset,
    length, rotation, translation, tolerance, max_iterations, status, iterations, worst,
):  # fmt: skip
    """Run `solve_system` on each of k packed systems; offset (k + 1, 6): see `system.Plan`."""
    for s in range(len(offset) - 1):
        e, f = offset[s, 0], offset[s + 1, 0]
        m, n = offset[s, 1], offset[s + 1, 1]
        b, c = offset[s, 2], offset[s + 1, 2]
        x, y = offset[s, 3], offset[s + 1, 3]
        status[s], iterations[s], worst[s] = solve_system(
            code[e:f], body[e:f], element[e:f], param[e:f], start[e:f], weight[m:n], extent[b:c], column_of[b:c],
            target[e:f], column[x:y], row[offset[s, 4] : offset[s + 1, 4]],
            update[offset[s, 5] : offset[s + 1, 5]], update_start[x:y],
            rotation[b:c], translation[b:c], length[s], tolerance, max_iterations,
        )  # fmt: skip
