"""Fast rejection of pairs of features that cannot match, by array operations; most pairs of neighbours are such.

Each test is a necessary condition of a rule in `constraints.recognition.pairings`, weakened by `ROUNDING`. Pairs that
pass are measured by the rule itself, so that the filter never changes a result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from constraints.geometry.surfaces import Cone, Cylinder, Plane, Sphere, Torus
from constraints.geometry.views import CLEARANCE_HOLE, Extent, Limits
from constraints.recognition.pairings import PAIRINGS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ROUNDING = 1e-9
"""m, rad, and 1 per 1e3 m of the greatest coordinate"""
PLANE, CYLINDER, CONE = range(3)
TYPES = (Plane, Cylinder, Cone, Sphere, Torus)
MATCHED = np.array(
    [
        [[[any(row.fits_types((p, s), (q, t)) or row.fits_types((q, t), (p, s)) for row in PAIRINGS)
           for t in (1, -1)] for q in TYPES] for s in (1, -1)] for p in TYPES
    ]
)  # fmt: skip
"""(type, 0 solid or 1 hollow, type, 0 or 1): whether a row of the table applies to the two features"""


class Placed(NamedTuple):
    """n features in one frame."""

    type: NDArray[np.int64]
    """(n,) places in `TYPES`"""
    hollow: NDArray[np.int64]
    """(n,) 0 or 1"""
    origin: Array
    """(n, 3) origin, apex or centre, m"""
    axis: Array
    """(n, 3) normal or axis; zero for a sphere"""
    size: Array
    """(n,) radius, m, or half angle of a cone, rad"""
    middle: Array
    """(n,) height along the axis of the middle of the faces, m"""
    half: Array
    """(n,) half the length of the faces along the axis, m"""
    center: Array
    """(n, 3) centre of a ball that contains the faces"""
    radius: Array
    """(n,) m: its radius"""
    off: Array
    """(n,) greatest distance of the samples from the surface, m"""

    @classmethod
    def of(cls, extents: list[Extent]) -> Placed:
        """Return the features of extents, each in the frame of its own body."""
        rows = []
        for extent in extents:
            feature = extent.feature
            g: Any = feature.geometry
            origin = g.apex if isinstance(g, Cone) else g.center if isinstance(g, Sphere | Torus) else g.origin
            axis = g.normal if isinstance(g, Plane) else getattr(g, "axis", np.zeros(3))
            size = g.half_angle if isinstance(g, Cone) else getattr(g, "radius", 0.0)
            low, high = float(extent.spans[0, 0]), float(extent.spans[-1, 1])
            away = feature.samples - extent.center
            radius = np.sqrt(np.einsum("ij,ij->i", away, away).max())
            rows.append(
                (TYPES.index(type(g)), feature.sense < 0, *origin, *axis, size,
                 0.5 * (low + high), 0.5 * (high - low), *extent.center, radius, feature.residual)
            )  # fmt: skip
        t = np.array(rows, np.float64).reshape(-1, 16)
        type_, hollow = t[:, :2].astype(np.int64).T
        return cls._make((type_, hollow, t[:, 2:5], t[:, 5:8], *t[:, 8:11].T, t[:, 11:14], *t[:, 14:].T))

    def moved(self, rotations: Array, translations: Array) -> Placed:
        """Return the features after motions (n, 3, 3), (n, 3)."""

        def turned(vectors: Array) -> Array:
            return np.einsum("nij,nj->ni", rotations, vectors)

        center = turned(self.center) + translations
        return self._replace(origin=turned(self.origin) + translations, axis=turned(self.axis), center=center)

    def at(self, places: NDArray[np.int64]) -> Placed:
        """Return the features at some indices."""
        return Placed._make(column[places] for column in self)


class Bounds(NamedTuple):
    """Limits of a match, rounding included."""

    linear: float
    """m, on offsets and gaps"""
    angular: float
    """rad"""
    sine: float
    """1: of `angular`"""
    beyond: float
    """m: greatest distance, along their axis, of two features that share no length"""
    limits: Limits
    clearance: float
    """m, radial: that of the loosest thread"""


def may_match(a: Placed, b: Placed, limits: Limits, clearance: float = 0.0) -> Mask:
    """Return (n,) bool: whether two features may match within the limits; False is certain.

    a, b: first and second features of n pairs, in the world. clearance: radial clearance of the loosest thread, m.
    """
    out = np.asarray(MATCHED[a.type, a.hollow, b.type, b.hollow])
    if not (np.isfinite(limits.linear) and np.isfinite(limits.overlap)):
        return out
    rounding = ROUNDING * (1.0 + 1e-3 * max(np.abs(x).max(initial=0.0) for p in (a, b) for x in (p.origin, p.center)))
    angular = min(limits.angular, 0.5 * np.pi)
    bounds = Bounds(
        limits.linear + rounding, angular + ROUNDING, float(np.sin(angular)) + ROUNDING,
        max(0.0, -limits.overlap) + rounding, limits, clearance,
    )  # fmt: skip
    for (one, other), rule in RULES.items():
        for first, second in ((a, b),) if one == other else ((a, b), (b, a)):
            k = np.flatnonzero(out & (first.type == one) & (second.type == other))
            if len(k):
                out[k] = rule(first.at(k), second.at(k), bounds)
    return out


def _dot(u: Array, v: Array) -> Array:
    return np.einsum("ij,ij->i", u, v)


def _aside(vectors: Array, axes: Array) -> Array:
    """(n,) lengths of the components of vectors perpendicular to unit axes."""
    return np.linalg.norm(np.cross(vectors, axes), axis=1)


def _midpoint(p: Placed) -> Array:
    return p.origin + p.middle[:, None] * p.axis


def _reach_each_other(a: Placed, b: Placed, bounds: Bounds) -> Mask:
    """Whether the faces of both features may reach the place where their surfaces touch: each within twice its
    deflection, `linear` and the gap."""
    deflections = sum(_deflection(p) + p.off for p in (a, b))
    return np.linalg.norm(a.center - b.center, axis=1) <= a.radius + b.radius + 2.0 * deflections + 4.0 * bounds.linear


def _deflection(p: Placed) -> Array:
    """(n,) m: upper bound of the distance of facets' centroids from their surface, apart from `off`."""
    return np.where(p.type == CONE, p.radius, np.minimum(p.radius, p.size))  # 0 for planes, of size 0


def _planes(p: Placed, q: Placed, bounds: Bounds) -> Mask:
    """Against: the planes face each other, are near, and overlap along the normal of the first."""
    sine, apart = _aside(p.axis, q.axis), q.center - p.center
    height = _dot(apart, p.axis)
    off = 3.0 * (p.off + q.off)
    beside = np.sqrt(np.maximum(_dot(apart, apart) - height * height, 0.0))
    return (
        (_dot(p.axis, q.axis) < 0.0)
        & (sine <= bounds.sine)
        & (np.abs(height) <= bounds.linear + q.radius * sine + off)
        & (beside <= p.radius + q.radius + bounds.linear)
    )


def _plane_cylinder(p: Placed, c: Placed, bounds: Bounds) -> Mask:
    """Tangent: small gap at the middle of the line, which ends at most `_stray` beyond the faces."""
    sine = np.abs(_dot(c.axis, p.axis))
    gap = _dot(_midpoint(c) - p.origin, p.axis) - c.size
    near = np.abs(gap) <= bounds.linear + sine * (c.half + _stray(c, bounds))
    return (sine <= bounds.sine) & near & _reach_each_other(p, c, bounds)


def _stray(c: Placed, bounds: Bounds) -> Array:
    """(n,) m: greatest distance beyond a cylinder's faces of a point that counts as reached."""
    return 2.0 * (_deflection(c) + c.off + bounds.linear)


def _plane_cone(p: Placed, c: Placed, bounds: Bounds) -> Mask:
    lean = np.arcsin(np.clip(_dot(c.axis, p.axis), -1.0, 1.0))
    near = np.abs(_dot(c.origin - p.origin, p.axis)) <= bounds.linear
    return near & (np.abs(lean - c.size) <= bounds.angular + 1e-7) & _reach_each_other(p, c, bounds)


def _cylinders(a: Placed, b: Placed, bounds: Bounds) -> Mask:
    """Concentric, screw, or tangent along a line or at crossed axes."""
    solid, other = _chosen(b.hollow == 1, a, b), _chosen(b.hollow == 1, b, a)  # of two solid ones the second is `solid`
    hollow = other.hollow == 1
    cross = np.cross(solid.axis, other.axis)
    sine = np.linalg.norm(cross, axis=1)
    shift = solid.origin - other.origin
    aside = _aside(shift + solid.middle[:, None] * solid.axis, other.axis)
    slant = 1.2 * sine  # of an axis at most 0.5 rad off, along the other
    air = other.size - solid.size
    gap = np.where(hollow, air - aside, aside - other.size - solid.size)
    stray = slant * (solid.half + _stray(solid, bounds))
    tangent = (sine <= min(0.1 + ROUNDING, bounds.sine)) & (np.abs(gap) <= bounds.linear + stray)
    crossed = np.abs(_dot(shift, cross)) - (other.size + solid.size) * sine
    tangent |= ~hollow & (sine >= 0.1 - ROUNDING) & (np.abs(crossed) <= bounds.linear * sine + ROUNDING * sine)
    tangent &= _reach_each_other(a, b, bounds)
    limits = bounds.limits
    loosest = np.minimum(limits.relative * 2.0 * solid.size, CLEARANCE_HOLE)
    loosest = np.maximum(max(limits.clearance, bounds.clearance), loosest) + limits.slack + ROUNDING
    sign = np.where(_dot(solid.axis, other.axis) >= 0.0, 1.0, -1.0)
    along = np.abs(_dot(shift, other.axis) + sign * solid.middle - other.middle)
    tilt = slant * (solid.half + bounds.beyond) + np.abs(solid.middle) * sine**3
    off_axis = aside - tilt > bounds.linear + np.maximum(air, 0.0)
    fits = hollow & (air <= loosest) & (sine <= bounds.sine) & ~((sine < 0.45) & off_axis)
    return tangent | (fits & (along <= solid.half + other.half + bounds.beyond))


def _chosen(where: Mask, a: Placed, b: Placed) -> Placed:
    """The features of a where the mask (n,) is True, else those of b."""
    both = zip(a, b, strict=True)
    return Placed._make(np.where(where[:, None] if x.ndim == 2 else where, x, y) for x, y in both)


RULES: dict[tuple[int, int], Callable[[Placed, Placed, Bounds], Mask]] = {
    (PLANE, PLANE): _planes,
    (PLANE, CYLINDER): _plane_cylinder,
    (PLANE, CONE): _plane_cone,
    (CYLINDER, CYLINDER): _cylinders,
}
"""necessary conditions by types; pairs of other types, which are few, always pass"""
