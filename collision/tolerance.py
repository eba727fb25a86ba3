"""The one place where epsilons live."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

from collision.errors import CollisionError


@dataclass(frozen=True)
class Tolerance:
    """What counts as equal. Every package takes its epsilons from here; a user may set any of them.

    Collision verdicts do not depend on it (they are exact); nearness, recognition and solving do.

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
    """1: … and below this part of their extent, so that a tiny freeform face does not pass for a plane."""
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
    most by which a shaft may be larger than its bore and be a press fit; beyond it they clash. u8 allows more."""
    fit_class: str = ""
    """ISO 286 class, such as H7/g6, that a shaft and its bore have to make; empty for `clearance` alone"""
    rigid: float = 1e-6
    """1: greatest |RᵀR - I| entry of a rotation that counts as rigid."""
    slop: float = 0.1
    """1: share of `linear` by which surfaces in contact may come nearer as they slide, and a sweep's stop may be off"""
    gjk: float = 1e-10
    """m: precision of coal's GJK (at its default of 1e-6 it reports contacts of surfaces that do not touch)"""
    oracle: float = 1e-8
    """1: error bound of coal's verdicts, a unit of the parts' size"""
    depth: float = 1e-2
    """1: depths of penetration are found to within this part of themselves and of `linear`"""
    solver: float = 1e-12
    """m, rad: residual at which a constraint counts as satisfied by the solver."""
    satisfied: float = 1e-9
    """m, rad: residual below which moving parts obey a constraint"""
    conflict: float = 1e-7
    """m, rad: constraints that miss each other by more contradict; below it is what files and fits leave."""
    lower_pair: float = 1e-6
    """rad: within it directions are parallel and axes meet, when a joint is named by its twists."""
    rank: float = 1e-9
    """1: singular values below this times the largest count as zero."""
    reach: float = 1e-3
    """m: how far from exact a mate may be and still be offered; 0 judges an assembly as it stands"""
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
"""what holds where no other is given"""
