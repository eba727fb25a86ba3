"""Analytic surfaces: plane, cylinder, cone, sphere, torus, and freeform for the rest.

All are values in some frame (a part's, unless said otherwise). `distance(points)` is the signed orthogonal
distance in metres, positive on the side the natural normal points to (away from axis or centre).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite, sqrt
from typing import Self

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints.errors import GeometryError

Vector = NDArray[np.float64]
LARGEST = 1e15
"""m: lengths and coordinates beyond it are refused (a tenth of a light year): their squares would swamp all others"""


PLACES = ("origin", "apex", "center")
"""fields that are points"""
DIRECTIONS = ("axis", "normal", "direction")
"""fields of which only the direction counts"""


def _vector(value: ArrayLike, field: str) -> Vector:
    try:
        v = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise GeometryError(f"{field} is {value!r}; give three finite numbers", field) from None
    if v.shape != (3,) or not all(map(isfinite, v.tolist())):
        raise GeometryError(f"{field} is {value!r}; give three finite numbers", field)
    if field not in DIRECTIONS and max(map(abs, v.tolist())) > LARGEST:
        raise GeometryError(f"{field} is {value!r}; give coordinates of at most {LARGEST:g} m", field)
    v.setflags(write=False)
    return v


def _direction(value: ArrayLike, field: str) -> Vector:
    v = _vector(value, field)
    largest = max(map(abs, v.tolist()))
    if largest == 0.0:
        raise GeometryError(f"{field} is the zero vector; give a direction", field)
    v = v / largest  # before its square overflows or vanishes
    v = v / norm(v)
    v.setflags(write=False)
    return v


def _positive(value: float, field: str) -> float:
    try:
        x = float(value)
    except (TypeError, ValueError):
        raise GeometryError(f"{field} is {value!r}; give a positive number", field) from None
    if not (np.isfinite(x) and x > 0.0):
        raise GeometryError(f"{field} is {value!r}; give a positive number", field)
    if x > LARGEST:
        raise GeometryError(f"{field} is {value!r}; give one of at most {LARGEST:g}", field)
    return x


def norm(v: Vector) -> float:
    """The length of a vector (n,), as `np.linalg.norm` has it to the bit, in a fraction of its time."""
    return sqrt(v @ v)


def cross(u: Vector, v: Vector) -> Vector:
    """The product of two vectors (3,), as `np.cross` has it to the bit, in a fraction of its time."""
    (a, b, c), (x, y, z) = u.tolist(), v.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


@dataclass(frozen=True, eq=False)
class Geometry:
    """An analytic surface. Subclasses are frozen values; compare by their fields.

    Fields named in `PLACES` are points (3,) in m, those in `DIRECTIONS` are made unit vectors (3,), all others are
    positive numbers. GeometryError says which field is none.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            read = _vector if field.name in PLACES else _direction if field.name in DIRECTIONS else _positive
            object.__setattr__(self, field.name, read(getattr(self, field.name), field.name))

    @property
    def kind(self) -> str:
        """Lower-case name of the type: "plane", "cylinder", …"""
        return type(self).__name__.lower()

    def distance(self, points: ArrayLike) -> Vector:
        """Signed orthogonal distances (n,) in metres of `points` (n, 3)."""
        raise GeometryError(f"a {self.kind} surface has no closed-form distance")

    def normals(self, points: ArrayLike) -> Vector:
        """Unit gradients of `distance` (n, 3) at `points` (n, 3)."""
        raise GeometryError(f"a {self.kind} surface has no closed-form normal")

    def transformed(self, pose: pin.SE3) -> Self:
        """The same surface seen from the frame that `pose` maps into."""
        changed = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in PLACES:
                value = pose.act(np.array(value))
            elif field.name in DIRECTIONS:
                value = pose.rotation @ value
            changed[field.name] = value
        return type(self)(**changed)


@dataclass(frozen=True, eq=False)
class Plane(Geometry):
    """Points p with normal·(p - origin) = 0. On a part, `normal` points out of the material."""

    origin: Vector
    normal: Vector

    def distance(self, points: ArrayLike) -> Vector:
        return (np.atleast_2d(points) - self.origin) @ self.normal

    def normals(self, points: ArrayLike) -> Vector:
        return np.broadcast_to(self.normal, np.atleast_2d(points).shape).copy()


def _radial(points: ArrayLike, origin: Vector, axis: Vector) -> tuple[Vector, Vector, Vector]:
    """Height along the axis (n,), radial unit vectors (n, 3) and radii (n,); on the axis any unit vector serves."""
    q = np.atleast_2d(points) - origin
    height = q @ axis
    r = q - height[:, None] * axis
    rho = np.linalg.norm(r, axis=1)
    if rho.all():
        return height, r / rho[:, None], rho
    unit = np.divide(r, rho[:, None], out=np.broadcast_to(perpendicular(axis), r.shape).copy(), where=rho[:, None] > 0)
    return height, unit, rho


def perpendicular(axis: ArrayLike) -> Vector:
    """A unit vector (3,) at right angles to `axis`, the same one each time."""
    a = np.asarray(axis, dtype=np.float64)
    x, y, z = a.tolist()
    least = min((abs(x), 0), (abs(y), 1), (abs(z), 2))[1]
    p = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[least])  # a times that unit vector
    return p / norm(p)


@dataclass(frozen=True, eq=False)
class Cylinder(Geometry):
    """Points at `radius` from the line through `origin` along `axis`."""

    origin: Vector
    axis: Vector
    radius: float

    def distance(self, points: ArrayLike) -> Vector:
        return _radial(points, self.origin, self.axis)[2] - self.radius

    def normals(self, points: ArrayLike) -> Vector:
        return _radial(points, self.origin, self.axis)[1]


@dataclass(frozen=True, eq=False)
class Cone(Geometry):
    """One nappe: points p whose direction from `apex` makes `half_angle` (rad, in (0, π/2)) with `axis`."""

    apex: Vector
    axis: Vector
    half_angle: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.half_angle >= np.pi / 2:
            raise GeometryError(f"half_angle is {self.half_angle}; give one below π/2", "half_angle")

    def distance(self, points: ArrayLike) -> Vector:
        height, _, rho = _radial(points, self.apex, self.axis)
        c, s = np.cos(self.half_angle), np.sin(self.half_angle)
        beyond = height * c + rho * s < 0  # nearest point of the nappe is the apex itself
        return np.where(beyond, np.hypot(height, rho), rho * c - height * s)

    def normals(self, points: ArrayLike) -> Vector:
        _, unit, _ = _radial(points, self.apex, self.axis)
        return unit * np.cos(self.half_angle) - self.axis * np.sin(self.half_angle)


@dataclass(frozen=True, eq=False)
class Sphere(Geometry):
    """Points at `radius` from `center`."""

    center: Vector
    radius: float

    def distance(self, points: ArrayLike) -> Vector:
        return np.linalg.norm(np.atleast_2d(points) - self.center, axis=1) - self.radius

    def normals(self, points: ArrayLike) -> Vector:
        q = np.atleast_2d(points) - self.center
        length = np.linalg.norm(q, axis=1)[:, None]
        return np.divide(q, length, out=np.tile([0.0, 0.0, 1.0], (len(q), 1)), where=length > 0)


@dataclass(frozen=True, eq=False)
class Torus(Geometry):
    """Points at `minor` from the circle of radius `major` about `axis` through `center`."""

    center: Vector
    axis: Vector
    major: float
    minor: float

    def distance(self, points: ArrayLike) -> Vector:
        height, _, rho = _radial(points, self.center, self.axis)
        return np.hypot(rho - self.major, height) - self.minor

    def normals(self, points: ArrayLike) -> Vector:
        height, unit, rho = _radial(points, self.center, self.axis)
        n = (rho - self.major)[:, None] * unit + height[:, None] * self.axis
        length = np.linalg.norm(n, axis=1)[:, None]
        return np.divide(n, length, out=unit.copy(), where=length > 0)


@dataclass(frozen=True, eq=False)
class Freeform(Geometry):
    """A surface with no analytic type; only its triangles are known."""
