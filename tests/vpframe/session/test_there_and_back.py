"""What was travelled can be travelled back, in fits of hardly any clearance; what is solid is never passed."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from constraints.motion.motion import Motion
from tests.vpframe.session.fits import tight_fit
from vpframe import Hand, Part, Scene, Session, load
from vpframe.hands.paths import Track
from vpframe.scene import modelling
from vpframe.scene.modelling import box, cylinder, extrude
from vpframe.session import rules

HERE = pin.SE3.Identity()


@pytest.mark.parametrize("kind", ["pocket", "bore", "dovetail", "fingers"])
@settings(max_examples=4, deadline=None, derandomize=True)
@given(
    clearance=st.sampled_from([0.0, 1e-6, 1e-5, 3e-5, 1e-4]),
    rule=st.sampled_from([rules.leave_all, rules.accept_all]),
    carried=st.booleans(),
)
def test_a_part_goes_back_to_where_it_was(kind: str, clearance: float, rule: rules.Rule, carried: bool) -> None:
    housing, key = (modelling.shape(solid) for solid in tight_fit(kind, clearance))
    handle = modelling.shape(cylinder(0.002, 0.01))
    parts = [Part("housing", housing, HERE), Part("key", key, HERE)]
    parts.append(Part("handle", handle, pin.SE3(np.eye(3), np.array([0.0, -0.005, 0.025]))))
    parts[0].fixed = True
    with Session(Scene(parts), rule=rule) as session:
        hand = session.hand()
        hand.grab("key", carry="handle" if carried else ())
        if not carried:
            hand.release()
            hand.grab("handle")
            hand.move_by((0.2, 0.0, 0.0))
            hand.release()
            hand.grab("key")
        hand.slide("z", 0.03, speed=0.3)
        assert session.scene["key"].pose.translation[2] == pytest.approx(0.03, abs=1e-6)
        hand.move_to(HERE, duration=0.1)
        off = HERE.actInv(session.scene["key"].pose)
        assert np.linalg.norm(off.translation) + 0.02 * np.linalg.norm(pin.log3(off.rotation)) < 1e-6


NUTS = "l-bracket-assembly_1/nut-bolt-assembly_2/"
SLOPE = np.sqrt(0.5)
REAL = [
    ("as1-oc-214.stp", ("rod-assembly_1/nut_1",), (1, 0, 0), 0.02),
    ("as1-oc-214.stp", (f"{NUTS}bolt_1",), (0, 0, 1), 0.09),
    ("box_sides.STEP", ("box_base",), (0, 0, -1), 0.02),
    ("box_sides.STEP", ("side_short",), (-1, 0, 0), 0.02),
    ("v4_engine.step", ("Cylindre_1",), (-SLOPE, 0, SLOPE), 0.12),
    ("v4_engine.step", ("M6x20-Screw_1",), (SLOPE, 0, -SLOPE), 0.05),
    ("um2_head.step", ("1330-Z1P-B/1330 Fan Base 25x25", "1330-Z1P-B/1330 Fan Rotor 25x25"), (0, 0, -1), 0.05),
    ("um2_head.step", ("1320-B2P-B",), (0, 1, 0), 0.05),
    ("um2_head.step", ("1268-Z1P-A",), (0, 0, -1), 0.05),
    ("um2_head.step", ("1307-Z2P-B Hot End Holder Top",), (0, 0, 1), 0.036),
    ("um2_head.step", ("1313-Z1P-A_1/Fan Rotor 30x30",), (-SLOPE, SLOPE, 0), 0.05),
    ("um2_head.step", ("1321-B2P-B",), (0, 1, 0), 0.057),
    ("um2_head.step", ("1065-Z1P-A_1",), (0, 1, 0), 0.05),
]
"""models of VPFRAME_DATA: file, the part that is held and what it carries, its way out and how far (m)"""
OFF_FIRST = {
    "1321-B2P-B": ("1320", "1307", "1268", "1329", "Fan", "1301", "1065-Z1P-A_2"),
    "1065-Z1P-A_1": (
        "1320",
        "1307",
        "1268",
        "1329",
        "Fan",
        "1301",
        "1065-Z1P-A_2",
        "1321",
        "1308",
        "1306",
        "1310",
        "1322",
    ),
}
"""by part: those that have to be off before it, by parts of their names"""


@cache
def real(file: Path) -> Scene:
    return load(file)


@pytest.mark.slow
@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all], ids=["leave all", "accept all"])
@pytest.mark.parametrize(
    ("model", "unit", "way", "far"), REAL, ids=[f"{m[:3]} {u[0].split('/')[-1]}" for m, u, *_ in REAL]
)
def test_a_real_part_goes_back_to_where_it_was(
    real_models: Path,
    model: str,
    unit: tuple[str, ...],
    way: tuple[float, float, float],
    far: float,
    rule: rules.Rule,
) -> None:
    scene = real(real_models / "step" / model)
    off_first = OFF_FIRST.get(unit[0], ())
    scene = Scene([part for part in scene.parts if not any(name in part.name for name in off_first)])
    start = {part.name: pin.SE3(part.pose) for part in scene.parts}
    try:
        with Session(scene, rule=rule) as session:
            hand = session.hand()
            hand.grab(unit[0], carry=unit[1:])
            assert hand.move_by(far * np.array(way))
            assert hand.move_to(start[unit[0]])
            for name in unit:
                off = start[name].actInv(scene[name].pose)
                size = np.ptp(scene[name].mesh.vertices, axis=0).max()
                assert np.linalg.norm(off.translation) + size * np.linalg.norm(pin.log3(off.rotation)) < 1e-6
    finally:
        for name, pose in start.items():
            scene[name].pose = pose


@pytest.mark.parametrize("gap", [0.0, 5e-6, 1e-5, 1.5e-5, 5e-4])
def test_equal_faces_do_not_pass_through_each_other(gap: float) -> None:
    """Their sides are flush: no triangle of one goes into one of the other while they pass."""
    cube = modelling.shape(box(0.02, 0.02, 0.02))
    scene = Scene([Part("left", cube, HERE), Part("right", cube, pin.SE3(np.eye(3), np.array([0.02 + gap, 0.0, 0.0])))])
    scene["right"].fixed = True
    with Session(scene, rule=rules.leave_all) as session:
        hand = session.hand()
        hand.grab("left")
        outcome = hand.move_by((0.01, 0.0, 0.0), required=False)
        assert not outcome
        assert scene["left"].pose.translation[0] <= gap + 1e-6
        assert "right stands in its way (face" in outcome.reason


@pytest.mark.parametrize("way", [(0.05, 0.0, 0.0), (0.0, 0.04, 0.003)])
def test_a_ring_is_not_pulled_through_its_rod(way: tuple[float, float, float]) -> None:
    """Its facets overlap those of the rod as drawn; nor where the hand is ahead by more than both are thick."""
    ring = modelling.shape(cylinder(0.009, 0.006) - cylinder(0.005, 0.006))
    rod = modelling.shape(cylinder(0.005, 0.1).rotated((0.0, 0.0, 1.0), 0.1))
    scene = Scene([Part("ring", ring, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05]))), Part("rod", rod, HERE)])
    scene["rod"].fixed = True
    with Session(scene, rule=rules.leave_all) as session:
        hand = session.hand()
        hand.grab("ring")
        outcome = hand.move_by(way, required=False)
        assert not outcome and "rod stands in its way" in outcome.reason
        assert np.linalg.norm(scene["ring"].pose.translation[:2]) < 1e-3
        assert hand.move_to(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.12])))


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
def test_a_key_drawn_into_its_pocket_on_every_side_says_what_to_authorise(rule: rules.Rule) -> None:
    block = box(0.04, 0.03, 0.02) - box(0.02, 0.008, 0.02).translated(0.01, 0.011, 0.01)
    key = box(0.0204, 0.0084, 0.0102).translated(0.0098, 0.0108, 0.0098)
    for authorised in (False, True):
        scene = Scene([Part("block", modelling.shape(block), HERE), Part("key", modelling.shape(key), HERE)])
        with Session(scene, rule=rule) as session:
            if authorised:
                session.authorise("key", "block")
            hand = session.hand()
            hand.grab("key")
            outcome = hand.slide("up", 0.03, required=False)
            advice = re.search(r"key and block overlap by (.*) mm as drawn: if that is meant, (.*)$", outcome.reason)
            assert bool(outcome) is authorised and bool(advice) is not authorised, outcome.reason
            if advice:
                assert float(advice[1]) == pytest.approx(0.283, abs=1e-3)
                assert advice[2] == 'session.authorise("key", "block")'


@pytest.mark.parametrize("draft", [2.0, 10.0, 45.0])
def test_a_wedge_leaves_its_seat(draft: float) -> None:
    """Both its flanks are mated: neither way along one of them is open, and off both it is what the hand wants."""
    wide = 0.01 + 0.02 * np.tan(np.radians(draft))
    wedge = extrude([(-0.01, 0.0), (0.01, 0.0), (wide, 0.02), (-wide, 0.02)], 0.02)
    seat = extrude([(-0.06, -0.01), (0.06, -0.01), (0.06, 0.02), (-0.06, 0.02)], 0.02) - wedge
    scene = Scene([Part("seat", modelling.shape(seat), HERE), Part("wedge", modelling.shape(wedge), HERE)])
    scene["seat"].fixed = True
    with Session(scene) as session:
        hand = session.hand()
        hand.grab("wedge")
        assert len(session.constraints_of("wedge")) >= 2
        assert hand.move_by((0.0, 0.06, 0.0), required=False)
        assert hand.move_to(HERE)
        assert np.linalg.norm(scene["wedge"].pose.translation) < 1e-6


def back_along_the_trail(hand: Hand, session: Session, known: int) -> float:
    """Deviation (m, the turn counted at 20 mm) of a held part that went back along its trail from row `known` on."""
    held = str(hand.held)
    start, *out = [pose for _, pose in session.trail(held)[known - 1 :]]
    if out:
        poses = [*out[::-1], start]
        hand.follow(Track(session.dt * np.arange(len(poses) + 1.0), [out[-1], *poses]), required=False)
    off = start.actInv(session.scene[held].pose)
    return float(np.linalg.norm(off.translation) + 0.02 * np.linalg.norm(pin.log3(off.rotation)))


@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all])
@pytest.mark.parametrize("steps", [1, 2, 3, 20])
def test_a_pin_that_slid_over_a_ramp_goes_back_over_it(steps: int, rule: rules.Rule) -> None:
    """However few steps it took: its trail bends where the way did, and behind the ramp is a wall."""
    ramp = [(-0.01, 0.0), (0.004, 0.0), (0.010, 0.004), (0.010, 0.0), (0.04, 0.0), (0.04, -0.005), (-0.01, -0.005)]
    rail, roll = extrude(ramp, 0.01), cylinder(0.003, 0.01).translated(y=0.003)
    scene = Scene([Part("rail", modelling.shape(rail), HERE), Part("pin", modelling.shape(roll), HERE)])
    scene["rail"].fixed = True
    with Session(scene, rule=rule) as session:
        hand = session.hand()
        hand.grab("pin")
        known = len(session.trail("pin"))
        assert hand.move_by((0.024, 0.0, 0.0), duration=steps * session.dt)
        assert len({step for step, _ in session.trail("pin")[known:]}) <= steps + 1
        assert back_along_the_trail(hand, session, known) < 1e-6


@pytest.mark.parametrize("kind", ["pocket", "bore", "dovetail", "fingers"])
@settings(max_examples=3, deadline=None, derandomize=True)
@given(
    clearance=st.sampled_from([0.0, 1e-5, 1e-4, 4e-4]),
    rule=st.sampled_from([rules.leave_all, rules.accept_all, rules.accept_kinds("concentric")]),
    way=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda way: np.linalg.norm(way) > 0.1),
    far=st.sampled_from([0.001, 0.01, 0.04]),
    steps=st.sampled_from([1, 10]),
)
def test_a_part_that_was_pulled_any_way_goes_back_along_its_trail(
    kind: str, clearance: float, rule: rules.Rule, way: tuple[float, float, float], far: float, steps: int
) -> None:
    housing, key = (modelling.shape(solid) for solid in tight_fit(kind, clearance))
    scene = Scene([Part("housing", housing, HERE), Part("key", key, HERE)])
    scene["housing"].fixed = True
    with Session(scene, rule=rule) as session:
        hand = session.hand()
        hand.grab("key")
        known = len(session.trail("key"))
        hand.move_by(far * np.array(way) / np.linalg.norm(way), duration=steps * session.dt, required=False)
        assert back_along_the_trail(hand, session, known) < 1e-6


@pytest.mark.parametrize("kind", ["pocket", "fingers"])
@settings(max_examples=4, deadline=None, derandomize=True)
@given(
    clearance=st.sampled_from([0.0, 1e-6, 1e-5, 1e-4]),
    aside=st.tuples(*[st.floats(-0.5, 0.5)] * 2),
    steps=st.sampled_from([3, 40]),
    carried=st.booleans(),
)
@example(clearance=0.0, aside=(0.0022636, 0.0087975), steps=40, carried=False)
def test_a_part_that_is_pulled_askew_slides_out_along_the_walls_and_goes_back(
    kind: str, clearance: float, aside: tuple[float, float], steps: int, carried: bool
) -> None:
    """Also where the ends of what leaves and the rim that it leaves meet in edges alone, and however little askew."""
    housing, key = (modelling.shape(solid) for solid in tight_fit(kind, clearance))
    parts = [Part("housing", housing, HERE), Part("key", key, HERE)]
    if carried:
        handle = modelling.shape(cylinder(0.002, 0.01))
        parts.append(Part("handle", handle, pin.SE3(np.eye(3), np.array([0.0, -0.005, 0.025]))))
    parts[0].fixed = True
    with Session(Scene(parts), rule=rules.leave_all) as session:
        hand = session.hand()
        hand.grab("key", carry="handle" if carried else ())
        known = len(session.trail("key"))
        hand.move_by((0.04 * aside[0], 0.04 * aside[1], 0.04), duration=steps * session.dt, required=False)
        assert session.scene["key"].pose.translation[2] > {"pocket": 0.005, "fingers": 0.01}[kind]
        assert back_along_the_trail(hand, session, known) < 1e-6


def test_a_constraint_of_the_initial_assembly_is_in_force_again_when_its_part_comes_back() -> None:
    """Other constraints that are met on the way are not."""
    plate = box(0.08, 0.04, 0.02) - cylinder(0.005, 0.02).translated(0.02, 0.02)
    plate = plate - cylinder(0.005, 0.02).translated(0.06, 0.02)
    pin_ = cylinder(0.005, 0.03).translated(0.02, 0.02)
    scene = Scene([Part("plate", modelling.shape(plate), HERE), Part("pin", modelling.shape(pin_), HERE)])
    scene["plate"].fixed = True

    with Session(scene, rule=rules.accept_standing) as session:
        hand = session.hand()
        hand.grab("pin")
        for shift, kinds in (((0, 0, 0), ["concentric"]), ((0.04, 0, 0), []), ((0, 0, 0), ["concentric"])):
            hand.move_to(pin.SE3(np.eye(3), np.array([*session.scene["pin"].pose.translation[:2], 0.04])))
            assert not session.constraints_of("pin")
            hand.move_to(pin.SE3(np.eye(3), np.array([shift[0], shift[1], 0.04])))
            hand.move_to(pin.SE3(np.eye(3), np.array(shift, dtype=float)), required=False)
            assert [mate.kind for mate in session.constraints_of("pin")] == kinds


@pytest.mark.parametrize("deep", [2e-4, 4.5e-4])
def test_a_cap_that_is_drawn_inside_its_block_comes_back_there(deep: float) -> None:
    """Its floor is set on the block's top on the way: the mate that is accepted there lets go."""
    block = box(0.02, 0.02, 0.03)
    cap = box(0.03, 0.03, 0.02).translated(-0.005, -0.005, 0.015)
    cap = cap - box(0.022, 0.022, 0.02).translated(-0.001, -0.001, 0.01 - deep)
    scene = Scene([Part("block", modelling.shape(block), HERE), Part("cap", modelling.shape(cap), HERE)])
    scene["block"].fixed = True
    with Session(scene) as session:
        hand = session.hand()
        hand.grab("cap")
        assert hand.move_by((0.0, 0.0, 0.04))
        assert hand.move_to(pin.SE3(np.eye(3), np.array([0.0, 0.0, deep])))
        assert [mate.kind for mate in session.constraints_of("cap")] == ["against"]
        assert hand.move_to(HERE).reason == "arrived"
        assert np.linalg.norm(scene["cap"].pose.translation) < 1e-12


def test_an_arrival_short_of_the_target_says_how_far_and_why() -> None:
    cube = modelling.shape(box(0.02, 0.02, 0.02))
    scene = Scene([Part("cube", cube, HERE), Part("wall", cube, pin.SE3(np.eye(3), np.array([0.03, 0.0, 0.0])))])
    scene["wall"].fixed = True
    with Session(scene, rule=rules.leave_all) as session:
        hand = session.hand()
        hand.grab("cube")
        near = hand.move_by((0.0104, 0.0, 0.0))
        assert near and re.fullmatch(r"arrived 0\.4\d mm from its target: wall stands in its way .*", near.reason)
        assert hand.move_by((-0.01, 0.0, 0.0)).reason == "arrived"


def test_a_part_that_is_stuck_is_moved_twice_a_step_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """However far ahead of it the hand is, and in the first step of the next motion."""
    cube = modelling.shape(box(0.02, 0.02, 0.02))
    scene = Scene([Part("cube", cube, HERE), Part("wall", cube, pin.SE3(np.eye(3), np.array([0.021, 0.0, 0.0])))])
    scene["wall"].fixed = True
    steps: list[float] = []
    whole = Motion.step
    monkeypatch.setattr(Motion, "step", lambda *given, **named: (steps.append(0.0), whole(*given, **named))[1])
    with Session(scene, rule=rules.leave_all) as session:
        hand = session.hand()
        hand.grab("cube")
        hand.move_by((0.002, 0.0, 0.0), required=False)
        before, begun = len(steps), session.step_count
        assert not hand.move_by((0.2, 0.0, 0.0), required=False)
        assert len(steps) - before <= 2 * (session.step_count - begun)
        before = len(steps)
        hand.move_by((-1e-5, 0.0, 0.0), duration=session.dt)
        assert len(steps) - before == 1


SHROUD = "1329-B2P-C"
"""of the print head: its floor is drawn 0.45 mm inside the nozzle's block"""


@pytest.mark.slow
@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all], ids=["leave all", "accept all"])
def test_the_shroud_of_the_print_head_goes_out_and_back(real_models: Path, rule: rules.Rule) -> None:
    """Its floor meets the block 0.45 mm short of where it is drawn: a mate there does not keep it out."""
    scene = real(real_models / "step" / "um2_head.step")
    start = pin.SE3(scene[SHROUD].pose)
    with Session(scene, rule=rule) as session:
        mark = session.mark()
        hand = session.hand()
        hand.grab(SHROUD)
        assert hand.move_by((0.0, -0.1, 0.0))
        assert hand.move_to(start)
        off = start.actInv(scene[SHROUD].pose)
        assert np.linalg.norm(off.translation) < 1e-6 and np.linalg.norm(pin.log3(off.rotation)) < 1e-6
        session.undo(mark)
