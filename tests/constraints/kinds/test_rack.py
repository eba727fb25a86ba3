"""`RackAndPinion`: a rack and its pinion."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Cylinder
from constraints.kinds import Line, RackAndPinion
from tests.constraints.kinds.properties import AB, CYLINDERS, LINES, KindProperties


class TestRackAndPinion(KindProperties):
    cases = (
        ("rack", RackAndPinion(AB, (CYLINDERS[0], LINES[1]), radius=0.03, teeth=3), 5),
        ("rack reversed", RackAndPinion(AB, (CYLINDERS[0], LINES[1]), radius=0.03, teeth=1, sense=-1), 5),
    )


def test_a_pinion_moves_its_rack_by_the_arc() -> None:
    rack0 = pin.SE3(np.eye(3), np.array([0, -0.02, 0]))
    pair = (Cylinder([0, 0, 0], [0, 0, 1], 0.02), Line([0, 0, 0], [1, 0, 0]))
    rack = RackAndPinion(AB, pair, radius=0.02, teeth=25).engaged(pin.SE3.Identity(), rack0)
    for turn in (0.01, 0.5, 3.0):
        moved = pin.SE3(np.eye(3), np.array([0.02 * turn, -0.02, 0]))
        assert rack.residual(pin.SE3(pin.exp3(np.array([0, 0, turn])), np.zeros(3)), moved)[0] == pytest.approx(
            0, abs=1e-12
        )
