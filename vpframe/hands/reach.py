"""Nearest points of a part's surfaces to a hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh

Array = NDArray[np.float64]


def nearest_on_triangles(point: Array, triangles: Array) -> Array:
    """(m, 3) point of each triangle (m, 3, 3) nearest to `point` (3,).

    Ericson, Real-Time Collision Detection, 5.1.5: the Voronoi regions of vertices, edges and face in turn.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, ac, ap, bp, cp = b - a, c - a, point - a, point - b, point - c
    d1, d2 = (ab * ap).sum(1), (ac * ap).sum(1)
    d3, d4 = (ab * bp).sum(1), (ac * bp).sum(1)
    d5, d6 = (ab * cp).sum(1), (ac * cp).sum(1)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ab = a + ab * (d1 / (d1 - d3))[:, None]
        along_ac = a + ac * (d2 / (d2 - d6))[:, None]
        along_bc = b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))[:, None]
        inside = a + ab * (vb / (va + vb + vc))[:, None] + ac * (vc / (va + vb + vc))[:, None]
    regions = [
        (d1 <= 0) & (d2 <= 0),
        (d3 >= 0) & (d4 <= d3),
        (vc <= 0) & (d1 >= 0) & (d3 <= 0),
        (d6 >= 0) & (d5 <= d6),
        (vb <= 0) & (d2 >= 0) & (d6 <= 0),
        (va <= 0) & (d4 >= d3) & (d5 >= d6),
    ]
    return np.select([r[:, None] for r in regions], [a, b, along_ab, c, along_ac, along_bc], inside)


def surface_distances(mesh: SurfaceMesh, pose: pin.SE3, point: Array) -> tuple[Array, Array]:
    """Distance (k,) of each surface to a world `point` (3,), m, and the surfaces' nearest points (k, 3), world."""
    local = pose.actInv(np.asarray(point, dtype=np.float64))
    near = nearest_on_triangles(local, mesh.vertices[mesh.triangles])
    squared = ((near - local) ** 2).sum(1)
    squared = np.where(np.isnan(squared), np.inf, squared)  # NaN: triangles of zero area
    best = np.array([mesh.triangles_of(s)[np.argmin(squared[mesh.triangles_of(s)])] for s in range(mesh.n_surfaces)])
    points = near[best] @ pose.rotation.T + pose.translation
    return np.sqrt(squared[best]), points
