"""A mesh and its copies."""

import copy
import gc
import pickle
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, SurfaceMesh, colliding_surfaces
from collision.mesh import welded
from tests.collision import shapes


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda mesh: pickle.loads(pickle.dumps(mesh))])
def test_a_copy_shares_nothing_that_lies_in_the_memory_of_the_first(copied: Callable[[SurfaceMesh], SurfaceMesh]):
    mesh, other = shapes.box((1.0, 1.0, 1.0)), shapes.box((1.0, 1.0, 1.0))
    pose = pin.SE3(np.eye(3), np.array([0.4, 0.3, 0.2]))
    expected = colliding_surfaces(mesh, other, pose)
    twin = copied(mesh)
    assert twin._cache == {} and twin.name == mesh.name
    assert not any(array.flags.writeable for array in (twin.vertices, twin.triangles, twin.surface_of_triangle))
    del mesh
    gc.collect()
    assert np.array_equal(colliding_surfaces(twin, other, pose), expected)


def test_a_copied_manager_answers_as_the_first() -> None:
    mesh, other = shapes.box(), shapes.box()
    pose = pin.SE3(np.eye(3), np.array([0.4, 0.3, 0.2]))
    manager = CollisionManager()
    manager.add(mesh, pin.SE3.Identity())
    manager.add(other, pose)
    rows = manager.colliding_surfaces()
    second = copy.deepcopy(manager)
    del manager
    gc.collect()
    for _ in range(3):
        second.set_pose(1, pin.SE3.Identity())
        second.colliding_surfaces()
        second.set_pose(1, pose)
        assert np.array_equal(second.colliding_surfaces(), rows)


def test_vertices_weld_where_they_are_equal_or_round_to_the_same_point():
    vertices = np.array([[1.0, 0.0, 2.0], [0.0, 0.0, 0.0], [1.0, -0.0, 2.0], [1e-10, 0.0, 0.0]])
    points, index = welded(vertices)
    assert len(points) == 3 and np.array_equal(points[index], vertices)
    points, index = welded(vertices, 1e-9)
    assert len(points) == 2 and np.abs(points[index] - vertices).max() <= 1e-10
    assert index.tolist() == [1, 0, 1, 0]
