"""Lengths are metres: what can only be meant in millimetres is refused, what anybody may want is not."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vpframe.bench_scene import scene
from vpframe.errors import TaskError
from vpframe.hands.arguments import radians
from vpframe.scene import modelling
from vpframe.scene.scene import Scene
from vpframe.session import rules
from vpframe.session.session import Session


def opened() -> tuple[Session, object]:
    session = Session(scene(), rule=rules.leave_all)
    hand = session.hand(at=(0.09, 0.07, 0.05))
    hand.grab("cube")
    return session, hand


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (
            lambda hand: hand.move_by((0, 0, 50)),
            r"move_by: 50 m is 116 times the size of the scene \(0\.429 m\); .* write 0\.05 for 50 mm",
        ),
        (lambda hand: hand.move_by((30, 40, 0)), "move_by: 50 m is"),
        (lambda hand: hand.move_to((0, 0, 120)), r"move_to: 1\d\d\.?\d* m is .* lengths are metres"),
        (lambda hand: hand.follow([(0.1, 0.1, 0.1), (10, 10, 10)]), "follow: 17.* m is"),
        (lambda hand: hand.slide("up", 25), r"slide: distance=25: 25 m is .* write 0\.025 for 25 mm"),
        (lambda hand: hand.slide("up", -25), "slide: distance=-25: 25 m is"),
        (lambda hand: hand.pull("up", 25, until=None), "pull: distance=25: 25 m is"),
        (lambda hand: hand.place("table", height=50), "place: height=50"),
        (lambda hand: hand.insert("block", gap=30), "insert: gap=30"),
        (lambda hand: hand.screw(2, pitch=1.5), r"screw: pitch=1\.5: 1\.5 m is .* write 0\.0015 for 1\.5 mm"),
        (lambda hand: hand.session.thread("cube", -1.5), r"thread\('cube', -1\.5\): 1\.5 m is"),
    ],
)
def test_millimetres_are_refused_with_the_hint(ask, words: str) -> None:
    session, hand = opened()
    before = session.step_count
    with pytest.raises(TaskError, match=words):
        ask(hand)
    assert session.step_count == before, "nothing has moved"


def test_what_a_script_may_want_is_not_refused() -> None:
    session, hand = opened()
    hand.speed = 20.0
    hand.move_by((0.0, 0.0, 1.0))
    hand.move_by((0.0, 0.0, 5.0))
    session.thread("cube", 0.02)
    np.testing.assert_allclose(session.scene["cube"].pose.translation, (0.08, 0.06, 6.02), atol=1e-6)


def test_the_way_back_from_far_away_is_not_refused() -> None:
    """A part that was let fall has come farther than any hand carries it."""
    session, hand = opened()
    home = pin.SE3(session.scene["cube"].pose)
    hand.speed = 500.0
    session.engine.start()
    for _ in range(6):
        hand.move_by((0.0, 0.0, 8.0))
    assert hand.move_to(home)


def test_a_small_part_alone_may_go_a_metre() -> None:
    made = modelling.scene({"screw": (modelling.cylinder(0.0005, 0.002), pin.SE3.Identity())})
    session = Session(Scene(made.parts))
    hand = session.hand(at=(0.0, 0.0, 0.003))
    hand.speed = 2.0
    hand.grab("screw")
    assert hand.move_by((0.0, 0.6, 0.7))
    assert np.linalg.norm(session.scene["screw"].pose.translation) > 0.9
    with pytest.raises(TaskError, match="lengths are metres"):
        hand.move_by((0.0, 0.0, 2.0))


@pytest.mark.parametrize("angle", [90, 45.0, -90.0, 180, 360, 22.5, 7, 10.0, 64.1, -1e6, 1e20])
def test_an_angle_that_must_be_meant_in_degrees_is_refused_in_one_line(angle: float) -> None:
    with pytest.raises(
        TaskError, match=r"angle=.* turns; angles are radians, write math\.radians\(.*\) for .*°"
    ) as told:
        radians(float(angle), "hand.turn: angle")
    assert "\n" not in str(told.value)


@given(st.floats(-6.28, 6.28) | st.integers(-800, 800).map(lambda k: k * math.pi / 4.0))
def test_an_angle_of_up_to_a_turn_and_eighths_of_turns_are_taken(angle: float) -> None:
    assert radians(angle, "angle") == angle


@pytest.mark.parametrize("turns", [1.2, 2.5, 7.3, 9.99, 40, 1000])
def test_turns_that_a_script_computes_are_taken(turns: float) -> None:
    assert radians(2.0 * math.pi * turns, "angle") == 2.0 * math.pi * turns


def test_a_hand_that_is_told_to_turn_by_90_says_degrees_and_does_nothing() -> None:
    session, hand = opened()
    with session:
        begun = session.step_count
        with pytest.raises(
            TaskError, match=r"hand\[cube\]\.turn: angle=90: 90 rad is 14\.3 turns; .*math\.radians\(90\)"
        ):
            hand.turn(90, about="z")
        assert session.step_count == begun
        assert hand.turn(math.radians(90), about="z", until="contact", required=False) is not None
