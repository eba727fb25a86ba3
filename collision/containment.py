"""Inside and outside: what a mesh bounds, and whether one part lies wholly inside another.

A point is inside a closed mesh if the mesh winds about it: if the sum of the triangles' signed solid angles over 4π,
its generalised winding number, is above 1/2. That needs no ray, so no ray can hit an edge; overlapping closed shells
count as their union, an inner shell with its normals turned inwards as a cavity. A mesh is closed if every edge, taken
with its direction, is met by its opposite once corners of equal coordinates are made one; an open mesh contains
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.shape import ShapeMesh
from collision.tree import tree_of

if TYPE_CHECKING:
    from collision.manager import CollisionManager


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """What is derived from a mesh as the boundary of a solid; arrays by triangle in the tree's leaf order."""

    closed: bool
    """whether every directed edge is met by its opposite"""
    seeds: NDArray[np.int32]
    """one vertex of each connected shell"""
    face: NDArray[np.float64]
    """(m, 3) unit normals, 0 for triangles of no area"""
    edge: NDArray[np.float64]
    """(m, 3, 3) sum of the unit normals at the edges ab, bc, ca"""
    vertex: NDArray[np.float64]
    """(m, 3, 3) sum of the unit normals about the corners, weighted by the angle there"""


def solid_of(mesh: SurfaceMesh) -> Solid:
    """The mesh as the boundary of a solid, derived at the first call and kept in `mesh._cache["solid"]`."""
    solid = mesh._cache.get("solid")
    if solid is None:
        if isinstance(mesh, ShapeMesh):
            raise CollisionError(f"{mesh.name}: a shape without triangles bounds no mesh; give it as a SurfaceMesh")
        solid = mesh._cache["solid"] = _derive(mesh)
    return solid


def _derive(mesh: SurfaceMesh) -> Solid:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    order = tree_of(mesh).order
    _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    welded = welded.reshape(-1)
    n = int(welded.max()) + 1
    t = welded[mesh.triangles[order]]
    corners = mesh.vertices[mesh.triangles[order]]
    face = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))

    ends = np.stack([t, np.roll(t, -1, axis=1)], axis=2).reshape(-1, 2)
    forward = ends[:, 0].astype(np.int64) * n + ends[:, 1]
    backward = ends[:, 1].astype(np.int64) * n + ends[:, 0]
    real = forward != backward
    closed = np.array_equal(np.sort(forward[real]), np.sort(backward[real]))
    _, which = np.unique(np.minimum(forward, backward), return_inverse=True)
    at_edge = np.zeros((int(which.max()) + 1, 3))
    np.add.at(at_edge, which.reshape(-1), np.repeat(face, 3, axis=0))

    along = _unit(np.roll(corners, -1, axis=1) - corners)
    back = _unit(np.roll(corners, 1, axis=1) - corners)
    angle = np.arccos(np.clip((along * back).sum(axis=2), -1.0, 1.0))
    at_vertex = np.zeros((n, 3))
    np.add.at(at_vertex, t.reshape(-1), (angle[:, :, None] * face[:, None]).reshape(-1, 3))

    graph = coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(n, n))
    _, shell = connected_components(graph, directed=False)
    first_vertex = mesh.triangles[order][:, 0]
    _, seed = np.unique(shell[welded[first_vertex]], return_index=True)
    return Solid(
        closed=closed,
        seeds=first_vertex[seed].astype(np.int32),
        face=face,
        edge=at_edge[which.reshape(-1)].reshape(-1, 3, 3),
        vertex=at_vertex[t],
    )


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def is_closed(mesh: SurfaceMesh) -> bool:
    """Whether the mesh bounds a volume: every directed edge is met by its opposite."""
    return solid_of(mesh).closed


def inside(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.bool_]:
    """Which of the points (n, 3), in the mesh's frame, lie inside it; none does if the mesh is open."""
    from collision.kernels_solid import winding_number

    p = np.asarray(points, np.float64).reshape(-1, 3)
    if not solid_of(mesh).closed:
        return np.zeros(len(p), bool)
    return np.array([winding_number(mesh.vertices, mesh.triangles, tuple(q)) > 0.5 for q in p.tolist()], bool)


def signed_distances(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.float64]:
    """(n,) distances in m of points (n, 3), in the mesh's frame, to the mesh: negative behind the nearest surface.

    For a closed mesh without self-intersections, behind is inside.
    """
    from collision import kernels_solid as kernels
    from collision.kernels_distance import STACK

    p = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 3))
    tree, solid = tree_of(mesh), solid_of(mesh)
    out = np.empty(len(p))
    kernels.signed_distances(
        mesh.vertices, tree.box, tree.second, tree.first, tree.count, tree.corner,
        solid.face, solid.edge, solid.vertex, p, out, np.empty(STACK, np.int64), np.empty(STACK),
    )  # fmt: skip
    return out


def contains(manager: CollisionManager, i: int, j: int) -> bool:
    """Whether object j lies wholly inside the solid of object i, their surfaces not meeting anywhere.

    Always False if the mesh of i is open. Ignored pairs are answered too.
    """
    from collision.query import colliding_surfaces

    manager.ignored(i, j)  # raises, unless there are both, and two
    mesh_i, mesh_j = manager.mesh(i), manager.mesh(j)
    pose = manager.relative_pose(i, j)
    if not solid_of(mesh_i).closed:
        return False
    seeds = mesh_j.vertices[solid_of(mesh_j).seeds] @ pose.rotation.T + pose.translation
    box = tree_of(mesh_i).box[0]
    if (seeds < box[:3]).any() or (seeds > box[3:]).any():
        return False
    if len(colliding_surfaces(mesh_i, mesh_j, pose)):
        return False
    return bool(inside(mesh_i, seeds).all())
