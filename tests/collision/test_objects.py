"""`Objects`: ids, poses, and which pairs are enabled."""

import numpy as np
import pinocchio as pin
import pytest

from collision import (
    CollisionManager,
    PoseError,
    UnknownObjectError,
)
from tests.collision import shapes
from tests.collision.crowds import anywhere, crowd, one_by_one
from tests.collision.shapes import at


def test_poses_are_kept_and_changed() -> None:
    manager = crowd(9, 5, 2.0)
    rng = np.random.default_rng(1)
    for _ in range(20):
        i = int(rng.integers(9))
        pose = anywhere(rng, 2.0)
        manager.set_pose(i, pose)
        assert np.array_equal(manager.pose(i).homogeneous, pose.homogeneous)
        assert manager.colliding_surfaces().tolist() == one_by_one(manager)


def test_many_poses_at_once() -> None:
    manager, other = crowd(12, 3, 3.0), crowd(12, 3, 3.0)
    rng = np.random.default_rng(2)
    for _ in range(5):
        ids = rng.permutation(12)[:7]
        poses = [anywhere(rng, 3.0) for _ in ids]
        manager.set_poses(ids, poses)
        for i, pose in zip(ids.tolist(), poses, strict=True):
            other.set_pose(i, pose)
        assert np.array_equal(manager.colliding_surfaces(), other.colliding_surfaces())
        manager.set_poses(ids, np.array([pose.homogeneous for pose in poses]))
        assert np.array_equal(manager.colliding_surfaces(), other.colliding_surfaces())
    before = [manager.pose(i).homogeneous for i in manager.objects]
    poses[3] = pin.SE3(np.eye(3) * 1.5, np.zeros(3))
    with pytest.raises(PoseError, match=rf"object {ids[3]} "):
        manager.set_poses(ids, poses)
    with pytest.raises(PoseError, match="as many poses"):
        manager.set_poses([0, 1], poses)
    with pytest.raises(UnknownObjectError):
        manager.set_poses([0, 99], poses[:2])
    assert np.array_equal(before, [manager.pose(i).homogeneous for i in manager.objects])


def test_poses_read_are_those_set_to_the_bit_and_of_nobody_else() -> None:
    manager, rng = crowd(6, 3, 3.0), np.random.default_rng(4)
    mark = manager.snapshot
    for ids in ([0, 2, 4, 5, 3], [1, 2], [3, 3, 0], [4]):
        given = [anywhere(rng, 3.0) for _ in ids]
        manager.set_poses(ids, given)
        was = {i: pose.homogeneous for i, pose in zip(ids, given, strict=True)}
        for pose in given:
            pose.translation = np.full(3, 7.0)  # the caller's own
        known = manager.poses
        assert all(np.array_equal(known[i].homogeneous, manager.pose(i).homogeneous) for i in range(6))
        assert all(np.array_equal(known[i].homogeneous, pose) for i, pose in was.items())
        manager.set_poses(ids[-1:], np.array([was[ids[-1]]]))
        assert all(a is b for a, b in zip(known, manager.poses, strict=True)), "nothing has moved"
    manager.snapshot = mark
    assert all(np.array_equal(pose.homogeneous, manager.pose(i).homogeneous) for i, pose in enumerate(manager.poses))


def test_a_move_that_was_interrupted_is_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt may come when an object has its new pose, and its version is still the old one."""
    manager = crowd(4, 5, 2.0)
    before, mark = manager.packed_poses().tobytes(), manager.snapshot
    rows = manager.colliding_surfaces().tolist()

    def interrupted() -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(manager, "_next_version", interrupted)
    with pytest.raises(KeyboardInterrupt):
        manager.set_pose(2, at(5.0))
    with pytest.raises(KeyboardInterrupt):
        manager.set_poses([0, 1], [at(6.0), at(7.0)])
    monkeypatch.undo()
    manager.snapshot = mark
    assert manager.packed_poses().tobytes() == before
    assert manager.colliding_surfaces().tolist() == rows == one_by_one(manager)


def test_enabled_surfaces_are_the_same_in_either_order() -> None:
    manager = CollisionManager()
    a, b = manager.add(shapes.box(), at(0)), manager.add(shapes.soup(40, 4, 1), at(0.5))
    assert manager.enabled_surfaces(b, a) is None
    for left_out in ((2, 3), (5, 1)):  # asked before and after a change
        manager.ignore_surfaces(b, [left_out[1]], a, [left_out[0]])
        enabled, other = manager.enabled_surfaces(a, b), manager.enabled_surfaces(b, a)
        assert enabled is not None and other is not None
        assert enabled.shape == (6, 4) and enabled[left_out] == 0
        assert enabled.T.tolist() == other.tolist()
    manager.enable_surfaces(b, range(4), a, range(6))
    assert manager.enabled_surfaces(a, b) is None and manager.enabled_surfaces(b, a) is None


def test_enabled_surfaces_follow_each_change_and_no_table_that_was_given_changes() -> None:
    manager, random = CollisionManager(), np.random.default_rng(5)
    a, b = manager.add(shapes.box(), at(0)), manager.add(shapes.soup(40, 4, 1), at(0.5))
    left_out: set[tuple[int, int]] = set()
    given = []
    for _ in range(60):
        some = [sorted(set(random.integers(0, n, 3).tolist())) for n in (6, 4)]
        pairs = {(i, j) for i in some[0] for j in some[1]}
        if random.random() < 0.5:
            manager.ignore_surfaces(a, some[0], b, some[1])
            left_out |= pairs
        else:
            manager.enable_surfaces(b, some[1], a, some[0])
            left_out -= pairs
        table = manager.enabled_surfaces(a, b)
        expected = [[(i, j) not in left_out for j in range(4)] for i in range(6)]
        assert (table is None and not left_out) or table.astype(bool).tolist() == expected
        if table is not None:
            given.append((table, table.copy()))
            assert manager.enabled_surfaces(b, a).T.tolist() == table.tolist()
    assert all(np.array_equal(table, before) for table, before in given)


def test_ids_stay_when_others_go() -> None:
    manager = CollisionManager()
    a, b, c = (manager.add(shapes.box(), at(0.6 * k)) for k in range(3))
    manager.remove(b)
    assert manager.objects == (a, c) and len(manager.colliding_surfaces()) == 0
    d = manager.add(shapes.box(), at(0.6))
    assert d not in (a, b, c)
    assert {(row[0], row[2]) for row in manager.colliding_surfaces().tolist()} == {(a, d), (c, d)}
    with pytest.raises(UnknownObjectError, match=rf"no object {b}"):
        manager.pose(b)
