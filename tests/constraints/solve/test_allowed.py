"""Solutions of a few linear equations against numpy's pseudo-inverse and singular values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from constraints.solve.allowed import SMALL, allowed


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    m=st.integers(1, 40),
    n=st.sampled_from([6, 12, 18, SMALL, SMALL + 6]),
    rank=st.integers(0, 12),
    scale=st.sampled_from([1e-6, 1.0, 1e3]),
)
def test_origin_and_basis_are_those_of_the_pseudo_inverse(seed: int, m: int, n: int, rank: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    rank = min(rank, m, n)
    jacobian = scale * rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    jacobian += 1e-13 * np.abs(jacobian).max(initial=0.0) * rng.normal(size=(m, n))
    residual = rng.normal(size=m)
    origin, basis = allowed(residual, jacobian)
    s = np.linalg.svd(jacobian, compute_uv=False)
    independent = int((s > 1e-7 * s[0]).sum()) if s[0] > 0.0 else 0
    assert basis.shape == (n, n - independent)
    assert np.allclose(basis.T @ basis, np.eye(n - independent), atol=1e-12)
    assert np.abs(jacobian @ basis).max(initial=0.0) <= 1e-7 * s[0]
    expected = -np.linalg.pinv(jacobian, rcond=1e-7) @ residual
    assert origin == pytest.approx(expected, rel=1e-6, abs=1e-8 * (np.abs(expected).max() + 1e-300))


def test_equations_that_say_nothing_leave_everything_free() -> None:
    for m in (0, 3):
        origin, basis = allowed(np.ones(m), np.zeros((m, 6)))
        assert not origin.any() and np.array_equal(basis, np.eye(6))


@pytest.mark.parametrize("tiny", [1e-100, 1e-140, 1e-160, 1e-300])
def test_entries_of_which_squares_vanish_are_nothing(tiny: float) -> None:
    jacobian = np.zeros((5, 6))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[2, 3] = 1.0
    jacobian[2:, 2] = jacobian[:, 5] = tiny
    origin, basis = allowed(np.arange(5.0), jacobian)
    assert origin == pytest.approx([0.0, -1.0, 0.0, -2.0, 0.0, 0.0], abs=1e-12) and basis.shape == (6, 3)
