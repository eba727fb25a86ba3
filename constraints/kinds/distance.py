"""Points, axes and planes at a distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from constraints.errors import GeometryError
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.kinds.base import Constraint
from constraints.kinds.elements import Circle, Line, Point, axis_of, plane_of, point_of
from constraints.kinds.equations import Equation, Limits, line_distance, lines_distance, on_plane, point_distance

_PLANE, _AXIS, _POINT = (Plane,), (Cylinder, Cone, Line, Torus, Circle), (Sphere, Point)


@dataclass(frozen=True, eq=False)
class Distance(Constraint):
    """Distance `at` (m), or within limits (low, high), of centres, axes and planes.

    Plane with point or sphere: signed height of the centre. Axis with point or sphere: distance from the axis. Axis
    with axis: along the common normal. Point with point: their distance. Two planes: see `Offset`.
    """

    kind: ClassVar[str] = "distance"

    at: Limits = 0.0

    def equations(self) -> tuple[Equation, ...]:
        low = self.at[0] if isinstance(self.at, tuple) else self.at
        a, b = (self.feature(i, *_PLANE, *_AXIS, *_POINT) for i in (0, 1))
        if isinstance(a, _POINT) and not isinstance(b, _POINT):
            return tuple(e.swap() for e in self._pair(1, 0, low))
        return self._pair(0, 1, low)

    def _pair(self, i: int, j: int, low: float) -> tuple[Equation, ...]:
        a, b = self.features[i], self.features[j]
        if isinstance(a, _PLANE) and isinstance(b, _POINT):
            return (on_plane(plane_of(self, i), point_of(self, j), self.at),)
        if low < 0.0:
            raise GeometryError(f"distance is {self.at}; give one that is not negative", "at")
        if isinstance(a, _AXIS) and isinstance(b, _POINT):
            return (line_distance(axis_of(self, i), point_of(self, j), self.at),)
        if isinstance(a, _AXIS) and isinstance(b, _AXIS):
            return (lines_distance(axis_of(self, i), axis_of(self, j), self.at, side=int(self.at == 0.0)),)
        if isinstance(a, _POINT) and isinstance(b, _POINT):
            if self.at == 0.0:
                raise GeometryError("distance of two points is 0; use Spherical", "at")
            return (point_distance(point_of(self, i), point_of(self, j), self.at),)
        raise GeometryError(f"distance of a {a.kind} and a {b.kind} is not defined; use Offset for planes", "features")
