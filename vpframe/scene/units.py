"""Lengths as people write them."""

from __future__ import annotations

import math
import re

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254, "ft": 0.3048}
"""metres a unit, wherever vpframe takes one"""
NAMES = "m, cm, mm, um, in, ft"

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zµμ]*)\s*")


def length(text: str) -> float:
    """Metres of "0.5mm", "20 um" or "0.01in": not negative, finite, with its unit. Raises ValueError."""
    match = _LENGTH.fullmatch(text)
    if match is not None and not match[2]:
        raise ValueError(f"{text!r} is not a length without its unit, one of {NAMES}: {match[1]}mm")
    if match is None or match[2] not in METRES:
        raise ValueError(f"{text!r} is not a length; write a number with one of {NAMES}: 0.5mm")
    value = float(match[1]) * METRES[match[2]]
    if not math.isfinite(value) or value < 0:
        raise ValueError(f"{text!r} is not a length: it must be finite and not negative")
    return value
