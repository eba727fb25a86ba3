"""Classifies a round solid surface in a hollow one: clearance, contact, press fit or clash.

Recognition, clash, constrained motion and planning all call `round_fit`, through `Limits.round_fit`: a pair of surfaces
is the same to each of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from constraints.geometry.words import millimetres

RoundFitKind = Literal["clearance", "contact", "press fit", "clash"]
ROUNDING = 1e-12
"""m: differences of lengths below it are rounding"""


@dataclass(frozen=True)
class RoundFit:
    """A shaft in its bore, a ball in its socket, a ring in its groove."""

    kind: RoundFitKind
    gap: float
    """m: least gap between the surfaces, the offset of their axes or centres included; negative for interference"""
    clearance: float
    """m: radius of the hollow surface minus that of the solid one; negative for interference"""

    @property
    def press(self) -> float:
        """m, radial: interference of a press fit; 0 for other kinds."""
        return -self.clearance if self.kind == "press fit" else 0.0

    @property
    def words(self) -> str:
        """Radial clearance or interference; a press fit as every command and report names it."""
        if f"{abs(self.clearance) * 1e6:.2f}" == "0.00":
            return "same radius"
        if self.press:
            return press_fit_words(self.press)
        return f"{millimetres(abs(self.clearance))} radial {'clearance' if self.clearance > 0.0 else 'interference'}"


def press_fit_words(interference: float) -> str:
    """Name a press fit of a radial interference (m)."""
    return f"press fit, {millimetres(interference)} radial interference, force not checked"


def round_fit(clearance: float, offset: float, most: float, linear: float) -> RoundFit:
    """Return the class of fit of two round surfaces.

    Parameters
    ----------
    clearance: m: radius of the hollow surface minus that of the solid one.
    offset: m: between their axes over the shared length, or between their centres.
    most: m, radial: the greatest interference of a press fit of that diameter.
    linear: m: surfaces nearer than this touch, axes nearer than this coincide.
    """
    gap = clearance - offset
    kind: RoundFitKind = "clash"
    if gap >= -linear - ROUNDING:
        kind = "contact" if gap <= linear else "clearance"
    elif -clearance <= most + ROUNDING and offset <= linear + ROUNDING:
        kind = "press fit"
    return RoundFit(kind, gap, clearance)
