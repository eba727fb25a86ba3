"""Straight and turning pushes."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from tests.vpframe.planning.measured import angle_of, deepest_beyond, is_clear
from vpframe.planning.assembly import Assembly

LONG = 600.0


PRESSED = 1e-11


def turned(removal):
    """rad: all turns along the way."""
    knots = removal.way.knots
    return sum(float(np.linalg.norm(pin.log3(a.rotation.T @ b.rotation))) for a, b in pairwise(knots))


def test_a_nut_turns_by_the_engaged_length_over_the_pitch_and_is_not_pulled():
    scene = cases.m16(engaged=0.012)
    found = vp.planning.removal(scene, "nut", budget=LONG)
    assert found.verdict == "removable" and found.way.motion == "screw"
    assert found.way.turns == pytest.approx(0.012 / 0.002)
    assert turned(found) >= 2.0 * np.pi * 6.0
    pulled = vp.planning.removal(scene, "nut", budget=LONG, motion="straight")
    assert pulled.verdict == "not found" and pulled.blockers == ("stud",)
    assert all("thread" in t.why for t in pulled.tried if t.way.endswith("(0, 0, 1)"))


@pytest.mark.parametrize(
    ("scene", "part", "least"),
    [
        pytest.param(cases.c_clip, "clip", cases.clip_angle(), marks=pytest.mark.slow),
        (cases.bayonet, "plug", cases.BAYONET),
        (cases.l_hook, "hook", np.radians(20.0)),
    ],
)
def test_what_has_to_be_turned_is_turned_by_the_analytic_angle(scene, part, least):
    scene = scene()
    straight = vp.planning.removal(scene, part, motion="straight", budget=LONG)
    assert straight.verdict == "not found"
    found = vp.planning.removal(scene, part, budget=LONG)
    assert found.verdict == "removable" and found.way.motion == "slide"
    assert angle_of(found) >= least
    assert deepest_beyond(scene, found) <= PRESSED
    assert is_clear(scene, found)


def test_a_dovetail_leaves_one_direction_and_its_opposite():
    scene = cases.dovetail()
    assembly = Assembly(scene)
    free = []
    for d in [np.array(d, float) for d in ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1])]:
        if assembly.straight(1, 0, d) is None:
            free.append(tuple(d))
    assert free == [(0, 1, 0), (0, -1, 0)]
    found = vp.planning.removal(scene, "slide", budget=LONG)
    assert found.verdict == "removable" and abs(found.way.direction[1]) == 1.0
    assert deepest_beyond(scene, found) <= PRESSED
