"""Numba kernels: how deep a point is behind the boundary of a solid, and what lies wholly outside it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from collision.kernels_solid import closest_on_triangle, distance
from collision.kernels_triangles import planes_part
from collision.kernels_vector import along, dot, norm, row, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL


class Boundary(NamedTuple):
    """The solid: as in `SurfaceMesh`, `MeshTree` and `Solid`; what is by triangle, in the tree's leaf order."""

    vertices: Any
    box: Any
    second: Any
    first: Any
    count: Any
    corner: Any
    root: Any
    surface: Any
    face: Any
    edge: Any
    vertex: Any
    closed: Any


class Room(NamedTuple):
    """What traversals work in."""

    stack: Any
    gap: Any
    work: Any


@njit(error_model="numpy", **KERNEL)
def nearest_on(solid, t, p):
    """(point of triangle t nearest to p, the feature it lies on), see `kernels_solid.closest_on_triangle`."""
    a, b = row(solid.vertices, solid.corner[t, 0]), row(solid.vertices, solid.corner[t, 1])
    c = row(solid.vertices, solid.corner[t, 2])
    return closest_on_triangle(p, a, b, c)


@njit(error_model="numpy", **KERNEL)
def to_triangle(solid, t, p):
    """The distance of p from triangle t."""
    q, _ = nearest_on(solid, t, p)
    return norm(sub(p, q))


@njit(error_model="numpy", **KERNEL)
def to_surface(solid, s, p, bound, room):
    """(nearest point, its triangle) of surface s, if nearer to p than the root of `bound`; else triangle -1."""
    _, q, t, _ = distance(
        solid.root[s], solid.vertices, solid.box, solid.second, solid.first, solid.count, solid.corner,
        p, bound, room.stack, room.gap,
    )  # fmt: skip
    return q, t


@njit(error_model="numpy", **KERNEL)
def depth_at(solid, p, guess, room):
    """(depth of p behind the solid's boundary, negative before it; nearest triangle), by way of the triangle `guess`.

    The side is told by the pseudonormal of the nearest feature, see `kernels_solid.signed_distance`.
    """
    q, feature = nearest_on(solid, guess, p)
    w = sub(p, q)
    best = dot(w, w)
    nearer, f, t, where = distance(
        0, solid.vertices, solid.box, solid.second, solid.first, solid.count, solid.corner,
        p, best, room.stack, room.gap,
    )  # fmt: skip
    if t < 0:
        t = guess
    else:
        best, q, feature = nearer, f, where
    if feature == 6:
        n = row(solid.face, t)
    elif feature < 3:
        n = (solid.edge[t, feature, 0], solid.edge[t, feature, 1], solid.edge[t, feature, 2])
    else:
        k = feature - 3
        n = (solid.vertex[t, k, 0], solid.vertex[t, k, 1], solid.vertex[t, k, 2])
    apart = np.sqrt(best)
    return (apart if dot(n, sub(p, q)) < 0.0 else -apart), t


@njit(error_model="numpy", **KERNEL)
def _meets(solid, p, q, r, room):
    """Whether the triangle p q r meets any of the solid's."""
    low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
    high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
    box, stack = solid.box, room.stack
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
        if solid.second[i] >= 0:
            stack[top], stack[top + 1] = i + 1, solid.second[i]
            top += 2
            continue
        for t in range(solid.first[i], solid.first[i] + solid.count[i]):
            a, b = row(solid.vertices, solid.corner[t, 0]), row(solid.vertices, solid.corner[t, 1])
            c = row(solid.vertices, solid.corner[t, 2])
            if not planes_part(a, b, c, p, q, r, 0.0) and triangles_meet(a, b, c, p, q, r, room.work):
                return True
    return False


@njit(error_model="numpy", **KERNEL)
def comes_out(solid, p, q, r, t, step, room):
    """Whether a step along the normal of the solid's triangle t takes all of p q r out of it."""
    n = row(solid.face, t)
    p, q, r = along(p, step, n), along(q, step, n), along(r, step, n)
    if _meets(solid, p, q, r, room):
        return False
    depth, _ = depth_at(solid, p, t, room)
    return depth < 0.0


@njit(error_model="numpy", **KERNEL)
def reaches(solid, surface, middle, reach, room):
    """Whether the surface is nearer to a middle than `reach`."""
    _, t = to_surface(solid, surface, middle, reach * reach, room)
    return t >= 0
