"""Statistics of many outcomes: rate with its interval, percentiles, classes, importance of variables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
PERCENTS = (0, 1, 5, 25, 50, 75, 95, 99, 100)
LEAST_COUNT = 1.5
"""standard deviation of a count of successes that did not vary between sequences"""
_MOST_CLASSES = 30


def wilson(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval that covers the true rate with this confidence; (0, 1) without trials.

    Source: Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927).
    """
    from scipy.special import ndtri

    return _score(successes / trials, trials, float(ndtri(0.5 + 0.5 * confidence))) if trials else (0.0, 1.0)


def replicated(
    good: Sequence[bool] | NDArray[np.bool_], replicate: ArrayLike, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Return the interval that covers the true rate, of samples of several independent randomisations.

    Points of one quasi-random sequence depend on each other: `wilson` takes their mean for less certain than it is. The
    spread of the rates of independent sequences tells its variance; the interval is Wilson's of as many independent
    samples as would have that variance, with Student's quantile. Where no rate can be distinguished (too few samples,
    all good or all bad) it is `wilson`; it is never narrower than 3 samples to each side, as of a count that may vary.

    good: (n,) successes. replicate: (n,) number of the sequence of each sample.

    Source: Owen, "Practical Quasi-Monte Carlo Integration" (2023), section 17.4; Korn, Graubard, "Confidence intervals
    for proportions with small expected number of positive counts", Survey Methodology 24 (1998), effective sample size.
    """
    from scipy.special import stdtrit

    hits = np.asarray(good, dtype=np.float64)
    n, of = len(hits), np.asarray(replicate, dtype=np.int64)
    sizes = np.bincount(of) if n else np.empty(0)
    r, p = int((sizes > 0).sum()), float(hits.mean()) if n else 0.0
    if r < 2 or n < 2 * r or p in (0.0, 1.0):
        return wilson(int(hits.sum()), n, confidence)
    off = np.bincount(of, hits) - p * sizes
    variance = max(r / (r - 1) * float(off @ off) / n**2, (LEAST_COUNT / n) ** 2)
    return _score(p, p * (1.0 - p) / variance, float(stdtrit(r - 1, 0.5 + 0.5 * confidence)))


def _score(p: float, n: float, z: float) -> tuple[float, float]:
    """Return Wilson's interval of a rate p of n samples, for a quantile z."""
    middle, spread = p + z * z / (2.0 * n), z * math.sqrt(p * (1.0 - p) / n + (z / (2.0 * n)) ** 2)
    low, high = ((middle + side * spread) / (1.0 + z * z / n) for side in (-1.0, 1.0))
    return max(0.0, min(low, p)), min(1.0, max(high, p))


def percentiles(values: ArrayLike) -> dict[str, float]:
    """Return percentiles by percent ("0" … "100"); empty without values."""
    data = np.asarray(values, dtype=np.float64)
    return {str(p): float(x) for p, x in zip(PERCENTS, np.percentile(data, PERCENTS), strict=True)} if len(data) else {}


@dataclass(frozen=True)
class Classes:
    """Counts of values between edges."""

    edges: tuple[float, ...]
    """(n + 1,) edges of n classes"""
    counts: tuple[int, ...]


def classes(values: ArrayLike) -> Classes:
    """Return a histogram of 2 n^(1/3) classes of equal width (Rice's rule), at most 30; one class for equal values."""
    data = np.asarray(values, dtype=np.float64)
    if not len(data):
        return Classes((0.0, 0.0), (0,))
    if np.ptp(data) <= max(1e-12 * np.abs(data).max(), np.finfo(np.float64).tiny):
        return Classes((float(data.min()), float(data.max())), (len(data),))
    counts, edges = np.histogram(data, min(math.ceil(2.0 * len(data) ** (1.0 / 3.0)), _MOST_CLASSES))
    return Classes(tuple(edges.tolist()), tuple(counts.tolist()))


def rank_correlation(x: ArrayLike, y: ArrayLike) -> float | None:
    """Return Spearman's coefficient of x and y, -1 … 1; None if one of them does not vary."""
    from scipy.stats import spearmanr

    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(a) < 3 or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return None
    return float(spearmanr(a, b).statistic)


def groups(x: Sequence[float | str]) -> NDArray[np.int64]:
    """Return the class of each value, (n,): one per different value if these are few, else n^(1/3) of equal counts."""
    _, place, counts = np.unique(np.asarray(x), return_inverse=True, return_counts=True)
    wanted = int(np.clip(round(len(place) ** (1.0 / 3.0)), 2, _MOST_CLASSES))
    if len(counts) <= wanted or isinstance(x[0], str):
        return place.astype(np.int64)
    before = np.cumsum(counts) - counts  # equal values stay together
    return ((before + 0.5 * counts) * wanted / len(place)).astype(np.int64)[place]


def first_order(x: Sequence[float | str], y: ArrayLike) -> float | None:
    """Return the first-order Sobol' index of y for x from data: the share of y's variance that x alone explains, 0 … 1.

    It is the variance of the means of y over classes of x, less what chance would give (Kelley's epsilon squared).
    None where y does not vary or there are too few values.

    Source: Plischke, Borgonovo, Smith, "Global sensitivity measures from given data", EJOR 226 (2013), section 3;
    Kelley, "An unbiased correlation ratio measure", PNAS 21 (1935).
    """
    values = np.asarray(y, dtype=np.float64)
    if len(values) < 4:
        return None
    of = groups(x)
    counts = np.bincount(of)
    used = counts > 0
    k, n = int(used.sum()), len(values)
    centred = values - values.mean()
    total = float(centred @ centred)
    if total <= (1e-12 * np.abs(values).max()) ** 2 * n or k >= n:
        return None
    means = np.bincount(of, centred)[used] / counts[used]
    within = total - float(counts[used] @ means**2)
    return float(min(max(1.0 - (within / (n - k)) / (total / (n - 1)), 0.0), 1.0))
