"""The point of a triangle nearest to a point, against rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from collision.numeric.point_triangle import closest_on_triangle


@njit
def closest(p: tuple, a: tuple, b: tuple, c: tuple) -> tuple:
    return closest_on_triangle(p, a, b, c)


def exact_distance(p: np.ndarray, corners: np.ndarray) -> float:
    """m, by way of the triangle's plane where the foot is inside, else the nearest of its three edges; exact till the
    last root."""
    p, (a, b, c) = [Fraction(x) for x in p], [[Fraction(x) for x in corner] for corner in corners]
    n = cross(minus(b, a), minus(c, a))
    edges = ((a, b), (b, c), (c, a))
    if any(n) and all(dot(cross(n, minus(f, e)), minus(p, e)) >= 0 for e, f in edges):
        return float(dot(n, minus(p, a)) ** 2 / dot(n, n)) ** 0.5
    return float(min(squared_from_segment(p, e, f) for e, f in edges)) ** 0.5


def squared_from_segment(p: list[Fraction], e: list[Fraction], f: list[Fraction]) -> Fraction:
    u, length = minus(f, e), dot(minus(f, e), minus(f, e))
    s = min(max(dot(minus(p, e), u) / length, Fraction(0)), Fraction(1)) if length else Fraction(0)
    w = [x - y - s * z for x, y, z in zip(p, e, u, strict=True)]
    return dot(w, w)


def minus(x: list[Fraction], y: list[Fraction]) -> list[Fraction]:
    return [u - v for u, v in zip(x, y, strict=True)]


def dot(x: list[Fraction], y: list[Fraction]) -> Fraction:
    return sum((u * v for u, v in zip(x, y, strict=True)), Fraction(0))


def cross(x: list[Fraction], y: list[Fraction]) -> list[Fraction]:
    return [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]


@pytest.mark.parametrize("height", [1.0, 1e-3, 1e-7, 1e-12, 1e-16, 0.0])
@pytest.mark.parametrize("away", [1e-9, 1e-2, 1.0, 1e6])
def test_nearest_point_of_a_triangle_of_any_shape(height: float, away: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        flat = np.array([[0.0, 0.0], [1.0, 0.0], [rng.uniform(-0.5, 1.5), height * rng.choice([-1.0, 1.0])]])
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        corners = np.roll(flat @ frame[:2] + rng.normal(size=3), rng.integers(3), axis=0)
        weights = rng.choice([0.0, 0.5, 1.0], 3) + 1e-3 * rng.normal(size=3)
        on = (weights / weights.sum() if abs(weights.sum()) > 0.1 else np.full(3, 1 / 3)) @ corners
        p = on + away * rng.normal(size=3)
        q, feature = closest(tuple(p), *(tuple(corner) for corner in corners))
        size = np.abs(corners).max() + np.abs(p).max()
        rounding = 1e-14 * size if feature < 6 else 1e-14 * size + 1e-15 * size / height  # of a sliver's normal
        assert float(np.linalg.norm(p - q)) == pytest.approx(exact_distance(p, corners), abs=rounding)
        if feature < 3:
            e, f = corners[feature], corners[(feature + 1) % 3]
            assert np.linalg.norm(np.cross(f - e, q - e)) <= 1e-14 * size
        elif feature < 6:
            assert (q == corners[feature - 3]).all()
