"""coal behind the same interface: agreement, and a disagreement that can be reproduced."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, PoseError, colliding_surfaces
from collision.query.distance import contacts_at
from collision.reference import oracle as oracle_module
from collision.reference.oracle import OracleError, cross_check, reproduce
from tests.collision.brute_force import box, random_soup, sphere
from tests.collision.shapes import at


@pytest.mark.parametrize("seed", range(10))
def test_coal_gives_the_same_answer_on_soups(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_soup(rng, 90, 6), random_soup(rng, 70, 5)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * 0.5)
    ours = colliding_surfaces(a, b, pose, method="brute")
    assert len(ours)
    assert ours.tolist() == colliding_surfaces(a, b, pose, method="coal").tolist()
    cross_check(a, b, pose, ours)
    theirs = oracle_module.surface_contacts(a, b, pose, 0.1)
    mine = contacts_at(a, b, pose, 0.1)
    assert mine[["surface_a", "surface_b"]].tolist() == theirs[["surface_a", "surface_b"]].tolist()
    np.testing.assert_allclose(mine["distance"], theirs["distance"], atol=1e-7)


def test_a_wrong_answer_is_raised_with_what_reproduces_it(tmp_path) -> None:
    rng = np.random.default_rng(5)
    a, b = random_soup(rng, 60, 4), random_soup(rng, 60, 4)
    pose = at(0.2, 0.1)
    ours = colliding_surfaces(a, b, pose, method="brute")
    with pytest.raises(OracleError, match="reproduce from") as raised:
        cross_check(a, b, pose, ours[1:], tmp_path)
    assert raised.value.theirs.tolist() == ours.tolist()
    again_a, again_b, matrix = reproduce(raised.value.path)
    assert colliding_surfaces(again_a, again_b, pin.SE3(matrix), method="brute").tolist() == ours.tolist()


def test_touching_by_less_than_coal_can_tell_is_no_disagreement() -> None:
    a = box(1.0, 1.0, 1.0)
    for gap in (0.0, 1e-12, -1e-12):
        pose = at(0.3, 0.2, 1.0 + gap)
        cross_check(a, a, pose, colliding_surfaces(a, a, pose, method="brute"))
    with pytest.raises(OracleError):
        cross_check(a, a, at(0.3, 0.2, 0.99), np.empty((0, 2), np.int32))


def test_the_manager_checks_every_nth_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    world = CollisionManager(cross_check=2)
    world.add(sphere(0.5), at(0.0))
    world.add(sphere(0.5), at(0.4))
    for _ in range(4):
        assert len(world.colliding_surfaces()) == 1
    monkeypatch.setattr(oracle_module, "colliding_surfaces", lambda *a: np.empty((0, 2), np.int32))
    world.colliding_surfaces()
    with pytest.raises(OracleError):
        world.colliding_surfaces()


def test_bad_poses_never_reach_coal() -> None:
    bad = np.eye(4)
    bad[0, 3] = np.nan
    with pytest.raises(PoseError):
        colliding_surfaces(box(1, 1, 1), box(1, 1, 1), bad, method="coal")
    with pytest.raises(PoseError):
        oracle_module.colliding_surfaces(box(1, 1, 1), box(1, 1, 1), bad)
