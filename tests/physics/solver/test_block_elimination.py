"""Block-sparse elimination against dense solves, and groups against union by hand."""

import numpy as np
import pytest

from physics.solver.block_elimination import SMALL, solve_blocks, structure


def system(n, pairs, seed):
    """A random system with blocks where `pairs` are: dense, and laid out by `structure`."""
    rng = np.random.default_rng(seed)
    order, start, later, slot, blocks = structure(n, pairs)
    values = np.zeros((blocks, 6, 6))
    dense = np.zeros((6 * n, 6 * n))
    for i, j in [*((i, i) for i in range(n)), *map(tuple, pairs), *((j, i) for i, j in pairs)]:
        if i < 0 or j < 0:
            continue
        block = rng.normal(size=(6, 6)) + (60.0 * np.eye(6) if i == j else 0.0)
        values[slot[i, j]] += block
        dense[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] += block
    return dense, (values, order, start, later, slot)


@pytest.mark.parametrize("seed", range(12))
def test_sparse_elimination_solves_what_the_dense_does(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 60))
    pairs = rng.integers(-1, n, size=(int(rng.integers(0, 4 * n)), 2))
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    dense, sparse = system(n, pairs, seed)
    right = rng.normal(size=(n, 6))
    expected = np.linalg.solve(dense, right.reshape(-1)).reshape(n, 6)
    assert np.abs(solve_blocks(*sparse, right) - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_row_of_bodies_fills_nothing_in():
    n = 10 * SMALL
    row = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    *_, blocks = structure(n, row)
    assert blocks == n + 2 * (n - 1)
