"""Small quadratic programs against every active set."""

from itertools import combinations

import numpy as np
import pytest

from constraints.motion.quadratic_program import UndecidedError, quadratic_program


def test_quadratic_program_against_every_active_set():
    """Random rows, some of them twice or opposed, some of them without a solution."""
    rng = np.random.default_rng(2)
    solved = 0
    for trial in range(120):
        n, m = int(rng.integers(1, 5)), int(rng.integers(1, 6))
        root = rng.normal(size=(n, n))
        h, g, c = root @ root.T + 0.1 * np.eye(n), rng.normal(size=n), rng.normal(size=(m, n))
        lower = -rng.uniform(0.0, 1.0, m) + (trial % 3 == 0)
        if trial % 2:
            twins = rng.integers(0, m, 3)
            c = np.vstack([c, c[twins], -c[:1]])
            lower = np.concatenate([lower, lower[twins] - [0.0, 0.0, 0.1], -lower[:1] - rng.choice([0.0, 0.5, -0.5])])
        m = len(lower)
        best = np.inf
        for size in range(min(n, m) + 1):
            for active in map(list, combinations(range(m), size)):
                k = np.block([[h, c[active].T], [c[active], np.zeros((size, size))]])
                try:
                    y = np.linalg.solve(k, np.concatenate([-g, lower[active]]))[:n]
                except np.linalg.LinAlgError:
                    continue
                if (c @ y >= lower - 1e-9).all():
                    best = min(best, 0.5 * y @ h @ y + g @ y)
        found = quadratic_program(h, g, c, lower)
        assert (found is None) == (best == np.inf)
        if found is None:
            continue
        solved += 1
        y, pressed = found
        assert (c @ y >= lower - 1e-9).all()
        assert 0.5 * y @ h @ y + g @ y == pytest.approx(best, abs=1e-8)
        assert all(abs(c[k] @ y - lower[k]) < 1e-8 for k in pressed)
        force, *_ = np.linalg.lstsq(c[pressed].T, h @ y + g, rcond=None)
        assert c[pressed].T @ force == pytest.approx(h @ y + g, abs=1e-8)
    assert 60 < solved < 120


def test_a_quadratic_program_without_solution_says_so():
    c = np.array([[1.0], [-1.0]])
    assert quadratic_program(np.eye(1), np.zeros(1), c, np.array([1.0, 1.0])) is None


def test_a_quadratic_program_that_runs_out_of_changes_is_not_taken_for_one_without_solution():
    n = 6
    c, lower = np.eye(n), np.ones(n)  # each row becomes active in turn
    y, pressed = quadratic_program(np.eye(n), np.zeros(n), c, lower)
    np.testing.assert_allclose(y, 1.0)
    assert len(pressed) == n
    with pytest.raises(UndecidedError, match="6 unknowns is undecided after 3 changes"):
        quadratic_program(np.eye(n), np.zeros(n), c, lower, most_changes=3)
