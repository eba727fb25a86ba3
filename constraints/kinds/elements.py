"""Features that are no surfaces (a line, a point, a circle: edges and vertices), and the axis of any feature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from constraints.geometry import Cone, Cylinder, Geometry, Torus, Vector, _direction, _positive, _vector

if TYPE_CHECKING:
    from constraints.kinds.base import Constraint


@dataclass(frozen=True, eq=False)
class Line(Geometry):
    """A straight edge, or an axis: points origin + s·axis."""

    origin: Vector
    axis: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", _vector(self.origin, "origin"))
        object.__setattr__(self, "axis", _direction(self.axis, "axis"))


@dataclass(frozen=True, eq=False)
class Point(Geometry):
    """A vertex."""

    center: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector(self.center, "center"))


@dataclass(frozen=True, eq=False)
class Circle(Geometry):
    """A circular edge of `radius` about `axis` through `center`."""

    center: Vector
    axis: Vector
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector(self.center, "center"))
        object.__setattr__(self, "axis", _direction(self.axis, "axis"))
        object.__setattr__(self, "radius", _positive(self.radius, "radius"))


def axis_of(constraint: Constraint, body: int) -> tuple[Vector, Vector]:
    """A point on the axis and the axis' direction of the feature of a (0) or b (1)."""
    feature = constraint._feature(body, Cylinder, Cone, Torus, Circle, Line)
    if isinstance(feature, (Cylinder, Line)):
        return feature.origin, feature.axis
    if isinstance(feature, Cone):
        return feature.apex, feature.axis
    return feature.center, feature.axis
