"""A step always ends: with a motion, or with one error that names the body, what moves it, and the mend."""

import time

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager
from physics import Behaviour, Body, World, WorldError
from physics.stepping import step
from vpframe.scene import modelling as m

FLOOR = m.shape(m.box(1.0, 1.0, 0.1).translated(-0.5, -0.5, -0.1), name="floor").mesh
BOX = m.shape(m.box(0.1, 0.1, 0.1), name="box").mesh
SOONER = 20.0
"""s of processor time: far below what the sub-steps of such a motion would take"""


class Wrench(Behaviour):
    def __init__(self, wrench: list[float]) -> None:
        self.given = wrench

    def wrench(self, view: object) -> list[float]:
        return self.given


class Constant(Wrench):
    constant = True


def world(height: float = 0.2, gravity: float = 9.81, *behaviours: Behaviour) -> World:
    collision = CollisionManager()
    collision.add(FLOOR, pin.SE3.Identity())
    box = collision.add(BOX, pin.SE3(np.eye(3), np.array([0.0, 0.0, height])))
    out = World(collision, gravity=(0.0, 0.0, -gravity))
    out.add(box, Body.from_mesh(BOX, 1000.0, "box"), behaviours)
    return out


def failed(made: World, dt: float = 1.0 / 60.0, steps: int = 20) -> str:
    begun = time.process_time()
    for _ in range(steps):
        before = made.poses[1].homogeneous.tobytes(), made.time
        try:
            made.step(dt)
        except WorldError as error:
            assert error.object_id == 1
            assert (made.poses[1].homogeneous.tobytes(), made.time) == before  # nothing has changed
            assert time.process_time() - begun < SOONER
            return str(error)
    raise AssertionError("it went on")


@pytest.mark.parametrize("height", [0.2, 0.0, 10.0], ids=["above the floor", "on the floor", "near to nothing"])
@pytest.mark.parametrize("pull", [1e15, 1e30, 1e300])
def test_gravity_beyond_all_measure_ends_in_one_error(pull: float, height: float) -> None:
    made = world(height, pull)
    if height == 0.0 and pull < 1e20:  # the floor bears it
        made.step(0.01)
        assert abs(made.velocity(1)).max() < 1e-3
        return
    assert "box" in (text := failed(made)) and "cannot be followed in a step of 0.0167 s" in text
    assert "give less force, gravity or speed, or a shorter step" in text and "\n" not in text


@pytest.mark.parametrize("twist", [[1e30] * 6, [0, 0, -1e300, 0, 0, 0], [0, 0, 0, 1e30, 0, 0], [0, 0, 0, 0, 1e6, 1e5]])
@pytest.mark.parametrize("height", [0.0, 0.2, 10.0])
def test_a_speed_beyond_all_measure_ends_in_one_error(twist: list[float], height: float) -> None:
    made = world(height)
    made.set_velocity(1, twist)
    if height == 10.0 and twist[4] == 1e6:  # far from everything it can be followed
        made.step(1.0 / 60.0)
        return
    text = failed(made)
    assert "box" in text and "cannot be followed" in text and "rad/s" in text


@pytest.mark.parametrize("kind", [Wrench, Constant])
@pytest.mark.parametrize("k", range(6))
@pytest.mark.parametrize("size", [1e20, -1e20, 1e250])
def test_a_wrench_beyond_all_measure_ends_in_one_error_with_its_value(size: float, k: int, kind: type[Wrench]) -> None:
    given = [0.0] * 6
    given[k] = size
    text = failed(world(0.2, 9.81, kind(given)))
    assert "box" in text and f"{abs(size):.3g} {'N·m' if k > 2 else 'N'}" in text


def test_what_can_be_followed_is_followed() -> None:
    """A plate at 1 km/s, a spindle of 60,000 rpm, 1e5 N: no limit is near."""
    fast = world(1.0)
    fast.set_velocity(1, [0, 0, -1000.0, 0, 0, 0])
    spun = world(10.0)
    spun.set_velocity(1, [0, 0, 0, 0, 0, 6283.0])
    pushed = world(0.0, 9.81, Wrench([0.0, 0.0, -1e5, 0.0, 0.0, 0.0]))
    for made in (fast, spun, pushed):
        for _ in range(3):
            made.step(0.01)
        assert np.isfinite(made.velocity(1)).all()
    assert np.linalg.norm(spun.velocity(1)[3:]) == pytest.approx(6283.0, rel=1e-9)


def test_a_step_has_a_bounded_number_of_sub_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step, "SUBSTEPS", 3)
    made = world(0.0)
    made.set_velocity(1, [0, 0, 0, 300.0, 200.0, 100.0])
    assert "more than 3 sub-steps" in failed(made, 0.1)
