"""Floating-point filter of the intersection of two triangles: most pairs are decided here, with few branches.

The six signs of `collision.triangle.intersection` share two normals: with o, e, f the first corner and two edges of a
triangle, the sign of a point x is that of (x - o) · (e × f), whose error is at most `ORIENT3D` times the same sum of
absolute values (Shewchuk's bound for orient3d, which holds for an expansion along any row or column).
"""

from __future__ import annotations

from typing import Final

from collision.numeric.kernel import inner_kernel
from collision.numeric.predicates import ORIENT3D, TINY

APART: Final = 0
MEET: Final = 1
UNCERTAIN: Final = -1


@inner_kernel(forceinline=True)
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner_kernel(forceinline=True)
def _plane(e, f):
    """(e × f, the sums of the absolute values of its terms)."""
    yz, zy = e[1] * f[2], e[2] * f[1]
    zx, xz = e[2] * f[0], e[0] * f[2]
    xy, yx = e[0] * f[1], e[1] * f[0]
    return (yz - zy, zx - xz, xy - yx), (abs(yz) + abs(zy), abs(zx) + abs(xz), abs(xy) + abs(yx))


@inner_kernel(forceinline=True)
def _above(d, plane):
    """1 if d · (e × f) is positive, -1 if negative, 0 if uncertain."""
    n, m = plane
    det = d[0] * n[0] + d[1] * n[1] + d[2] * n[2]
    bound = ORIENT3D * (abs(d[0]) * m[0] + abs(d[1]) * m[1] + abs(d[2]) * m[2]) + TINY
    return int(det > bound) - int(det < -bound)


@inner_kernel(forceinline=True)
def _turned(p, q, r, sp, sq, sr):
    """The corners of a triangle, permuted cyclically so that the first is alone on its side, and the sign of that side.

    sp, sq, sr: signs of the corners, none of them 0.
    """
    if sp == sq:
        return r, p, q, sr
    if sp == sr:
        return q, r, p, sq
    return p, q, r, sp


@inner_kernel(forceinline=True)
def arranged(one, s, other, t):
    """The corners of both triangles in Guigue & Devillers' canonical form: each permuted cyclically so that its first
    corner is alone on its side of the other's plane, and mirrored so that the side is the positive one.

    s, t: signs of the corners of `one` and `other`, none of them 0.
    """
    p1, q1, r1, sp = _turned(one[0], one[1], one[2], s[0], s[1], s[2])
    p2, q2, r2, tp = _turned(other[0], other[1], other[2], t[0], t[1], t[2])
    if sp < 0:
        q2, r2 = r2, q2
    if tp < 0:
        q1, r1 = r1, q1
    return p1, q1, r1, p2, q2, r2


@inner_kernel
def verdict(p1, q1, r1, p2, q2, r2):
    """Whether the closed triangles p1 q1 r1 and p2 q2 r2 intersect: `MEET`, `APART` or `UNCERTAIN`.

    Guigue & Devillers' test, as in `triangle.intersection`; uncertain if a corner is too near the other's plane.
    """
    plane = _plane(_minus(q2, p2), _minus(r2, p2))
    sp, sq, sr = _above(_minus(p1, p2), plane), _above(_minus(q1, p2), plane), _above(_minus(r1, p2), plane)
    if abs(sp + sq + sr) == 3:
        return APART
    plane = _plane(_minus(q1, p1), _minus(r1, p1))
    tp, tq, tr = _above(_minus(p2, p1), plane), _above(_minus(q2, p1), plane), _above(_minus(r2, p1), plane)
    if abs(tp + tq + tr) == 3:
        return APART
    if sp * sq * sr * tp * tq * tr == 0:
        return UNCERTAIN
    # `orient3d` has the opposite sign
    p1, q1, r1, p2, q2, r2 = arranged((p1, q1, r1), (-sp, -sq, -sr), (p2, q2, r2), (-tp, -tq, -tr))
    between = _minus(p2, p1)
    left = _above(between, _plane(_minus(q1, p1), _minus(q2, p1)))
    right = _above(between, _plane(_minus(r1, p1), _minus(r2, p1)))
    if left > 0 or right < 0:
        return APART
    return MEET if left < 0 and right > 0 else UNCERTAIN
