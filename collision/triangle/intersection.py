"""Exact intersection test of two triangles, from signs alone.

Triangles are closed sets: touching in a vertex, along an edge or in a coplanar face counts. A degenerate triangle is
the segment or the point that its corners span.

If none of the six signs of corners and planes is zero, the test is that of Guigue & Devillers, "Fast and Robust
Triangle-Triangle Overlap Test Using Orientation Predicates", J. Graphics Tools 8(1), 2003: six signs reject, two more
decide. Otherwise `_touching` tests each edge of one triangle against the other triangle.
"""

from __future__ import annotations

from collision.numeric.kernel import inner_kernel
from collision.numeric.predicates import orient2d, orient3d
from collision.triangle.filter import MEET, UNCERTAIN, arranged, verdict


@inner_kernel
def _turn(a, b, c, axis, w):
    """orient2d of three points projected along `axis` (0 … 2)."""
    if axis == 0:
        return orient2d(a[1], a[2], b[1], b[2], c[1], c[2], w)
    if axis == 1:
        return orient2d(a[2], a[0], b[2], b[0], c[2], c[0], w)
    return orient2d(a[0], a[1], b[0], b[1], c[0], c[1], w)


@inner_kernel
def _beyond_an_edge(one, turn, other, axis, w):
    """Whether all corners of `other` are strictly outside one edge of `one`, both projected along `axis`.

    turn: orientation of `one`, 1 or -1.
    """
    p, q, r = other
    for k in range(3):
        a, b = one[k], one[(k + 1) % 3]
        if _turn(a, b, p, axis, w) == _turn(a, b, q, axis, w) == _turn(a, b, r, axis, w) == -turn:
            return True
    return False


@inner_kernel
def _ranges_meet(p, q, a, b, d):
    return min(p[d], q[d]) <= max(a[d], b[d]) and min(a[d], b[d]) <= max(p[d], q[d])


@inner_kernel
def _segments_meet(p, q, a, b, w):
    """Whether two closed segments in space intersect; either may be a point."""
    if orient3d(p, q, a, b, w) != 0:
        return False
    for axis in range(3):
        s, t = _turn(p, q, a, axis, w), _turn(p, q, b, axis, w)
        u, v = _turn(a, b, p, axis, w), _turn(a, b, q, axis, w)
        if s != 0 or t != 0 or u != 0 or v != 0:  # their plane is not parallel to this axis
            return s * t <= 0 and u * v <= 0
    return _ranges_meet(p, q, a, b, 0) and _ranges_meet(p, q, a, b, 1) and _ranges_meet(p, q, a, b, 2)  # on one line


@inner_kernel
def _segment_meets(p, q, sp, sq, triangle, w):
    """Whether a segment p q intersects a triangle; sp, sq: signs of p and q for the triangle's plane."""
    if sp * sq > 0:
        return False
    a, b, c = triangle
    if sp != 0 or sq != 0:  # the segment meets the plane in one point: is it within all three edges?
        s, t = orient3d(p, q, a, b, w), orient3d(p, q, b, c, w)
        if s * t < 0:
            return False
        u = orient3d(p, q, c, a, w)
        return s * u >= 0 and t * u >= 0
    for k in range(3):
        if _segments_meet(p, q, triangle[k], triangle[(k + 1) % 3], w):
            return True
    for axis in range(3):
        turn = _turn(a, b, c, axis, w)
        if turn != 0:
            return (
                _turn(a, b, p, axis, w) == turn and _turn(b, c, p, axis, w) == turn and _turn(c, a, p, axis, w) == turn
            )
    return False


@inner_kernel
def _touching(one, s, other, t, w):
    """Whether two triangles intersect of which a corner lies in the other's plane: coplanar, touching or degenerate.

    s, t: signs of the corners of `one` and of `other`.
    """
    if s == t == (0, 0, 0):
        for axis in range(3):
            turn1 = _turn(one[0], one[1], one[2], axis, w)
            turn2 = _turn(other[0], other[1], other[2], axis, w)
            if turn1 != 0 and turn2 != 0:
                return not (_beyond_an_edge(one, turn1, other, axis, w) or _beyond_an_edge(other, turn2, one, axis, w))
    for i in range(3):
        j = (i + 1) % 3
        if _segment_meets(one[i], one[j], s[i], s[j], other, w) or _segment_meets(
            other[i], other[j], t[i], t[j], one, w
        ):
            return True
    return False


@inner_kernel
def _sides(a, b, c, triangle, w):
    """The signs of the corners of a triangle for the plane of a b c."""
    return orient3d(a, b, c, triangle[0], w), orient3d(a, b, c, triangle[1], w), orient3d(a, b, c, triangle[2], w)


@inner_kernel
def _meet(one, other, w):
    """Whether two closed triangles intersect, by exact signs."""
    s = _sides(other[0], other[1], other[2], one, w)
    if abs(s[0] + s[1] + s[2]) == 3:
        return False
    t = _sides(one[0], one[1], one[2], other, w)
    if abs(t[0] + t[1] + t[2]) == 3:
        return False
    if s[0] * s[1] * s[2] * t[0] * t[1] * t[2] == 0:
        return _touching(one, s, other, t, w)
    p1, q1, r1, p2, q2, r2 = arranged(one, s, other, t)
    return orient3d(p1, q1, p2, q2, w) <= 0 and orient3d(p1, r1, r2, p2, w) <= 0


@inner_kernel
def triangles_meet(p1, q1, r1, p2, q2, r2, w):
    """Whether the closed triangles p1 q1 r1 and p2 q2 r2 intersect. Exact, in most cases by float64 alone.

    w: workspace of `numeric.predicates`.
    """
    known = verdict(p1, q1, r1, p2, q2, r2)
    return _meet((p1, q1, r1), (p2, q2, r2), w) if known == UNCERTAIN else known == MEET
