"""All tolerances of the packages, in one dataclass."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

from collision.errors import CollisionError


@dataclass(frozen=True)
class Tolerance:
    """Tolerances of geometry, solving and contact. Every package takes its epsilons from here; a user may set any.

    Intersection is exact and does not depend on them; nearness, recognition and solving do.

    Raises
    ------
    CollisionError: a field that is negative or no number. Infinity is one (`break_distance`: never).
    """

    linear: float = 1e-5
    """m: two surfaces (as analytic geometry) nearer than this touch; two planes within it are flush."""
    angular: float = 1e-3
    """rad: two directions within it are parallel."""
    fit: float = 1e-5
    """m: vertices whose distance to an analytic surface is below this lie on it."""
    fit_relative: float = 1e-3
    """1: … and below this part of their extent, so that a tiny freeform face is not taken for a plane."""
    facet: float = 0.25
    """rad: a triangle's normal and its surface's (at the triangle's middle) differ by less."""
    flat: float = 1e-2
    """rad: triangles of one flat facet of a bare mesh have normals that differ by less."""
    bend: float = 0.6
    """rad: triangles that meet at less may be segments of one curved surface."""
    segment_relative: float = 2e-5
    """1: in a bare mesh, vertices lie on their surface to this part of the mesh's extent (files carry seven digits)."""
    clearance: float = 2.5e-4
    """m: greatest radial clearance at which a shaft still fits a bore."""
    clearance_relative: float = 0.1
    """1: … or looser by this share of the shaft's diameter, up to 4 mm: screws in clearance holes (ISO 273)"""
    press_fit: str = "s7"
    """ISO 286 class of the tightest shaft in a hole H: its greatest interference, for the diameter of the bore, is the
    greatest of a press fit; beyond it shaft and bore clash. u8 allows more."""
    fit_class: str = ""
    """ISO 286 class, such as H7/g6, required of a shaft and its bore; empty for `clearance` alone"""
    rigid: float = 1e-6
    """1: greatest |RᵀR - I| entry of a rotation that counts as rigid."""
    slop: float = 0.1
    """1: fraction of `linear` by which surfaces in contact may approach while sliding; precision of a sweep's stop"""
    gjk: float = 1e-10
    """m: precision of coal's GJK (at its default of 1e-6 it reports contacts of surfaces that do not touch)"""
    oracle: float = 1e-8
    """1: error bound of coal's distances, per unit of the parts' size"""
    depth: float = 1e-2
    """1: precision of penetration depths, as a fraction of themselves and of `linear`"""
    solver: float = 1e-12
    """m, rad: residual at which a constraint counts as satisfied by the solver."""
    satisfied: float = 1e-9
    """m, rad: residual below which moving parts obey a constraint"""
    conflict: float = 1e-7
    """m, rad: constraints of a greater residual contradict each other; a smaller one is the error of files and fits"""
    lower_pair: float = 1e-6
    """rad: within it directions are parallel and axes meet, when a joint is named by its twists."""
    rank: float = 1e-9
    """1: singular values below this times the largest count as zero."""
    reach: float = 1e-3
    """m: greatest deviation of a mate that is offered; 0 assesses an assembly as drawn"""
    reach_angular: float = 0.0175
    """rad: the same for directions (one degree)"""
    release: float = 2.0
    """1: an offer is withdrawn, and an overlap has ended, only beyond `release` times the reach (hysteresis)"""
    break_distance: float = 5e-3
    """m: a hand that pulls an accepted constraint apart by more than this removes it"""
    break_angular: float = 0.2
    """rad: the same for directions"""
    touch: float = 1e-10
    """m: two surfaces whose gap is at most this press on one another (physics finds impacts to 1e-13)"""
    rest_speed: float = 1e-3
    """m/s: an impact slower than this does not rebound"""
    sleep_speed: float = 1e-4
    """m/s: a body whose every point has stayed slower than this for `sleep_time` may sleep"""
    sleep_time: float = 0.5
    """s"""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, str):
                if not isinstance(value, str):
                    raise CollisionError(f"Tolerance: {field.name} is {value!r}; give a class of ISO 286 as text")
                continue
            if not isinstance(value, (int, float)) or not value >= 0.0:
                raise CollisionError(f"Tolerance: {field.name} is {value!r}; give a number that is not negative")


DEFAULT: Final = Tolerance()
"""the tolerance used if none is given"""
