"""Figures of a study against closed forms."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vpframe.studies import statistics
from vpframe.studies.distributions import Uniform
from vpframe.studies.variants import sequence_of, sobol_sample


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


REGIONS: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray], float]] = {
    "half a line": (1, lambda u: u[:, 0] < 0.3712, 0.3712),
    "triangle": (2, lambda u: u.sum(axis=1) < 1.553, 1.0 - 0.447**2 / 2),
    "corner": (2, lambda u: u.sum(axis=1) < 1.9, 0.995),
    "ball": (3, lambda u: ((u - 0.5) ** 2).sum(axis=1) < 0.16, 4.0 / 3.0 * np.pi * 0.4**3),
    "simplex": (5, lambda u: u.sum(axis=1) < 2.5, 0.5),
    "by two of six": (6, lambda u: u[:, 1] * u[:, 4] < 0.5, 0.5 * (1.0 + np.log(2.0))),
}
"""variables, what succeeds, its true rate"""


@pytest.mark.parametrize("count", [pytest.param(100, marks=pytest.mark.slow), 400])
@pytest.mark.parametrize("name", REGIONS)
def test_the_interval_of_sobol_sequences_covers_as_often_as_it_says(name: str, count: int) -> None:
    """200 studies by their seeds: Wilson's interval, of independent samples, covers always and is far too wide."""
    dimensions, succeeds, rate = REGIONS[name]
    variables = {f"x{k}": Uniform(0.0, 1.0) for k in range(dimensions)}
    covered, width, wilson = 0, 0.0, 0.0
    for seed in range(200):
        taken = sobol_sample(variables, count, seed)
        good = succeeds(np.array([list(v.values()) for v in taken]))
        low, high = statistics.replicated(good, [sequence_of(v.index) for v in taken])
        assert 0.0 <= low <= good.mean() <= high <= 1.0
        covered += low <= rate <= high
        width += high - low
        first, last = statistics.wilson(int(good.sum()), count)
        wilson += last - first
    assert 0.90 <= covered / 200 <= 0.995
    if name not in ("corner", "simplex"):  # few failures, or many variables: as if independent
        assert width < 0.9 * wilson if count == 100 else width < 0.8 * wilson


def test_the_interval_of_replicates_is_wilsons_where_samples_are_independent() -> None:
    rng = np.random.default_rng(2)
    for rate in (0.5, 0.9, 0.98):
        hits = rng.random((400, 800)) < rate
        found = [statistics.replicated(row, np.arange(800) % 16) for row in hits]
        assert 0.925 < np.mean([low <= rate <= high for low, high in found]) < 0.975
        wilson = [statistics.wilson(int(row.sum()), 800) for row in hits]
        assert np.mean(np.diff(found)) == pytest.approx(np.mean(np.diff(wilson)), rel=0.15)


@pytest.mark.parametrize("good", [[True] * 40, [False] * 40, [True] * 20, [True, False] * 5, []])
def test_replicates_that_tell_nothing_leave_wilsons_interval(good: list[bool]) -> None:
    found = statistics.replicated(good, [k % 16 for k in range(len(good))])
    assert found == statistics.wilson(sum(good), len(good))
    if len(good) > 10:
        assert found[0] < found[1], "no rate is certain"


def test_equal_replicates_are_not_taken_for_certain() -> None:
    low, high = statistics.replicated([k % 2 == 0 for k in range(64)], [k // 4 for k in range(64)])
    assert low < 0.5 - 2.5 / 64 and high > 0.5 + 2.5 / 64


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
