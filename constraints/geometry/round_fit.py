"""What a round solid surface and the hollow one around it are to each other: clearance, contact, press fit or clash.

Recognition, clash, constrained motion and planning all call `round_fit`, through `Limits.round_fit`: a pair of surfaces
is the same to each of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from constraints.geometry.words import millimetres

RoundFitKind = Literal["clearance", "contact", "press fit", "clash"]
ROUNDING = 1e-12
"""m: to which lengths are compared"""


@dataclass(frozen=True)
class RoundFit:
    """A shaft in its bore, a ball in its socket, a ring in its groove."""

    kind: RoundFitKind
    gap: float
    """m: least gap between the surfaces, the offset of their axes or centres included; negative for interference"""
    interference: float
    """m, radial, at least 0: how much larger the solid surface is"""

    @property
    def words(self) -> str:
        """A press fit as every command and report names it, any other interference as such; else empty."""
        if self.interference == 0.0:
            return ""
        size = f"{millimetres(self.interference)} radial interference"
        return f"press fit, {size}, force not checked" if self.kind == "press fit" else size


def round_fit(clearance: float, offset: float, most: float, linear: float) -> RoundFit:
    """Return what two round surfaces are to each other.

    Parameters
    ----------
    clearance: m: radius of the hollow surface minus that of the solid one.
    offset: m: between their axes over the shared length, or between their centres.
    most: m, radial: the greatest interference of a press fit of that diameter.
    linear: m: surfaces nearer than this touch, axes nearer than this coincide.
    """
    gap, interference = clearance - offset, max(-clearance, 0.0)
    kind: RoundFitKind = "clash"
    if gap >= -linear - ROUNDING:
        kind = "contact" if gap <= linear else "clearance"
    elif interference <= most + ROUNDING and offset <= linear + ROUNDING:
        kind = "press fit"
    return RoundFit(kind, gap, interference)
