"""Orientation of three and four points, against integer arithmetic."""

import numpy as np

from collision.numeric.predicates import FALLBACKS, orient2d, orient3d, workspace
from tests.collision import exact

FLAT = ((0.1, 0.3, 0.0), (0.2, 0.6, 0.0), (0.3, 0.9, 0.0), (0.0, 0.0, -1.0))
"""Collinear in decimals, not in binary, seen from a point below."""


def test_orientation_where_float64_fails() -> None:
    rng = np.random.default_rng(6)
    w = workspace()
    seen = {-1: 0, 0: 0, 1: 0}
    for _ in range(3_000):
        a, b, c = rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-6, 7)
        u, v = rng.random(2)
        d = a + u * (b - a) + v * (c - a)  # in the plane but for rounding
        sign = orient3d(tuple(a), tuple(b), tuple(c), tuple(d), w)
        assert sign == exact.orient3d(a, b, c, d)
        seen[sign] += 1
    assert min(seen[-1], seen[1]) > 500
    assert w[FALLBACKS] > 1_000
    assert orient2d(0.1, 0.3, 0.2, 0.6, 0.3, 0.9, w) == exact.orient3d(*np.array(FLAT)) != 0
