"""How far a surface's triangles stray from the surface itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from constraints.geometry import Freeform
from vpframe.scene import Shape

_TINY = np.finfo(np.float64).tiny


def deflections(shape: Shape) -> NDArray[np.float64]:
    """(surfaces,) m: greatest distance between each surface's triangles and the true surface.

    Measured at the middles of triangles and of their edges. An edge between two surfaces counts for both: the border of
    a flat face that a bore cuts strays within its plane by as much as the bore's facets do. Of a freeform surface only
    the triangles are known: two that meet at an angle θ over heights h sag by about h θ / 8 from an arc through their
    corners.
    """
    mesh = shape.mesh
    corners = mesh.vertices[mesh.triangles]
    # a triangle's edges; `edge` numbers them, the same for the triangles on either side
    ends = np.sort(np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2), axis=2)
    edge = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 3)
    middles = (corners + np.roll(corners, -1, axis=1)) / 2.0
    sag = np.zeros((mesh.n_triangles, 3))
    inner = np.zeros(len(shape.surfaces))
    for surface in shape.surfaces:
        own = mesh.triangles_of(surface.index)
        if isinstance(surface.geometry, Freeform):
            sag[own] = _estimate(corners[own], edge[own])
        else:
            sag[own] = np.abs(surface.geometry.distance(middles[own].reshape(-1, 3))).reshape(-1, 3)
            centroids = np.abs(surface.geometry.distance(corners[own].mean(axis=1)))
            inner[surface.index] = centroids.max(initial=surface.residual)
    shared = np.zeros(edge.max(initial=-1) + 1)
    np.maximum.at(shared, edge, sag)
    return np.array(
        [shared[edge[mesh.triangles_of(i)]].max(initial=least) for i, least in enumerate(inner)], dtype=np.float64
    )


def _estimate(corners: NDArray[np.float64], edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """(t, 3): h θ / 8 at each edge of each triangle, 0 where its other side is another surface."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(length, _TINY)[:, None]
    base = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    height = (length[:, None] / np.maximum(base, _TINY)).reshape(-1)
    order = np.argsort(edge, axis=None, kind="stable")
    twins = edge.reshape(-1)[order][:-1] == edge.reshape(-1)[order][1:]
    first, second = order[:-1][twins], order[1:][twins]
    cosine = (normals[first // 3] * normals[second // 3]).sum(axis=1)
    out = np.zeros(edge.size)
    out[first] = np.maximum(height[first], height[second]) * np.arccos(np.clip(cosine, -1.0, 1.0)) / 8.0
    return out.reshape(-1, 3)
