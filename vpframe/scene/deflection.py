"""Deflection: distance between a surface's triangles and the true surface."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from constraints.geometry.surfaces import Freeform, Plane
from vpframe.scene.scene import Shape

_TINY = np.finfo(np.float64).tiny
_FLAT = 1e-9
"""deflection below which an edge is straight, m"""
_BETWEEN = 1.06
"""1: a triangle on a sphere deviates at most by this part more than at its centroid and at the middles of its edges"""
_DEFLECTIONS: WeakKeyDictionary[Shape, NDArray[np.float64]] = WeakKeyDictionary()
_BORDERS: WeakKeyDictionary[Shape, dict[int, NDArray[np.float64]]] = WeakKeyDictionary()


def deflections(shape: Shape) -> NDArray[np.float64]:
    """(surfaces,) greatest distance between each surface's triangles and the true surface, m.

    Measured at the middles of triangles and edges. An edge between two surfaces counts for both: the border of a flat
    face cut by a bore deviates within its plane by as much as the bore's facets do. The deflection of a freeform
    surface is estimated: two triangles of heights h that meet at an angle θ deviate by about h θ / 8 from an arc
    through their corners.
    """
    if shape.faceted:
        return np.zeros(shape.mesh.n_surfaces)
    if shape not in _DEFLECTIONS:
        edge, shared, inner = _sags(shape)
        worst = [shared[edge[shape.mesh.triangles_of(i)]].max(initial=least) for i, least in enumerate(inner)]
        _DEFLECTIONS[shape] = np.array(worst, dtype=np.float64)
    return _DEFLECTIONS[shape]


def curved_borders(shape: Shape) -> dict[int, NDArray[np.float64]]:
    """Return the edges (k, 2, 3), m, that each planar surface shares with facets of curved surfaces, by surface."""
    if shape not in _BORDERS:
        edge, shared, _ = _sags(shape)
        mesh = shape.mesh
        ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2)
        out = {}
        for surface in shape.surfaces:
            own = mesh.triangles_of(surface.index)
            curved = shared[edge[own]] > np.maximum(surface.residual, _FLAT)
            if isinstance(surface.geometry, Plane) and curved.any():
                out[surface.index] = mesh.vertices[ends[own][curved]]
        _BORDERS[shape] = out
    return _BORDERS[shape]


def _sags(shape: Shape) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Edge number (t, 3) at each side of each triangle; deflection of each edge, and within each surface, m."""
    mesh = shape.mesh
    corners = mesh.vertices[mesh.triangles]
    # number the edges; both triangles of an edge have the same number
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
            inner[surface.index] = max(surface.residual, _BETWEEN * centroids.max(initial=0.0))
    shared = np.zeros(edge.max(initial=-1) + 1)
    np.maximum.at(shared, edge, sag)
    return edge, shared, inner


def _estimate(corners: NDArray[np.float64], edge: NDArray[np.int64]) -> NDArray[np.float64]:
    """(t, 3) deflection h θ / 8 at each edge of each triangle; 0 at the border to another surface."""
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
