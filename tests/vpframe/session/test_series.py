"""Series of measurements."""

import math

import numpy as np
import pytest

from vpframe.session import series
from vpframe.session.series import Series


def test_a_series_keeps_what_stands_for_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(series, "LIMIT", 8)
    least: Series[float] = Series(min)
    every: Series[int] = Series()
    values = np.random.default_rng(3).permutation(1000)
    for n, value in enumerate(values, 1):
        least.add(float(value))
        every.add(n - 1)
        stride = 1
        while math.ceil(n / stride) > 8:
            stride *= 2
        assert list(every) == list(range(0, n, stride))
        assert list(least) == [min(values[i : min(i + stride, n)]) for i in range(0, n, stride)]
