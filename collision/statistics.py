"""Counts of box and triangle tests, by which the methods are compared."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from operator import add, sub


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts of one query, or of many added up."""

    object_pairs: int = 0
    """pairs of objects that the broad phase let through"""
    surface_box_tests: int = 0
    """tests of the box of a surface, or of a group of surfaces, with another or with an OAABB"""
    triangle_box_tests: int = 0
    """tests of the box of a triangle, or of a group of triangles of one surface, with another or with an OAABB"""
    triangle_tests: int = 0
    """exact triangle-triangle tests"""
    exact_fallbacks: int = 0
    """signs within the error bound of float64, computed in exact arithmetic"""

    @property
    def box_tests(self) -> int:
        """All box tests, of surfaces and of triangles."""
        return self.surface_box_tests + self.triangle_box_tests

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(*map(add, astuple(self), astuple(other)))

    def __sub__(self, other: Statistics) -> Statistics:
        return Statistics(*map(sub, astuple(self), astuple(other)))
