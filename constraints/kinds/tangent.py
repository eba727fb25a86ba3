"""Surfaces that touch along a line or in a point."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.kinds.base import EitherWay
from constraints.kinds.equations import (
    Equation,
    aligned,
    angle,
    cone_distance,
    element,
    line_distance,
    lines_distance,
    on_plane,
    point_distance,
    rim_height,
    torus_distance,
)

MODES = ("outside", "inside", "crossed")


@dataclass(frozen=True, eq=False)
class Tangent(EitherWay):
    """Two surfaces in contact along a line or in a point.

    Pairs, either way round: plane with cylinder, cone (resting on its side), sphere or torus; cylinder with
    cylinder or sphere; cone or torus with sphere; sphere with sphere. `mode` is "outside", "inside" (the smaller one
    rolls in the larger one) or, for two cylinders, "crossed" (touching in a point at any angle between the axes).
    """

    kind: ClassVar[str] = "tangent"
    symbol: ClassVar[str] = "point"
    types: ClassVar = (Plane, Cone, Torus, Cylinder, Sphere)

    mode: str = "outside"

    def equations(self) -> tuple[Equation, ...]:
        if self.mode not in MODES:
            raise GeometryError(f"mode is {self.mode!r}; give one of {', '.join(MODES)}", "mode")
        return super().equations()

    def pair(self, a: object, b: object) -> tuple[Equation, ...]:
        match a, b:
            case Plane(), Cylinder():
                plane, axis = element(a.origin, a.normal), element(b.origin, b.axis)
                return angle(plane, axis, pi / 2), on_plane(plane, axis, b.radius)
            case Plane(), Sphere():
                return (on_plane(element(a.origin, a.normal), element(b.center), b.radius),)
            case Plane(), Cone():
                plane, axis = element(a.origin, a.normal), element(b.apex, b.axis)
                return angle(plane, axis, pi / 2 - b.half_angle), on_plane(plane, axis)
            case Plane(), Torus():
                return (rim_height(element(a.origin, a.normal), element(b.center, b.axis), b.major, b.minor),)
            case Cylinder(), Cylinder():
                first, second = element(a.origin, a.axis), element(b.origin, b.axis)
                if self.mode == "crossed":
                    return (lines_distance(first, second, a.radius + b.radius),)
                return aligned(first, second, 0), line_distance(first, second, self._gap(a.radius, b.radius))
            case Cylinder(), Sphere():
                gap = self._gap(a.radius, b.radius)
                return (line_distance(element(a.origin, a.axis), element(b.center), gap),)
            case Cone(), Sphere():
                gap = -b.radius if self.mode == "inside" else b.radius
                return (cone_distance(element(a.apex, a.axis), element(b.center), a.half_angle, gap),)
            case Torus(), Sphere():
                gap = self._gap(a.minor, b.radius)
                return (torus_distance(element(a.center, a.axis), element(b.center), a.major, gap),)
            case Sphere(), Sphere():
                return (point_distance(element(a.center), element(b.center), self._gap(a.radius, b.radius)),)
        pair = f"a {type(a).__name__.lower()} and a {type(b).__name__.lower()}"
        raise GeometryError(f"tangent: {pair} have no tangency that is defined; see docs/constraints.md", "features")

    def _gap(self, a: float, b: float) -> float:
        """Distance of the centres or axes."""
        if self.mode == "outside":
            return a + b
        if a == b:
            raise GeometryError(f"tangent inside: both radii are {a}; equal ones are concentric or spherical", "mode")
        return abs(a - b)
