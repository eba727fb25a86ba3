"""Which points lie near triangles, and how far triangles deviate from the analytic surface they approximate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import dot, row, sub
from constraints.geometry.surfaces import Geometry

Array = NDArray[np.float64]


def reached(points: Array, triangles: Array, slack: float) -> NDArray[np.bool_]:
    """(k,) mask of the points (k, 3) that are within `slack` (m) of one of `triangles` (t, 3, 3)."""
    out = np.zeros(len(points), bool)
    _reached(np.ascontiguousarray(points), np.ascontiguousarray(triangles), slack, out)
    return out


@kernel
def _reached(
    points: Array, triangles: Array, slack: float, out: NDArray[np.bool_]
) -> None:  # pragma: no cover - compiled
    for k in range(len(points)):
        p = row(points, k)
        for t in range(len(triangles)):
            far = False
            for i in range(3):
                x, y, z = triangles[t, 0, i], triangles[t, 1, i], triangles[t, 2, i]
                far |= p[i] < min(x, y, z) - slack or p[i] > max(x, y, z) + slack
            if far:
                continue
            q, _ = closest_on_triangle(p, row(triangles[t], 0), row(triangles[t], 1), row(triangles[t], 2))
            if dot(sub(p, q), sub(p, q)) <= slack * slack:
                out[k] = True
                break


def deflection(geometry: Geometry, triangles: Array) -> float:
    """m: greatest distance of the centroids of `triangles` (t, 3, 3) from the surface they approximate."""
    return float(np.abs(geometry.distance(triangles.mean(axis=1))).max())
