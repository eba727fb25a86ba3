"""Numba kernels about the solid a mesh bounds: winding number, nearest point, signed distance."""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.kernels_triangles import closest_on_segment
from collision.kernels_vector import along, cross, dot, sub
from collision.predicates import KERNEL


@njit(error_model="numpy", **KERNEL)
def winding_number(vertices, triangles, p):
    """How often the mesh winds about p: the sum of the triangles' signed solid angles, over 4π.

    Van Oosterom & Strackee, "The Solid Angle of a Plane Triangle", 1983; Jacobson et al., "Robust Inside-Outside
    Segmentation using Generalized Winding Numbers", 2013. 1 inside and 0 outside a closed mesh with outward normals.
    """
    total = 0.0
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        a = (vertices[i, 0] - p[0], vertices[i, 1] - p[1], vertices[i, 2] - p[2])
        b = (vertices[j, 0] - p[0], vertices[j, 1] - p[1], vertices[j, 2] - p[2])
        c = (vertices[k, 0] - p[0], vertices[k, 1] - p[1], vertices[k, 2] - p[2])
        la, lb, lc = np.sqrt(dot(a, a)), np.sqrt(dot(b, b)), np.sqrt(dot(c, c))
        numerator = dot(a, cross(b, c))
        denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total += 2.0 * np.arctan2(numerator, denominator)
    return total / (4.0 * np.pi)


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


@njit(error_model="numpy", **KERNEL)
def signed_distance(vertices, box, second, first, count, corner, face, edge, vertex, p, stack, gap):
    """(distance, negative behind the surface; nearest point; its triangle, in leaf order) of the mesh and a point.

    The side is told by the pseudonormal of the nearest feature, which is right for any closed mesh (Bærentzen & Aanæs,
    "Signed Distance Computation Using the Angle Weighted Pseudonormal", 2005). face: (m, 3), edge: (m, 3, 3), vertex:
    (m, 3, 3) pseudonormals by triangle in leaf order.
    """
    best, nearest, triangle, feature = distance(0, vertices, box, second, first, count, corner, p, np.inf, stack, gap)
    if feature == 6:
        n = (face[triangle, 0], face[triangle, 1], face[triangle, 2])
    elif feature < 3:
        n = (edge[triangle, feature, 0], edge[triangle, feature, 1], edge[triangle, feature, 2])
    else:
        k = feature - 3
        n = (vertex[triangle, k, 0], vertex[triangle, k, 1], vertex[triangle, k, 2])
    apart = np.sqrt(best)
    return (-apart if dot(n, sub(p, nearest)) < 0.0 else apart), nearest, triangle


@njit(error_model="numpy", **KERNEL)
def signed_distances(vertices, box, second, first, count, corner, face, edge, vertex, points, out, stack, gap):
    """`signed_distance` of many points (n, 3): distances into `out` (n,)."""
    for i in range(len(points)):
        p = (points[i, 0], points[i, 1], points[i, 2])
        out[i], _, _ = signed_distance(vertices, box, second, first, count, corner, face, edge, vertex, p, stack, gap)
