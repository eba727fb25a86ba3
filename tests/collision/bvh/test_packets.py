"""Pairs of triangles of two packets that may be near: none is left out wrongly."""

import numpy as np
import pytest

from tests.collision.packets import distances_between, in_leaf_order, kept_and_bounds, packet, relative


@pytest.mark.parametrize("meeting", [False, True])
def test_pairs_of_triangles_that_are_left_out_are_farther_apart(meeting: bool) -> None:
    rng = np.random.default_rng(1)
    exact, left = np.empty((8, 8)), 0
    for _ in range(600):
        one, other = (packet(rng, 1e-2, 1e-1, slivers=k == 1) for k in range(2))
        pose, along = relative(rng, 0.05), rng.normal(size=3) * (rng.random() < 0.5)
        distances_between(in_leaf_order(one), in_leaf_order(other) @ pose.rotation.T + pose.translation, exact)
        distance = float(np.quantile(exact, rng.random()))
        kept, _ = kept_and_bounds(one, other, pose, distance * (1.0 + 1e-6), along, meeting)
        assert (exact[~kept] > distance).all()
        left += int((~kept).sum())
    assert left > 2000
