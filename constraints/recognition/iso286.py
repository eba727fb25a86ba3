"""Fits by ISO 286: the clearance between a hole and a shaft of a class, such as H7/g6, at a diameter.

The standard's formulas (ISO 286-1:2010, annex B), rounded to whole micrometres as its tables are: the tolerance unit
i = 0.45·∛D + 0.001·D and the fundamental deviations, in µm, at the geometric mean D (mm) of the step of sizes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from constraints.errors import ConstraintsError

STEPS = (1.0, 3.0, 6.0, 10.0, 18.0, 30.0, 50.0, 80.0, 120.0, 180.0, 250.0, 315.0, 400.0, 500.0)
"""mm: bounds of the steps of sizes; the first is 1 … 3"""
GRADES = {5: 7.0, 6: 10.0, 7: 16.0, 8: 25.0, 9: 40.0, 10: 64.0, 11: 100.0, 12: 160.0}
"""tolerance grade -> tolerance units"""
DEVIATIONS = {"d": (16.0, 0.44), "e": (11.0, 0.41), "f": (5.5, 0.41), "g": (2.5, 0.34), "h": (0.0, 0.0)}
"""letter -> (factor, power) of D: how far a shaft's upper deviation lies below the line of zero, µm"""
CLASS = re.compile(r"([D-H])(\d+)/([d-h])(\d+)")


class FitClassError(ConstraintsError):
    """A fit class that is not known, or a diameter it is not made for. `given` is what was asked."""

    def __init__(self, message: str, given: str) -> None:
        super().__init__(message)
        self.given = given


@dataclass(frozen=True)
class FitClass:
    """Diametral clearance that a class allows, m."""

    name: str
    least: float
    most: float

    def allows(self, clearance: float, slack: float) -> bool:
        """Whether a diametral clearance (m) is in the class, or drawn at nominal size (none at all), within `slack`."""
        return self.least - slack <= clearance <= self.most + slack or abs(clearance) <= slack


@lru_cache(maxsize=4096)
def fit_class(name: str, diameter: float) -> FitClass:
    """The class `name` (a clearance fit of D … H and d … h, grades 5 … 12) at a nominal diameter (m).

    Raises FitClassError for other names, and for diameters outside 1 … 500 mm.
    """
    parts = CLASS.fullmatch(name)
    if parts is None or not {int(parts[2]), int(parts[4])} <= GRADES.keys():
        raise FitClassError(f"fit class {name!r} is not known; give a clearance fit such as H7/g6 (D-H, 5-12)", name)
    size = 1e3 * diameter
    if not STEPS[0] <= size <= STEPS[-1]:
        raise FitClassError(f"fit class {name} at Ø{size:.6g} mm: classes are defined for 1 … 500 mm", name)
    k = max(1, int(np.searchsorted(STEPS, size, side="left")))
    mean = float(np.sqrt(STEPS[k - 1] * STEPS[k]))
    unit = 0.45 * np.cbrt(mean) + 0.001 * mean
    hole, shaft = (round(unit * GRADES[int(parts[g])]) for g in (2, 4))
    lowest = sum(_deviation(letter, mean) for letter in (parts[1].lower(), parts[3]))
    return FitClass(name, 1e-6 * lowest, 1e-6 * (lowest + hole + shaft))


def _deviation(letter: str, mean: float) -> int:
    factor, power = DEVIATIONS[letter]
    return round(factor * mean**power)
