"""Numba kernels about the solid a mesh bounds: solid angles, nearest point."""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.kernels_triangles import closest_on_segment
from collision.kernels_vector import along, cross, dot, norm, sub
from collision.predicates import KERNEL


@njit(error_model="numpy", **KERNEL)
def solid_angle(a, b, c):
    """sr, the signed solid angle of a triangle seen from the origin: positive from behind.

    Van Oosterom & Strackee, "The Solid Angle of a Plane Triangle", 1983.
    """
    la, lb, lc = norm(a), norm(b), norm(c)
    return 2.0 * np.arctan2(dot(a, cross(b, c)), la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)


@njit(error_model="numpy", **KERNEL)
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


@njit(error_model="numpy", **KERNEL)
def _gap(box, i, p):
    x = max(0.0, box[i, 0] - p[0], p[0] - box[i, 3])
    y = max(0.0, box[i, 1] - p[1], p[1] - box[i, 4])
    z = max(0.0, box[i, 2] - p[2], p[2] - box[i, 5])
    return x * x + y * y + z * z


@njit(error_model="numpy", **KERNEL)
def distance(root, vertices, box, second, first, count, corner, p, bound, stack, gap):
    """(squared distance, nearest point, its triangle in leaf order, feature) of a point and the triangles below a node.

    Only what is nearer than `bound` (squared, m²) is looked for; triangle -1 if there is nothing.
    """
    best = bound
    nearest = p
    triangle, feature = -1, 6
    stack[0] = root
    gap[0] = _gap(box, root, p)
    top = 1
    while top > 0:
        top -= 1
        if gap[top] >= best:
            continue
        i = stack[top]
        if second[i] < 0:
            for t in range(first[i], first[i] + count[i]):
                a = (vertices[corner[t, 0], 0], vertices[corner[t, 0], 1], vertices[corner[t, 0], 2])
                b = (vertices[corner[t, 1], 0], vertices[corner[t, 1], 1], vertices[corner[t, 1], 2])
                c = (vertices[corner[t, 2], 0], vertices[corner[t, 2], 1], vertices[corner[t, 2], 2])
                q, where = closest_on_triangle(p, a, b, c)
                w = sub(p, q)
                d = dot(w, w)
                if d < best:
                    best, nearest, triangle, feature = d, q, t, where
            continue
        g0, g1 = _gap(box, i + 1, p), _gap(box, second[i], p)
        near, far = i + 1, second[i]
        if g1 < g0:
            near, far, g0, g1 = far, near, g1, g0
        stack[top], gap[top] = far, g1
        stack[top + 1], gap[top + 1] = near, g0
        top += 2
    return best, nearest, triangle, feature
