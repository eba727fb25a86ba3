"""Quaternions and the exponential map, against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from physics.model.rotations import across, exponential, matrix, multiply


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.9e-4, 2.1e-4, 0.5, 3.0, np.pi, 6.0])
def test_quaternions_are_the_rotations_of_pinocchio(angle: float) -> None:
    rng = np.random.default_rng(1)
    out = np.empty((3, 3))
    for _ in range(20):
        axis, other = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        q, p = np.array(exponential(*(angle * axis))), np.array(exponential(*other))
        matrix(3.0 * q, out)
        assert np.abs(out - pin.exp3(angle * axis)).max() < 1e-15 * 20
        matrix(np.array(multiply(q, p)), out)
        assert np.abs(out - pin.exp3(angle * axis) @ pin.exp3(other)).max() < 1e-15 * 20
        assert across(axis) @ axis == pytest.approx(0.0, abs=1e-15) and np.linalg.norm(across(axis)) > 0.8
