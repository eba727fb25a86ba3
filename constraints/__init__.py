"""What two touching surfaces can mean to each other, and the motion that meaning leaves."""

from constraints.candidate import Candidate
from constraints.errors import ConstraintsError, GeometryError
from constraints.god_object import MotionResult
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
from constraints.mobility import Freedom, Mobility, mobility
from constraints.motion import Motion
from constraints.recognition import recognise
from constraints.solver import Solution, solve

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
