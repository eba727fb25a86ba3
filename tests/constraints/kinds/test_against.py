"""`Against`: two planes face to face."""

from math import pi

import numpy as np
import pinocchio as pin
import pytest

from constraints.geometry.surfaces import Plane
from constraints.kinds import Against, Fixed
from constraints.solve.solver import solve
from tests.constraints.kinds.properties import AB, PLANES, POINTS, KindProperties


class TestAgainst(KindProperties):
    cases = (("against", Against(AB, PLANES), 3),)


def test_opposed_directions_still_know_which_way_to_turn() -> None:
    """Exactly upside down has no nearest way round; any half turn will do, but it must not stay there."""
    up, down = Plane([0, 0, 0], [0, 0, 1]), Plane([0, 0, 0], [0, 0, -1])
    flipped = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    for start in (flipped, pin.SE3(pin.exp3(np.array([0.0, pi - 1e-9, 0.0])), np.zeros(3))):
        solution = solve([Against(AB, (up, down))], [pin.SE3.Identity(), start], movable=[1])
        assert solution.converged
        assert solution.poses[1].rotation[2, 2] == pytest.approx(1.0, abs=1e-12)
    fixed = Fixed(AB, POINTS)
    solution = solve([fixed], [pin.SE3.Identity(), flipped], movable=[1])
    assert solution.converged
    assert solution.poses[1].isIdentity(1e-11)
