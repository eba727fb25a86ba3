"""Materials: density, friction and restitution, and those of pairs of materials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from physics.errors import BodyError

LAWS = ("newton", "poisson")
"""impact laws: restitution is a ratio of speeds (Newton) or of impulses (Poisson)"""


@dataclass(frozen=True)
class Material:
    """Contact and mass properties of a material. None: not stated.

    Raises
    ------
    BodyError: a coefficient out of range, an unknown law.
    """

    name: str
    friction: float | None = None
    """1: Coulomb's coefficient; of two objects see `forces.behaviours.Reaction`"""
    restitution: float | None = None
    """1: coefficient of restitution, 0 … 1"""
    density: float | None = None
    """kg/m³"""
    law: str = "newton"
    """one of `LAWS`, by which `restitution` is meant"""

    def __post_init__(self) -> None:
        _require(self.name, "friction", self.friction, 0.0, np.inf)
        _require(self.name, "restitution", self.restitution, 0.0, 1.0)
        _require(self.name, "density", self.density, np.finfo(np.float64).tiny, np.inf)
        if self.law not in LAWS:
            raise BodyError(f"{self.name}: law is {self.law!r}; give one of {', '.join(LAWS)}", self.name, "law")


@dataclass(frozen=True)
class Pair:
    """Friction and restitution of two materials in contact; None: combined from their own.

    Poisson's impact law counts for `restitution` if either material means its own by it.

    Raises
    ------
    BodyError: a coefficient out of range.
    """

    friction: float | None = None
    restitution: float | None = None

    def __post_init__(self) -> None:
        _require("pair of materials", "friction", self.friction, 0.0, np.inf)
        _require("pair of materials", "restitution", self.restitution, 0.0, 1.0)


def _require(name: str, field: str, value: float | None, low: float, high: float) -> None:
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not low <= value <= high:
        limits = "0 … 1" if high == 1.0 else "zero or more" if low == 0.0 else "a positive number"
        raise BodyError(f"{name}: {field} is {value!r}; give {limits}", name, field)
    if not np.isfinite(value):
        raise BodyError(f"{name}: {field} is {value!r}; give a finite number", name, field)


MATERIALS: Mapping[str, Material] = {
    name: Material(name, density=density)
    for name, density in {
        "steel": 7850.0,
        "stainless steel": 7900.0,
        "cast iron": 7200.0,
        "aluminium": 2700.0,
        "brass": 8500.0,
        "copper": 8960.0,
        "titanium": 4430.0,
        "abs": 1050.0,
        "nylon": 1150.0,
        "ptfe": 2200.0,
        "rubber": 1200.0,
        "glass": 2500.0,
        "wood": 700.0,
        "concrete": 2400.0,
        "water": 1000.0,
        "air": 1.204,
        "helium": 0.1664,
    }.items()
}
"""materials by name, with their densities at 20 °C"""

DENSITY: Mapping[str, float] = {name: m.density for name, m in MATERIALS.items() if m.density is not None}
"""kg/m³ at 20 °C by material name"""

PAIRS: Mapping[tuple[str, str], Pair] = {
    ("steel", "steel"): Pair(friction=0.57),
    ("aluminium", "steel"): Pair(friction=0.47),
    ("copper", "steel"): Pair(friction=0.36),
    ("rubber", "concrete"): Pair(friction=0.8),
    ("wood", "wood"): Pair(friction=0.2),
    ("glass", "glass"): Pair(friction=0.4),
    ("ptfe", "ptfe"): Pair(friction=0.04),
}
"""kinetic friction of dry pairs, by names in either order; sources differ by half of it and more. Engineer Laboratory,
"Friction Coefficients of Common Materials"; PTFE: The Handy Physics Answer Book, "How is the friction between two
surfaces characterized?\""""


def material(given: Material | str) -> Material:
    """The material of a name from `MATERIALS`, or the one given. Raises BodyError for an unknown name."""
    if isinstance(given, Material):
        return given
    if not isinstance(given, str) or given.lower() not in MATERIALS:
        raise BodyError(
            f"no material {given!r}; there are: {', '.join(MATERIALS)}; or give a Material", None, "material"
        )
    return MATERIALS[given.lower()]
