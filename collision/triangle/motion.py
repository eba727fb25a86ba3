"""Lower bounds of the time for which two moving triangles stay apart, and their signed distance.

At a time t every pair of triangles, or of boxes that contain them, has a certificate: a direction n in a's frame along
which the pair is separated by g, the speed s at which b's points can close that gap at t, and a bound k of the growth
rate of that speed. The pair then stays apart for as long as s·dt + k·dt²/2 < g.

Both objects move along screws: body twists (v, w) are constant over t in [0, 1]. A point x of b, in a's frame, has the
velocity u = dv + dw × x, dw = R·w_b - w_a. In the world, where dw is constant, du/dt is dw × (velocity of x by b's own
motion, which has constant length), and a's frame turns with w_a; so for n fixed in a's frame

    |n·du/dt| <= |n × w_a|·|u| + (|n × dw| + |w_a × dw|)·|v_b + w_b × x_b|

where |w_a × dw| bounds the rotation of dw in a's frame within the unit of time.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from collision.numeric.kernel import inner_kernel
from collision.numeric.vectors import cross, dot, norm, scaled, sub
from collision.triangle.distance import closest_features
from collision.triangle.intersection import triangles_meet


@inner_kernel
def _safe(g, s, k):
    """The greatest dt with s·dt + k·dt²/2 <= g, for g > 0 and k >= 0; infinity if there is none."""
    root = np.sqrt(s * s + 2.0 * k * g)
    if s + root > 0.0:
        return 2.0 * g / (s + root)
    return np.inf


class RelativeMotion(NamedTuple):
    """Motion of the triangles of b relative to a, in a's frame; the unit of time is the whole motion."""

    velocity: Any
    """(x, y, z) m: velocity of the point of b at a's origin"""
    turn: Any
    """(x, y, z) rad: angular velocity of b against a"""
    turn_a: Any
    """(x, y, z) rad: angular velocity of a"""
    fastest: Any
    """m: bound of the speed of b's points relative to a at any time"""
    own: Any
    """m: bound of their speed by b's own motion"""


STILL: Final = RelativeMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


@inner_kernel
def _range(n, triangle):
    x, y, z = dot(n, triangle[0]), dot(n, triangle[1]), dot(n, triangle[2])
    return min(x, y, z), max(x, y, z)


@inner_kernel
def _hold(n, offset, triangle, motion, aim):
    """Lower bound of the time for which a moving triangle stays more than `aim` beyond the plane n·x = `offset`.

    The speed is taken at each corner: a distant corner of a large turning triangle may be fast.
    """
    turn, turn_a = motion.turn, motion.turn_a
    if turn == turn_a == (0.0, 0.0, 0.0):
        gap, closing = _range(n, triangle)[0] - offset - aim, -dot(n, motion.velocity)
        return (gap / closing if closing > 0.0 else np.inf) if gap > 0.0 else 0.0
    bend = norm(cross(n, turn)) + norm(cross(turn_a, turn))
    growth = norm(cross(n, turn_a)) * motion.fastest + bend * motion.own
    hold = np.inf
    for x in triangle:
        gap = dot(n, x) - offset - aim
        if gap <= 0.0:
            return 0.0
        hold = min(hold, _safe(gap, -dot(n, motion.velocity) - dot(n, cross(turn, x)), growth))
    return hold


@inner_kernel
def separation(one, other, motion, aim, enough):
    """(separation of two triangles, lower bound of the time for which it stays above `aim`).

    The separation is the greatest over both normals and all cross products of edges. For triangles that meet it is
    minus the length of the shortest translation that separates them, 0 for coplanar ones. The time is the longest over
    the axes; the search ends with the first axis along which it is at least `enough`.
    """
    (a, b, c), (p, q, r) = one, other
    ours, theirs = (sub(b, a), sub(c, b), sub(a, c)), (sub(q, p), sub(r, q), sub(p, r))
    best, hold = -np.inf, 0.0
    for k in range(-2, 9):
        if k == -2:
            n = cross(ours[0], ours[1])
        elif k == -1:
            n = cross(theirs[0], theirs[1])
        else:
            n = cross(ours[k // 3], theirs[k % 3])
        length = norm(n)
        if length == 0.0:
            continue
        n = scaled(1.0 / length, n)
        low_a, high_a = _range(n, one)
        low_b, high_b = _range(n, other)
        ahead, behind = low_b - high_a, low_a - high_b
        best = max(best, ahead, behind)
        if ahead > aim:
            hold = max(hold, _hold(n, high_a, other, motion, aim))
        if behind > aim:
            hold = max(hold, _hold(scaled(-1.0, n), -low_a, other, motion, aim))
        if best > aim and hold >= enough:
            break
    if best == -np.inf:
        best = 0.0  # degenerate to points or parallel segments
    return best, hold


@inner_kernel
def pair_step(one, other, motion, aim, enough, touching, work):
    """(signed distance of two triangles, lower bound of the time for which it stays above `aim`).

    The signed distance is their distance, or their separation if they meet or are nearer than `touching` (m), below
    which float64 does not resolve the direction between the witness points; or, if the time is at least `enough`, a
    lower bound of it. work: workspace of `numeric.predicates`.
    """
    s, hold = separation(one, other, motion, aim, enough)
    (a, b, c), (p, q, r) = one, other
    if (s > aim and hold >= enough) or triangles_meet(a, b, c, p, q, r, work):
        return s, hold
    d2, x, y = closest_features(a, b, c, p, q, r)
    d = np.sqrt(d2)
    if d <= touching:
        return s, hold
    if d > aim:
        n = scaled(1.0 / d, sub(y, x))
        _, offset = _range(n, one)
        hold = max(hold, _hold(n, offset, other, motion, aim))
    return d, hold
