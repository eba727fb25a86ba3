"""Distributions of the variables of a study, sampled through their quantile functions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from typing import Any

from vpframe.errors import VpframeError

Value = float | int | bool | str
"""of a variable: what JSON and CSV keep exactly"""
LARGEST = 1e150
"""greatest number of a study; the squares of larger ones overflow"""


def is_number(value: Any) -> bool:
    """Whether a value is a number that is finite and whose square is."""
    return isinstance(value, int | float) and abs(value) <= LARGEST


@dataclass(frozen=True)
class Distribution(ABC):
    """How one variable varies: a quantile function (inverse of the cumulative distribution)."""

    unit: str = field(default="", kw_only=True, repr=False)
    """of its values, as reports show it: "m" (in mm or µm by size), "rad", "N", …"""

    def given(self) -> dict[str, Any]:
        """Return the parameters by name, without the unit."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "unit"}

    @abstractmethod
    def quantile(self, u: float) -> Any:
        """Return the value that the variable stays below with probability `u`, 0 < u < 1."""

    @property
    @abstractmethod
    def nominal(self) -> Any:
        """Return the value of a variant without deviations."""

    def count(self, levels: int) -> int:
        """Return the number of values of `levels`."""
        return levels

    def levels(self, count: int) -> tuple[Any, ...]:
        """Return `count` values of equal probability, for a grid: the quantiles of (k + 1/2) / count."""
        return tuple(self.quantile((k + 0.5) / count) for k in range(count))

    def _check(self, holds: bool, rule: str) -> None:
        values = ", ".join(f"{name}={value!r}" for name, value in self.given().items())
        if not holds:
            raise VpframeError(f"{type(self).__name__}({values}): {rule}")

    def _check_numbers(self) -> None:
        self._check_unit()
        for name, value in self.given().items():
            number = is_number(value) and not isinstance(value, bool)
            self._check(number or value == getattr(type(self), name, None), f"{name} must be a finite number")

    def _check_unit(self) -> None:
        self._check(isinstance(self.unit, str), f"unit={self.unit!r} must be a text such as 'm' or 'rad'")


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal with a standard deviation; cut off at `low` and `high` if given (parts outside are sorted out)."""

    mean: float
    deviation: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check(self.deviation > 0.0, "deviation must be positive")
        below, above = self._tails()
        self._check(self.low < self.high and below < above, "no part of it lies between low and high")

    def _tails(self) -> tuple[float, float]:
        """Cumulative probabilities of `low` and `high`, of the mirrored distribution if both lie above the mean."""
        from scipy.special import ndtr

        a, b = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        return (float(ndtr(-b)), float(ndtr(-a))) if a > 0.0 else (float(ndtr(a)), float(ndtr(b)))

    def quantile(self, u: float) -> float:
        """Return the quantile, in the unit of the mean."""
        from scipy.special import ndtri

        below, above = self._tails()
        if self.low > self.mean:  # mirrored: the upper tail keeps its digits
            value = self.mean - self.deviation * float(ndtri(above - u * (above - below)))
        else:
            value = self.mean + self.deviation * float(ndtri(below + u * (above - below)))
        return min(max(value, self.low), self.high)

    @property
    def nominal(self) -> float:
        """Return the mean, or the limit that cuts it off."""
        return min(max(self.mean, self.low), self.high)


@dataclass(frozen=True)
class Uniform(Distribution):
    """All values from `low` to `high`, equally probable."""

    low: float
    high: float

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check(self.low < self.high, "low must be less than high")

    def quantile(self, u: float) -> float:
        """In the unit of its limits."""
        return min(self.low + u * (self.high - self.low), self.high)

    @property
    def nominal(self) -> float:
        """Return the middle."""
        return 0.5 * (self.low + self.high)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """Its logarithm is normal: `median` times a factor that is within exp(±`spread`) in two thirds of all cases."""

    median: float
    spread: float = field(metadata={"ratio": True})

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check(
            self.median > 0.0 and 0.0 < self.spread <= 10.0, "median and spread must be positive, spread at most 10"
        )

    def quantile(self, u: float) -> float:
        """Return the quantile, in the unit of the median."""
        from scipy.special import ndtri

        return self.median * math.exp(self.spread * float(ndtri(u)))

    @property
    def nominal(self) -> float:
        """Return the median."""
        return self.median


@dataclass(frozen=True)
class Triangular(Distribution):
    """From `low` to `high` with the greatest density at `peak`: for values that nobody has measured."""

    low: float
    peak: float
    high: float

    def __post_init__(self) -> None:
        self._check_numbers()
        order = self.low <= self.peak <= self.high and self.low < self.high
        self._check(order, "needs low <= peak <= high, low < high")

    def quantile(self, u: float) -> float:
        """In the unit of its limits."""
        width, rise = self.high - self.low, self.peak - self.low
        if u * width < rise:
            return self.low + math.sqrt(u * width * rise)
        return self.high - math.sqrt((1.0 - u) * width * (self.high - self.peak))

    @property
    def nominal(self) -> float:
        """Return the peak."""
        return self.peak


@dataclass(frozen=True, init=False)
class Choice(Distribution):
    """One of several values (numbers, texts, truth values), equally probable: `Choice("steel", "brass")`."""

    values: tuple[Value, ...]

    def __init__(self, *values: Value, unit: str = "") -> None:
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "unit", unit)
        self._check_unit()
        self._check(bool(values), "give at least one value")
        for value in values:
            self._check(
                isinstance(value, str) or is_number(value), f"{value!r} is no finite number, text or truth value"
            )
        self._check(len({(type(v), v) for v in values}) == len(values), "a value is there twice")

    def quantile(self, u: float) -> Value:
        """Return the value whose share of [0, 1) contains `u`."""
        return self.values[min(int(u * len(self.values)), len(self.values) - 1)]

    @property
    def nominal(self) -> Value:
        """Return the first value."""
        return self.values[0]

    def count(self, levels: int) -> int:
        """All."""
        return len(self.values)

    def levels(self, count: int) -> tuple[Value, ...]:
        """Return all values, for any `count`."""
        return self.values
