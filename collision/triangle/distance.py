"""Numba kernels about two triangles: their closest points, a point they have in common, a plane between them.

A corner or a vector is a tuple (x, y, z). These are numbers, right to rounding: whether triangles meet is decided by
`collision.triangle.intersection` alone, and `planes_part` says yes only when it is so beyond the rounding of its own
arithmetic.
"""

from __future__ import annotations

from typing import Final

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.vectors import along, cross, dot, greatest, sub

ROUNDING: Final = 1e-14
"""1: bound, generously, of the relative rounding error of the few dozen operations behind one pruning test."""


@inner_kernel
def closest_on_segment(p, a, b):
    """The point of the segment a b nearest p."""
    u = sub(b, a)
    length = dot(u, u)
    s = dot(sub(p, a), u)
    if s <= 0.0 or length == 0.0:
        return a
    if s >= length:
        return b
    return along(a, s / length, u)


@inner_kernel
def _vertex_edges(best, x, y, p, a, b, c):
    """Update (squared distance, x, y) with the point y of the edges of a b c that is nearest to x = p."""
    for k in range(3):
        if k == 0:
            q = closest_on_segment(p, a, b)
        elif k == 1:
            q = closest_on_segment(p, b, c)
        else:
            q = closest_on_segment(p, c, a)
        w = sub(p, q)
        d = dot(w, w)
        if d < best:
            best, x, y = d, p, q
    return best, x, y


@inner_kernel
def _vertex_face(best, x, y, p, a, b, c, n, nn):
    """Update (squared distance, x, y) with the foot of p on the triangle a b c of normal n, nn = n·n > 0, if inside."""
    h = dot(n, sub(p, a))
    if h * h < best * nn:
        f = along(p, -h / nn, n)
        if (
            dot(cross(sub(b, a), sub(f, a)), n) >= 0.0
            and dot(cross(sub(c, b), sub(f, b)), n) >= 0.0
            and dot(cross(sub(a, c), sub(f, c)), n) >= 0.0
        ):
            w = sub(p, f)
            d = dot(w, w)
            if d < best:
                return d, p, f
    return best, x, y


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
                e = along(p, s, u)
                f = along(q, t, v)
                g = sub(e, f)
                d = dot(g, g)
                if d < best:
                    return d, e, f
    return best, x, y


@kernel
def closest_features(a, b, c, p, q, r):
    """(squared distance, point of a b c, point of p q r) of the nearest features: 6 vertex-face and 9 edge-edge pairs.

    For triangles that do not meet this is their distance. Each candidate is a pair of points that lie on the triangles
    to rounding, so that an ill-conditioned candidate can only be too far, never too near (Ericson 2005, 5.1).
    """
    w = sub(a, p)
    best, x, y = dot(w, w), a, p
    best, x, y = _vertex_edges(best, x, y, a, p, q, r)
    best, x, y = _vertex_edges(best, x, y, b, p, q, r)
    best, x, y = _vertex_edges(best, x, y, c, p, q, r)
    best, y, x = _vertex_edges(best, y, x, p, a, b, c)
    best, y, x = _vertex_edges(best, y, x, q, a, b, c)
    best, y, x = _vertex_edges(best, y, x, r, a, b, c)
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    pq, qr, rp = sub(q, p), sub(r, q), sub(p, r)
    n = cross(pq, qr)
    nn = dot(n, n)
    if nn > 0.0:
        best, x, y = _vertex_face(best, x, y, a, p, q, r, n, nn)
        best, x, y = _vertex_face(best, x, y, b, p, q, r, n, nn)
        best, x, y = _vertex_face(best, x, y, c, p, q, r, n, nn)
    n = cross(ab, bc)
    nn = dot(n, n)
    if nn > 0.0:
        best, y, x = _vertex_face(best, y, x, p, a, b, c, n, nn)
        best, y, x = _vertex_face(best, y, x, q, a, b, c, n, nn)
        best, y, x = _vertex_face(best, y, x, r, a, b, c, n, nn)
    for k in range(3):
        if k == 0:
            o, u = a, ab
        elif k == 1:
            o, u = b, bc
        else:
            o, u = c, ca
        best, x, y = _edge_edge(best, x, y, o, u, p, pq)
        best, x, y = _edge_edge(best, x, y, o, u, q, qr)
        best, x, y = _edge_edge(best, x, y, o, u, r, rp)
    return best, x, y


@inner_kernel
def _pierces(a, b, p, q, r):
    """(how deep inside the triangle p q r the segment a b pierces it, where); depth -1 where it does not."""
    n = cross(sub(q, p), sub(r, p))
    ha, hb = dot(n, sub(a, p)), dot(n, sub(b, p))
    if (ha > 0.0) == (hb > 0.0) or ha == hb:
        return -1.0, a
    f = along(a, ha / (ha - hb), sub(b, a))
    s = dot(cross(sub(q, p), sub(f, p)), n)
    t = dot(cross(sub(r, q), sub(f, q)), n)
    u = dot(cross(sub(p, r), sub(f, r)), n)
    return min(s, t, u), f


@inner_kernel
def common_point(a, b, c, p, q, r):
    """A point that two triangles have in common, to rounding: the middle of the segment in which they cross."""
    n = 0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(6):
        if k == 0:
            depth, f = _pierces(a, b, p, q, r)
        elif k == 1:
            depth, f = _pierces(b, c, p, q, r)
        elif k == 2:
            depth, f = _pierces(c, a, p, q, r)
        elif k == 3:
            depth, f = _pierces(p, q, a, b, c)
        elif k == 4:
            depth, f = _pierces(q, r, a, b, c)
        else:
            depth, f = _pierces(r, p, a, b, c)
        if depth >= 0.0:
            x, y, z = x + f[0], y + f[1], z + f[2]
            n += 1
    if n > 0:
        return (x / n, y / n, z / n)
    _, e, f = closest_features(a, b, c, p, q, r)  # touching, or coplanar
    return (0.5 * (e[0] + f[0]), 0.5 * (e[1] + f[1]), 0.5 * (e[2] + f[2]))


@inner_kernel
def _beyond(n, o, p, q, r, size, bound):
    """Whether p, q, r lie on one side of the plane (n, o), all farther from it than `bound`, whatever the rounding."""
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
    """Whether the plane of one triangle proves that they are farther apart than `bound`."""
    (a, b, c), (p, q, r) = one, other
    u, v = sub(b, a), sub(c, a)
    if _beyond(cross(u, v), a, p, q, r, greatest(u) * greatest(v), bound):
        return True
    u, v = sub(q, p), sub(r, p)
    return _beyond(cross(u, v), p, a, b, c, greatest(u) * greatest(v), bound)
