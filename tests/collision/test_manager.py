"""`CollisionManager`: what it holds, what it leaves out, and its answers against pairs asked one by one."""

from __future__ import annotations

import copy
from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
import pytest

from collision import (
    CollisionError,
    CollisionManager,
    PoseError,
    Tolerance,
    UnknownObjectError,
    colliding_surfaces,
)
from collision.query import METHODS, Method
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


def test_threads_and_memory_change_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    manager = crowd(40, 6, 3.0)
    rng = np.random.default_rng(7)
    answers = []
    for _ in range(4):
        manager.set_poses(range(0, 40, 2), [anywhere(rng, 3.0) for _ in range(20)])
        answers.append((manager.colliding_surfaces(), [manager.pose(i) for i in range(40)]))
    assert len(manager.object_pairs()) > 40
    monkeypatch.setattr("collision.narrow_phase.WORTH_A_THREAD", 10**9)
    monkeypatch.setattr("collision.narrow_phase.REMEMBERED", 0)
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


def test_relative_poses_of_many_are_those_of_each() -> None:
    from collision.numeric.poses import relative_poses

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Term by term: a library's product may round otherwise."""
        ra, rb = a[:9].reshape(3, 3), b[:9].reshape(3, 3)
        shift = b[9:] - a[9:]
        rotation = ra[0][:, None] * rb[0] + ra[1][:, None] * rb[1] + ra[2][:, None] * rb[2]
        return np.concatenate([rotation.ravel(), ra[0] * shift[0] + ra[1] * shift[1] + ra[2] * shift[2]])

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


def test_heeded_surfaces_are_the_same_in_either_order() -> None:
    manager = CollisionManager()
    a, b = manager.add(shapes.box(), at(0)), manager.add(shapes.soup(40, 4, 1), at(0.5))
    assert manager.heeded_surfaces(b, a) is None
    for left_out in ((2, 3), (5, 1)):  # asked before and after a change
        manager.ignore_surfaces(b, [left_out[1]], a, [left_out[0]])
        heeded, other = manager.heeded_surfaces(a, b), manager.heeded_surfaces(b, a)
        assert heeded is not None and other is not None
        assert heeded.shape == (6, 4) and heeded[left_out] == 0
        assert heeded.T.tolist() == other.tolist()
    manager.heed_surfaces(b, range(4), a, range(6))
    assert manager.heeded_surfaces(a, b) is None and manager.heeded_surfaces(b, a) is None


def skewed(x: float, by: float) -> np.ndarray:
    """A pose whose RᵀR is off the identity by `by`."""
    matrix = at(x).homogeneous
    matrix[0, 1] = by
    return matrix


@pytest.mark.parametrize("method", METHODS)
def test_poses_that_the_tolerance_takes_are_taken_by_every_question(method: Method) -> None:
    manager = CollisionManager(Tolerance(rigid=1e-3), method, cross_check=1)
    a, b = manager.add(shapes.box(), skewed(0.0, 9e-4)), manager.add(shapes.box(), skewed(0.9, -9e-4))
    far = manager.add_shape(coal.Sphere(0.2), skewed(-0.6, 5e-4))
    assert {(row[0], row[2]) for row in manager.colliding_surfaces().tolist()} == {(a, b), (a, far)}
    assert not manager.contains(a, b)
    assert manager.clearance(a, b)["distance"][0] == 0.0 and manager.clearance(b, far)["distance"][0] > 0.0
    assert len(manager.contacts(within=1e-3)) and len(manager.penetration(a, b))
    pose, loose = skewed(0.9, 9e-4), Tolerance(rigid=1e-3)
    box = shapes.box()
    assert len(colliding_surfaces(box, box, pose, method, loose))
    with pytest.raises(PoseError, match="1e-06 is allowed"):
        colliding_surfaces(box, box, pose, method)
    world = copy.deepcopy(manager)
    world.set_pose(b, pose)
    assert len(world.colliding_surfaces())
    with pytest.raises(PoseError, match="1e-06 is allowed"):
        CollisionManager().add(box, pose)


def test_coal_is_asked_with_the_gjk_of_the_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    for name in ("collide", "distance"):
        plain = getattr(coal, name)
        monkeypatch.setattr(coal, name, lambda *a, plain=plain: asked.append(a[4].gjk_tolerance) or plain(*a))
    manager = CollisionManager(Tolerance(gjk=3e-8), cross_check=1)
    ball = manager.add_shape(coal.Sphere(0.2), at(0))
    for x in (0.9, 1.8):
        manager.add(shapes.box(), at(x))
    manager.colliding_surfaces(), manager.contacts(within=1.0), manager.clearance(ball, 1)
    assert len(asked) > 3 and set(asked) == {3e-8}


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


def test_what_makes_no_sense_is_named() -> None:
    world = CollisionManager()
    for _ in range(2):
        world.add(shapes.box(), pin.SE3.Identity())
    for wrong in (7, -1, "a", 0.5, None):
        with pytest.raises(UnknownObjectError, match="no object"):
            world.mesh(wrong)  # type: ignore[arg-type]
        with pytest.raises(UnknownObjectError, match="no object"):
            world.set_poses([wrong], [pin.SE3.Identity()])  # type: ignore[list-item]
        with pytest.raises(UnknownObjectError, match="no object"):
            world.time_of_contact({wrong: pin.SE3.Identity()})  # type: ignore[dict-item]
    for question in (world.clearance, world.contains, world.penetration, world.ignore):
        with pytest.raises(CollisionError, match="twice"):
            question(1, 1)
    with pytest.raises(PoseError, match="target of object 1"):
        world.time_of_contact({1: None})  # type: ignore[dict-item]
    with pytest.raises(CollisionError, match="within"):
        world.object_pairs(within=-1.0)
    with pytest.raises(CollisionError, match="within"):
        world.contacts(within=float("nan"))
    with pytest.raises(CollisionError, match="object 2 is a ndarray"):
        world.add(np.eye(3), pin.SE3.Identity())  # type: ignore[arg-type]
    with pytest.raises(CollisionError, match="method 'quick'"):
        CollisionManager(method="quick")  # type: ignore[arg-type]
    with pytest.raises(CollisionError, match="cross_check"):
        CollisionManager(cross_check=-3)
    assert world.objects == (0, 1)
