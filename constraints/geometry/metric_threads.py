"""ISO metric threads modelled as plain cylinders: the screw at nominal diameter, the hole as drilled.

A tapped hole is drawn with the minor diameter of its thread or with its tap drill, so that screw and hole overlap by
about half a pitch all round: M6 in Ø5. Sizes are those of ISO 262, the minor diameter is D - 1.0825·P (ISO 724), tap
drills are about D - P (ISO 2306).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

PITCHES: dict[float, tuple[float, ...]] = {
    1.6: (0.35,), 2: (0.4,), 2.5: (0.45,), 3: (0.5,), 3.5: (0.6,), 4: (0.7,), 5: (0.8,), 6: (1,), 7: (1,), 8: (1.25, 1),
    10: (1.5, 1.25, 1), 12: (1.75, 1.5, 1.25), 14: (2, 1.5), 16: (2, 1.5), 18: (2.5, 2, 1.5), 20: (2.5, 2, 1.5),
    22: (2.5, 2, 1.5), 24: (3, 2), 27: (3, 2), 30: (3.5, 2), 33: (3.5, 2), 36: (4, 3), 39: (4, 3), 42: (4.5, 3),
    45: (4.5, 3), 48: (5, 3), 52: (5, 4), 56: (5.5, 4), 60: (5.5, 4), 64: (6, 4),
}  # fmt: skip
"""mm: nominal diameter -> pitches, the coarse one first"""
MINOR = (1.0825, 0.85)
"""pitches by which a tapped hole is narrower than nominal: at its basic minor diameter, and at the widest of 6H"""
THINNER = 0.25
"""pitches by which the screw may be drawn below nominal (class 6g at its thinnest)"""
DRAWN = 1e-3
"""mm: how exactly diameters are drawn"""


@dataclass(frozen=True)
class MetricThread:
    """A size of ISO 262."""

    name: str
    """"M6" for the coarse pitch, "M8×1" for a fine one"""
    pitch: float
    """m a turn"""
    coarse: bool


@dataclass(frozen=True)
class DrawnThread:
    """A thread drawn as two plain cylinders."""

    size: MetricThread
    evidence: str
    """what tells it from a dowel in a bore that is too small: "hexagon head", 'name "screw"', …"""


@lru_cache(maxsize=4096)
def metric_threads(screw: float, hole: float) -> tuple[MetricThread, ...]:
    """The threads that a screw and a hole of these diameters (m), drawn as plain cylinders, may stand for; the one with
    the nearest tap drill first."""
    d, bore = 1e3 * screw, 1e3 * hole
    for nominal in sorted(PITCHES, key=lambda x: abs(x - d)):
        fitting = [
            pitch
            for pitch in PITCHES[nominal]
            if nominal - THINNER * pitch - DRAWN <= d <= nominal + DRAWN
            and nominal - MINOR[0] * pitch - DRAWN <= bore <= nominal - MINOR[1] * pitch + DRAWN
        ]
        if fitting:
            fitting.sort(key=lambda p: abs(nominal - p - bore))
            return tuple(MetricThread(designation(nominal, p), 1e-3 * p, p == PITCHES[nominal][0]) for p in fitting)
        if nominal - d > THINNER * PITCHES[nominal][0] + DRAWN:
            return ()
    return ()


def designation(nominal: float, pitch: float | None = None) -> str:
    """ "M6" for a nominal diameter (mm) and its coarse pitch (mm), "M8×1" for a fine one; "M6" for any other number."""
    fine = pitch is not None and pitch in PITCHES.get(nominal, ())[1:]
    return f"M{nominal:g}" + (f"×{pitch:g}" if fine else "")
