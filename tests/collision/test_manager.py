"""`CollisionManager`: what it holds, what it leaves out, and its answers against pairs asked one by one."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, CollisionManager, PoseError, UnknownObjectError, colliding_surfaces
from tests.collision import shapes


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def anywhere(rng: np.random.Generator, spread: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), spread * rng.random(3))


def crowd(n: int, seed: int, spread: float) -> CollisionManager:
    rng = np.random.default_rng(seed)
    meshes = [shapes.soup(40, 4, 1), shapes.box(cells=2), shapes.wave(6, 2, 3)]
    manager = CollisionManager()
    for i in range(n):
        manager.add(meshes[i % 3], anywhere(rng, spread), movable=bool(i % 4))
    return manager


def one_by_one(manager: CollisionManager) -> list[list[int]]:
    rows = []
    for i, j in combinations(manager.objects, 2):
        if manager.movable(i) or manager.movable(j):
            pairs = colliding_surfaces(manager.mesh(i), manager.mesh(j), manager.relative_pose(i, j), "brute")
            rows += [[i, a, j, b] for a, b in pairs.tolist()]
    return rows


def test_all_pairs_against_pairs_one_by_one() -> None:
    for seed in range(3):
        manager = crowd(14, seed, 4.0)
        rows = manager.colliding_surfaces()
        assert rows.dtype == np.int32 and rows.shape[1] == 4
        assert rows.tolist() == one_by_one(manager) and len(rows) > 10
        only = manager.colliding_surfaces(objects=[2, 5])
        assert only.tolist() == [row for row in rows.tolist() if {row[0], row[2]} & {2, 5}]


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


def test_object_pairs_against_all_boxes() -> None:
    rng = np.random.default_rng(4)
    manager = crowd(120, 4, 9.0)
    for step in range(6):
        manager.set_poses(manager.objects, [anywhere(rng, 9.0) for _ in manager.objects])
        if step == 3:
            manager.remove(17)
            manager.ignore(3, 5)
        within = 0.3 * (step % 2)
        corners = []
        for i in range(120):
            triangles = manager.mesh(i).triangles if i in manager.objects else None
            points = np.zeros((1, 3)) + 1e9 if triangles is None else manager.mesh(i).vertices[np.unique(triangles)]
            pose = None if triangles is None else manager.pose(i)
            box = np.array([points.min(0), points.max(0)])
            hull = np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]])
            hull = hull if pose is None else hull @ pose.rotation.T + pose.translation
            corners.append((hull.min(0), hull.max(0)))
        expected = [
            [i, j]
            for i, j in combinations(range(120), 2)
            if (i % 4 or j % 4)
            and not (step >= 3 and (17 in (i, j) or (i, j) == (3, 5)))
            and (corners[i][0] <= corners[j][1] + within).all()
            and (corners[j][0] <= corners[i][1] + within).all()
        ]
        assert manager.object_pairs(within=within).tolist() == expected and len(expected) > 20
        some = manager.object_pairs([1, 2], within=within).tolist()
        assert some == [pair for pair in expected if {1, 2} & set(pair)]


def test_threads_and_memory_change_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    manager = crowd(40, 6, 3.0)
    rng = np.random.default_rng(7)
    answers = []
    for _ in range(4):
        manager.set_poses(range(0, 40, 2), [anywhere(rng, 3.0) for _ in range(20)])
        answers.append((manager.colliding_surfaces(), [manager.pose(i) for i in range(40)]))
    assert len(manager.object_pairs()) > 40
    monkeypatch.setattr("collision.query.WORTH_A_THREAD", 10**9)
    monkeypatch.setattr("collision.query.REMEMBERED", 0)
    for rows, poses in reversed(answers):
        manager.set_poses(range(40), poses)
        assert np.array_equal(manager.colliding_surfaces(), rows) and len(rows) > 50
        fresh = crowd(40, 6, 3.0)
        fresh.set_poses(range(40), poses)
        assert np.array_equal(fresh.colliding_surfaces(), rows)


def test_what_does_not_move_is_not_asked_again() -> None:
    manager = crowd(10, 8, 1.5)
    first = manager.colliding_surfaces()
    manager.reset_statistics()
    assert np.array_equal(manager.colliding_surfaces(), first)
    assert manager.statistics.box_tests == 0
    manager.set_pose(1, manager.pose(1))
    assert np.array_equal(manager.colliding_surfaces(), first)
    assert manager.statistics.object_pairs == sum(1 in pair for pair in manager.object_pairs().tolist())


def test_relative_poses_are_the_same_bits_everywhere() -> None:
    from collision.objects import relative_poses
    from collision.poses import between

    rng = np.random.default_rng(9)
    poses = np.array([anywhere(rng, 2.0).homogeneous for _ in range(60)])
    packed = np.concatenate([poses[:, :3, :3].reshape(60, 9), poses[:, :3, 3]], axis=1)
    pairs = np.stack([np.arange(30), np.arange(30, 60)], axis=1).astype(np.int32)
    out = np.empty((30, 12))
    relative_poses(packed, pairs, out)
    assert np.array_equal(out, [between(packed[i], packed[j]) for i, j in pairs.tolist()])
    expected = [np.linalg.inv(poses[i]) @ poses[j] for i, j in pairs.tolist()]
    assert np.allclose(out[:, 9:], [e[:3, 3] for e in expected], atol=1e-13)


def test_what_is_ignored_is_left_out_until_heeded() -> None:
    manager = CollisionManager()
    a, b, c = (manager.add(shapes.box(name=n), at(0.9 * k)) for k, n in enumerate("abc"))
    everything = manager.colliding_surfaces().tolist()
    assert {(row[0], row[2]) for row in everything} == {(a, b), (b, c)}
    manager.ignore(b, a)
    assert manager.colliding_surfaces().tolist() == [row for row in everything if row[0] == b]
    manager.heed(a, b)
    manager.ignore_surfaces(c, [4], b, [2, 3])
    kept = [row for row in everything if row[:3] not in ([b, 2, c], [b, 3, c]) or row[3] != 4]
    assert manager.colliding_surfaces().tolist() == kept and len(kept) == len(everything) - 2
    manager.heed_surfaces(b, range(6), c, range(6))
    assert manager.colliding_surfaces().tolist() == everything


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


def test_bad_input_is_named_and_changes_nothing() -> None:
    manager = CollisionManager()
    a, b = manager.add(shapes.box(name="lid"), at(0)), manager.add(shapes.box(), at(0.9))
    before = manager.colliding_surfaces().tolist()
    with pytest.raises(PoseError, match=r"object 0 \(lid\)") as caught:
        manager.set_pose(a, at(np.inf))
    assert caught.value.object_id == a
    with pytest.raises(PoseError, match="object 2"):
        manager.add(shapes.box(), np.zeros((4, 4)))
    with pytest.raises(UnknownObjectError, match="no object 7; ids are 0 … 1"):
        manager.set_pose(7, at(0))
    with pytest.raises(UnknownObjectError):
        manager.colliding_surfaces(objects=[-1])
    with pytest.raises(CollisionError, match="needs two objects"):
        manager.ignore(a, a)
    with pytest.raises(CollisionError, match=r"object 1 .* no surface 6; they are 0 … 5"):
        manager.ignore_surfaces(a, [0], b, [6])
    assert manager.objects == (a, b) and manager.colliding_surfaces().tolist() == before


def test_statistics_add_up() -> None:
    manager = crowd(10, 7, 2.0)
    manager.colliding_surfaces()
    once = manager.statistics
    assert once.object_pairs > 0 and once.triangle_tests > 0 and once.box_tests > once.triangle_tests
    manager.reset_statistics()
    assert manager.statistics.box_tests == 0
