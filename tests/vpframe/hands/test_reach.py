"""Nearest points on triangles against dense sampling."""

import numpy as np
import pinocchio as pin

from collision import SurfaceMesh
from vpframe.hands.reach import surface_distances
from vpframe.scene.boxes import half_size


def test_nearest_points_are_no_farther_than_any_sample() -> None:
    rng = np.random.default_rng(3)
    u, v = (x.ravel() for x in np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60)))
    inside = u + v <= 1.0
    weights = np.stack([1 - u - v, u, v], axis=1)[inside]
    triangles = rng.normal(size=(200, 3, 3))
    mesh = SurfaceMesh(triangles.reshape(-1, 3), np.arange(600).reshape(-1, 3), np.arange(200))
    for point in rng.normal(scale=1.5, size=(20, 3)):
        distance, near = surface_distances(mesh, pin.SE3.Identity(), point)
        np.testing.assert_allclose(np.linalg.norm(near - point, axis=1), distance, atol=1e-15)
        sampled = np.linalg.norm(weights @ triangles - point, axis=2).min(axis=1)
        assert (distance <= sampled + 1e-12).all()
        assert (sampled - distance <= 0.1).all()
        # and it lies on the triangle: barycentric coordinates are those of the plane, none negative
        for t, n in zip(triangles, near, strict=True):
            b = np.linalg.lstsq(np.vstack([t.T, np.ones(3)]), np.append(n, 1.0), rcond=None)[0]
            np.testing.assert_allclose(b @ t, n, atol=1e-9)
            assert b.min() > -1e-9


def test_surface_distances_are_of_the_placed_mesh() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2.0], [1, 0, 2.0], [0, 1, 2.0]]
    mesh = SurfaceMesh(vertices, [[0, 1, 2], [3, 4, 5]], [0, 1])
    pose = pin.SE3(np.eye(3), np.array([10.0, 0.0, 0.0]))
    distances, points = surface_distances(mesh, pose, np.array([10.25, 0.25, 0.5]))
    np.testing.assert_allclose(distances, [0.5, 1.5])
    np.testing.assert_allclose(points, [[10.25, 0.25, 0.0], [10.25, 0.25, 2.0]])
    assert half_size(mesh) == np.sqrt(6.0) / 2
