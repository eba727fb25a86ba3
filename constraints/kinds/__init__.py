"""The kinds of constraint, one small class a file."""

from constraints.kinds.against import Against
from constraints.kinds.base import Constraint, Equation, Symbol
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from constraints.kinds.elements import Circle, Line, Point

__all__ = [
    "Against",
    "Circle",
    "Concentric",
    "Constraint",
    "Coplanar",
    "Equation",
    "Line",
    "Point",
    "Symbol",
]
