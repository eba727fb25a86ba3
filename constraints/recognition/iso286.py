"""Fits by ISO 286: the clearance between a hole and a shaft of a class, such as H7/g6, at a diameter.

The values are those of the standard's tables (ISO 286-1:2010, tables 1 to 5), which its formulas give only roughly.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache

from constraints.errors import ConstraintsError

STEPS = (3.0, 6.0, 10.0, 18.0, 30.0, 50.0, 80.0, 120.0, 180.0, 250.0, 315.0, 400.0, 500.0)
"""mm: the greatest size of each step of sizes"""
LEAST = 1.0
"""mm: the least size"""
GRADES = {
    5: (4, 5, 6, 8, 9, 11, 13, 15, 18, 20, 23, 25, 27),
    6: (6, 8, 9, 11, 13, 16, 19, 22, 25, 29, 32, 36, 40),
    7: (10, 12, 15, 18, 21, 25, 30, 35, 40, 46, 52, 57, 63),
    8: (14, 18, 22, 27, 33, 39, 46, 54, 63, 72, 81, 89, 97),
    9: (25, 30, 36, 43, 52, 62, 74, 87, 100, 115, 130, 140, 155),
    10: (40, 48, 58, 70, 84, 100, 120, 140, 160, 185, 210, 230, 250),
    11: (60, 75, 90, 110, 130, 160, 190, 220, 250, 290, 320, 360, 400),
    12: (100, 120, 150, 180, 210, 250, 300, 350, 400, 460, 520, 570, 630),
}
"""tolerance grade -> width of the tolerance (µm) by step of sizes"""
DEVIATIONS = {
    "d": (20, 30, 40, 50, 65, 80, 100, 120, 145, 170, 190, 210, 230),
    "e": (14, 20, 25, 32, 40, 50, 60, 72, 85, 100, 110, 125, 135),
    "f": (6, 10, 13, 16, 20, 25, 30, 36, 43, 50, 56, 62, 68),
    "g": (2, 4, 5, 6, 7, 9, 10, 12, 14, 15, 17, 18, 20),
    "h": (0,) * 13,
}
"""letter -> how far the upper limit of a shaft lies below the nominal size, and the lower one of a hole above, µm"""
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
    if not LEAST <= size <= STEPS[-1]:
        raise FitClassError(f"fit class {name} at Ø{size:.6g} mm: classes are defined for 1 … 500 mm", name)
    step = bisect_left(STEPS, size)
    hole, shaft = (GRADES[int(parts[group])][step] for group in (2, 4))
    lowest = DEVIATIONS[parts[1].lower()][step] + DEVIATIONS[parts[3]][step]
    return FitClass(name, 1e-6 * lowest, 1e-6 * (lowest + hole + shaft))
