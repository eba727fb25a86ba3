"""Containment of points in a mesh, and of one object in another.

A point is inside a mesh if its generalised winding number is above 1/2: the sum of the triangles' signed solid angles
over 4π (Jacobson et al., "Robust Inside-Outside Segmentation using Generalized Winding Numbers", 2013). No ray is cast,
so no ray can hit an edge. Overlapping closed shells count as their union; an inner shell with its normals turned
inwards is a cavity. An open mesh is closed by the surface on which the winding number is 1/2; a sheet bounds nothing.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.bvh.build import bounds_of
from collision.bvh.layout import LANES
from collision.bvh.single import ALONE
from collision.bvh.traverse import QueryWorkspace, corner_of, walk, workspace_for
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inner_kernel, kernel
from collision.numeric.point_triangle import solid_angle
from collision.numeric.vectors import dot, norm, sub
from collision.objects import Objects
from collision.query.intersection import intersecting
from collision.solid import SolidMesh, solid_of

FAR: Final = ((2.0, 0.25), (4.0, 0.03), (np.inf, 0.0))
"""(distance of a cluster of triangles, in its radii, above which it counts as a dipole; error bound of winding numbers
then). Errors measured for open and closed meshes: 0.07 and 0.008"""
MOUTH: Final = 0.01
"""1: winding number above 1/2 from which on a point is inside an open mesh, so that its mouth is outside"""


class SolidQuery(NamedTuple):
    """A solid and the workspace for queries of points against it, for one thread."""

    solid: SolidMesh
    ws: QueryWorkspace
    value: Any
    """(4,) float64: the last sum, or the last squared distance (m²) and nearest point"""
    place: Any
    """(2,) int64: the last nearest triangle, in leaf order, and its feature"""


def query_about(mesh: SurfaceMesh) -> SolidQuery:
    """Return the query for the solid that a mesh bounds; raises as `solid_of`."""
    solid = solid_of(mesh)
    return SolidQuery(solid, workspace_for(solid.bvh, solid.bvh), np.zeros(4), np.zeros(2, np.int64))


# --- kernels ---------------------------------------------------------------------------------------------------------


class Winding(NamedTuple):
    """Task: sum the solid angles of all triangles at a point; distant clusters count as dipoles."""

    point: Any
    far: Any
    """1: distance of a cluster, in its radii, above which it counts as a dipole"""
    cluster: Any
    """as in `SolidMesh`"""
    total: Any
    """(1,) float64, sr"""

    def children_of_a(self, a, b, ws, node, lane_b):
        """Add the solid angles of the distant clusters of a node; return the bits of the others."""
        bits = 0
        for k in range(LANES):
            at = 7 * (LANES * node + k)
            radius = self.cluster[at + 6]
            if radius < 0.0:
                continue
            to = sub((self.cluster[at + 3], self.cluster[at + 4], self.cluster[at + 5]), self.point)
            apart = norm(to)
            if apart > self.far * radius:
                vector = self.cluster[at], self.cluster[at + 1], self.cluster[at + 2]
                self.total[0] += dot(vector, to) / (apart * apart * apart)
            else:
                bits |= 1 << k
        return bits

    def visit(self, a, b, ws, lane_a, lane_b):
        """Add the solid angles of the triangles of a packet."""
        packet = ~np.int64(a.child[lane_a])
        for i in range(3 * np.int64(a.first[packet]), 3 * np.int64(a.first[packet + 1]), 3):
            p, q, r = corner_of(a, i), corner_of(a, i + 1), corner_of(a, i + 2)
            self.total[0] += solid_angle(sub(p, self.point), sub(q, self.point), sub(r, self.point))
        return False


@inner_kernel
def _winding_number(query, p, far):
    """Return the winding number of the mesh about p: 1 inside and 0 outside a closed mesh with outward normals.

    A cluster farther than `far` of its radii counts as a dipole: the first term of Barill et al., "Fast Winding Numbers
    for Soups and Clouds", 2018.
    """
    query.value[0] = 0.0
    bvh = query.solid.bvh
    walk(Winding(p, far, query.solid.cluster, query.value), bvh, bvh, query.ws, 0, ALONE)
    return query.value[0] / (4.0 * np.pi)


@inner_kernel
def winds(query, p):
    """Whether p (x, y, z), m, is inside by the winding number."""
    number = 0.5
    for far, sure in FAR:
        number = _winding_number(query, p, far)
        if abs(number - 0.5) > sure:
            break
    return number > (0.5 if query.solid.closed else 0.5 + MOUTH)


@kernel
def which_wind(query, points, out):
    """Fill `out` (n,) bool with `winds` of points (n, 3), m."""
    for i in range(len(points)):
        out[i] = winds(query, (points[i, 0], points[i, 1], points[i, 2]))


# --- from Python -----------------------------------------------------------------------------------------------------

_which_wind = EntryPoint(which_wind)


def inside(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.bool_]:
    """Return (n,) bool: which of the points (n, 3), m, in the mesh's frame, are inside the mesh.

    Raises
    ------
    CollisionError: the mesh stands for a shape without triangles.
    """
    p = np.array(points, np.float64).reshape(-1, 3)
    out = np.empty(len(p), np.bool_)
    _which_wind.call(query_about(mesh), p, out)
    return out


def contains(objects: Objects, i: int, j: int) -> bool:
    """Whether object j lies wholly inside the solid of object i, and no surfaces intersect.

    Each shell of j must have a vertex inside i. A sheet contains nothing. Ignored pairs are not left out.

    Raises
    ------
    UnknownObjectError, CollisionError: no such object; one object twice; a shape without triangles.
    """
    objects.ignored(i, j)  # raises unless these are two objects
    mesh_i, mesh_j = objects.mesh(i), objects.mesh(j)
    pose = objects.relative_pose(i, j)
    solid_of(mesh_i)  # raises for a shape without triangles
    seeds = mesh_j.vertices[solid_of(mesh_j).seeds] @ pose.rotation.T + pose.translation
    box = bounds_of(mesh_i)
    if (seeds < box[:3]).any() or (seeds > box[3:6]).any():
        return False
    if len(intersecting(mesh_i, mesh_j, pose, objects.checked.rigid)[0]):
        return False
    return bool(inside(mesh_i, seeds).all())
