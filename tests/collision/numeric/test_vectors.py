"""Vectors as tuples in kernels, against numpy."""

import numpy as np
from numba import njit

from collision.numeric.vectors import along, cross, dot, greatest, norm, rotated, row, sub, unit


@njit
def of_all(x, rotation, out):
    a, b = row(x, 0), row(x, 1)
    vectors = (sub(a, b), cross(a, b), along(a, 2.5, b), unit(a), rotated(rotation, a), unit((0.0, 0.0, 0.0)))
    for i in range(6):
        out[i, 0], out[i, 1], out[i, 2] = vectors[i]
    out[6, 0], out[6, 1], out[6, 2] = dot(a, b), greatest(a), norm(a)


def test_vectors_are_those_of_numpy() -> None:
    rng, out = np.random.default_rng(0), np.empty((7, 3))
    for _ in range(200):
        a, b = x = rng.normal(size=(2, 3)) * 10.0 ** rng.integers(-6, 6, (2, 1))
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        of_all(x, rotation, out)
        known = [a - b, np.cross(a, b), a + 2.5 * b, a / np.linalg.norm(a), rotation @ a, np.zeros(3)]
        known.append(np.array([a @ b, np.abs(a).max(), np.linalg.norm(a)]))
        scale = np.linalg.norm(a) * np.linalg.norm(b) + np.linalg.norm(a) + np.linalg.norm(b)
        assert np.abs(out - known).max() < 1e-15 * 10 * scale + 1e-15
