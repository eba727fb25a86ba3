"""Connected components of bodies."""

import numpy as np
import pytest

from physics.solver.islands import components


@pytest.mark.parametrize("seed", range(20))
def test_components_are_those_of_a_flood(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    pairs = rng.integers(-1, n, size=(int(rng.integers(0, n + 3)), 2))
    label, count = components(n, pairs)
    expected = np.full(n, -1)
    number = 0
    for i in range(n):
        if expected[i] >= 0:
            continue
        todo = [i]
        while todo:
            k = todo.pop()
            if expected[k] < 0:
                expected[k] = number
                todo += [int(b if a == k else a) for a, b in pairs if k in (a, b) and min(a, b) >= 0]
        number += 1
    assert count == number and label.tolist() == expected.tolist()
