"""Lengths are metres: what can only be meant in millimetres is refused, what anybody may want is not."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import scene
from vpframe.errors import TaskError
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
    session.state.start()
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
