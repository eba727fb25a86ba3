"""What two touching surfaces can mean to each other, and the motion that meaning leaves."""

from constraints.candidate import Candidate
from constraints.errors import ConstraintsError, GeometryError
from constraints.kinds import Against, Concentric, Constraint, Coplanar
from constraints.manager import Accepted, Change, ConstraintManager, UnknownConstraintError
from constraints.mobility import Freedom, Mobility, mobility
from constraints.motion import Motion, MotionResult
from constraints.recognition import recognise
from constraints.solver import Solution, solve

__all__ = [
    "Accepted",
    "Against",
    "Candidate",
    "Change",
    "Concentric",
    "Constraint",
    "ConstraintManager",
    "ConstraintsError",
    "Coplanar",
    "Freedom",
    "GeometryError",
    "Mobility",
    "Motion",
    "MotionResult",
    "Solution",
    "UnknownConstraintError",
    "mobility",
    "recognise",
    "solve",
]
