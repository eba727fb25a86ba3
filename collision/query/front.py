"""The front of a mesh on a screw: the triangles that move outwards, the only ones that can enter new material.

If the first of two solids moves, their intersection can gain material of the second only through the part of the
first's boundary that moves along its outward normal n. On a screw the velocity V of a point is constant in the frame of
its body, and V·n is linear over a triangle; so the front, where V·n > 0, is the same all along the screw. As long as no
part of the front is inside the second solid, the intersection, as a part of the second solid, only shrinks.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bounds_of, bvh_of
from collision.mesh import SurfaceMesh
from collision.objects import Objects
from collision.poses import pack_rigid
from collision.query.intersection import enabled_pairs
from collision.query.signed_distance import signed_distances, signed_distances_of
from collision.solid import is_closed

Array = NDArray[np.float64]
PLACES = np.array([[1, 1, 1], [8, 1, 1], [1, 8, 1], [1, 1, 8]]) / np.array([[3.0], [10.0], [10.0], [10.0]])
"""(4, 3) barycentric coordinates of the points of a triangle that are tested for being inside a solid"""


def front_of(
    mesh: SurfaceMesh, linear: Array, angular: Array, least: float, among: NDArray[np.int64] | None = None
) -> NDArray[np.int64]:
    """Return the triangles with a point that moves more than `least` m along their outward normal in unit time.

    linear, angular: (3,) velocity of the point at the origin, m, and angular velocity, rad, in the mesh's frame. A mesh
    that is not closed has no outside: all its triangles are front. among: the triangles considered; None for all.
    """
    among = np.arange(mesh.n_triangles) if among is None else among
    if not is_closed(mesh):
        return among
    corners = mesh.vertices[mesh.triangles[among]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0.0, length, 1.0)
    velocity = linear + np.cross(angular, corners)
    return among[np.einsum("tcd,td->tc", velocity, normal).max(axis=1) > least]


def part_of(mesh: SurfaceMesh, triangles: NDArray[np.integer]) -> tuple[SurfaceMesh, NDArray[np.int32]]:
    """Return the mesh of some triangles, and (k,) the surfaces of the whole mesh to which its surfaces belong."""
    surfaces, of = np.unique(mesh.surface_of_triangle[triangles], return_inverse=True)
    return SurfaceMesh(mesh.vertices, mesh.triangles[triangles], of.reshape(-1), mesh.name), surfaces


def triangle_depths(objects: Objects) -> dict[tuple[int, int], float]:
    """Return depths, m, by surface of object 0 and of object 1 that intersect; ignored pairs are left out.

    The depth of two triangles is the shortest translation that separates them, that of two surfaces the greatest of
    their triangles; it is never more than the penetration depth of the solids there.
    """
    pairs = enabled_pairs(objects, 0, 1)
    if not len(pairs):
        return {}
    a, b = bvh_of(objects.mesh(0)), bvh_of(objects.mesh(1))
    depths = -signed_distances_of(a, b, pack_rigid(objects.relative_pose(0, 1)), pairs, 0.0)
    return dict(zip(map(tuple, pairs.tolist()), depths.tolist(), strict=True))


def buried(
    part: SurfaceMesh, solid: SurfaceMesh, pose: Any, depth: float, excused: Iterable[tuple[Any, Any]] = ()
) -> NDArray[np.int32]:
    """Return the surfaces of `part` with a test point deeper than `depth` m inside a solid.

    pose: `pinocchio.SE3` of the part in the solid's frame. excused: (surfaces of the part, surfaces of the solid); a
    point of the former does not count if one of the latter is the surface nearest to it.
    """
    corners = part.vertices[part.triangles] @ pose.rotation.T + pose.translation
    points = np.einsum("pc,tcd->tpd", PLACES, corners).reshape(-1, 3)
    surface = np.repeat(part.surface_of_triangle, len(PLACES))
    box = bounds_of(solid)
    near = ((points > box[:3]) & (points < box[3:6])).all(axis=1)
    points, surface = points[near], surface[near]
    if not len(points):
        return surface
    depths = -signed_distances(solid, points)
    deep = depths > depth
    for mine, theirs in excused:
        of = deep & np.isin(surface, mine)
        if of.any():
            behind, _ = part_of(solid, np.flatnonzero(np.isin(solid.surface_of_triangle, theirs)))
            deep[of] = np.abs(signed_distances(behind, points[of])) > depths[of] * (1.0 + 1e-9)
    return np.unique(surface[deep])
