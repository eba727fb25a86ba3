"""Verbs of a hand for lists of parts."""

import numpy as np
import pytest

from tests.vpframe.bolted import bolted, poses
from vpframe.errors import TaskError
from vpframe.session.session import Session


def test_a_list_goes_out_beside_the_scene_and_back() -> None:
    with Session(bolted()) as session:
        session.step()
        begun = poses(session)
        _, high = session.bounds
        hand = session.hand()
        outcome = hand.remove(["bolt_1", "bolt_2", "cover"])
        assert outcome and "2 like bolt_1" in outcome.reason and "cover" in outcome.reason
        for name in ("lid/bolt_1", "lid/bolt_2", "lid/cover"):
            session.expect_free(name)
            session.expect_freedom(name, 6)
            assert (session.scene[name].pose.translation[1] > high[1]) or (
                session.scene[name].pose.translation[0] > high[0]
            )
        assert hand.refit(["bolt_1", "bolt_2", "cover"])
        for name, pose in begun.items():
            np.testing.assert_allclose(session.scene[name].pose.homogeneous, pose.homogeneous, atol=1e-6)
        session.expect_constraint("concentric", "bolt_1", "base")


def test_a_part_is_exchanged_for_another() -> None:
    with Session(bolted(spare=True)) as session:
        session.step()
        seat = session.scene["lid/bolt_1"].pose.copy()
        assert session.hand().exchange("bolt_1", "spare")
        session.expect_at("spare", seat, within=1e-6)
        session.expect_constraint("concentric", "spare", "base")
        session.expect_free("bolt_1")


def test_a_session_takes_subassemblies_wherever_it_takes_parts() -> None:
    with Session(bolted(spare=True)) as session:
        session.step()
        assert {name for c in session.constraints_of("lid") for name in c.parts} - set(session.group("lid")) == {"base"}
        session.expect_constraint("against", "lid", "base")
        assert session.clearance("lid", "spare") == pytest.approx(0.08 - 0.006 - 0.0, abs=2e-2)
        session.authorise("lid", "spare")
        assert len(session.authorised) == 3
        hand = session.hand()
        hand.grab("lid")
        hand.pull("up", until="free")
        hand.move_by((0.0, 0.0, 0.03))
        session.expect_at("lid", session.scene["lid/cover"].pose)
        session.expect_free("lid")
        with pytest.raises(TaskError, match="name one of them"):
            session.thread("lid", 0.001)
        with pytest.raises(TaskError, match="name one, or a material"):
            session.behave("lid", mass=1.0)
        hand.place("base", at=(0.0, 0.0))
        low = min(p.mesh.vertices[:, 2].min() + p.pose.translation[2] for n, p in session.scene.items() if "lid" in n)
        assert low == pytest.approx(0.0, abs=1e-4)  # the bolts stand out under the cover
