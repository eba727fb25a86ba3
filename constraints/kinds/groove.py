"""A ball in a groove of its own radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cylinder, Sphere, Torus
from constraints.kinds.base import EitherWay
from constraints.kinds.elements import Circle, Line, Point
from constraints.kinds.equations import Equation, element, line_distance, on_line, on_plane


@dataclass(frozen=True, eq=False)
class Groove(EitherWay):
    """A centre (of a sphere, or a point) that runs along an axis (of a cylinder, or a line) or around a circle.

    Pairs, either way round: cylinder or line, torus or circle, with sphere or point. The ball fills the groove: where
    it is smaller and lies on one side of it, that is a `Tangent` inside.
    """

    kind: ClassVar[str] = "groove"
    symbol: ClassVar[str] = "point"
    types: ClassVar = (Cylinder, Line, Torus, Circle, Sphere, Point)

    def pair(self, a: object, b: object) -> tuple[Equation, ...]:
        match a, b:
            case ((Cylinder() | Line()), (Sphere() | Point())):
                return (on_line(element(a.origin, a.axis), element(b.center)),)
            case ((Torus() | Circle()), (Sphere() | Point())):
                radius = a.major if isinstance(a, Torus) else a.radius
                ring, ball = element(a.center, a.axis), element(b.center)
                return on_plane(ring, ball), line_distance(ring, ball, radius)
        pair = f"a {type(a).__name__.lower()} and a {type(b).__name__.lower()}"
        raise GeometryError(f"groove: {pair} make none; give a groove or its centre line, and a ball", "features")
