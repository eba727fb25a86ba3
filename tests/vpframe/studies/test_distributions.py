"""Quantile functions against scipy's distributions, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from vpframe.errors import VpframeError
from vpframe.studies import Choice, Distribution, LogNormal, Normal, Triangular, Uniform

PAIRS = [
    (Normal(8.02e-3, 5e-6), stats.norm(8.02e-3, 5e-6)),
    (Normal(0.0, 1.0, -0.5, 2.0), stats.truncnorm(-0.5, 2.0)),
    (Normal(0.0, 1.0, 4.0, 9.0), stats.truncnorm(4.0, 9.0)),
    (Normal(0.0, 1.0, -math.inf, -5.0), stats.truncnorm(-math.inf, -5.0)),
    (Uniform(-2.0, 3.0), stats.uniform(-2.0, 5.0)),
    (LogNormal(0.3, 0.2), stats.lognorm(0.2, scale=0.3)),
    (Triangular(1.0, 2.0, 5.0), stats.triang(0.25, 1.0, 4.0)),
    (Triangular(1.0, 1.0, 2.0), stats.triang(0.0, 1.0, 1.0)),
]


@pytest.mark.parametrize(("ours", "theirs"), PAIRS, ids=lambda x: str(x)[:40])
def test_quantiles_are_those_of_the_distribution(ours: Distribution, theirs) -> None:
    for u in (1e-9, 0.01, 0.3, 0.5, 0.77, 0.99, 1.0 - 1e-9):
        value = ours.quantile(u)
        assert theirs.cdf(value) == pytest.approx(u, rel=1e-6, abs=1e-9)


@given(st.sampled_from([ours for ours, _ in PAIRS]), st.floats(1e-12, 1.0 - 1e-12), st.floats(1e-12, 1.0 - 1e-12))
def test_quantiles_rise_and_stay_within_limits(ours: Distribution, u: float, w: float) -> None:
    low, high = sorted((u, w))
    assert ours.quantile(low) <= ours.quantile(high)
    limits = getattr(ours, "low", -math.inf), getattr(ours, "high", math.inf)
    assert limits[0] <= ours.quantile(u) <= limits[1]


def test_a_choice_takes_each_value_alike() -> None:
    choice = Choice("a", 2, 0.5, True)
    taken = [choice.quantile(u) for u in (np.arange(4000) + 0.5) / 4000]
    assert [taken.count(value) for value in ("a", 2, 0.5, True)] == [1000] * 4
    assert choice.quantile(1.0 - 2**-54) is True
    assert choice.levels(2) == ("a", 2, 0.5, True)


def test_levels_have_equal_probability() -> None:
    assert Uniform(0.0, 1.0).levels(4) == (0.125, 0.375, 0.625, 0.875)
    assert Normal(3.0, 1.0).levels(1) == (3.0,)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Normal(0.0, 0.0), "deviation must be positive"),
        (lambda: Normal(0.0, -1.0), "deviation must be positive"),
        (lambda: Normal("a", 1.0), "mean must be a finite number"),
        (lambda: Normal(math.nan, 1.0), "mean must be a finite number"),
        (lambda: Normal(0.0, 1.0, 2.0, 1.0), "no part of it lies between"),
        (lambda: Normal(0.0, 1e-9, 1.0, 2.0), "no part of it lies between"),
        (lambda: Uniform(1.0, 1.0), "low must be less than high"),
        (lambda: Uniform(0.0, math.inf), "high must be a finite number"),
        (lambda: Uniform(0.0, 10**400), "high must be a finite number"),
        (lambda: LogNormal(-1.0, 0.1), "must be positive"),
        (lambda: LogNormal(1.0, 1000.0), "spread at most 10"),
        (lambda: Choice(10**400), "is no finite number, text or truth value"),
        (lambda: Triangular(0.0, 2.0, 1.0), "low <= peak <= high"),
        (lambda: Choice(), "at least one value"),
        (lambda: Choice("a", "a"), "is there twice"),
        (lambda: Choice([1]), "is no finite number, text or truth value"),
        (lambda: Choice(math.nan), "is no finite number, text or truth value"),
    ],
)
def test_what_is_no_distribution_is_refused(make, words: str) -> None:
    with pytest.raises(VpframeError, match=words):
        make()
