"""The drawn form of a part: triangles by surface with normals, and the lines between features."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from collision.mesh import welded
from vpframe.scene.scene import Shape

CREASE = np.cos(np.radians(35.0))
"""neighbouring triangles of one surface have an edge drawn between them if the cosine of their angle is less"""


@dataclass(frozen=True, eq=False)
class DisplayMesh:
    """A shape's triangles sorted by surface, vertices split where surfaces or creases meet; part frame, metres."""

    positions: NDArray[np.float32]
    """(n, 3)"""
    normals: NDArray[np.float32]
    """(n, 3) unit, out of the material"""
    triangles: NDArray[np.uint32]
    """(m, 3) into `positions`"""
    surface_of_triangle: NDArray[np.int32]
    """(m,) ascending"""
    vertex_start: NDArray[np.int64]
    """(k+1,) vertices of surface s are `vertex_start[s]:vertex_start[s+1]`"""
    triangle_start: NDArray[np.int64]
    """(k+1,) likewise for triangles"""
    feature_of_surface: NDArray[np.int32]
    """(k,) feature number of each surface; no line is drawn between surfaces of one feature"""
    lines: NDArray[np.float32]
    """(e, 2, 3) segments between features and along creases"""

    @property
    def n_surfaces(self) -> int:
        """Number of surfaces."""
        return len(self.vertex_start) - 1


_MADE: WeakKeyDictionary[Shape, DisplayMesh] = WeakKeyDictionary()


def display_mesh(shape: Shape) -> DisplayMesh:
    """Return the drawn form of `shape`; instances share it."""
    made = _MADE.get(shape)
    if made is None:
        made = _MADE[shape] = _make(shape)
    return made


def _make(shape: Shape) -> DisplayMesh:
    mesh = shape.mesh
    tri = mesh.triangles[mesh.order]
    surface = mesh.surface_of_triangle[mesh.order]
    corners = mesh.vertices[tri]  # (m, 3, 3)
    area_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area_normal, axis=1, keepdims=True)
    flat = np.divide(area_normal, length, out=np.zeros_like(area_normal), where=length > 0)

    # one normal a (surface, vertex): area-weighted mean; a corner far from the mean keeps its triangle's own
    point, weld = welded(mesh.vertices)  # CAD kernels mesh each face for itself
    key = surface[:, None].astype(np.int64) * len(point) + weld[tri]
    _, group = np.unique(key.ravel(), return_inverse=True)
    total = np.zeros((int(group.max()) + 1, 3))
    np.add.at(total, group, np.repeat(area_normal, 3, axis=0))
    size = np.linalg.norm(total, axis=1, keepdims=True)
    mean = np.divide(total, size, out=np.zeros_like(total), where=size > 0)[group].reshape(-1, 3, 3)
    creased = np.einsum("ijk,ik->ij", mean, flat) < CREASE
    normal = np.where(creased[:, :, None], flat[:, None, :], mean)

    own = np.where(creased, np.arange(len(tri))[:, None] + 1, 0)
    split = np.stack([np.repeat(surface, 3), weld[tri].ravel(), own.ravel()], axis=1)
    rows, first, index = np.unique(split, axis=0, return_index=True, return_inverse=True)
    k = mesh.n_surfaces
    feature = np.arange(k, dtype=np.int32) + len(shape.features)
    for f, item in enumerate(shape.features):
        feature[list(item.surfaces)] = f
    return DisplayMesh(
        positions=corners.reshape(-1, 3)[first].astype(np.float32),
        normals=normal.reshape(-1, 3)[first].astype(np.float32),
        triangles=index.reshape(-1, 3).astype(np.uint32),
        surface_of_triangle=surface.astype(np.int32),
        vertex_start=np.searchsorted(rows[:, 0], np.arange(k + 1)),
        triangle_start=mesh.surface_start.astype(np.int64),
        feature_of_surface=feature,
        lines=_lines(point, weld[tri], flat, feature[surface]),
    )


def _lines(
    point: NDArray[np.float64], tri: NDArray[np.int64], normal: NDArray[np.float64], feature: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return the edges of a single triangle or more than two, between two features, or at a crease."""
    edge = np.sort(tri[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(tri)), 3)
    order = np.lexsort((owner, edge[:, 1], edge[:, 0]))
    edge, owner = edge[order], owner[order]
    new = np.r_[True, (edge[1:] != edge[:-1]).any(axis=1)]
    start = np.flatnonzero(new)
    count = np.diff(np.r_[start, len(edge)])
    drawn = count != 2
    pair = start[count == 2]
    a, b = owner[pair], owner[pair + 1]
    drawn[count == 2] = (feature[a] != feature[b]) | (np.einsum("ij,ij->i", normal[a], normal[b]) < CREASE)
    kept = edge[start[drawn]]
    kept = kept[kept[:, 0] != kept[:, 1]]
    return point[kept].astype(np.float32)
