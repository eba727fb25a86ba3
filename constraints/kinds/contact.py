"""Edges and vertices that lie on something."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.kinds.base import EitherWay
from constraints.kinds.elements import Circle, Line, Point
from constraints.kinds.equations import (
    Equation,
    angle,
    coincident,
    cone_distance,
    element,
    line_distance,
    lines_distance,
    on_line,
    on_plane,
    point_distance,
    rim_height,
    torus_distance,
)


@dataclass(frozen=True, eq=False)
class Contact(EitherWay):
    """An edge or vertex in contact: a line contact (an edge in a plane) or a point contact (all others).

    Pairs, either way round: plane with line (edge flat on the face), circle (rim on the face) or point; cylinder, cone,
    sphere, torus, line with point; line or cylinder with line (crossing edges); point with point.
    """

    kind: ClassVar[str] = "contact"
    symbol: ClassVar[str] = "point"
    types: ClassVar = (Plane, Cylinder, Cone, Sphere, Torus, Line, Circle, Point)

    def pair(self, a: object, b: object) -> tuple[Equation, ...]:
        match a, b:
            case Plane(), Line():
                plane, line = element(a.origin, a.normal), element(b.origin, b.axis)
                return angle(plane, line, pi / 2), on_plane(plane, line)
            case Plane(), Circle():
                return (rim_height(element(a.origin, a.normal), element(b.center, b.axis), b.radius, 0.0),)
            case Plane(), Point():
                return (on_plane(element(a.origin, a.normal), element(b.center)),)
            case Cylinder(), Point():
                return (line_distance(element(a.origin, a.axis), element(b.center), a.radius),)
            case Cone(), Point():
                return (cone_distance(element(a.apex, a.axis), element(b.center), a.half_angle, 0.0),)
            case Sphere(), Point():
                return (point_distance(element(a.center), element(b.center), a.radius),)
            case Torus(), Point():
                return (torus_distance(element(a.center, a.axis), element(b.center), a.major, a.minor),)
            case Cylinder(), Line():
                return (lines_distance(element(a.origin, a.axis), element(b.origin, b.axis), a.radius),)
            case Line(), Line():
                return (lines_distance(element(a.origin, a.axis), element(b.origin, b.axis), 0.0, side=1),)
            case Line(), Point():
                return (on_line(element(a.origin, a.axis), element(b.center)),)
            case Point(), Point():
                return (coincident(element(a.center), element(b.center)),)
        pair = f"a {type(a).__name__.lower()} and a {type(b).__name__.lower()}"
        raise GeometryError(f"contact: {pair} have no contact that is defined; see docs/constraints.md", "features")
