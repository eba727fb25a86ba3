"""Geometric constraints between analytic surfaces: recognised from contact, solved, and the motion they leave."""

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
