"""Where an insertion ends: seated on whatever part, at a depth, or where nothing more is gained."""

import numpy as np
import pytest

from tests.vpframe.bench_scene import at
from vpframe.errors import TaskError
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session

RULES = pytest.mark.parametrize("rule", [rules.accept_all, rules.leave_all], ids=["accept all", "leave all"])


def assembly(length: float, thickness: float = 0.01, **more: Part) -> Scene:
    """A plain pin Ø10 over a bored plate, whose top is at z = 0."""
    plate = m.box(0.06, 0.06, thickness).translated(-0.03, -0.03, -thickness)
    bored = m.shape(plate - m.cylinder(0.0051, thickness).translated(0, 0, -thickness), 5e-6, 0.1)
    pin = m.shape(m.cylinder(0.005, length), 5e-6, 0.1)
    parts = [Part("plate", bored, at(0, 0, 0), fixed=True), Part("pin", pin, at(0.05, 0.0, 0.06))]
    return Scene([*parts, *more.values()])


def inserted(session: Session, part: str = "pin", **options):
    hand = session.hand(at=session.scene[part].pose.translation)
    hand.grab(part)
    return hand.insert("plate", **options)


@RULES
@pytest.mark.parametrize(("length", "bottom"), [(0.03, -0.03), (0.006, -0.01)])
def test_a_plain_pin_stays_in_its_plate(rule, length: float, bottom: float) -> None:
    with Session(assembly(length), rule=rule) as session:
        outcome = inserted(session)
        assert outcome and "greatest overlap" in outcome.reason
        np.testing.assert_allclose(session.scene["pin"].pose.translation, [0, 0, bottom], atol=5e-5)


@RULES
def test_a_pin_seats_on_a_third_part_under_its_plate(rule) -> None:
    floor = Part("floor", m.shape(m.box(0.1, 0.1, 0.01)), at(-0.05, -0.05, -0.025), fixed=True)
    with Session(assembly(0.03, floor=floor), rule=rule) as session:
        outcome = inserted(session)
        assert outcome and outcome.reason.startswith("seated on floor")
        assert session.scene["pin"].pose.translation[2] == pytest.approx(-0.015, abs=1e-4)


@RULES
def test_depth_is_of_the_tip_from_the_mouth(rule) -> None:
    with Session(assembly(0.03), rule=rule) as session:
        assert inserted(session, depth=0.004)
        assert session.scene["pin"].pose.translation[2] == pytest.approx(-0.004, abs=2e-5)
    floor = Part("floor", m.shape(m.box(0.1, 0.1, 0.01)), at(-0.05, -0.05, -0.02), fixed=True)
    with Session(assembly(0.03, floor=floor), rule=rule) as session, pytest.raises(TaskError, match="short of"):
        inserted(session, depth=0.02)


def test_what_stops_in_front_of_the_bore_is_no_seat() -> None:
    lid = Part("lid", m.shape(m.box(0.06, 0.06, 0.001)), at(-0.03, -0.03, 0.0005), fixed=True)
    with Session(assembly(0.03, lid=lid), rule=rules.leave_all) as session:
        with pytest.raises(TaskError, match=r"pin stopped after 1.5 mm: lid stands in its way"):
            inserted(session)
        assert session.scene["pin"].pose.translation[2] > 0.0


def test_a_subassembly_goes_into_a_subassembly() -> None:
    parts = assembly(0.03)
    ring = Part("tool/ring", m.shape(m.cylinder(0.012, 0.005) - m.cylinder(0.005, 0.005)), at(0.05, 0.0, 0.08))
    plate, pin = (
        Part(f"{sub}/{p.name}", p.shape, p.pose) for sub, p in zip(("base", "tool"), parts.parts, strict=True)
    )
    plate.fixed = True
    with Session(Scene([plate, pin, ring])) as session:
        hand = session.hand(at=(0.05, 0.0, 0.09))
        hand.grab("tool")
        assert {hand.held, *hand.carried} == {"tool/ring", "tool/pin"}
        assert hand.insert("base")
        np.testing.assert_allclose(session.scene["tool/pin"].pose.translation, [0, 0, -0.02], atol=1e-4)
        session.expect_constraint("against", "tool", "base")
        session.expect_constraint("concentric", "tool", "base")


@pytest.mark.parametrize("depth", [0.0, -0.01, float("nan"), "deep", 30.0])
def test_a_depth_that_is_none_is_refused(depth) -> None:
    with Session(assembly(0.03)) as session, pytest.raises(TaskError, match="insert: depth="):
        inserted(session, depth=depth)
