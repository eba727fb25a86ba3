"""`Fastener`: a part as a fastener or bought-in small part."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

MM = 1e-3
INCH = 25.4e-3


class FastenerKind(StrEnum):
    """Kinds of fasteners and small parts that a drawing is full of."""

    SCREW = "screw"
    """bolts, too: with a head"""
    SELF_TAPPING = "self-tapping screw"
    SET_SCREW = "set screw"
    THREADED_ROD = "threaded rod"
    NUT = "nut"
    """of any form: hexagon, square, T-slot, barrel; threaded standoffs, too"""
    INSERT = "threaded insert"
    WASHER = "washer"
    DOWEL = "dowel"
    RIVET = "rivet"
    KEY = "key"
    CIRCLIP = "circlip"
    BEARING = "bearing"
    """its rings, rolling elements and cage, too, where they are parts of their own"""
    BUSHING = "bushing"
    """spacers, too"""
    MAGNET = "magnet"
    SEAL = "seal"
    """O-rings, too"""
    BELT = "belt"
    SPRING = "spring"
    TIE = "cable tie"


SCREWS = frozenset({FastenerKind.SCREW, FastenerKind.SELF_TAPPING, FastenerKind.SET_SCREW, FastenerKind.THREADED_ROD})
"""kinds with a thread outside"""
NUTS = frozenset({FastenerKind.NUT, FastenerKind.INSERT})
"""kinds with a thread inside"""
SOFT = frozenset({FastenerKind.SEAL, FastenerKind.BELT, FastenerKind.SPRING, FastenerKind.TIE})
"""kinds that give way"""


@dataclass(frozen=True, eq=False)
class Fastener:
    """A part as a fastener, in its own frame."""

    kind: FastenerKind
    origin: NDArray[np.float64]
    """(3,) m, on the axis, where the length begins: of a screw under its head, of a countersunk one at the rim of the
    head, of a set screw at the end that is driven; a screw's tip is at `origin + length * axis`"""
    axis: NDArray[np.float64]
    """(3,) unit: of a screw from head to tip, the direction in which it is driven; of others any of the two"""
    diameter: float
    """m: nominal, of the thread (outside or inside), bore or shaft; 0 where none is meant"""
    length: float
    """m: as drawn: of a screw from `origin` to its tip, else along the axis"""
    outside: float
    """m: greatest radius about the axis"""
    thread: str = ""
    """size of the thread, or of the screw that a washer is made for: "M3", "1/4-20"; empty if there is none"""
    pitch: float = 0.0
    """m a turn, of a thread; 0 for none"""
    standard: str = ""
    """where dimensions match, or the name states it: "ISO 7380-1", "DIN 912", …; empty if none does"""
    drive: str = ""
    """ "hexagon", "hexagon socket 2 mm", "Torx T10", "cross", "slot", "recess" (of no known form); empty if none"""
    evidence: str = ""
    """what it was recognised by, in words"""
    confidence: float = 1.0
    """0 to 1"""

    @property
    def size(self) -> str:
        """ "M3x8" of a metric screw, "1/4-20x1\\"" of an imperial one, "M3" of a nut, "Ø6x20" of a dowel, "Ø6" else."""
        inch = bool(self.thread) and not self.thread.startswith("M")
        long = self.kind in SCREWS or self.kind in (FastenerKind.DOWEL, FastenerKind.RIVET)
        times = ("x" + number(self.length, INCH if inch else MM) + '"' * inch) if long else ""
        if self.thread:
            return self.thread + times
        return f"Ø{number(self.diameter)}{times}" if self.diameter else ""


def number(length: float, unit: float = MM) -> str:
    """Format a length (m) in a unit (m) with two decimals at most."""
    return f"{round(length / unit, 2):g}"
