"""Features that are no surfaces (a line, a point, a circle: edges and vertices), and the axis of any feature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from constraints.errors import GeometryError
from constraints.geometry.surfaces import PLACES, Cone, Cylinder, Geometry, Plane, Sphere, Torus, Vector
from constraints.kinds.equations import Array, element

if TYPE_CHECKING:
    from constraints.kinds.base import Constraint


@dataclass(frozen=True, eq=False)
class Line(Geometry):
    """A straight edge, or an axis: points origin + s·axis."""

    origin: Vector
    axis: Vector


@dataclass(frozen=True, eq=False)
class Point(Geometry):
    """A vertex."""

    center: Vector


@dataclass(frozen=True, eq=False)
class Circle(Geometry):
    """A circular edge of `radius` about `axis` through `center`."""

    center: Vector
    axis: Vector
    radius: float


def axis_of(constraint: Constraint, body: int) -> Array:
    """Element on the axis of the feature of body a (0) or b (1)."""
    feature = constraint.feature(body, Cylinder, Cone, Torus, Circle, Line)
    return element(_origin(feature), feature.axis)


def plane_of(constraint: Constraint, body: int) -> Array:
    """Element in the plane of the feature, D its normal."""
    plane = constraint.feature(body, Plane)
    return element(plane.origin, plane.normal)


def point_of(constraint: Constraint, body: int) -> Array:
    """Element at the centre of the feature."""
    return element(constraint.feature(body, Sphere, Point).center)


def direction_of(constraint: Constraint, body: int) -> Array:
    """Element along the feature's normal or axis."""
    feature = constraint.feature(body, Plane, Cylinder, Cone, Torus, Circle, Line)
    return element(_origin(feature), feature.normal if isinstance(feature, Plane) else feature.axis)


def _origin(feature: Geometry) -> Vector:
    for name in PLACES:
        if hasattr(feature, name):
            return getattr(feature, name)
    raise GeometryError(f"a {feature.kind} has no place", "features")
