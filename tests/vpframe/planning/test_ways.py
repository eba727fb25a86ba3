"""The legs of a way: told in words, and together the motion that was swept."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vpframe as vp
from tests.vpframe.planning import cases
from vpframe.planning.assembly import translation, turned
from vpframe.planning.document import document, table
from vpframe.planning.ways import AXES, RemovalPath

LONG = 600.0


@pytest.mark.parametrize(
    ("scene", "part", "words"),
    [
        (cases.bayonet, "plug", ("turn 8", "° about (0, 0, -1), then slide", "mm along (0, 0, 1)")),
        (cases.l_hook, "hook", ("slide 8 mm along (1, 0, 0), then turn", "° about (0, 1, 0)")),
        (cases.c_clip, "clip", ("turn", "° about (0, 0, 1), then slide", "mm along")),
    ],
)
def test_every_turn_of_a_planned_way_is_told(scene, part, words):
    scene = scene()
    plan = vp.planning.disassembly(scene, part, budget=LONG)
    (line,) = (line for line in table(plan).splitlines() if line.startswith("    1  "))
    at = 0
    for word in words:
        assert word in line[at:]
        at = line.index(word, at)
    (step,) = document(plan, 0, 1e-6)["steps"]
    turns = [np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)) for a, b in pairwise(plan.steps[0].way.knots)]
    assert step["turns"] == pytest.approx(sum(turns) / (2.0 * np.pi)) and step["turns"] > 0.1
    assert sum(leg["angle"] for leg in step["legs"]) == pytest.approx(sum(turns))


def test_a_screw_and_a_pull_are_told_as_before():
    nut, *_, plate = vp.planning.disassembly(cases.bolted_plate(), budget=LONG).steps
    assert nut.way.text == "unscrewed 8 turns, along (0, 0, -1)"
    assert plate.way.text == "straight along (0, 0, 1)"
    assert [leg.angle > 0.0 for leg in nut.way.legs] == [True, False]  # 32 quarters and more as one leg
    assert nut.way.legs[0].length / nut.way.legs[0].angle == pytest.approx(0.00125 / (2.0 * np.pi))


def of_leg(leg):
    """The displacement that a leg tells, for a leg about its own axis, or of the middle."""
    turn = turned(leg.point, leg.axis, leg.angle) if leg.angle else pin.SE3.Identity()
    return translation(leg.shift) * turn


twist = st.tuples(*[st.floats(-1.0, 1.0)] * 6)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["slide", "turn", "both"]), twist), min_size=1, max_size=5),
       st.floats(0.01, 10.0))  # fmt: skip
def test_the_legs_together_are_the_way(rows, radius):
    knots = [pin.SE3.Identity()]
    for kind, x in rows:
        x = np.array(x)
        x[:3] *= kind != "turn"
        x[3:] *= kind != "slide"
        knots.append(pin.exp6(x) * knots[-1])
    way = RemovalPath("free", AXES[0], tuple(knots), middle=np.array([0.3, -0.2, 0.1]), radius=radius)
    at = pin.SE3.Identity()
    for leg in way.legs:
        at = of_leg(leg) * at
    assert np.allclose(at.homogeneous, knots[-1].homogeneous, atol=1e-5)  # legs are joined within 1e-6


def test_legs_that_continue_each_other_are_one_and_long_ways_are_told_in_short():
    origin, axis = np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    knots = [turned(origin, axis, 0.3 * k, 0.001 * k) for k in range(5)]
    knots += [translation(0.02 * k * axis) * knots[4] for k in range(1, 4)]
    way = RemovalPath("slide", AXES[0], tuple(knots))
    assert [round(leg.angle, 9) for leg in way.legs] == [1.2, 0.0]
    assert way.text == "slide 4 mm along (0, 0, 1), turning 68.8° about (0, 0, 1), then slide 60 mm along (0, 0, 1)"
    zigzag = [translation(np.array([0.01 * (k % 2), 0.01 * k, 0.0])) for k in range(12)]
    text = RemovalPath("free", AXES[0], tuple(zigzag)).text
    assert text.count("then") == 6 and "then 5 more legs, then slide" in text
