"""Verbs, conditions, the assist and behaviours, each on the small bench."""

import numpy as np
import pinocchio as pin
import pytest

from physics import BodyError, Gravity, SpringHand
from tests.vpframe.bench_scene import SEAT, at, holding, scene
from vpframe.errors import TaskError, VpframeError
from vpframe.hands import Spline, constraint
from vpframe.scene import modelling
from vpframe.session import rules
from vpframe.session.session import Session


def test_insert_finds_the_bore_and_seats_the_peg() -> None:
    with Session(scene()) as session:
        assert holding(session).insert("block")
        session.expect_at("peg", SEAT, within=1e-9)
        session.expect_freedom("peg", 1)
    with Session(scene()) as session, pytest.raises(TaskError, match="nothing of cube fits into block"):
        holding(session, "cube").insert("block")


def test_place_puts_a_part_on_the_top_of_another() -> None:
    with Session(scene()) as session:
        hand = holding(session, "cube")
        assert hand.place("table", at=(0.1, 0.1))
        assert hand.held is None
        session.expect_constraint("against", "cube", "table")
        session.expect_at("cube", (0.09, 0.09, 0.0), within=1e-6)


def test_screw_and_unscrew_advance_by_the_pitch() -> None:
    with Session(scene()) as session:
        hand = holding(session)
        hand.move_to(SEAT + np.array([0.0, 0.0, 0.014]))
        hand.slide("down", until=constraint("concentric"))
        high = session.scene["peg"].pose.translation[2]
        hand.screw(turns=2.0, pitch=0.0015)
        low = session.scene["peg"].pose.translation[2]
        assert high - low == pytest.approx(0.003, abs=1e-6)
        session.thread("peg", 0.0015)
        hand.unscrew(turns=2.0)
        assert session.scene["peg"].pose.translation[2] == pytest.approx(high, abs=1e-6)


def test_follow_goes_through_the_poses_of_a_path() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session)
        here = session.scene["peg"].pose
        turned = pin.SE3(pin.exp3(np.array([0.0, 0.0, 1.0])), here.translation + np.array([0.05, 0.05, 0.05]))
        assert hand.follow(Spline([here, at(0.09, -0.03, 0.10), turned], speed=0.2))
        session.expect_at("peg", turned, within=1e-9, angle=1e-6)


def test_a_part_with_gravity_falls_when_let_go_and_comes_to_rest() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session, "cube")
        session.behave("cube", Gravity())
        hand.move_by((0.0, 0.0, 0.03))
        hand.release()
        session.run(2.0)
        assert abs(session.scene["cube"].pose.translation[2]) < 1e-4
        landed = [e for e in session.events if e.kind == "landed"]
        assert [e.parts for e in landed] == [("cube", "table")]
        with pytest.raises(TaskError, match="fixed"):
            session.behave("table", Gravity())
        with pytest.raises(BodyError, match="mass is 'heavy'"):
            session.behave("cube", Gravity(), mass="heavy")


def test_a_spring_hand_feels_the_weight() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session, "cube")
        hand.spring = SpringHand(
            pin.SE3.Identity(), stiffness=100.0, damping=2.0, angular_stiffness=2e-3, angular_damping=5e-5
        )
        with pytest.raises(TaskError, match="has no behaviours"):
            session.step()
        session.behave("cube", Gravity())
        hand.slack = 0.01
        hand.wait(1.5)
        weight = 7850.0 * 0.02**3 * 9.80665
        assert 0.02 - session.scene["cube"].pose.translation[2] == pytest.approx(weight / 100.0, rel=0.02)


def test_what_a_hand_carries_stays_in_place_on_it_when_the_hand_is_stopped() -> None:
    """Peg and cube in one hand, the cube pressed askew on the table: the peg beside it keeps its place to 1e-9."""
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=session.scene["peg"].pose.translation + np.array([0.0, 0.0, 0.01]))
        for wrong in (["peg"], ["cube", "cube"], ["cone"], ["table"]):
            with pytest.raises(VpframeError, match=r"once|no part|fixed"):
                hand.grab("peg", carry=wrong)
        hand.grab("peg", carry=["cube"])
        start = session.scene["peg"].pose.actInv(session.scene["cube"].pose)
        down = pin.SE3(pin.rpy.rpyToMatrix(0.05, 0.08, 0.3), np.array([0.06, 0.0, -0.02]))
        assert not hand.move_to(down, duration=0.5, required=False)
        assert any(e.kind == "blocked" for e in session.events)
        off = start.actInv(session.scene["peg"].pose.actInv(session.scene["cube"].pose))
        assert np.abs(pin.log6(off).vector).max() < 1e-9
        session.expect_no_clash()


def test_a_screw_is_put_into_its_clearance_hole() -> None:
    """M6 into Ø6.6, 0.3 mm of clearance all round: looser than a running fit, as ISO 273 has it."""
    hole = modelling.cylinder(0.0033, 0.02).translated(0.02, 0.02, 0.0)
    plate = modelling.box(0.04, 0.04, 0.02) - hole
    screw = modelling.cylinder(0.003, 0.02) + modelling.cylinder(0.005, 0.004).translated(z=0.02)
    made = modelling.scene({"plate": plate, "screw": (screw, pin.SE3(np.eye(3), np.array([0.03, 0.02, 0.04])))})
    made["plate"].fixed = True
    with Session(made) as session:
        assert holding(session, "screw").insert("plate")
        assert {c.kind for c in session.constraints} >= {"against", "concentric"}
        session.expect_freedom("screw", 1)
