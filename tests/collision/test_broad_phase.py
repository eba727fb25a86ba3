"""The broad phase: pairs of objects against boxes and spheres one by one."""

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from collision import (
    CollisionManager,
    colliding_surfaces,
)
from tests.collision import shapes
from tests.collision.crowds import anywhere, crowd, one_by_one
from tests.collision.shapes import at


def bounds(manager: CollisionManager, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Least and greatest corner of the moved box of an object, its centre and the radius about it."""
    mesh, pose = manager.mesh(i), manager.pose(i)
    points = mesh.vertices[np.unique(mesh.triangles)]
    box = np.array([points.min(0), points.max(0)])
    hull = np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]])
    hull = hull @ pose.rotation.T + pose.translation
    centre = pose.rotation @ box.mean(0) + pose.translation
    return hull.min(0), hull.max(0), centre, float(np.linalg.norm(points - box.mean(0), axis=1).max())


def near_by_bounds(manager: CollisionManager, within: float) -> list[list[int]]:
    known = {i: bounds(manager, i) for i in manager.objects}
    near = []
    for i, j in combinations(manager.objects, 2):
        (low_i, high_i, centre_i, radius_i), (low_j, high_j, centre_j, radius_j) = known[i], known[j]
        boxes = (low_i <= high_j + within).all() and (low_j <= high_i + within).all()
        spheres = np.linalg.norm(centre_i - centre_j) <= radius_i + radius_j + within
        if (manager.movable(i) or manager.movable(j)) and boxes and spheres and not manager.ignored(i, j):
            near.append([i, j])
    return near


def test_object_pairs_against_all_bounds() -> None:
    rng = np.random.default_rng(4)
    manager = crowd(120, 4, 9.0)
    for step in range(6):
        manager.set_poses(manager.objects, [anywhere(rng, 9.0) for _ in manager.objects])
        if step == 3:
            manager.remove(17)
            manager.ignore(3, 5)
        within = 0.3 * (step % 2)
        expected = near_by_bounds(manager, within)
        assert manager.object_pairs(within=within).tolist() == expected and len(expected) > 20
        some = manager.object_pairs([1, 2], within=within).tolist()
        assert some == [pair for pair in expected if {1, 2} & set(pair)]


@pytest.mark.parametrize("seed", range(3))
def test_pairs_and_answers_after_adding_moving_removing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    manager = crowd(20, seed, 6.0)
    meshes = [manager.mesh(i) for i in range(3)]
    met = 0
    for step in range(40):
        ids = manager.objects
        for i in rng.permutation(ids)[: rng.integers(0, 6)].tolist():  # a little, far, or out of the way of all
            step_size = float(rng.choice([0.01, 1.0, 1e3], p=[0.7, 0.27, 0.03]))
            manager.set_pose(i, manager.pose(i) * pin.exp6(step_size * rng.normal(size=6) * 0.5))
        for _ in range(int(rng.integers(0, 3))):
            manager.add(meshes[rng.integers(3)], anywhere(rng, 6.0), movable=bool(rng.random() < 0.6))
        if rng.random() < 0.5:
            manager.remove(int(rng.choice(manager.objects)))
        within = float(rng.choice([0.0, 0.2, np.inf]))
        assert manager.object_pairs(within=within).tolist() == near_by_bounds(manager, within)
        if step % 5 == 0:
            rows = manager.colliding_surfaces().tolist()
            assert rows == one_by_one(manager)
            met += len(rows)
    assert met > 100


def test_far_off_objects_are_as_near_as_others() -> None:
    manager = CollisionManager()
    for far in (0.0, 1e38, 1e39, -1e60):
        for movable in (True, False):
            manager.add(shapes.box(), at(far), movable)
    assert manager.object_pairs().tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]
    assert len(manager.object_pairs(within=np.inf)) == 8 * 7 // 2 - 4 * 3 // 2


def test_rotations_that_are_not_quite_rotations_hide_no_pair() -> None:
    rng = np.random.default_rng(8)
    meeting = 0
    for _ in range(200):
        pose = np.eye(4)
        pose[:3, :3] += 1e-7 * rng.normal(size=(3, 3)).clip(-2, 2)
        target = pose.copy()  # what is nearest along a's x axis, as a's transposed rotation sees it
        target[:3, 3] = np.linalg.inv(pose[:3, :3].T)[:, 0] * (1.0 - 1e-9)
        manager = CollisionManager()
        manager.add(shapes.box(), pose), manager.add(shapes.box(), target)
        meet = colliding_surfaces(manager.mesh(0), manager.mesh(1), manager.relative_pose(0, 1), "brute")
        assert manager.colliding_surfaces()[:, 1::2].tolist() == meet.tolist()
        meeting += len(meet) > 0
    assert meeting > 50
