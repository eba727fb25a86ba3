"""Which surfaces collide, exactly: triangles grouped by surface and poses in, surface pairs out.

Knows triangles, surfaces, poses and boxes; nothing of CAD, names, mass or viewers. See `collision/README.md`.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collision.classify import PairClass, classify
    from collision.contact import CONTACT_DTYPE, PENETRATION_DTYPE, TimeOfImpact
    from collision.errors import CollisionError, MeshError, PoseError, UnknownObjectError
    from collision.manager import CollisionManager
    from collision.mesh import SurfaceMesh
    from collision.methods import colliding_surfaces
    from collision.statistics import Statistics
    from collision.tolerance import Tolerance

__all__ = [
    "CONTACT_DTYPE",
    "PENETRATION_DTYPE",
    "CollisionError",
    "CollisionManager",
    "MeshError",
    "PairClass",
    "PoseError",
    "Statistics",
    "SurfaceMesh",
    "TimeOfImpact",
    "Tolerance",
    "UnknownObjectError",
    "classify",
    "colliding_surfaces",
]

_MODULE = {
    name: module
    for module, names in {
        "collision.classify": (
            "PairClass",
            "classify",
        ),
        "collision.contact": (
            "CONTACT_DTYPE",
            "PENETRATION_DTYPE",
            "TimeOfImpact",
        ),
        "collision.errors": (
            "CollisionError",
            "MeshError",
            "PoseError",
            "UnknownObjectError",
        ),
        "collision.manager": ("CollisionManager",),
        "collision.mesh": ("SurfaceMesh",),
        "collision.methods": ("colliding_surfaces",),
        "collision.statistics": ("Statistics",),
        "collision.tolerance": ("Tolerance",),
    }.items()
    for name in names
}
"""where each name is defined: imported at its first use, because kernels take long to import"""


class _Package(ModuleType):
    """A package some of whose names are those of its modules (`classify`), and do not mean these."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _MODULE or not isinstance(value, ModuleType):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
