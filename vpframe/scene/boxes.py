"""Boxes about parts: corners, middles and sizes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import SurfaceMesh
from vpframe.scene.scene import Part, Scene

Array = NDArray[np.float64]


def box_of(mesh: SurfaceMesh) -> tuple[Array, Array]:
    """(3,) lower and upper corner of the box about the triangles of a mesh, m."""
    used = mesh.vertices[mesh.triangles.ravel()]
    return used.min(axis=0), used.max(axis=0)


def corners(mesh: SurfaceMesh) -> Array:
    """(8, 3) corners of that box."""
    return np.array(list(product(*zip(*box_of(mesh), strict=True))))


def middle(mesh: SurfaceMesh) -> Array:
    """(3,) middle of that box, m."""
    low, high = box_of(mesh)
    return 0.5 * (low + high)


def half_size(mesh: SurfaceMesh) -> float:
    """Half the diagonal of that box, m."""
    low, high = box_of(mesh)
    return 0.5 * float(np.linalg.norm(high - low))


def placed_corners(part: Part, pose: pin.SE3) -> Array:
    """(8, 3) corners of the part's own box, in the world."""
    return corners(part.mesh) @ pose.rotation.T + pose.translation


def bounds(scene: Scene) -> tuple[Array, Array]:
    """(3,) lower and upper corner of the box that holds all parts as they stand, m."""
    placed = [part.mesh.vertices @ part.pose.rotation.T + part.pose.translation for part in scene.parts]
    return np.min([v.min(0) for v in placed], axis=0), np.max([v.max(0) for v in placed], axis=0)


def above(scene: Scene) -> Array:
    """A point over the middle of a scene, a fifth of its size clear of it: where a hand comes in."""
    low, high = bounds(scene)
    center = 0.5 * (low + high)
    return np.array([center[0], center[1], high[2] + 0.2 * float(np.linalg.norm(high - low))])
