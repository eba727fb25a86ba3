"""Rules decide what is accepted."""

import numpy as np
import pytest

from tests.vpframe.bench_scene import SEAT, scene
from vpframe.errors import TaskError
from vpframe.hands import freedom
from vpframe.session import rules
from vpframe.session.session import Session


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (rules.accept_all, {"concentric", "against"}),
        (rules.leave_all, set()),
        (rules.accept_kinds("against"), {"against"}),
        (rules.first_of(rules.refuse_between("block", "peg"), rules.accept_all), set()),
        (rules.accept_between("peg", "block", "concentric"), {"concentric"}),
        (rules.first_of(rules.refuse_kinds("concentric"), rules.accept_all), {"against"}),
    ],
)
def test_rules_decide_what_is_accepted(rule, expected: set[str]) -> None:
    # exactly on the axis, so that it goes in without help
    with Session(scene(), rule=rule) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        hand.move_to(SEAT + np.array([0.0, 0.0, 0.018]))
        hand.move_to(SEAT, required=False)
        assert {c.kind for c in session.constraints_of("peg")} == expected
        refused = [c for c in session.frame.constraints if c.state == "refused"]
        assert bool(refused) == (rule is not rules.accept_all and any(e.kind == "refused" for e in session.events))


def test_a_script_accepts_refuses_and_removes() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        hand.move_to(SEAT + np.array([0.0001, 0.0, 0.016]))
        hand.slide("down", distance=0.003, required=False)
        offered = [c for c in session.candidates if c.kind == "concentric"]
        assert len(offered) == 1
        session.accept(offered[0])
        session.step()
        assert [c.kind for c in session.constraints] == ["concentric"]
        session.expect(freedom(2, "peg"))
        session.remove(session.constraints[0])
        session.step()
        assert session.constraints == ()
        with pytest.raises(TaskError, match="no candidate has id"):
            session.accept(offered[0].__class__(**{**offered[0].__dict__, "id": 999}))
            session.step()
