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


def crowd(n: int, seed: int, spread: float) -> CollisionManager:
    rng = np.random.default_rng(seed)
    meshes = [shapes.soup(40, 4, 1), shapes.box(cells=2), shapes.wave(6, 2, 3)]
    manager = CollisionManager()
    for i in range(n):
        q = pin.Quaternion(*rng.normal(size=4)).normalized()
        manager.add(meshes[i % 3], pin.SE3(q.matrix(), spread * rng.random(3)), movable=bool(i % 4))
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
        pose = pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), 2 * rng.random(3))
        manager.set_pose(i, pose)
        assert np.array_equal(manager.pose(i).homogeneous, pose.homogeneous)
        assert manager.colliding_surfaces().tolist() == one_by_one(manager)


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
