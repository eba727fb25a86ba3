"""A point and a triangle: the nearest point, and the solid angle."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel
from collision.numeric.vectors import along, cross, dot, norm, sub
from collision.triangle.distance import closest_on_segment


@inner_kernel
def solid_angle(a, b, c):
    """sr, the signed solid angle of a triangle seen from the origin: positive from behind.

    Van Oosterom & Strackee, "The Solid Angle of a Plane Triangle", 1983.
    """
    la, lb, lc = norm(a), norm(b), norm(c)
    return 2.0 * np.arctan2(dot(a, cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)


@inner_kernel
def closest_on_triangle(p, a, b, c):
    """(nearest point, where it lies: 0 … 2 on the edge ab, bc, ca, 3 … 5 in the corner a, b, c, 6 inside)."""
    n = cross(sub(b, a), sub(c, a))
    nn = dot(n, n)
    if nn > 0.0:
        f = along(p, -dot(n, sub(p, a)) / nn, n)
        if (
            dot(cross(sub(b, a), sub(f, a)), n) > 0.0
            and dot(cross(sub(c, b), sub(f, b)), n) > 0.0
            and dot(cross(sub(a, c), sub(f, c)), n) > 0.0
        ):
            return f, 6
    best, nearest, feature = np.inf, a, 3
    for k in range(3):
        e, f = (a, b) if k == 0 else ((b, c) if k == 1 else (c, a))
        q = closest_on_segment(p, e, f)
        w = sub(p, q)
        d = dot(w, w)
        if d < best:
            best, nearest = d, q
            if q == e:
                feature = 3 + k
            elif q == f:
                feature = 3 + (k + 1) % 3
            else:
                feature = k
    return nearest, feature
