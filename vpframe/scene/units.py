"""Lengths and times written with units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Scale:
    """How the numbers of one quantity are written: times `factor`, with so many `digits`, in `unit`."""

    unit: str
    factor: float = 1.0
    digits: int = 6

    def number(self, value: float) -> str:
        """Return the number without its unit."""
        return f"{value * self.factor:.{self.digits}g}"

    def text(self, value: float) -> str:
        """Return the number with its unit: "8.02 mm"."""
        return f"{self.number(value)} {self.unit}".rstrip()

    def label(self, name: str) -> str:
        """Return the name of the quantity with its unit: "bore (mm)"."""
        return f"{name} ({self.unit})" if self.unit else name


def scale_of(values: Iterable[float], unit: str) -> Scale:
    """Return the scale that shows differences between values to three digits; metres become mm or µm by their size."""
    sizes = [float(value) for value in values if math.isfinite(value)]
    largest = max(map(abs, sizes), default=0.0)
    spread = max(sizes, default=0.0) - min(sizes, default=0.0)
    digits = 6 if spread == 0.0 else min(3 + max(0, math.ceil(math.log10(largest) - math.log10(spread))), 15)
    if unit == "m" and largest < 1.0:
        return Scale("µm", 1e6, digits) if 0.0 < largest < 1e-3 else Scale("mm", 1e3, digits)
    return Scale(unit, 1.0, digits)


def quantity_text(value: float, unit: str) -> str:
    """Return a number with its unit, six digits; a length in m, mm or µm by its size."""
    return scale_of((value,), unit).text(value)


def name_and_unit(name: str) -> tuple[str, str]:
    """Split "force (N)" into its parts; the unit is empty where the name states none."""
    match = re.fullmatch(r"(.*\S)\s+\(([^()\s]{1,12})\)", name)
    return (match[1], match[2]) if match else (name, "")


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
