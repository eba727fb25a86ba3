"""Stage 3, polygon intersection: do two triangles meet? Exact, from signs alone.

Triangles are closed sets: touching in a vertex, along an edge or in a coplanar face counts. A degenerate triangle is
the segment or the point that its corners span.

The straddling case is Guigue & Devillers, "Fast and Robust Triangle-Triangle Overlap Test Using Orientation
Predicates", J. Graphics Tools 8(1), 2003: six signs reject, two more decide. Whatever has a zero among the six signs
goes to `_touching`, which asks whether an edge of one meets the other.
"""

from __future__ import annotations

from collision.numeric.kernel import inner_kernel
from collision.numeric.predicates import orient2d, orient3d
from collision.triangle.filter import MEET, UNCERTAIN, arranged, verdict


@inner_kernel
def _turn(a, b, c, axis, w):
    """orient2d of the points seen along `axis` (0 … 2)."""
    if axis == 0:
        return orient2d(a[1], a[2], b[1], b[2], c[1], c[2], w)
    if axis == 1:
        return orient2d(a[2], a[0], b[2], b[0], c[2], c[0], w)
    return orient2d(a[0], a[1], b[0], b[1], c[0], c[1], w)


@inner_kernel
def _beyond_an_edge(a, b, c, turn, p, q, r, axis, w):
    """Whether an edge of the plane triangle a b c has all of p q r strictly on its outer side."""
    return (
        (_turn(a, b, p, axis, w) == -turn and _turn(a, b, q, axis, w) == -turn and _turn(a, b, r, axis, w) == -turn)
        or (_turn(b, c, p, axis, w) == -turn and _turn(b, c, q, axis, w) == -turn and _turn(b, c, r, axis, w) == -turn)
        or (_turn(c, a, p, axis, w) == -turn and _turn(c, a, q, axis, w) == -turn and _turn(c, a, r, axis, w) == -turn)
    )


@inner_kernel
def _ranges_meet(p, q, a, b, d):
    return min(p[d], q[d]) <= max(a[d], b[d]) and min(a[d], b[d]) <= max(p[d], q[d])


@inner_kernel
def _segments_meet(p, q, a, b, w):
    """Whether two closed segments in space meet; either may be a point."""
    if orient3d(p, q, a, b, w) != 0:
        return False
    for axis in range(3):
        s = _turn(p, q, a, axis, w)
        t = _turn(p, q, b, axis, w)
        u = _turn(a, b, p, axis, w)
        v = _turn(a, b, q, axis, w)
        if s != 0 or t != 0 or u != 0 or v != 0:  # seen along this axis their plane is not edge-on
            return s * t <= 0 and u * v <= 0
    return _ranges_meet(p, q, a, b, 0) and _ranges_meet(p, q, a, b, 1) and _ranges_meet(p, q, a, b, 2)  # on one line


@inner_kernel
def _segment_meets(p, q, sp, sq, a, b, c, w):
    """Whether the segment p q, whose ends lie on the sides sp and sq of the plane of a b c, meets that triangle."""
    if sp * sq > 0:
        return False
    if sp != 0 or sq != 0:  # one point of the plane: is it within all three edges?
        s = orient3d(p, q, a, b, w)
        t = orient3d(p, q, b, c, w)
        if s * t < 0:
            return False
        u = orient3d(p, q, c, a, w)
        return s * u >= 0 and t * u >= 0
    if _segments_meet(p, q, a, b, w) or _segments_meet(p, q, b, c, w) or _segments_meet(p, q, c, a, w):
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
    """The same if a corner lies in the plane of the second triangle: coplanar, touching or degenerate triangles."""
    (p1, q1, r1), (sp, sq, sr), (p2, q2, r2), (tp, tq, tr) = one, s, other, t
    if sp == 0 and sq == 0 and sr == 0 and tp == 0 and tq == 0 and tr == 0:
        for axis in range(3):
            turn1 = _turn(p1, q1, r1, axis, w)
            turn2 = _turn(p2, q2, r2, axis, w)
            if turn1 != 0 and turn2 != 0:
                return not (
                    _beyond_an_edge(p1, q1, r1, turn1, p2, q2, r2, axis, w)
                    or _beyond_an_edge(p2, q2, r2, turn2, p1, q1, r1, axis, w)
                )
    return (
        _segment_meets(p1, q1, sp, sq, p2, q2, r2, w)
        or _segment_meets(q1, r1, sq, sr, p2, q2, r2, w)
        or _segment_meets(r1, p1, sr, sp, p2, q2, r2, w)
        or _segment_meets(p2, q2, tp, tq, p1, q1, r1, w)
        or _segment_meets(q2, r2, tq, tr, p1, q1, r1, w)
        or _segment_meets(r2, p2, tr, tp, p1, q1, r1, w)
    )


@inner_kernel
def _meet(p1, q1, r1, p2, q2, r2, w):
    """Whether the closed triangles p1 q1 r1 and p2 q2 r2 have a point in common."""
    sp = orient3d(p2, q2, r2, p1, w)
    sq = orient3d(p2, q2, r2, q1, w)
    sr = orient3d(p2, q2, r2, r1, w)
    if sp == sq and sq == sr and sp != 0:
        return False
    tp = orient3d(p1, q1, r1, p2, w)
    tq = orient3d(p1, q1, r1, q2, w)
    tr = orient3d(p1, q1, r1, r2, w)
    if tp == tq and tq == tr and tp != 0:
        return False
    if sp == 0 or sq == 0 or sr == 0 or tp == 0 or tq == 0 or tr == 0:
        return _touching((p1, q1, r1), (sp, sq, sr), (p2, q2, r2), (tp, tq, tr), w)
    p1, q1, r1, p2, q2, r2 = arranged((p1, q1, r1), (sp, sq, sr), (p2, q2, r2), (tp, tq, tr))
    return orient3d(p1, q1, p2, q2, w) <= 0 and orient3d(p1, r1, r2, p2, w) <= 0


@inner_kernel
def triangles_meet(p1, q1, r1, p2, q2, r2, w):
    """Whether the closed triangles p1 q1 r1 and p2 q2 r2 have a point in common, exactly, though mostly by float64."""
    known = verdict(p1, q1, r1, p2, q2, r2)
    return _meet(p1, q1, r1, p2, q2, r2, w) if known == UNCERTAIN else known == MEET
