"""Rows of rotations: series near 0, closed form, and near the pole."""

import numpy as np
import pinocchio as pin
import pytest

from constraints.kinds import Constraint, Fixed, Parallel
from tests.constraints.kinds.properties import AB, PLANES, POINTS, differences


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 9e-5, 1.1e-4, 1e-3, 0.5, 2.0, 3.0])
@pytest.mark.parametrize(
    "constraint", [Parallel(AB, PLANES, sense=1), Parallel(AB, PLANES, sense=-1), Fixed(AB, POINTS)]
)
def test_rotation_rows_are_right_at_every_angle(constraint: Constraint, angle: float) -> None:
    """Series and closed form meet; near the pole, at 3 rad, too."""
    frames = constraint.compiled.element[0].reshape(2, 12)
    a, b = (np.column_stack([f[3:6], f[6:9], f[9:12]]) for f in frames)
    flip = np.diag([1.0, -1.0, -1.0]) if getattr(constraint, "sense", 1) == -1 else np.eye(3)
    turn = pin.exp3(angle * np.array([0.6, 0.8, 0.0]))
    pose = pin.SE3(a @ turn @ flip @ b.T, np.zeros(3))
    first, second = pin.SE3.Identity(), pose
    assert np.linalg.norm(constraint.residual(first, second)) == pytest.approx(angle, abs=1e-15, rel=1e-9)
    for exact, numeric in zip(
        constraint.jacobian(first, second), differences(constraint, first, second, 1e-4), strict=True
    ):
        assert np.abs(exact - numeric).max() < 2e-7 * max(1.0, np.abs(exact).max() ** 2)
