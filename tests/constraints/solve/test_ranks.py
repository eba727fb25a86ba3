"""Rank-revealing factorisations, each against numpy."""

import numpy as np
import pytest

from constraints.solve.ranks import least_norm, null_basis, pivoted_qr, row_space


class TestRanks:
    @pytest.mark.parametrize("seed", range(20))
    def test_pivoted_qr_finds_rank_and_null_space_as_svd_does(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m, n = int(rng.integers(1, 40)), int(rng.integers(1, 40))
        rank = int(rng.integers(1, min(m, n) + 1))
        matrix = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        matrix *= 10.0 ** rng.integers(-6, 7)
        order, upper, found, margin = pivoted_qr(np.ascontiguousarray(matrix.T), 1e-9)
        assert found == rank == np.linalg.matrix_rank(matrix, tol=1e-9 * np.linalg.norm(matrix, 2))
        assert 1e-9 < margin <= 1.0
        null = null_basis(order, upper, found)
        assert null.shape == (n - rank, n)
        assert np.linalg.matrix_rank(null) == n - rank
        assert np.abs(matrix @ null.T).max(initial=0.0) < 1e-8 * np.linalg.norm(matrix, 2) * np.abs(null).max(initial=1)

    def test_no_rows_but_zeros_leave_everything_free(self) -> None:
        order, upper, rank, margin = pivoted_qr(np.zeros((6, 3)), 1e-9)
        assert rank == 0 and margin == 1.0
        assert np.linalg.matrix_rank(null_basis(order, upper, rank)) == 6

    @pytest.mark.parametrize("seed", range(20))
    def test_least_norm_is_that_of_numpy(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        m, n = int(rng.integers(1, 30)), int(rng.integers(1, 30))
        rank = int(rng.integers(1, min(m, n) + 1))
        matrix = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        rhs = rng.normal(size=m)
        x = least_norm(np.ascontiguousarray(matrix.T), rhs, 1e-10)
        assert x == pytest.approx(np.linalg.lstsq(matrix, rhs, rcond=1e-10)[0], rel=1e-6, abs=1e-8)

    @pytest.mark.parametrize("seed", range(20))
    def test_row_space_keeps_what_is_new_and_explains_the_rest(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        n, rank = 12, int(rng.integers(1, 10))
        rows = rng.normal(size=(20, rank)) @ rng.normal(size=(rank, n))
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        place, weights = row_space(rows, 1e-9)
        kept = rows[place >= 0]
        assert len(kept) == rank
        for i in range(20):
            assert (place[i] >= 0) == (
                np.linalg.matrix_rank(rows[: i + 1], 1e-8) > np.linalg.matrix_rank(rows[:i], 1e-8)
            )
        assert weights[place < 0] @ kept == pytest.approx(rows[place < 0], abs=1e-8)
