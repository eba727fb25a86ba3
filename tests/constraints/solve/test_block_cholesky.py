"""Block Cholesky against numpy, and orders of elimination small enough to see."""

import numpy as np
import pytest

from constraints.solve.block_cholesky import eliminate, factor, substitute


class TestElimination:
    @pytest.mark.parametrize("seed", range(8))
    def test_block_cholesky_agrees_with_a_dense_solution(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        edges = {(int(a), int(b)) for a, b in rng.integers(0, n, (2 * n, 2)) if a != b}
        e = eliminate(n, edges)
        blocks = np.zeros((n + len(e.row), 6, 6))
        dense = np.zeros((n, 6, n, 6))
        for (a, b), size in [((i, i), 40.0) for i in range(n)] + [(pair, 1.0) for pair in sorted(edges)]:
            block = size * np.eye(6) + rng.normal(size=(6, 6)) / 6
            i, j = int(e.position[a]), int(e.position[b])
            if i == j:
                block = block + block.T
                blocks[i] += block
                dense[i, :, i] += block
            else:
                row, column = max(i, j), min(i, j)
                blocks[e.block_of[row, column]] += block
                dense[row, :, column] += block
                dense[column, :, row] += block.T
        right = rng.normal(size=(n, 6))
        x = right.copy()
        assert factor(blocks, e.column, e.row, e.update, e.update_start)
        substitute(blocks, e.column, e.row, x)
        assert x.ravel() == pytest.approx(np.linalg.solve(dense.reshape(6 * n, 6 * n), right.ravel()), abs=1e-12)

    def test_an_indefinite_matrix_is_refused(self) -> None:
        e = eliminate(1, set())
        assert not factor(-np.eye(6)[None], e.column, e.row, e.update, e.update_start)

    def test_a_star_and_a_chain_fill_nothing(self) -> None:
        star = eliminate(50, {(0, k) for k in range(1, 50)})
        chain = eliminate(50, {(k, k + 1) for k in range(49)})
        assert len(star.row) == len(chain.row) == 49
