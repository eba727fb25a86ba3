"""Inside and outside: what a mesh bounds, and whether one part lies wholly inside another.

A point is inside a mesh that winds about it: if the sum of the triangles' signed solid angles over 4π, the generalised
winding number (Jacobson et al., 2013), is above 1/2. That needs no ray, so no ray can hit an edge; overlapping closed
shells count as their union, an inner shell with its normals turned inwards as a cavity. A mesh is closed if every edge,
taken with its direction, is met by its opposite once corners of equal coordinates are made one. Of an open mesh the
winding number tells what its missing faces would bound, the surface on which it is 1/2 taking their place; a sheet
bounds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.shape import ShapeMesh
from collision.tree import MeshTree, tree_of

if TYPE_CHECKING:
    from collision.kernels_boundary import Boundary
    from collision.manager import CollisionManager

SLIVER: Final = 1e-3
"""1: triangles of a smaller height, as part of their longest side, are slivers: real ones fold over their neighbours"""
ROUNDING: Final = 1e-12
"""1: …, or as part of their coordinates"""
FOLD: Final = 0.2
"""1: a shorter pseudonormal, of unit normals or a unit of angle, is of a fold (of less than 12°) or a needle"""


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """What is derived from a mesh as the boundary of a solid; arrays by triangle in the tree's leaf order."""

    closed: bool
    """whether every directed edge is met by its opposite"""
    seeds: NDArray[np.int32]
    """one vertex of each connected shell"""
    normal: NDArray[np.float64]
    """(m, 7, 3) pseudonormals: the sums of the unit normals at the edges ab, bc, ca; their sums about the corners, each
    weighted by its angle there; the unit normal, 0 for a triangle of no area"""
    sure: NDArray[np.bool_]
    """(m, 7) which of them tell inside from outside: not those of slivers and folds, whose normals are rounding or
    turned over, nor where the surface ends or meets itself in an edge or a corner"""
    cluster: NDArray[np.float64]
    """(nodes, 7) of the triangles below each node of the tree the vector area, a middle, m, and the radius about it"""


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
    which = which.reshape(-1)
    at_edge = np.zeros((int(which.max()) + 1, 3))
    np.add.at(at_edge, which, np.repeat(face, 3, axis=0))

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
        normal=np.concatenate([at_edge[which].reshape(-1, 3, 3), at_vertex[t], face[:, None]], axis=1),
        sure=_sure(t, corners, which.reshape(-1, 3), np.sign(backward - forward), at_edge, at_vertex, angle),
        cluster=_clusters(tree_of(mesh), corners),
    )


def _sure(
    t: NDArray[np.int_], corners: NDArray[np.float64], edge: NDArray[np.int64], way: NDArray[np.int64],
    at_edge: NDArray[np.float64], at_vertex: NDArray[np.float64], angle: NDArray[np.float64],
) -> NDArray[np.bool_]:  # fmt: skip
    """`Solid.sure`, of welded corners t (m, 3); `way`: which way each edge is run along, 0 where it has no length."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    sides = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    sliver = area <= longest * (SLIVER * longest + ROUNDING * np.abs(corners).max())

    flat = edge.reshape(-1)
    two = (np.bincount(flat) == 2) & (np.bincount(flat, way) == 0.0) & (np.bincount(flat, way == 0) == 0.0)
    fold = np.linalg.norm(at_edge, axis=1) < FOLD
    edge_sure = two & ~fold
    edge_sure[edge[sliver]] = False

    half = np.flatnonzero(two[flat])  # an edge's two sides one after the other: the corners that it joins
    first, second = half[np.argsort(flat[half], kind="stable")].reshape(-1, 2).T
    after = np.roll(np.arange(flat.size).reshape(-1, 3), -1, axis=1).reshape(-1)
    graph = coo_array(
        (np.ones(2 * len(first), bool), (np.append(first, after[first]), np.append(after[second], second))),
        shape=(flat.size, flat.size),
    )
    _, fan = connected_components(graph, directed=False)
    fans = np.bincount(np.unique(np.stack([t.reshape(-1), fan]), axis=1)[0], minlength=len(at_vertex))
    vertex_sure = (fans == 1) & (
        np.linalg.norm(at_vertex, axis=1) > FOLD * np.bincount(t.reshape(-1), angle.reshape(-1), len(at_vertex))
    )
    vertex_sure[t[~edge_sure[edge].all(axis=1)]] = False
    return np.concatenate([edge_sure[edge], vertex_sure[t], ~(sliver | fold[edge].any(axis=1))[:, None]], axis=1)


def _clusters(tree: MeshTree, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """`Solid.cluster`, of corners (m, 3, 3) in the tree's leaf order."""
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(vector, axis=1)[:, None]
    sums = np.concatenate([np.zeros((1, 7)), np.cumsum(np.hstack([vector, area * corners.mean(axis=1), area]), axis=0)])
    of = sums[tree.first + tree.count] - sums[tree.first]
    low, high = tree.box[:, :3], tree.box[:, 3:]
    middle = np.clip(of[:, 3:6] / np.maximum(of[:, 6:], np.finfo(np.float64).tiny), low, high)
    radius = np.linalg.norm(np.maximum(middle - low, high - middle), axis=1)
    return np.hstack([of[:, :3], middle, radius[:, None]])


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def is_closed(mesh: SurfaceMesh) -> bool:
    """Whether the mesh bounds a volume: every directed edge is met by its opposite."""
    return solid_of(mesh).closed


def boundary_of(mesh: SurfaceMesh) -> Boundary:
    """The mesh as kernels take it that ask about the solid it bounds."""
    from collision.kernels_boundary import Boundary

    tree, solid = tree_of(mesh), solid_of(mesh)
    return Boundary(
        mesh.vertices, tree.box, tree.second, tree.first, tree.count, tree.corner, tree.root,
        mesh.surface_of_triangle[tree.order], solid.normal, solid.sure, solid.cluster, solid.closed,
    )  # fmt: skip


def inside(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.bool_]:
    """(n,) which of the points (n, 3), in the mesh's frame, the mesh winds about; an open mesh by more than a half."""
    from collision import kernels_boundary as kernels

    p = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 3))
    out = np.empty(len(p), np.bool_)
    kernels.which_wind(boundary_of(mesh), p, out, kernels.room())
    return out


def signed_distances(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.float64]:
    """(n,) distances in m of points (n, 3), in the mesh's frame, to the mesh: negative behind the nearest surface.

    For a closed mesh without self-intersections, behind is inside; where the nearest point lies in a sliver or a fold,
    or where an open mesh ends, the winding number tells.
    """
    from collision import kernels_boundary as kernels

    p = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 3))
    out = np.empty(len(p))
    kernels.depths_at(boundary_of(mesh), p, out, kernels.room())
    return -out


def contains(manager: CollisionManager, i: int, j: int) -> bool:
    """Whether object j lies wholly inside the solid of object i, their surfaces not meeting anywhere.

    Of an open mesh the winding number tells; a sheet contains nothing. Ignored pairs are answered too.
    """
    from collision.query import colliding_surfaces

    manager.ignored(i, j)  # raises, unless there are both, and two
    mesh_i, mesh_j = manager.mesh(i), manager.mesh(j)
    pose = manager.relative_pose(i, j)
    solid_of(mesh_i)  # raises for a shape of coal's
    seeds = mesh_j.vertices[solid_of(mesh_j).seeds] @ pose.rotation.T + pose.translation
    box = tree_of(mesh_i).box[0]
    if (seeds < box[:3]).any() or (seeds > box[3:]).any():
        return False
    if len(colliding_surfaces(mesh_i, mesh_j, pose, tolerance=manager.checked)):
        return False
    return bool(inside(mesh_i, seeds).all())
