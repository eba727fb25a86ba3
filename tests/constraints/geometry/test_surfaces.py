"""Directions and products of the analytic surfaces."""

import numpy as np

from constraints.geometry.surfaces import Cylinder, cross, norm


def test_products_and_lengths_are_those_of_numpy_to_the_bit():
    rng = np.random.default_rng(0)
    for _ in range(2000):
        u, v = rng.normal(size=(2, 3)) * 10.0 ** rng.integers(-9, 9, (2, 1))
        assert cross(u, v).tolist() == np.cross(u, v).tolist()
        assert norm(u) == np.linalg.norm(u)


Z = [0.0, 0.0, 1.0]


def test_axes_of_any_length_are_directions() -> None:
    for length in (1e-320, 1e-200, 1e200):
        np.testing.assert_allclose(Cylinder([0, 0, 0], [0, 0, length], 0.01).axis, Z, atol=1e-12)
