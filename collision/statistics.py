"""What a query cost: the counts by which the stages of the algorithm are compared."""

from __future__ import annotations

from dataclasses import astuple, dataclass


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts of one query, or of many added up."""

    object_pairs: int = 0
    """pairs of objects whose surfaces were looked at (stage 1 let them through)"""
    surface_box_tests: int = 0
    """tests of a surface's box, or of a group of surfaces, against another or against an OAABB"""
    triangle_box_tests: int = 0
    """tests of a triangle's box, or of a group of triangles of one surface, against another or against an OAABB"""
    triangle_tests: int = 0
    """exact triangle-triangle tests"""
    exact_fallbacks: int = 0
    """signs that float64 could not decide, computed in exact arithmetic"""

    @property
    def box_tests(self) -> int:
        """All box tests, of surfaces and of triangles."""
        return self.surface_box_tests + self.triangle_box_tests

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __sub__(self, other: Statistics) -> Statistics:
        return Statistics(*(a - b for a, b in zip(astuple(self), astuple(other), strict=True)))
