"""A part about its main axis: the bands, flats and prisms that a turned, milled or pressed small part is made of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import SurfaceMesh
from constraints.geometry.features import Feature
from constraints.geometry.overlap import open_angle
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus, cross, norm, perpendicular
from constraints.geometry.threads import threaded

Array = NDArray[np.float64]

ALIKE = 0.01
"""rad, and over the radius: within it axes coincide, and planes are those of one prism"""
STEEPEST = 0.35
"""1: greatest pitch of a thread over its diameter: knurls are steeper"""
DEEPEST = 1.5
"""1: greatest depth of a thread over its pitch: walls of a recess in a head are deeper"""
LOOSE = 0.05
"""the same for the axis of a thread, which is fitted to its facets"""
WHOLE = 2.2
"""rad: greatest angle that a band leaves open and goes all round"""


def flat(points: Array, line: tuple[Array, Array]) -> tuple[Array, Array]:
    """Heights along a line and distances from it, m, of points (…, 3)."""
    away = points - line[0]
    heights = away @ line[1]
    return heights, np.linalg.norm(away - heights[..., None] * line[1], axis=-1)


def heights_radii(points: Array, about: Cylinder) -> tuple[Array, Array]:
    """Heights along an axis and distances from it (n,), m, of points (n, 3)."""
    return flat(points, (about.origin, about.axis))


def coaxial(feature: Feature, about: Cylinder, alike: float = ALIKE) -> bool:
    """Whether a round surface is one of revolution about an axis, within `alike` (rad, and over its radius)."""
    g = feature.geometry
    if not isinstance(g, Cylinder | Cone | Torus | Sphere):
        return False
    axis, point = about.axis if isinstance(g, Sphere) else g.axis, _point(g)
    aside = cross(point - about.origin, about.axis)
    return bool(norm(cross(axis, about.axis)) <= alike and norm(aside) <= alike * about.radius)


def prism(
    features: Iterable[Feature],
    about: Cylinder,
    side: int,
    corners: int = 6,
    bounds: tuple[float, float] = (0.0, np.inf),
) -> tuple[Feature, ...]:
    """Return the planes of a regular prism about an axis, nearest to the axis first; empty if there is none.

    side: 1 where they face away from the axis, as those of a nut, -1 where they face it, as those of a socket.
    bounds: m: least and greatest distance of the planes from the axis.
    """
    u = perpendicular(about.axis)
    frame = np.array([u, np.cross(about.axis, u)])
    found: list[tuple[float, float, Feature]] = []  # distance from the axis, direction in turns of 2π / corners
    for feature, geometry in _planes(features):
        if abs(float(geometry.normal @ about.axis)) > ALIKE:
            continue
        away = float((geometry.origin - about.origin) @ geometry.normal)
        if away * side > 0.0 and bounds[0] <= abs(away) <= bounds[1]:
            x, y = frame @ geometry.normal
            found.append((abs(away), float(np.arctan2(y, x)) * 0.5 * corners / np.pi, feature))
    found.sort(key=lambda row: row[0])
    for distance, turn, _ in found:
        alike = [(t - turn, f) for d, t, f in found if abs(d - distance) <= ALIKE * distance]
        of = {round(t) % corners: f for t, f in alike if abs(t - round(t)) <= ALIKE}
        if len(of) == corners:
            return tuple(of.values())
    return ()


def _planes(features: Iterable[Feature]) -> Iterator[tuple[Feature, Plane]]:
    for feature in features:
        if isinstance(feature.geometry, Plane):
            yield feature, feature.geometry


class Span(NamedTuple):
    """Heights along an axis and distances from it that a feature covers, m."""

    low: float
    high: float
    least: float
    most: float


@dataclass(frozen=True, eq=False)
class Band:
    """A surface of revolution about the axis."""

    feature: Feature
    low: float
    """m: least height"""
    high: float
    least: float
    """m: least distance from the axis"""
    most: float
    whole: bool
    """whether it goes all round"""

    @property
    def convex(self) -> bool:
        """Whether the material is inside."""
        return self.feature.sense > 0

    @property
    def cylinder(self) -> bool:
        """Whether it is a cylinder, or a thread."""
        return isinstance(self.feature.geometry, Cylinder)

    @property
    def length(self) -> float:
        """m, along the axis."""
        return self.high - self.low


@dataclass(frozen=True, eq=False)
class Profile:
    """A part about the axis that most of its round surfaces share."""

    about: Cylinder
    """axis, with the height 0 at its origin, and the greatest radius of the part"""
    points: Array
    """(n, 3) m: vertices of the part"""
    heights: Array
    """(n,) m, of them"""
    radii: Array
    """(n,) m"""
    bands: tuple[Band, ...]
    features: tuple[Feature, ...]
    pitches: dict[int, float]
    """m a turn: of the threads with real geometry, by their place among `features`"""
    _spans: dict[int, Span] = field(default_factory=dict, repr=False)

    @property
    def low(self) -> float:
        """m: least height."""
        return float(self.heights.min())

    @property
    def high(self) -> float:
        """m: greatest height."""
        return float(self.heights.max())

    @property
    def radius(self) -> float:
        """m: greatest distance from the axis."""
        return self.about.radius

    @property
    def height(self) -> float:
        """m: length of the part along the axis."""
        return self.high - self.low

    def span(self, feature: Feature) -> Span:
        """Return the heights and distances from the axis that a feature covers."""
        if id(feature) not in self._spans:
            h, r = heights_radii(feature.samples, self.about)
            self._spans[id(feature)] = Span(float(h.min()), float(h.max()), float(r.min()), float(r.max()))
        return self._spans[id(feature)]

    def apothem(self, planes: Sequence[Feature]) -> float:
        """Return the distance (m) of the planes of a prism from the axis."""
        g = planes[0].geometry
        return abs(float((g.origin - self.about.origin) @ g.normal)) if isinstance(g, Plane) else 0.0

    @property
    def shafts(self) -> list[Band]:
        """Cylinders and threads outside that go all round."""
        return [b for b in self.bands if b.convex and b.whole and b.cylinder]

    def has_pitch(self, band: Band) -> bool:
        """Whether a band is a thread with real geometry."""
        return any(self.features[k] is band.feature for k in self.pitches)

    @cached_property
    def bore(self) -> Band | None:
        """The narrowest cylinder inside that goes all round and most of the way through; None if it is solid."""
        inside = [b for b in self.bands if not b.convex and b.whole and b.cylinder and b.length >= 0.2 * self.height]
        return min((b for b in inside if b.least < 0.97 * self.radius), key=lambda b: b.least, default=None)

    @cached_property
    def hollow(self) -> bool:
        """Whether nothing is on the axis: no vertex or plane near it."""
        square = (f for f, g in _planes(self.features) if abs(float(g.normal @ self.about.axis)) > 0.99)
        return self.inner > 0.02 * self.radius and not any(covers_axis(f, self.about) for f in square)

    @cached_property
    def inner(self) -> float:
        """m: least distance of a vertex from the axis."""
        return float(self.radii.min())

    def with_threads(self, mesh: SurfaceMesh) -> Profile:
        """Return it with the threads of real geometry among its bands: freeform faces that slip along a screw about the
        axis."""
        if sum(len(f.surfaces) for f in self.features) == mesh.n_surfaces:
            return self
        features, found = threaded(mesh, self.features)
        threads, pitches = [], {}
        for k, pitch in found.items():
            thread = band_of(features[k], self.about)
            shallow = thread.most - thread.least <= DEEPEST * abs(pitch)
            if coaxial(features[k], self.about, LOOSE) and abs(pitch) <= STEEPEST * 2.0 * self.radius and shallow:
                threads.append(thread)
                pitches[k] = pitch
        return Profile(self.about, self.points, self.heights, self.radii, (*self.bands, *threads), features, pitches)

    def flipped(self) -> Profile:
        """Return it with the axis the other way round."""
        about = Cylinder(self.about.origin, -self.about.axis, self.about.radius)
        bands = tuple(Band(b.feature, -b.high, -b.low, b.least, b.most, b.whole) for b in self.bands)
        return Profile(about, self.points, -self.heights, self.radii, bands, self.features, self.pitches)


def covers_axis(feature: Feature, about: Cylinder) -> bool:
    """Whether a plane square to the axis is crossed by it."""
    u = perpendicular(about.axis)
    v = np.cross(about.axis, u)
    away = feature.samples - about.origin
    corners = np.stack([away @ u, away @ v], axis=1)[feature.triangles]  # (t, 3, 2)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    sides = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a))]
    slack = 1e-6 * about.radius**2
    same = np.all(np.array(sides) >= -slack, axis=0) | np.all(np.array(sides) <= slack, axis=0)
    return bool(same.any())


def main_axis(features: Sequence[Feature]) -> Cylinder | None:
    """Return the axis that the largest area of round features shares, None if none is round."""
    rounds = sorted((f for f in features if isinstance(f.geometry, Cylinder | Cone | Torus)), key=lambda f: -f.area)
    if not rounds:
        return None
    points = np.array([_point(f.geometry) for f in rounds])
    axes = np.array([f.geometry.axis for f in rounds if isinstance(f.geometry, Cylinder | Cone | Torus)])
    areas = np.array([f.area for f in rounds])
    left = np.ones(len(rounds), dtype=bool)
    best, most = 0, 0.0
    while areas[left].sum() > most:
        head = int(np.argmax(left))
        g = rounds[head].geometry
        radius = g.radius if isinstance(g, Cylinder) else float(np.ptp(rounds[head].samples, axis=0).max()) / 2.0
        aside = points - points[head]
        aside = aside - (aside @ axes[head])[:, None] * axes[head]
        along = np.abs(axes @ axes[head]) >= np.cos(ALIKE)
        same = left & along & (np.linalg.norm(aside, axis=1) <= ALIKE * radius)
        area = float(areas[same].sum())
        if area > most:
            best, most = head, area
        left &= ~same
        left[head] = False
    return Cylinder(points[best], axes[best], 1.0)


def _point(g: Geometry) -> Array:
    """A point (3,) on the axis of a round surface."""
    match g:
        case Cone():
            return g.apex
        case Torus() | Sphere():
            return g.center
        case Cylinder():
            return g.origin
    raise TypeError(f"a {g.kind} has no axis")


def profile(mesh: SurfaceMesh, features: Sequence[Feature], lopsided: float) -> Profile | None:
    """Return a part about its main axis; None if it has none, or is not central to it.

    lopsided: 1: greatest distance of the middle of its box from the axis, over its radius.
    """
    axis = main_axis(features)
    if axis is None:
        return None
    points = mesh.vertices
    u = perpendicular(axis.axis)
    local = (points - axis.origin) @ np.array([u, cross(axis.axis, u), axis.axis]).T
    middle = 0.5 * (local.min(axis=0) + local.max(axis=0))  # of the box in the axis' own frame
    radii = np.hypot(local[:, 0], local[:, 1])
    about = Cylinder(axis.origin + middle[2] * axis.axis, axis.axis, max(float(radii.max()), 1e-9))
    if float(np.hypot(middle[0], middle[1])) > lopsided * about.radius:
        return None
    heights = local[:, 2] - middle[2]
    bands = tuple(band_of(f, about) for f in features if coaxial(f, about))
    return Profile(about, points, heights, radii, bands, tuple(features), {})


def band_of(feature: Feature, about: Cylinder) -> Band:
    """Return a feature as a band about an axis."""
    h, r = heights_radii(feature.samples, about)
    whole = open_angle(feature.samples, about.origin, about.axis) <= WHOLE
    return Band(feature, float(h.min()), float(h.max()), float(r.min()), float(r.max()), whole)
