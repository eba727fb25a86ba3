"""Geometric constraints between analytic surfaces: recognised from contact, solved, and the motion they leave."""

from __future__ import annotations

from typing import TYPE_CHECKING

from collision.lazy import attributes

if TYPE_CHECKING:
    from constraints.errors import ConstraintsError, GeometryError
    from constraints.freedom.mobility import Freedom, Mobility, mobility
    from constraints.kinds import (
        Against,
        Angle,
        Belt,
        Circle,
        Concentric,
        Conical,
        Constraint,
        Contact,
        Coplanar,
        Distance,
        Fixed,
        Gear,
        Groove,
        Line,
        Offset,
        Parallel,
        Perpendicular,
        Point,
        RackAndPinion,
        Screw,
        Spherical,
        Tangent,
        Toroidal,
    )
    from constraints.manager import Accepted, Change, ConstraintManager, UnknownConstraintError
    from constraints.motion.god_object import MotionResult
    from constraints.motion.motion import Motion
    from constraints.recognition.candidate import Candidate
    from constraints.recognition.recognise import recognise
    from constraints.solve.solver import Solution, solve

__all__ = [
    "Accepted",
    "Against",
    "Angle",
    "Belt",
    "Candidate",
    "Change",
    "Circle",
    "Concentric",
    "Conical",
    "Constraint",
    "ConstraintManager",
    "ConstraintsError",
    "Contact",
    "Coplanar",
    "Distance",
    "Fixed",
    "Freedom",
    "Gear",
    "GeometryError",
    "Groove",
    "Line",
    "Mobility",
    "Motion",
    "MotionResult",
    "Offset",
    "Parallel",
    "Perpendicular",
    "Point",
    "RackAndPinion",
    "Screw",
    "Solution",
    "Spherical",
    "Tangent",
    "Toroidal",
    "UnknownConstraintError",
    "mobility",
    "recognise",
    "solve",
]

_MODULE = {
    name: module
    for module, names in {
        "constraints.errors": ("ConstraintsError", "GeometryError"),
        "constraints.freedom.mobility": ("Freedom", "Mobility", "mobility"),
        "constraints.kinds": (
            "Against", "Angle", "Belt", "Circle", "Concentric", "Conical", "Constraint", "Contact", "Coplanar",
            "Distance", "Fixed", "Gear", "Groove", "Line", "Offset", "Parallel", "Perpendicular", "Point",
            "RackAndPinion", "Screw", "Spherical", "Tangent", "Toroidal",
        ),
        "constraints.manager": ("Accepted", "Change", "ConstraintManager", "UnknownConstraintError"),
        "constraints.motion.god_object": ("MotionResult",),
        "constraints.motion.motion": ("Motion",),
        "constraints.recognition.candidate": ("Candidate",),
        "constraints.recognition.recognise": ("recognise",),
        "constraints.solve.solver": ("Solution", "solve"),
    }.items()
    for name in names
}  # fmt: skip
"""where each name is defined: imported at its first use, because kernels take long to import"""

__getattr__, __dir__ = attributes(__name__, _MODULE)
