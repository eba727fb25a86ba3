"""Numba kernels: how deep a point is behind the boundary of a solid, and what lies wholly outside it."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from collision.kernels_distance import STACK
from collision.kernels_solid import closest_on_triangle, distance, solid_angle
from collision.kernels_triangles import planes_part
from collision.kernels_vector import along, dot, norm, row, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL, workspace

FAR: Final = 2.0
"""1: from this many radii on, a cluster of triangles is seen as a dipole (errors of winding numbers measured: 0.07)"""
DOUBT: Final = 0.25
"""1: winding numbers that are nearer to 1/2 than this are summed over all triangles"""
MOUTH: Final = 0.01
"""1: an open mesh winds about what is inside by this more than 1/2, so that its mouth, where that is 1/2, is outside"""


class Boundary(NamedTuple):
    """The solid: as in `SurfaceMesh`, `MeshTree` and `Solid`; arrays by triangle are in the tree's leaf order."""

    vertices: Any
    box: Any
    second: Any
    first: Any
    count: Any
    corner: Any
    root: Any
    surface: Any
    normal: Any
    sure: Any
    cluster: Any
    closed: Any


class Room(NamedTuple):
    """What traversals work in."""

    stack: Any
    gap: Any
    work: Any


def room() -> Room:
    """Room for one thread."""
    return Room(np.empty(STACK, np.int64), np.empty(STACK), workspace())


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
def _winding_number(solid, p, far, room):
    """How often the mesh winds about p: 1 inside and 0 outside a closed mesh with outward normals.

    The sum of the triangles' signed solid angles over 4π (Jacobson et al., "Robust Inside-Outside Segmentation using
    Generalized Winding Numbers", 2013); nodes whose middle is farther than `far` of their radii count as a dipole
    (Barill et al., "Fast Winding Numbers for Soups and Clouds", 2018, its first term).
    """
    total = 0.0
    stack = room.stack
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        i = stack[top]
        to = sub((solid.cluster[i, 3], solid.cluster[i, 4], solid.cluster[i, 5]), p)
        apart = norm(to)
        if apart > far * solid.cluster[i, 6]:
            total += dot(row(solid.cluster, i), to) / (apart * apart * apart)
        elif solid.second[i] >= 0:
            stack[top], stack[top + 1] = i + 1, solid.second[i]
            top += 2
        else:
            for t in range(solid.first[i], solid.first[i] + solid.count[i]):
                a, b = row(solid.vertices, solid.corner[t, 0]), row(solid.vertices, solid.corner[t, 1])
                total += solid_angle(sub(a, p), sub(b, p), sub(row(solid.vertices, solid.corner[t, 2]), p))
    return total / (4.0 * np.pi)


@njit(error_model="numpy", **KERNEL)
def winds(solid, p, room):
    """Whether p is inside by the winding number."""
    least = 0.5 if solid.closed else 0.5 + MOUTH
    number = _winding_number(solid, p, FAR, room)
    if abs(number - 0.5) < DOUBT:
        number = _winding_number(solid, p, np.inf, room)
    return number > least


@njit(error_model="numpy", **KERNEL)
def which_wind(solid, points, out, room):
    """`winds` of points (n, 3), into `out` (n,) bool."""
    for i in range(len(points)):
        out[i] = winds(solid, row(points, i), room)


@njit(error_model="numpy", **KERNEL)
def depth_at(solid, p, guess, room):
    """(depth of p behind the solid's boundary, negative before it; nearest triangle), by way of the triangle `guess`.

    The side is told by the pseudonormal of the nearest feature, which is right for any closed mesh (Bærentzen & Aanæs,
    "Signed Distance Computation Using the Angle Weighted Pseudonormal", 2005); by the winding number where that normal
    is not sure, see `containment.Solid`.
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
    behind = dot(row(solid.normal[t], feature), sub(p, q)) < 0.0 if solid.sure[t, feature] else winds(solid, p, room)
    apart = np.sqrt(best)
    return (apart if behind else -apart), t


@njit(error_model="numpy", **KERNEL)
def depths_at(solid, points, out, room):
    """`depth_at` of points (n, 3), into `out` (n,)."""
    t = 0
    for i in range(len(points)):
        out[i], t = depth_at(solid, row(points, i), t, room)


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
    n = row(solid.normal[t], 6)
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
