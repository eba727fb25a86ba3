"""`Offset`: planes held apart."""

from math import inf

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Plane
from constraints.kinds import Offset
from constraints.solve.solver import solve
from tests.constraints.kinds.properties import AB, PLANES, KindProperties


class TestOffset(KindProperties):
    cases = (
        ("offset", Offset(AB, PLANES, at=0.01), 3),
        ("offset with limits", Offset(AB, PLANES, at=(-inf, 0.01)), 4),
    )


def test_limits_are_inert_inside_and_hold_at_the_nearer_end_outside() -> None:
    slider = Offset(AB, (Plane([0, 0, 0], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])), at=(0.01, 0.05))
    for start, end in ((0.03, 0.03), (0.2, 0.05), (-0.4, 0.01)):
        pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, start]))
        solution = solve([slider], [pin.SE3.Identity(), pose], movable=[1])
        assert solution.poses[1].translation[2] == pytest.approx(end, abs=1e-12)
