"""The kinds of constraint, one small class a file.

A kind is a frozen dataclass that names its equations; residual, Jacobian and freedom follow from them.
May use `geometry`, and the equations of `solve`.
Start with `concentric` (twelve lines), then `base` and `equations`; CONTRIBUTING.md has the steps to add one.
"""

from constraints.kinds.against import Against
from constraints.kinds.angle import Angle
from constraints.kinds.base import Constraint, Symbol
from constraints.kinds.belt import Belt
from constraints.kinds.concentric import Concentric
from constraints.kinds.conical import Conical
from constraints.kinds.contact import Contact
from constraints.kinds.coplanar import Coplanar
from constraints.kinds.distance import Distance
from constraints.kinds.elements import Circle, Line, Point
from constraints.kinds.equations import Equation
from constraints.kinds.fixed import Fixed
from constraints.kinds.gear import Gear
from constraints.kinds.groove import Groove
from constraints.kinds.offset import Offset
from constraints.kinds.parallel import Parallel
from constraints.kinds.perpendicular import Perpendicular
from constraints.kinds.rack import RackAndPinion
from constraints.kinds.screw import Screw
from constraints.kinds.spherical import Spherical
from constraints.kinds.tangent import Tangent
from constraints.kinds.toroidal import Toroidal

__all__ = [
    "Against",
    "Angle",
    "Belt",
    "Circle",
    "Concentric",
    "Conical",
    "Constraint",
    "Contact",
    "Coplanar",
    "Distance",
    "Equation",
    "Fixed",
    "Gear",
    "Groove",
    "Line",
    "Offset",
    "Parallel",
    "Perpendicular",
    "Point",
    "RackAndPinion",
    "Screw",
    "Spherical",
    "Symbol",
    "Tangent",
    "Toroidal",
]
