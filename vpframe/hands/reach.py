"""Points of parts in the world: those nearest to a hand, and extents along directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from collision.numeric.kernel import kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import dot, row, sub
from vpframe.scene.scene import Part

Array = NDArray[np.float64]


def surface_distances(mesh: SurfaceMesh, pose: pin.SE3, point: Array) -> tuple[Array, Array]:
    """Distance (k,) of each surface to a world `point` (3,), m, and the surfaces' nearest points (k, 3), world."""
    local = pose.actInv(np.asarray(point, dtype=np.float64))
    squared, near = np.full(mesh.n_surfaces, np.inf), np.zeros((mesh.n_surfaces, 3))
    _nearest(local, mesh.vertices, mesh.triangles, mesh.surface_of_triangle, squared, near)
    return np.sqrt(squared), near @ pose.rotation.T + pose.translation


@kernel
def _nearest(point, vertices, triangles, surface_of_triangle, squared, near):  # pragma: no cover - compiled
    """Write the squared distance (k,) of each surface to a point, m², and the surfaces' nearest points (k, 3)."""
    p = (point[0], point[1], point[2])
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        q, _ = closest_on_triangle(p, row(vertices, a), row(vertices, b), row(vertices, c))
        w, s = sub(p, q), surface_of_triangle[t]
        if dot(w, w) < squared[s]:
            squared[s] = dot(w, w)
            near[s, 0], near[s, 1], near[s, 2] = q


def points_at(part: Part, pose: pin.SE3) -> Array:
    """Vertices (n, 3) of a part at a pose, world, m."""
    return part.mesh.vertices[np.unique(part.mesh.triangles)] @ pose.rotation.T + pose.translation


def extent(parts: Sequence[Part]) -> tuple[float, Array]:
    """Lowest z and middle (3,) of the bounding box of some parts, world, m."""
    points = np.concatenate([points_at(part, part.pose) for part in parts])
    return float(points[:, 2].min()), 0.5 * (points.min(0) + points.max(0))


def spans(parts: Sequence[Part], way: Array) -> tuple[float, float]:
    """Least and greatest coordinate of some parts along a world direction (3,), m."""
    along = np.concatenate([points_at(part, part.pose) @ way for part in parts])
    return float(along.min()), float(along.max())


def middle(part: Part) -> Array:
    """Middle (3,) of the part's bounding box, world, m."""
    return extent((part,))[1]
