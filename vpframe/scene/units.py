"""Lengths and times written with units."""

from __future__ import annotations

import math
import re

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "in": 0.0254, "ft": 0.3048}
"""unit of length in metres"""
NAMES = "m, cm, mm, um, in, ft"

SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zµμ]*)\s*")


def length(text: str) -> float:
    """Convert "0.5mm", "20 um" or "0.01in" to metres. Raises ValueError: no unit, negative or not finite."""
    return _quantity(text, "length", METRES, f"{NAMES}: 0.5mm")


def seconds(text: str) -> float:
    """Convert "120s", "2 min", "1h" or "0.5" to seconds. Raises ValueError: negative or not finite."""
    return _quantity(text, "time", SECONDS, "s, ms, min, h: 120s")


def _quantity(text: str, what: str, units: dict[str, float], example: str) -> float:
    match = _QUANTITY.fullmatch(text)
    if match is not None and not match[2] and "" not in units:
        raise ValueError(f"{text!r} is not a {what} without its unit, one of {example.replace('0.5', match[1])}")
    if match is None or match[2] not in units:
        raise ValueError(f"{text!r} is not a {what}; write a number with one of {example}")
    value = float(match[1]) * units[match[2]]
    if not math.isfinite(value) or value < 0:
        raise ValueError(f"{text!r} is not a {what}: it must be finite and not negative")
    return value
