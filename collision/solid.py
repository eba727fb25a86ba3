"""A mesh as the boundary of a solid: whether it is closed, its pseudonormals, and the dipoles of its triangles.

A mesh is closed if every directed edge has its opposite, once vertices of equal coordinates are welded.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bvh_of
from collision.bvh.layout import LANES, Bvh
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh, welded
from collision.reference.shape import ShapeMesh

SLIVER: Final = 1e-3
"""1: a triangle is a sliver if its height is below this part of its longest side"""
ROUNDING: Final = 1e-12
"""1: … or below this part of its coordinates"""
FOLD: Final = 0.2
"""1: a shorter pseudonormal (sum of unit normals, or per unit of angle) belongs to a fold of less than 12°"""


class SolidMesh(NamedTuple):
    """Arrays derived from a mesh of m triangles as the boundary of a solid; read-only, triangles in leaf order."""

    bvh: Bvh
    normal: Any
    """(21 m,) float64: seven pseudonormals a triangle. The sums of the unit normals at the edges ab, bc, ca; their sums
    about the corners, each weighted by its angle there; the unit normal, 0 for a triangle of no area"""
    sure: Any
    """(7 m,) bool: whether the sign of a distance may be taken from each pseudonormal. Not from those of slivers and
    folds, whose normals are unreliable, nor at the rim of the mesh or where it meets itself in an edge or a vertex"""
    cluster: Any
    """(7 lanes,) float64: vector area, m², centre, m, and radius about it, m, of the triangles below each lane; radius
    -1 for an empty lane"""
    seeds: Any
    """(s,) int32: one vertex of each of the s connected shells"""
    surface: Any
    """(m,) int32: the surface of each triangle"""
    closed: Any
    """bool: whether every directed edge has its opposite"""


def solid_of(mesh: SurfaceMesh) -> SolidMesh:
    """Return the solid that a mesh bounds, derived at the first call and kept on the mesh.

    Raises
    ------
    CollisionError: the mesh stands for a shape without triangles.
    MeshError: as `collision.bvh.build.bvh_of`.
    """
    solid: SolidMesh | None = mesh._cache.get("solid")
    if solid is None:
        if isinstance(mesh, ShapeMesh):
            raise CollisionError(f"{mesh.name}: a shape without triangles bounds no mesh; give it as a SurfaceMesh")
        solid = mesh._cache["solid"] = _derive(mesh)
    return solid


def _derive(mesh: SurfaceMesh) -> SolidMesh:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    bvh = bvh_of(mesh)
    order = bvh.order
    points, point = welded(mesh.vertices)
    n = len(points)
    t = point[mesh.triangles[order]]
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
    _, seed = np.unique(shell[point[first_vertex]], return_index=True)
    normal = np.concatenate([at_edge[which].reshape(-1, 3, 3), at_vertex[t], face[:, None]], axis=1)
    arrays = (
        normal.ravel(),
        _sure(t, corners, which.reshape(-1, 3), np.sign(backward - forward), at_edge, at_vertex, angle).ravel(),
        _clusters(bvh, corners).ravel(),
        first_vertex[seed].astype(np.int32),
        mesh.surface_of_triangle[order],
    )
    for array in arrays:
        array.setflags(write=False)
    return SolidMesh(bvh, *arrays, closed)


def _sure(
    t: NDArray[np.int_], corners: NDArray[np.float64], edge: NDArray[np.int64], way: NDArray[np.int64],
    at_edge: NDArray[np.float64], at_vertex: NDArray[np.float64], angle: NDArray[np.float64],
) -> NDArray[np.bool_]:  # fmt: skip
    """`SolidMesh.sure`, of welded corners t (m, 3); `way`: the direction of each edge, 0 where it has no length."""
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

    half = np.flatnonzero(two[flat])  # the two sides of each edge in sequence: the corners that it joins
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


def _clusters(bvh: Bvh, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """`SolidMesh.cluster`, of corners (m, 3, 3) in leaf order."""
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(vector, axis=1)[:, None]
    sums = np.concatenate([np.zeros((1, 7)), np.cumsum(np.hstack([vector, area * corners.mean(axis=1), area]), axis=0)])
    box = bvh.boxes.astype(np.float64).reshape(-1, 2, 3, LANES).transpose(0, 3, 1, 2).reshape(-1, 6)
    box += np.tile(bvh.frame[:3], 2)
    used = np.isfinite(box[:, 0])
    # the triangles below a lane are consecutive: from the first of the leftmost packet to the last of the rightmost
    lanes = used.reshape(-1, LANES).sum(axis=1)
    left = right = np.where(used, np.arange(len(used)), 0)
    while (inner := bvh.child[left] >= 0).any():
        left = np.where(inner, LANES * bvh.child[left], left)
    while (inner := bvh.child[right] >= 0).any():
        below = np.maximum(bvh.child[right], 0)
        right = np.where(inner, LANES * below + lanes[below] - 1, right)
    of = sums[bvh.first[~bvh.child[right] + 1]] - sums[bvh.first[~bvh.child[left]]]
    low, high = box[:, :3], box[:, 3:]
    with np.errstate(invalid="ignore"):
        middle = np.clip(of[:, 3:6] / np.maximum(of[:, 6:], np.finfo(np.float64).tiny), low, high)
        radius = np.linalg.norm(np.maximum(middle - low, high - middle), axis=1)
    return np.where(used[:, None], np.hstack([of[:, :3], middle, radius[:, None]]), -1.0)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def is_closed(mesh: SurfaceMesh) -> bool:
    """Whether a mesh bounds a volume: every directed edge has its opposite."""
    return bool(solid_of(mesh).closed)
