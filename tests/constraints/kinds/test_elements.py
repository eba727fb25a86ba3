"""Lines, points and circles."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.kinds import Concentric, Line
from constraints.solve.solver import solve

AB = (0, 1)


HOME = pin.SE3.Identity()


Z = np.array([0.0, 0.0, 1.0])


def turned(axis: list[float], angle: float, at: list[float] | np.ndarray = (0.0, 0.0, 0.0)) -> pin.SE3:
    return pin.SE3(pin.exp3(angle * np.asarray(axis, float) / np.linalg.norm(axis)), np.asarray(at, float))


def test_a_line_and_its_reverse_are_one_axis() -> None:
    line, back = Line([0, 0, 0], Z), Line([0, 0, 5], -Z)
    solution = solve([Concentric(AB, (line, back))], [HOME, turned([1, 0, 0], 0.2, [0.1, 0, 0])], [1])
    assert solution.converged and solution.poses[1].rotation[2, 2] == pytest.approx(1.0, abs=1e-12)
