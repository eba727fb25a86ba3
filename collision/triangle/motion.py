"""How long two triangles that move surely stay apart, and their signed distance.

At a time t every pair of triangles, or of boxes that hold them, yields a certificate: a direction n in a's frame along
which it is separated by g, the speed s at which b's points can close that gap at t, and a bound k of how fast that
speed can grow. The pair then stays apart for as long as s·dt + k·dt²/2 < g.

Both objects move along screws: body twists (v, w) are constant over t in [0, 1]. A point x of b, in a's frame, moves
with u = dv + dw × x, dw = R·w_b - w_a. In the world, where dw is constant, du/dt = dw × (the velocity x has by b's own
motion, of constant length), and a's frame turns with w_a; so for n fixed in a's frame

    |n·du/dt| <= |n × w_a|·|u| + (|n × dw| + |w_a × dw|)·|v_b + w_b × x_b|

where |w_a × dw| bounds how far dw can turn in a's frame within the unit of time.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel
from collision.numeric.vectors import cross, dot, norm, sub
from collision.triangle.distance import closest_features
from collision.triangle.intersection import triangles_meet


@inner_kernel
def _safe(g, s, k):
    """The greatest dt with s·dt + k·dt²/2 <= g, for g > 0 and k >= 0; infinity if there is none."""
    root = np.sqrt(s * s + 2.0 * k * g)
    if s + root > 0.0:
        return 2.0 * g / (s + root)
    return np.inf


@inner_kernel
def _range(n, a, b, c):
    x, y, z = dot(n, a), dot(n, b), dot(n, c)
    return min(x, y, z), max(x, y, z)


@inner_kernel
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


@inner_kernel
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


@inner_kernel
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
