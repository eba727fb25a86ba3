"""Numba kernels about the solid a mesh bounds: winding number, signed distance, the deepest point of a triangle."""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.kernels_distance import closest_on_segment, planes_part
from collision.kernels_vector import along, cross, dot, sub
from collision.polygons import triangles_meet
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


@njit(error_model="numpy", **KERNEL)
def _to_triangle(vertices, corner, t, p):
    a = (vertices[corner[t, 0], 0], vertices[corner[t, 0], 1], vertices[corner[t, 0], 2])
    b = (vertices[corner[t, 1], 0], vertices[corner[t, 1], 1], vertices[corner[t, 1], 2])
    c = (vertices[corner[t, 2], 0], vertices[corner[t, 2], 1], vertices[corner[t, 2], 2])
    q, _ = closest_on_triangle(p, a, b, c)
    w = sub(p, q)
    return np.sqrt(dot(w, w))


@njit(error_model="numpy", **KERNEL)
def _meets(vertices, box, second, first, count, corner, p, q, r, stack, work):
    """Whether the triangle p q r meets any of the mesh."""
    low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
    high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        i = stack[top]
        if (
            box[i, 0] > high[0] or low[0] > box[i, 3]
            or box[i, 1] > high[1] or low[1] > box[i, 4]
            or box[i, 2] > high[2] or low[2] > box[i, 5]
        ):  # fmt: skip
            continue
        if second[i] >= 0:
            stack[top], stack[top + 1] = i + 1, second[i]
            top += 2
            continue
        for t in range(first[i], first[i] + count[i]):
            a = (vertices[corner[t, 0], 0], vertices[corner[t, 0], 1], vertices[corner[t, 0], 2])
            b = (vertices[corner[t, 1], 0], vertices[corner[t, 1], 1], vertices[corner[t, 1], 2])
            c = (vertices[corner[t, 2], 0], vertices[corner[t, 2], 1], vertices[corner[t, 2], 2])
            if not planes_part(a, b, c, p, q, r, 0.0) and triangles_meet(a, b, c, p, q, r, work):
                return True
    return False


@njit(error_model="numpy", **KERNEL)
def deepest(
    vertices, box, second, first, count, corner, face, edge, vertex, surface_of,
    todo, n, surface, root, precision, budget, out, work, stack, gap,
):  # fmt: skip
    """The deepest point behind the mesh of the first n triangles of `todo` (m, 9), where nearest to its `surface`.

    Branch and bound over halved triangles. A triangle's points are at most as deep as its corners are far from one
    triangle of the mesh (the distance to a convex set is convex), and at most by its radius deeper than its middle;
    they are no deeper than some step by which the whole triangle comes out of the solid. None of them is nearest to the
    surface, whose subtree is `root`, if that lies farther from the middle than radius and greatest depth together.
    Found to within `precision` (m) and 1 %, or after `budget` triangles the deepest seen. out: (7,) depth >= 0, the
    point, the nearest point of the mesh; all 0 if nothing lies behind. The rest of `todo` is room to work in.
    """
    room = len(todo)
    top = n
    depth = 0.0
    while top > 0 and budget > 0:
        top -= 1
        budget -= 1
        x0, y0, z0 = todo[top, 0], todo[top, 1], todo[top, 2]
        x1, y1, z1 = todo[top, 3], todo[top, 4], todo[top, 5]
        x2, y2, z2 = todo[top, 6], todo[top, 7], todo[top, 8]
        c = ((x0 + x1 + x2) / 3.0, (y0 + y1 + y2) / 3.0, (z0 + z1 + z2) / 3.0)
        apart, q, t = signed_distance(vertices, box, second, first, count, corner, face, edge, vertex, c, stack, gap)
        radius, bound = 0.0, 0.0
        for k in range(3):
            p = (todo[top, 3 * k], todo[top, 3 * k + 1], todo[top, 3 * k + 2])
            w = sub(p, c)
            radius = max(radius, np.sqrt(dot(w, w)))
            bound = max(bound, _to_triangle(vertices, corner, t, p))
        bound = min(bound, radius - apart)
        if bound <= 1.01 * depth + precision:
            continue
        if surface_of[t] != surface:
            reach = radius + bound
            _, _, near, _ = distance(root, vertices, box, second, first, count, corner, c, reach * reach, stack, gap)
            if near < 0:
                continue
        for k in range(4):  # the middle, then the corners
            if k == 0:
                p, d, f, u = c, apart, q, t
            else:
                p = (todo[top, 3 * k - 3], todo[top, 3 * k - 2], todo[top, 3 * k - 1])
                d, f, u = signed_distance(
                    vertices, box, second, first, count, corner, face, edge, vertex, p, stack, gap
                )
            if -d > depth and surface_of[u] == surface:
                depth = -d
                out[0] = depth
                for i in range(3):
                    out[1 + i], out[4 + i] = p[i], f[i]
        step = 1.01 * depth + precision
        if bound <= step or top + 2 > room:
            continue
        sx, sy, sz = step * face[t, 0], step * face[t, 1], step * face[t, 2]
        out_p = (x0 + sx, y0 + sy, z0 + sz)
        out_q = (x1 + sx, y1 + sy, z1 + sz)
        out_r = (x2 + sx, y2 + sy, z2 + sz)
        if not _meets(vertices, box, second, first, count, corner, out_p, out_q, out_r, stack, work):
            c = (c[0] + sx, c[1] + sy, c[2] + sz)
            apart, _, _ = signed_distance(
                vertices, box, second, first, count, corner, face, edge, vertex, c, stack, gap
            )
            if apart > 0.0:
                continue
        # halve the longest edge
        e0 = (x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2
        e1 = (x2 - x1) ** 2 + (y2 - y1) ** 2 + (z2 - z1) ** 2
        e2 = (x0 - x2) ** 2 + (y0 - y2) ** 2 + (z0 - z2) ** 2
        if e1 >= e0 and e1 >= e2:
            x0, y0, z0, x1, y1, z1, x2, y2, z2 = x1, y1, z1, x2, y2, z2, x0, y0, z0
        elif e2 >= e0:
            x0, y0, z0, x1, y1, z1, x2, y2, z2 = x2, y2, z2, x0, y0, z0, x1, y1, z1
        mx, my, mz = 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)
        row = todo[top]
        row[0], row[1], row[2], row[3], row[4], row[5] = x0, y0, z0, mx, my, mz
        row[6], row[7], row[8] = x2, y2, z2
        row = todo[top + 1]
        row[0], row[1], row[2], row[3], row[4], row[5] = mx, my, mz, x1, y1, z1
        row[6], row[7], row[8] = x2, y2, z2
        top += 2
