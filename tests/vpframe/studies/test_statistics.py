"""Figures of a study against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vpframe.studies import statistics


@given(st.integers(1, 5000), st.data())
def test_wilson_is_the_formula_of_1927(n: int, data) -> None:
    k = data.draw(st.integers(0, n))
    z, p = 1.959963984540054, k / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = statistics.wilson(k, n)
    assert low == pytest.approx(middle - half, abs=1e-12)
    assert high == pytest.approx(middle + half, abs=1e-12)
    assert 0.0 <= low <= p <= high <= 1.0


def test_wilson_without_trials_knows_nothing() -> None:
    assert statistics.wilson(0, 0) == (0.0, 1.0)


def test_wilson_covers_the_true_rate_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    hits = rng.binomial(200, 0.97, 4000)
    covered = np.mean([low <= 0.97 <= high for low, high in (statistics.wilson(int(k), 200) for k in hits)])
    assert 0.93 < covered < 0.98


def ishigami(x: np.ndarray) -> np.ndarray:
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_first_order_indices_of_the_ishigami_function() -> None:
    x = np.random.default_rng(3).uniform(-np.pi, np.pi, (20000, 3))
    found = [statistics.first_order(column.tolist(), ishigami(x)) for column in x.T]
    # Ishigami and Homma (1990), a = 7, b = 0.1: the first varies not monotonously, the third only with the first
    assert found == pytest.approx([0.3139, 0.4424, 0.0], abs=0.02)
    assert statistics.rank_correlation(x[:, 1], ishigami(x)) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.9])
def test_first_order_index_of_a_sum(share: float) -> None:
    rng = np.random.default_rng(5)
    x, rest = rng.normal(size=(2, 5000))
    y = np.sqrt(share) * x + np.sqrt(1.0 - share) * rest
    assert statistics.first_order(x.tolist(), y) == pytest.approx(share, abs=0.04)
    assert statistics.rank_correlation(x, y) == pytest.approx(6 / np.pi * np.arcsin(np.sqrt(share) / 2), abs=0.04)


def test_first_order_index_of_a_choice() -> None:
    rng = np.random.default_rng(7)
    x = rng.choice(["a", "b", "c"], 6000)
    y = np.where(x == "b", 1.0, 0.0) + rng.normal(0.0, 1.0, 6000)
    variance = (1 / 3) * (2 / 3)
    assert statistics.first_order(x.tolist(), y) == pytest.approx(variance / (variance + 1.0), abs=0.03)


def test_what_does_not_vary_explains_nothing() -> None:
    assert statistics.first_order([1.0] * 50, np.arange(50.0)) == 0.0
    assert statistics.first_order(np.arange(50.0).tolist(), [0.1] * 50) is None
    assert statistics.first_order([1.0, 2.0], [1.0, 2.0]) is None
    assert statistics.rank_correlation([1.0] * 9, range(9)) is None


@given(arrays(np.float64, st.integers(1, 300), elements=st.floats(-1e6, 1e6)))
@example(np.array([5e-324, 0.0]))
def test_classes_count_every_value_once(values) -> None:
    made = statistics.classes(values)
    assert sum(made.counts) == len(values)
    assert len(made.edges) == len(made.counts) + 1 <= 31
    assert made.edges[0] <= values.min() and values.max() <= made.edges[-1] + 1e-9 * abs(made.edges[-1])


def test_percentiles() -> None:
    found = statistics.percentiles(np.arange(101.0))
    assert found == {"0": 0, "1": 1, "5": 5, "25": 25, "50": 50, "75": 75, "95": 95, "99": 99, "100": 100}
    assert statistics.percentiles([]) == {}
