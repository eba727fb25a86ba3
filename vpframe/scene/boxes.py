"""Bounding boxes of parts: corners, middles and sizes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from vpframe.scene.scene import Part, Scene

Array = NDArray[np.float64]


def box_of(mesh: SurfaceMesh) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of the bounding box of a mesh's triangles, m."""
    low, high = mesh.bounds
    return low.copy(), high.copy()


def corners(mesh: SurfaceMesh) -> Array:
    """Corners (8, 3) of the bounding box of a mesh, m."""
    return corners_of(*mesh.bounds)


def corners_of(low: Array, high: Array) -> Array:
    """Corners (8, 3) of the box from a lower to an upper corner (3,)."""
    return np.array(list(product(*zip(low, high, strict=True))))


def middle(mesh: SurfaceMesh) -> Array:
    """Middle (3,) of the bounding box of a mesh, m."""
    low, high = box_of(mesh)
    return 0.5 * (low + high)


def half_size(mesh: SurfaceMesh) -> float:
    """Half the diagonal of the bounding box of a mesh, m."""
    low, high = box_of(mesh)
    return 0.5 * float(np.linalg.norm(high - low))


def placed_corners(part: Part, pose: pin.SE3) -> Array:
    """Corners (8, 3) of a part's own bounding box at a pose, world, m."""
    return corners(part.mesh) @ pose.rotation.T + pose.translation


def bounds(scene: Scene) -> tuple[Array, Array]:
    """Lower and upper corner (3,) of the bounding box of all parts at their present poses, m."""
    placed = [part.mesh.vertices @ part.pose.rotation.T + part.pose.translation for part in scene.parts]
    return np.min([v.min(0) for v in placed], axis=0), np.max([v.max(0) for v in placed], axis=0)


def above(scene: Scene) -> Array:
    """Point (3,) above the middle of a scene, a fifth of its size clear of it, m: initial position of hands."""
    low, high = bounds(scene)
    center = 0.5 * (low + high)
    return np.array([center[0], center[1], high[2] + 0.2 * float(np.linalg.norm(high - low))])
