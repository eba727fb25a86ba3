"""Numba kernels: how long two pieces that move surely stay apart, be they nodes of two trees or two triangles.

At a time t every pair of pieces yields a certificate: a direction n in a's frame along which it is separated by g, the
speed s at which b's points can close that gap at t, and a bound k of how fast that speed can grow. The pair then stays
apart for as long as s·dt + k·dt²/2 < g.

Both objects move along screws: body twists (v, w) are constant over t in [0, 1]. A point x of b, in a's frame, moves
with u = dv + dw × x, dw = R·w_b - w_a. In the world, where dw is constant, du/dt = dw × (the velocity x has by b's own
motion, of constant length), and a's frame turns with w_a; so for n fixed in a's frame

    |n·du/dt| <= |n × w_a|·|u| + (|n × dw| + |w_a × dw|)·|v_b + w_b × x_b|

where |w_a × dw| bounds how far dw can turn in a's frame within the unit of time.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.kernels_triangles import closest_features
from collision.kernels_vector import cross, dot, norm, rotated, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL


@njit(error_model="numpy", **KERNEL)
def _safe(g, s, k):
    """The greatest dt with s·dt + k·dt²/2 <= g, for g > 0 and k >= 0; infinity if there is none."""
    root = np.sqrt(s * s + 2.0 * k * g)
    if s + root > 0.0:
        return 2.0 * g / (s + root)
    return np.inf


@njit(error_model="numpy", **KERNEL)
def node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb):
    """(middle of a node of b in a's frame, its half extents, velocity of the middle, speed of the fastest point against
    a now, against a at any time up to 1, and by b's own motion)."""
    bc = (0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5]))
    bh = (box_b[j, 3] - bc[0], box_b[j, 4] - bc[1], box_b[j, 5] - bc[2])
    c = rotated(rotation, bc)
    c = (c[0] + translation[0], c[1] + translation[1], c[2] + translation[2])
    radius = norm(bh)
    u = cross(dw, c)
    u = (u[0] + dv[0], u[1] + dv[1], u[2] + dv[2])
    own = cross(wb, bc)
    own = (own[0] + vb[0], own[1] + vb[1], own[2] + vb[2])
    turn = norm(dw)
    fastest = norm(u) + turn * radius
    pace = norm(own) + norm(wb) * radius
    return c, bh, u, fastest, fastest + turn * pace, pace


@njit(error_model="numpy", **KERNEL)
def node_step(box_a, i, box_b, j, rotation, translation, dv, dw, wa, vb, wb, level, aim):
    """How long two nodes that are more than `level` (m) apart, or overlap by less, surely stay `aim` apart; else 0.

    The gap of the boxes along an axis is never more than the signed distance of triangles in them.
    """
    if level == -np.inf:
        return np.inf
    c, bh, u, fastest, ever, pace = node_speeds(box_b, j, rotation, translation, dv, dw, vb, wb)
    turn, bend = norm(dw), norm(cross(wa, dw))
    step = 0.0
    square = 0.0
    for d in range(3):
        e, f = (d + 1) % 3, (d + 2) % 3
        half = abs(rotation[d, 0]) * bh[0] + abs(rotation[d, 1]) * bh[1] + abs(rotation[d, 2]) * bh[2]
        middle = 0.5 * (box_a[i, d] + box_a[i, d + 3])
        offset = c[d] - middle
        gap = abs(offset) - half - (box_a[i, d + 3] - middle)
        if gap > level:
            closing = -u[d] if offset > 0.0 else u[d]
            for k in range(3):
                closing += abs(dw[e] * rotation[f, k] - dw[f] * rotation[e, k]) * bh[k]
            spin = np.sqrt(dw[e] * dw[e] + dw[f] * dw[f])
            growth = np.sqrt(wa[e] * wa[e] + wa[f] * wa[f]) * ever + (spin + bend) * pace
            step = max(step, _safe(gap - aim, closing, growth))
        if gap > 0.0:
            square += gap * gap
    distance = np.sqrt(square)
    if distance > max(level, 0.0):
        step = max(step, _safe(distance - aim, fastest, norm(wa) * ever + (turn + bend) * pace))
    return step


@njit(error_model="numpy", **KERNEL)
def _range(n, a, b, c):
    x, y, z = dot(n, a), dot(n, b), dot(n, c)
    return min(x, y, z), max(x, y, z)


@njit(error_model="numpy", **KERNEL)
def _hold(n, front, p, q, r, dv, dw, wa, ever, pace, aim):
    """How long p, q, r, which move, surely stay more than `aim` beyond the plane n·x = `front`: each by its own speed.

    What is far beyond may come fast: a large triangle beside a small one that turns.
    """
    growth = norm(cross(n, wa)) * ever + (norm(cross(n, dw)) + norm(cross(wa, dw))) * pace
    hold = np.inf
    for k in range(3):
        x = p if k == 0 else (q if k == 1 else r)
        gap = dot(n, x) - front - aim
        if gap <= 0.0:
            return 0.0
        hold = min(hold, _safe(gap, -dot(n, dv) - dot(n, cross(dw, x)), growth))
    return hold


@njit(error_model="numpy", **KERNEL)
def separation(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough):
    """(separation of two triangles, how long it surely stays above `aim`), over their normals and products of edges.

    The separation is the greatest over these axes. For triangles that meet it is minus the length of the shortest
    translation that parts them, 0 for triangles in one plane. It holds as long as along the axis that holds longest.
    Ends with the first axis that shows it to be above `level`, and to hold for `enough`.
    """
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    pq, qr, rp = sub(q, p), sub(r, q), sub(p, r)
    best, hold = -np.inf, 0.0
    for k in range(-2, 9):
        if k == -2:
            n = cross(ab, bc)
        elif k == -1:
            n = cross(pq, qr)
        else:
            u = ab if k < 3 else (bc if k < 6 else ca)
            v = pq if k % 3 == 0 else (qr if k % 3 == 1 else rp)
            n = cross(u, v)
        length = norm(n)
        if length == 0.0:
            continue
        n = (n[0] / length, n[1] / length, n[2] / length)
        low_a, high_a = _range(n, a, b, c)
        low_b, high_b = _range(n, p, q, r)
        ahead, behind = low_b - high_a, low_a - high_b
        best = max(best, ahead, behind)
        if ahead > aim:
            hold = max(hold, _hold(n, high_a, p, q, r, dv, dw, wa, ever, pace, aim))
        if behind > aim:
            n = (-n[0], -n[1], -n[2])
            hold = max(hold, _hold(n, -low_a, p, q, r, dv, dw, wa, ever, pace, aim))
        if best > level and hold >= enough:
            break
    if best == -np.inf:
        best = 0.0  # points or parallel segments, which meet in a point or along a line
    return best, hold


@njit(error_model="numpy", **KERNEL)
def pair_step(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough, touching, work):
    """(signed distance of two triangles, how long it surely stays above `aim`); less exact if that is `enough`.

    Signed distance: the distance, or the separation where they meet or are nearer than `touching` (m), below which
    float64 no longer tells the direction from one witness to the other.
    """
    s, hold = separation(a, b, c, p, q, r, dv, dw, wa, ever, pace, level, aim, enough)
    if (s > level and hold >= enough) or triangles_meet(a, b, c, p, q, r, work):
        return s, hold
    d2, x, y = closest_features(a, b, c, p, q, r)
    d = np.sqrt(d2)
    if d <= touching:
        return s, hold
    if d > aim:
        n = sub(y, x)
        n = (n[0] / d, n[1] / d, n[2] / d)
        _, front = _range(n, a, b, c)
        hold = max(hold, _hold(n, front, p, q, r, dv, dw, wa, ever, pace, aim))
    return d, hold
