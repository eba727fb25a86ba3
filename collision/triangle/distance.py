"""Distance kernels for two triangles: their closest points, a common point, a separating plane.

A corner or a vector is a tuple (x, y, z). Results are exact up to rounding; `collision.triangle.intersection` alone
decides whether triangles intersect, and `planes_part` returns True only beyond the rounding of its own arithmetic.
"""

from __future__ import annotations

from typing import Final

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import along, cross, dot, greatest, sub

ROUNDING: Final = 1e-14
"""1: generous bound of the relative rounding error of the few dozen operations of one pruning test"""


@inner_kernel
def _edge_edge(best, x, y, p, u, q, v):
    """Update (squared distance, x, y) with the common normal of the edges p + s·u and q + t·v, if it meets both."""
    n = cross(u, v)
    nn = dot(n, n)
    if nn > 0.0:
        w = sub(q, p)
        h = dot(w, n)
        if h * h < best * nn:
            s = dot(cross(w, v), n) / nn
            t = dot(cross(w, u), n) / nn
            if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
                e, f = along(p, s, u), along(q, t, v)
                g = sub(e, f)
                d = dot(g, g)
                if d < best:
                    return d, e, f
    return best, x, y


@kernel
def closest_features(a, b, c, p, q, r):
    """(squared distance, point of a b c, point of p q r) of the nearest features: 6 vertex-face and 9 edge-edge pairs.

    For triangles that do not intersect this is their distance. Each candidate is a pair of points that lie on the
    triangles up to rounding, so that an ill-conditioned candidate is never too near (Ericson 2005, 5.1).
    """
    w = sub(a, p)
    best, x, y = dot(w, w), a, p
    one, other = (a, b, c), (p, q, r)
    for v in one:
        f, _ = closest_on_triangle(v, p, q, r)
        w = sub(v, f)
        d = dot(w, w)
        if d < best:
            best, x, y = d, v, f
    for v in other:
        f, _ = closest_on_triangle(v, a, b, c)
        w = sub(v, f)
        d = dot(w, w)
        if d < best:
            best, x, y = d, f, v
    ours, theirs = (sub(b, a), sub(c, b), sub(a, c)), (sub(q, p), sub(r, q), sub(p, r))
    for k in range(9):
        best, x, y = _edge_edge(best, x, y, one[k // 3], ours[k // 3], other[k % 3], theirs[k % 3])
    return best, x, y


@inner_kernel
def _pierces(a, b, p, q, r):
    """(whether the segment a b meets the triangle p q r in one point, the point), up to rounding."""
    n = cross(sub(q, p), sub(r, p))
    ha, hb = dot(n, sub(a, p)), dot(n, sub(b, p))
    if (ha > 0.0) == (hb > 0.0) or ha == hb:
        return False, a
    f = along(a, ha / (ha - hb), sub(b, a))
    s = dot(cross(sub(q, p), sub(f, p)), n)
    t = dot(cross(sub(r, q), sub(f, q)), n)
    u = dot(cross(sub(p, r), sub(f, r)), n)
    return min(s, t, u) >= 0.0, f


@inner_kernel
def common_point(a, b, c, p, q, r):
    """A common point of two triangles, up to rounding: the middle of the segment in which they intersect."""
    one, other, n, total = (a, b, c), (p, q, r), 0, (0.0, 0.0, 0.0)
    for k in range(6):
        i, j = k % 3, (k + 1) % 3
        meet, f = _pierces(one[i], one[j], p, q, r) if k < 3 else _pierces(other[i], other[j], a, b, c)
        if meet:
            n, total = n + 1, along(total, 1.0, f)
    if n > 0:
        return (total[0] / n, total[1] / n, total[2] / n)
    _, e, f = closest_features(a, b, c, p, q, r)  # touching, or coplanar
    return (0.5 * (e[0] + f[0]), 0.5 * (e[1] + f[1]), 0.5 * (e[2] + f[2]))


@inner_kernel
def _beyond(n, o, p, q, r, size, bound):
    """Whether p, q, r surely lie on one side of the plane (n, o), all farther from it than `bound`.

    size: bound of the magnitude of n's entries.
    """
    u, v, w = sub(p, o), sub(q, o), sub(r, o)
    h0, h1, h2 = dot(n, u), dot(n, v), dot(n, w)
    if h0 < 0.0 and h1 < 0.0 and h2 < 0.0:
        h0, h1, h2 = -h0, -h1, -h2
    near = min(h0, h1, h2)
    if near <= 0.0:
        return False
    near -= ROUNDING * size * max(greatest(u), greatest(v), greatest(w))
    return near > 0.0 and near * near > bound * bound * dot(n, n)


@inner_kernel
def planes_part(one, other, bound):
    """Whether the plane of either triangle proves that two triangles are farther apart than `bound` (m)."""
    (a, b, c), (p, q, r) = one, other
    u, v = sub(b, a), sub(c, a)
    if _beyond(cross(u, v), a, p, q, r, greatest(u) * greatest(v), bound):
        return True
    u, v = sub(q, p), sub(r, p)
    return _beyond(cross(u, v), p, a, b, c, greatest(u) * greatest(v), bound)
