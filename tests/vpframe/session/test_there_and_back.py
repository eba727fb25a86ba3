"""What was travelled can be travelled back, in fits of hardly any clearance; what is solid is never passed."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vpframe import Part, Scene, Session, load
from vpframe.scene import modelling
from vpframe.scene.modelling import Solid, box, cylinder, extrude
from vpframe.session import rules

HERE = pin.SE3.Identity()


def tight_fit(kind: str, c: float) -> tuple[Solid, Solid]:
    """A housing and the part that leaves it along z, with a clearance of `c` m all around."""
    block = box(0.04, 0.04, 0.02).translated(-0.02, -0.02, -0.015)
    if kind == "pocket":
        room = box(0.02 + 2 * c, 0.02 + 2 * c, 0.03).translated(-0.01 - c, -0.01 - c, 0.0)
        return block - room, box(0.02, 0.02, 0.02).translated(-0.01, -0.01, 0.0)
    if kind == "bore":
        return block - cylinder(0.008 + c, 0.04).translated(0.0, 0.0, -0.03), cylinder(0.008, 0.03).translated(z=-0.01)
    if kind == "dovetail":
        tail = [(-0.006, -0.008), (0.006, -0.008), (0.010, 0.0), (-0.010, 0.0)]
        groove = [
            (-0.006 - 2 * c, -0.008 - c),
            (0.006 + 2 * c, -0.008 - c),
            (0.012 + 2 * c, 0.004),
            (-0.012 - 2 * c, 0.004),
        ]
        half = box(0.04, 0.02, 0.02).translated(-0.02, -0.02, -0.015)
        return half - extrude(groove, 0.04).translated(0.0, 0.0, -0.03), extrude(tail, 0.02).translated(z=-0.01)
    comb, key = block, box(0.04, 0.04, 0.005).translated(-0.02, -0.02, 0.005 + c)
    for x in (-0.013, 0.0, 0.013):
        comb = comb - box(0.006 + 2 * c, 0.05, 0.02).translated(x - 0.003 - c, -0.025, -0.005)
        key = key + box(0.006, 0.04, 0.011).translated(x - 0.003, -0.02, -0.005 + c)
    return comb, key


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
]
"""models of VPFRAME_DATA: file, the part that is held and what it carries, its way out and how far (m)"""


@cache
def real(name: str) -> Scene:
    return load(Path(os.environ["VPFRAME_DATA"]) / "step" / name)


@pytest.mark.slow
@pytest.mark.skipif("VPFRAME_DATA" not in os.environ, reason="VPFRAME_DATA names no folder of real models")
@pytest.mark.parametrize("rule", [rules.leave_all, rules.accept_all], ids=["leave all", "accept all"])
@pytest.mark.parametrize(
    ("model", "unit", "way", "far"), REAL, ids=[f"{m[:3]} {u[0].split('/')[-1]}" for m, u, *_ in REAL]
)
def test_a_real_part_goes_back_to_where_it_was(
    model: str, unit: tuple[str, ...], way: tuple[float, float, float], far: float, rule: rules.Rule
) -> None:
    scene = real(model)
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
