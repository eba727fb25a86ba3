"""Nearest point of a triangle, and its solid angle."""

from __future__ import annotations

from typing import Final

import numpy as np

from collision.numeric.kernel import inner_kernel
from collision.numeric.vectors import along, cross, dot, norm, sub

SURE: Final = 1e12
"""1: the side of an edge on which a point lies is reliable if the squared area is above 1/SURE of the squared size"""


@inner_kernel
def solid_angle(a, b, c):
    """Signed solid angle, sr, of a triangle seen from the origin: positive from behind.

    Van Oosterom & Strackee, "The Solid Angle of a Plane Triangle", 1983.
    """
    la, lb, lc = norm(a), norm(b), norm(c)
    return 2.0 * np.arctan2(dot(a, cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)


@inner_kernel
def closest_on_triangle(p, a, b, c):
    """(nearest point, feature on which it lies: 0 … 2 the edge ab, bc, ca, 3 … 5 the corner a, b, c, 6 the face).

    If the foot of p is outside the triangle, only the edges that p lies beyond are compared; for a sliver, where
    rounding makes the side unreliable, all three.
    """
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    n = cross(ab, ac)
    nn = dot(n, n)
    within_ab = dot(cross(n, ab), ap)
    within_ca = dot(cross(ac, n), ap)
    within_bc = dot(cross(n, sub(c, b)), sub(p, b))
    if within_ab > 0.0 and within_bc > 0.0 and within_ca > 0.0:
        return along(p, -dot(n, ap) / nn, n), 6
    size = dot(ab, ab) + dot(ac, ac) + dot(ap, ap)
    least = 0.0 if SURE * nn > size * size else np.inf
    best, nearest, feature = np.inf, a, 3
    for k in range(3):
        if (within_ab if k == 0 else (within_bc if k == 1 else within_ca)) > least:
            continue
        e, f = (a, b) if k == 0 else ((b, c) if k == 1 else (c, a))
        u, w = sub(f, e), sub(p, e)
        length, s = dot(u, u), dot(w, u)
        if s <= 0.0 or length == 0.0:
            q, on = e, 3 + k
        elif s >= length:
            q, on = f, 3 + (k + 1) % 3
        else:
            q, on = along(e, s / length, u), k
        w = sub(p, q)
        d = dot(w, w)
        if d < best:
            best, nearest, feature = d, q, on
    return nearest, feature
