"""`Screw`: a thread in its nut."""

from math import pi

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds import Fixed, Parallel, Screw
from constraints.solve.solver import solve
from tests.constraints.kinds.properties import AB, CYLINDERS, KindProperties


class TestScrew(KindProperties):
    cases = (
        ("screw", Screw(AB, CYLINDERS, pitch=0.05), 1),
        ("screw left-hand", Screw(AB, CYLINDERS, pitch=-0.04, sense=-1), 1),
    )


def test_a_screw_advances_its_pitch_in_a_turn_and_a_left_hand_one_backs_out() -> None:
    thread = Cylinder([0, 0, 0], [0, 0, 1], 0.005)
    for pitch in (2e-3, -1e-3):
        screw = Screw(AB, (thread, thread), pitch=pitch)
        pose = pin.SE3.Identity()
        for _ in range(24):  # two turns, by the hand turning it 30° and the thread pulling it along
            turned = pose * pin.SE3(pin.exp3(np.array([0, 0, pi / 6])), np.zeros(3))
            hold = Fixed.between((2, 1), pin.SE3.Identity(), turned)
            turn_only = Parallel((2, 1), (Plane([0, 0, 0], hold.relative.rotation[:, 0]), Plane([0, 0, 0], [1, 0, 0])))
            poses = [pin.SE3.Identity(), turned, pin.SE3.Identity()]
            pose = solve([screw, turn_only], poses, movable=[1]).poses[1]
        assert pose.translation == pytest.approx([0, 0, 2 * pitch], abs=1e-11)
