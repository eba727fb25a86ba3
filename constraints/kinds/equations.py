"""The equations as kinds write them: elements (a point and a frame) and one constructor an equation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from constraints.errors import GeometryError
from constraints.geometry.surfaces import cross, norm, perpendicular
from constraints.solve import jacobians

Array = NDArray[np.float64]
Limits = float | tuple[float, float]
"""what a scalar equals, or the interval it stays in (ends may be infinite)"""


def element(point: ArrayLike, direction: ArrayLike | None = None, reference: ArrayLike | None = None) -> Array:
    """A point and an orthonormal frame (E1, E2, D) by rows, (12,): what an equation needs of one body.

    `direction` is D; `reference`, where given, lies on the E1 side of it.
    """
    d = np.array([0.0, 0.0, 1.0]) if direction is None else np.asarray(direction, dtype=np.float64)
    d = d / norm(d)
    e1 = perpendicular(d) if reference is None else np.asarray(reference, dtype=np.float64)
    e1 = e1 - (e1 @ d) * d
    size = norm(e1)
    if size < 1e-9:
        raise GeometryError("reference is along the axis; give a direction at an angle to it", "reference")
    e1 = e1 / size
    return np.concatenate([np.asarray(point, dtype=np.float64), e1, cross(d, e1), d])


@dataclass(frozen=True, eq=False)
class Equation:
    """One equation of `constraints.solve.jacobians` between element `a` and element `b`, both (12,)."""

    code: int
    a: Array
    b: Array
    params: tuple[float, ...] = ()
    swapped: bool = False
    """whether `a` is on the constraint's second body and `b` on its first"""
    holds: bool = True
    """False where the equation only bounds (its limits differ)"""

    @property
    def rows(self) -> int:
        """Number of rows."""
        return jacobians.ROWS[self.code]

    def swap(self) -> Equation:
        """The same equation with `a` on the other body."""
        return replace(self, swapped=not self.swapped)


def _bounded(code: int, a: Array, b: Array, at: Limits, *extra: float) -> Equation:
    try:
        low, high = map(float, at) if isinstance(at, tuple) else (float(at), float(at))
    except (TypeError, ValueError):
        raise GeometryError(f"limits are {at!r}; give a number, or a pair (low, high)", "limits") from None
    if not low <= high:
        raise GeometryError(f"limits are ({low}, {high}); give the lower one first", "limits")
    return Equation(code, a, b, (low, high, *extra), holds=low == high)


def coincident(a: Array, b: Array) -> Equation:
    """Both points are one."""
    return Equation(jacobians.COINCIDENT, a, b)


def on_line(a: Array, b: Array) -> Equation:
    """Point b is on the axis of a."""
    return Equation(jacobians.ON_LINE, a, b)


def aligned(a: Array, b: Array, sense: int) -> Equation:
    """Directions are parallel (+1), opposed (-1), or whichever is nearer (0)."""
    if sense not in (-1, 0, 1):
        raise GeometryError(f"sense is {sense!r}; give 1 (parallel), -1 (opposed) or 0 (the nearer)", "sense")
    return Equation(jacobians.ALIGNED, a, b, (float(sense),))


def oriented(a: Array, b: Array) -> Equation:
    """Both frames have one orientation."""
    return Equation(jacobians.ORIENTED, a, b)


def on_plane(a: Array, b: Array, at: Limits = 0.0) -> Equation:
    """Height of point b over the plane a."""
    return _bounded(jacobians.ON_PLANE, a, b, at)


def angle(a: Array, b: Array, at: Limits) -> Equation:
    """Angle between the directions, 0 … π."""
    return _bounded(jacobians.ANGLE, a, b, at)


def point_distance(a: Array, b: Array, at: Limits) -> Equation:
    """Distance between the points."""
    return _bounded(jacobians.POINT_DISTANCE, a, b, at)


def line_distance(a: Array, b: Array, at: Limits) -> Equation:
    """Distance of point b from the axis of a."""
    return _bounded(jacobians.LINE_DISTANCE, a, b, at)


def lines_distance(a: Array, b: Array, at: Limits, side: int = 0) -> Equation:
    """Distance of the axes along their common normal, on `side` of a (0: the side they are on)."""
    return _bounded(jacobians.LINES_DISTANCE, a, b, at, float(side))


def cone_distance(a: Array, b: Array, half_angle: float, at: Limits) -> Equation:
    """Distance of point b from the cone of a, positive outside."""
    return _bounded(jacobians.CONE_DISTANCE, a, b, at, half_angle)


def torus_distance(a: Array, b: Array, major: float, at: Limits) -> Equation:
    """Distance of point b from the circle of radius `major` about the axis of a."""
    return _bounded(jacobians.TORUS_DISTANCE, a, b, at, major)


def rim_height(a: Array, b: Array, radius: float, at: Limits) -> Equation:
    """Height over plane a of the lowest point of the circle of `radius` about the axis of b."""
    return _bounded(jacobians.RIM_HEIGHT, a, b, at, radius)


def helix(a: Array, b: Array, pitch: float, phase: float) -> Equation:
    """b advances `pitch` along the axis of a for each turn about it."""
    return Equation(jacobians.HELIX, a, b, (pitch, phase))


def mesh(a: Array, b: Array, teeth_a: int, teeth_b: int, sense: int, phase: float) -> Equation:
    """teeth_a turns of a and sense · teeth_b turns of b, from the line of centres, cancel."""
    return Equation(jacobians.MESH, a, b, (float(teeth_a), float(teeth_b), float(sense), phase))


def rack(a: Array, b: Array, radius: float, teeth: int, sense: int, phase: float) -> Equation:
    """b travels sense · radius along its direction for each radian that a turns."""
    return Equation(jacobians.RACK, a, b, (radius, float(teeth), float(sense), phase))
