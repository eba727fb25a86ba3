"""Objects of one group are no pairs; contact rows within less than was asked are picked from those there are."""

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, CollisionManager
from tests.constraints.shapes import box


def row_of_boxes(n: int = 24) -> CollisionManager:
    """Boxes of 20 mm along x, each 1 mm into the next."""
    world = CollisionManager()
    for k in range(n):
        world.add(box(0.02, 0.02, 0.02).mesh, pin.SE3(np.eye(3), np.array([0.019 * k, 0.0, 0.0])))
    return world


def pairs_in(rows: np.ndarray) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for a, b in zip(rows["object_a"], rows["object_b"], strict=True)}


def test_pairs_within_a_group_are_left_out_of_every_answer_and_come_back() -> None:
    world, free = row_of_boxes(), row_of_boxes()
    groups = [{3, 4, 5}, {5 + k for k in range(5, 9)}]
    world.colliding_surfaces()
    world.set_groups(groups)
    inside = {pair for group in groups for pair in combinations(sorted(group), 2)}
    for moved in (None, 4, 11):
        if moved is not None:
            pose = free.pose(moved)
            pose.translation[1] += 1e-3
            world.set_pose(moved, pose), free.set_pose(moved, pose)
        for chosen in (None, [4], [2, 4, 9, 11]):
            rows = free.colliding_surfaces(chosen)
            expected = rows[[(a, b) not in inside for a, _, b, _ in rows.tolist()]]
            assert len(expected) < len(rows) and np.array_equal(world.colliding_surfaces(chosen), expected)
            near = free.contacts(2e-3, chosen)
            assert pairs_in(world.contacts(2e-3, chosen)) == pairs_in(near) - inside
    assert world.ignored(3, 5) and not world.ignored(5, 6)
    up = {k: free.pose(k) * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5])) for k in (3, 4, 5)}
    assert not inside & pairs_in(world.time_of_impact(up).contacts)
    world.set_groups([])
    assert np.array_equal(world.colliding_surfaces(), free.colliding_surfaces())


def test_an_object_is_in_one_group_once() -> None:
    world = row_of_boxes(4)
    for wrong in ([[0, 1], [1, 2]], [[1, 1]]):
        with pytest.raises(CollisionError, match="two groups"):
            world.set_groups(wrong)


def test_rows_within_less_are_those_that_a_fresh_manager_finds() -> None:
    world = row_of_boxes(6)
    for k in range(6):
        world.set_pose(k, pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3]) * k), np.array([0.021 * k, 0.0, 0.0])))
    for within in (5e-3, 1e-3, 0.0, 3e-3, 8e-3):
        fresh = row_of_boxes(6)
        for k in range(6):
            fresh.set_pose(k, world.pose(k))
        rows, expected = world.contacts(within), fresh.contacts(within)
        for name in ("object_a", "surface_a", "object_b", "surface_b", "distance"):
            assert np.array_equal(rows[name], expected[name])
