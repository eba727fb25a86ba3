"""Signed distances: closed forms, slivers and folds."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from collision.query.signed_distance import signed_distances
from collision.solid import is_closed
from tests.collision.brute_force import box, with_slivers


def test_signed_distance_of_a_box_has_a_closed_form() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-1, 1, (500, 3)), rng.choice([-1.0, -0.75, 0.75, 1.0], (50, 3))])
    q = np.abs(points) - np.array([0.5, 0.4, 0.3])
    truth = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(signed_distances(box(1.0, 0.8, 0.6, 2), points), truth, atol=1e-14)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), off=st.sampled_from([0.0, 1e-16, 1e-13, 1e-9, 1e-6, 1e-5]))
def test_slivers_and_folds_do_not_turn_inside_out(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    mesh, rotation = with_slivers(rng, off)
    assert is_closed(mesh)
    at_random = rng.uniform(-0.8, 0.8, (300, 3))
    near = np.array([0.5, 0.4, 0.3]) * rng.choice([-1.0, 1.0], (300, 3))
    near[np.arange(300), rng.integers(3, size=300)] *= rng.uniform(-1.0, 1.0, 300)  # on an edge
    points = np.concatenate([at_random, near + rng.normal(size=(300, 3)) * 0.05])
    q = np.abs(points) - np.array([0.5, 0.4, 0.3])
    truth = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(signed_distances(mesh, points @ rotation.T), truth, atol=1e-12 + 2.0 * off)
