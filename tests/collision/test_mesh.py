"""A mesh and its copies."""

from __future__ import annotations

import copy
import gc
import pickle
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, PairQuery, SurfaceMesh, colliding_surfaces
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


def test_a_copied_query_and_manager_answer_as_the_first() -> None:
    mesh, other = shapes.box(), shapes.box()
    pose = pin.SE3(np.eye(3), np.array([0.4, 0.3, 0.2]))
    query, manager = PairQuery(mesh, other), CollisionManager()
    manager.add(mesh, pin.SE3.Identity())
    manager.add(other, pose)
    expected, rows = query.colliding_surfaces(pose), manager.colliding_surfaces()
    twin, second = copy.deepcopy((query, manager))
    del query, manager
    gc.collect()
    for _ in range(3):
        assert np.array_equal(twin.colliding_surfaces(pose), expected)
        second.set_pose(1, pin.SE3.Identity())
        second.colliding_surfaces()
        second.set_pose(1, pose)
        assert np.array_equal(second.colliding_surfaces(), rows)
