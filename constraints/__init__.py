"""What two touching surfaces can mean to each other, and the motion that meaning leaves."""

from constraints.errors import ConstraintsError, GeometryError
from constraints.kinds import Against, Concentric, Constraint, Coplanar
from constraints.mobility import Freedom, Mobility, mobility
from constraints.solver import Solution, solve

__all__ = [
    "Against",
    "Concentric",
    "Constraint",
    "ConstraintsError",
    "Coplanar",
    "Freedom",
    "GeometryError",
    "Mobility",
    "Solution",
    "mobility",
    "solve",
]
