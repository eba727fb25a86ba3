"""`CollisionManager`: what it holds, what it leaves out, and its answers against pairs asked one by one."""

import copy

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
from collision.methods import METHODS, Method
from tests.collision import shapes
from tests.collision.crowds import anywhere, crowd, one_by_one
from tests.collision.shapes import at


def test_all_pairs_against_pairs_one_by_one() -> None:
    for seed in range(3):
        manager = crowd(14, seed, 4.0)
        rows = manager.colliding_surfaces()
        assert rows.dtype == np.int32 and rows.shape[1] == 4
        assert rows.tolist() == one_by_one(manager) and len(rows) > 10
        only = manager.colliding_surfaces(objects=[2, 5])
        assert only.tolist() == [row for row in rows.tolist() if {row[0], row[2]} & {2, 5}]


def test_threads_and_memory_change_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("collision.narrow_phase.WORTH_A_THREAD", 0.0)  # s: whatever takes any time is shared
    manager = crowd(40, 6, 3.0)
    rng = np.random.default_rng(7)
    answers = []
    for _ in range(4):
        manager.set_poses(range(0, 40, 2), [anywhere(rng, 3.0) for _ in range(20)])
        answers.append((manager.colliding_surfaces(), [manager.pose(i) for i in range(40)]))
    assert len(manager.object_pairs()) > 40
    monkeypatch.setattr("collision.narrow_phase.WORTH_A_THREAD", 1e9)
    monkeypatch.setattr("collision.narrow_phase.MOST_CACHED", 0)
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
    here = manager.pose(1)
    manager.set_pose(1, here)
    assert np.array_equal(manager.colliding_surfaces(), first)
    assert manager.statistics.object_pairs == 0
    manager.set_pose(1, at(9.0))
    manager.set_pose(1, here)
    assert np.array_equal(manager.colliding_surfaces(), first)
    assert manager.statistics.object_pairs == sum(1 in pair for pair in manager.object_pairs().tolist())


def test_what_is_ignored_is_left_out_until_enabled() -> None:
    manager = CollisionManager()
    a, b, c = (manager.add(shapes.box(name=n), at(0.9 * k)) for k, n in enumerate("abc"))
    everything = manager.colliding_surfaces().tolist()
    assert {(row[0], row[2]) for row in everything} == {(a, b), (b, c)}
    manager.ignore(b, a)
    assert manager.colliding_surfaces().tolist() == [row for row in everything if row[0] == b]
    manager.enable(a, b)
    manager.ignore_surfaces(c, [4], b, [2, 3])
    kept = [row for row in everything if row[:3] not in ([b, 2, c], [b, 3, c]) or row[3] != 4]
    assert manager.colliding_surfaces().tolist() == kept and len(kept) == len(everything) - 2
    manager.enable_surfaces(b, range(6), c, range(6))
    assert manager.colliding_surfaces().tolist() == everything


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
            world.time_of_impact({wrong: pin.SE3.Identity()})  # type: ignore[dict-item]
    for question in (world.clearance, world.contains, world.penetration, world.ignore):
        with pytest.raises(CollisionError, match="twice"):
            question(1, 1)
    with pytest.raises(PoseError, match="target of object 1"):
        world.time_of_impact({1: None})  # type: ignore[dict-item]
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
