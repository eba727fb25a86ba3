"""Fits by ISO 286: the clearance or interference between a hole and a shaft of a class, such as H7/g6, at a diameter.

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
FINE_STEPS = (
    3.0, 6.0, 10.0, 14.0, 18.0, 24.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0, 120.0, 140.0, 160.0, 180.0, 200.0, 225.0,
    250.0, 280.0, 315.0, 355.0, 400.0, 450.0, 500.0,
)  # fmt: skip
"""mm: greatest size of each step, for the deviations r, s and u"""
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
"""letter -> µm by which the upper limit of a shaft lies below the nominal size, and the lower limit of a hole above"""
ABOVE = {
    "k": (0, 1, 1, 1, 2, 2, 2, 3, 3, 4, 4, 4, 5),
    "m": (2, 4, 6, 7, 8, 9, 11, 13, 15, 17, 20, 21, 23),
    "n": (4, 8, 10, 12, 15, 17, 20, 23, 27, 31, 34, 37, 40),
    "p": (6, 12, 15, 18, 22, 26, 32, 37, 43, 50, 56, 62, 68),
    "r": (10, 15, 19, 23, 23, 28, 28, 34, 34, 41, 43, 51, 54, 63, 65, 68, 77, 80, 84, 94, 98, 108, 114, 126, 132),
    "s": (14, 19, 23, 28, 28, 35, 35, 43, 43, 53, 59, 71, 79, 92, 100, 108, 122, 130, 140, 158, 170, 190, 208, 232,
          252),
    "u": (18, 23, 28, 33, 33, 41, 48, 60, 70, 87, 102, 124, 144, 170, 190, 210, 236, 258, 284, 315, 350, 390, 435, 490,
          540),
}  # fmt: skip
"""letter -> µm by which the lower limit of a shaft lies above the nominal size; by `FINE_STEPS` for r, s and u"""
K_GRADES = range(4, 8)
"""grades in which k lies above the nominal size; in the others its lower limit is the nominal size"""
CLASS = re.compile(r"([D-H])(\d+)/([d-hkmnprsu])(\d+)")


class FitClassError(ConstraintsError):
    """A fit class that is not known, or a diameter outside its range. `given` is the argument."""

    def __init__(self, message: str, given: str) -> None:
        super().__init__(message)
        self.given = given


@dataclass(frozen=True)
class FitClass:
    """Diametral clearance that a class allows, m; negative for interference."""

    name: str
    least: float
    most: float

    def allows(self, clearance: float, slack: float) -> bool:
        """Whether a diametral clearance (m) is in the class, or 0 (drawn at nominal size), within `slack` (m)."""
        return self.least - slack <= clearance <= self.most + slack or abs(clearance) <= slack


@lru_cache(maxsize=4096)
def fit_class(name: str, diameter: float) -> FitClass:
    """Return a class (a hole of D … H, a shaft of d … h, k, m, n, p, r, s or u, grades 5 … 12) at a diameter (m).

    Raises FitClassError for other names, and for diameters outside 1 … 500 mm.
    """
    parts = CLASS.fullmatch(name)
    if parts is None or not {int(parts[2]), int(parts[4])} <= GRADES.keys():
        known = "a hole D-H and a shaft d-h, k, m, n, p, r, s or u, grades 5-12, such as H7/g6 or H7/s6"
        raise FitClassError(f"fit class {name!r} is not known; give {known}", name)
    size = 1e3 * diameter
    if not LEAST <= size <= STEPS[-1]:
        raise FitClassError(f"fit class {name} at Ø{size:.6g} mm: classes are defined for 1 … 500 mm", name)
    step = bisect_left(STEPS, size)
    hole, shaft = (GRADES[int(parts[group])][step] for group in (2, 4))
    lowest = DEVIATIONS[parts[1].lower()][step] - _highest(parts[3], int(parts[4]), size)
    return FitClass(name, 1e-6 * lowest, 1e-6 * (lowest + hole + shaft))


def _highest(letter: str, grade: int, size: float) -> int:
    """Upper limit of a shaft of `size` mm above the nominal size, µm."""
    step = bisect_left(STEPS, size)
    if letter in DEVIATIONS:
        return -DEVIATIONS[letter][step]
    above = ABOVE[letter][step if len(ABOVE[letter]) == len(STEPS) else bisect_left(FINE_STEPS, size)]
    return GRADES[grade][step] + (0 if letter == "k" and grade not in K_GRADES else above)


@lru_cache(maxsize=4096)
def greatest_interference(shaft: str, diameter: float) -> float:
    """Return the greatest diametral interference (m, at least 0) of a shaft class, such as s7, in a hole H.

    Below 1 mm and above 500 mm the nearest size in the tables is used. Raises FitClassError for unknown classes.
    """
    size = min(max(diameter, 1e-3 * LEAST), 1e-3 * STEPS[-1])
    try:
        return max(0.0, -fit_class(f"H7/{shaft}", size).least)
    except FitClassError:
        known = "d-h, k, m, n, p, r, s or u, grade 5-12, such as s7 or u8"
        raise FitClassError(f"shaft class {shaft!r} is not known; give {known}", shaft) from None
