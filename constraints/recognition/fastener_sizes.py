"""Dimensions of standard fasteners, as their standards state them: `fasteners.csv`, one row a size.

| form | diameter | a | b | c |
| --- | --- | --- | --- | --- |
| cylinder, dome, countersunk, raised countersunk | thread | head diameter | head height | socket |
| flange | thread | collar diameter | head height | |
| hexagon, hexagon flange | thread | across flats | head height | flange diameter |
| shoulder | thread | head diameter | head height | shoulder diameter |
| set screw | thread | socket | | |
| hexagon nut, square nut, flange nut, cap nut | thread | across flats | height | flange or dome diameter |
| insert | thread | outside diameter | length | least outside diameter |
| washer, tooth washer | of the screw | bore | outside diameter | thickness |
| bearing | bore | outside diameter | width | |
| circlip | shaft or bore | thickness | free diameter | |
| key | width | height | | |
| seal | bore | section diameter | | |
"""

from __future__ import annotations

import csv
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from constraints.geometry.metric_threads import PITCHES

MM = 1e-3
ROOT = 1.3
"""pitches by which a screw's core or a nut's bore is at most drawn narrower than nominal"""
WIDER = 0.03
"""1: by which they are at most drawn wider, over the diameter"""
EXACT = 0.015
"""1: within it a drawn diameter is the nominal one, or that of the thread's root"""
CLOSE = 0.05
"""1: greatest relative error of one dimension at which a size of a standard is taken"""
HEIGHT = 0.12
"""1: that of a height: standards leave it wider limits, and domes are drawn as spheres"""
SECOND = (3.5, 7, 14, 18, 22, 27, 33, 39, 45, 52, 60)
"""mm: second choices of ISO 262"""
SMALL = (1.0, 1.2, 1.4, 1.6, 1.7, 1.8, 2.0, 2.2, 2.3, 2.5, 2.6)
"""mm: nominal diameters below M3, those of screws for plastics and watches among them"""
NOMINAL = tuple(dict.fromkeys((*SMALL, *PITCHES)))
"""mm"""


@dataclass(frozen=True)
class StandardSize:
    """A size of a standard; lengths in m."""

    standard: str
    form: str
    name: str
    diameter: float
    pitch: float
    a: float
    b: float
    c: float


@lru_cache(maxsize=1)
def sizes() -> dict[str, tuple[StandardSize, ...]]:
    """Return all sizes, by form."""
    found: dict[str, list[StandardSize]] = {}
    with (Path(__file__).parent / "fasteners.csv").open(encoding="utf-8") as file:
        for standard, form, name, *numbers in list(csv.reader(file))[1:]:
            d, pitch, a, b, c = (MM * float(x) if x else 0.0 for x in numbers)
            found.setdefault(form, []).append(StandardSize(standard, form, name, d, pitch, a, b, c))
    return {form: tuple(rows) for form, rows in found.items()}


def drawn_thread_error(drawn: float, nominal: float, pitch: float) -> float:
    """Return how badly a cylinder of diameter `drawn` (m) stands for a thread: 0 at its nominal or root diameter, 1
    where it cannot be one; between them it is less likely the farther it is from both."""
    if not nominal - ROOT * pitch <= drawn <= (1.0 + WIDER) * nominal:
        return 1.0
    apart = min(abs(drawn - nominal), abs(drawn - nominal + 1.0825 * pitch)) / nominal
    return 0.0 if apart <= 1e-3 else apart


def best_size(
    forms: Collection[str], drawn: float, a: float, b: float, c: float = 0.0, named: float = 0.0
) -> tuple[StandardSize, float] | None:
    """Return the size of a standard that a head, nut or insert matches best, and its greatest relative error.

    drawn: m: diameter of shank or bore. a, b, c: m, as in the table; 0 where unknown. named: m: nominal diameter that
    the part's name states, 0 for none.
    """
    other = any(abs(d * MM - drawn) <= EXACT * drawn for d in NOMINAL)  # drawn as another size than that of its head
    found: list[tuple[float, int, StandardSize, float]] = []
    for form in forms:
        for row in sizes().get(form, ()):
            if named and abs(row.diameter - named) > 0.02 * named:
                continue
            thread = drawn_thread_error(drawn, row.diameter, row.pitch)
            doubtful = other or not row.name.startswith("M")
            if not named and (thread >= 1.0 or (thread > EXACT and doubtful)):
                continue
            errors = [abs(x / y - 1.0) for x, y in ((a, row.a), (c, row.c)) if x and y]
            height = abs(b / row.b - 1.0) if b and row.b else 0.0
            if max(errors, default=0.0) <= CLOSE and height <= HEIGHT:
                found.append((sum(errors) + height + thread, len(found), row, max([*errors, 0.5 * height])))
    if not found:
        return None
    _, _, row, error = min(found)
    return row, error


def matching(form: str, **dimensions: tuple[float, float]) -> list[StandardSize]:
    """Return the sizes of a form whose dimensions are those given, each as (m, greatest relative error), best first."""
    found = []
    for k, row in enumerate(sizes().get(form, ())):
        errors = [
            (abs(x - getattr(row, name)) - 1e-7) / max(getattr(row, name), 1e-9) for name, (x, _) in dimensions.items()
        ]
        if all(error <= most for error, (_, most) in zip(errors, dimensions.values(), strict=True)):
            found.append((sum(errors), k, row))
    return [row for *_, row in sorted(found)]


def nominal_diameter(drawn: float, hole: bool = False) -> tuple[float, float]:
    """Return the nominal diameter and pitch (m) of the metric thread drawn at this diameter (m), (drawn, 0) for none.

    hole: whether it is a nut's: then also what is between nominal diameter and root, first choices of ISO 262 only.
    """
    rows = [(d, PITCHES.get(d, (0.2 * d + 0.05,))[0]) for d in NOMINAL]
    for depth, exact in ((0.0, EXACT), (1.0825, EXACT), (1.0, EXACT), (0.0, 2.0 * EXACT)):  # nominal, root, tap drill
        d, pitch = min(rows, key=lambda row: abs((row[0] - depth * row[1]) * MM - drawn))
        if abs((d - depth * pitch) * MM - drawn) <= exact * d * MM and not (hole and d in SECOND):
            return d * MM, pitch * MM
    for d, pitch in rows if hole else ():
        if d not in SECOND and d - ROOT * pitch <= drawn / MM <= d:
            return d * MM, pitch * MM
    return drawn, 0.0


def coarse_pitch(diameter: float) -> float:
    """Return the coarse pitch (m) of a metric thread of a nominal diameter (m), 0 if ISO 262 has none."""
    nearest = min(PITCHES, key=lambda d: abs(d * MM - diameter))
    return PITCHES[nearest][0] * MM if abs(nearest * MM - diameter) <= 1e-6 else 0.0
