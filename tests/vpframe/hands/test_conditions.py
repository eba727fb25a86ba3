"""Conditions that end a motion."""

from tests.vpframe.bench_scene import holding, scene
from vpframe.hands import clearance, constraint, contact
from vpframe.session import rules
from vpframe.session.session import Session


def test_conditions_end_a_motion_when_they_hold() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session, "cube")
        outcome = hand.slide("down", until=clearance < 0.005)
        assert outcome.reason == "clearance < 5 mm"
        assert 0.0 < session.clearance("cube") < 0.005
        assert hand.slide("down", until=contact | constraint()).reason == "contact or constraint of any kind"
        assert session.touching("cube") == {"table": (5,)} or set(session.touching("cube")) == {"table"}
        assert hand.wait(0.1)
        assert not hand.slide("up", distance=0.01, until=contact & ~contact, required=False)
