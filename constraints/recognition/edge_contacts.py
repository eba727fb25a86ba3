"""Contacts in an edge or a vertex, and flush faces: candidates for an assembly as drawn, on request.

For two features that touch but neither fit nor are tangent, the boundary of each is compared with the surface of the
other. Contacts that a better candidate of the same two bodies implies are left out: the edges of a box on a plate touch
it too, but the contact of the planes implies that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.geometry.reach import Array, deflection, reached
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Vector
from constraints.geometry.views import FeatureView, Limits
from constraints.geometry.words import millimetres
from constraints.kinds.elements import Circle, Line, Point
from constraints.recognition.candidate import Match, Pair

CORNER = 0.7
"""rad: an edge that turns by less is part of a polygon that approximates a curve, not a corner"""
CROSSING = 0.1
"""1: sine of the least angle between crossing edges"""


@dataclass(frozen=True, eq=False)
class EdgeContact:
    """An edge, a rim or a vertex in contact, or two flush faces."""

    kind: str
    features: tuple[Geometry, Geometry]
    """elements in contact, of body a and of body b, world frame"""
    points: Array
    """(k, 3) world: the ends of the edge, or the point"""
    gap: float
    """m: greatest distance over the points"""
    normal: Vector
    """(3,) world: direction in which body a would move deeper"""
    words: str
    slack: float
    """m: accuracy of the place, limited by the facets"""

    @property
    def length(self) -> float:
        """m; 0 for a point."""
        return float(np.linalg.norm(self.points[-1] - self.points[0]))


def coplanar(a: FeatureView, b: FeatureView, limits: Limits) -> EdgeContact | None:
    """Contact of two planes with one outward direction in one plane, whose faces meet along an edge; None if not."""
    p, q = a.geometry, b.geometry
    if not (isinstance(p, Plane) and isinstance(q, Plane)) or p.normal @ q.normal <= 0.0:
        return None
    if float(np.linalg.norm(np.cross(p.normal, q.normal))) > limits.angular:
        return None
    heights = [p.distance(b.triangles.reshape(-1, 3)), q.distance(a.triangles.reshape(-1, 3))]
    gap = float(max(np.abs(h).max() for h in heights))
    if gap > limits.slack:
        return None
    points = _shared(a.sides, b.sides, limits.slack)
    if not len(points) or np.linalg.norm(points[-1] - points[0]) <= limits.strip:
        return None
    length = float(np.linalg.norm(points[-1] - points[0]))
    words = f"planes lie flush, {millimetres(gap)} off, and meet over {millimetres(length)}"
    return EdgeContact("coplanar", (p, q), points, gap, p.normal, words, limits.slack)


def _shared(first: Array, second: Array, slack: float) -> Array:
    """The two farthest points (2, 3) of the overlap of two sets of sides (k, 2, 3); (0, 3) without overlap."""
    points = [np.zeros((0, 3))]
    for start, end in first:
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        q = second - start
        heights = q @ along
        off = np.linalg.norm(q - heights[:, :, None] * along, axis=2).max(axis=1)
        low, high = np.maximum(heights.min(axis=1), 0.0), np.minimum(heights.max(axis=1), length)
        both = (off <= slack) & (high > low + slack)
        points += [start + low[both, None] * along, start + high[both, None] * along]
    return _farthest(np.concatenate(points))


def _farthest(points: Array) -> Array:
    """(2, 3) two points far apart: the ends, if the points lie on a line."""
    if not len(points):
        return points
    one = points[int(np.argmax(np.linalg.norm(points - points[0], axis=1)))]
    other = points[int(np.argmax(np.linalg.norm(points - one, axis=1)))]
    return np.array([one, other]) if tuple(one) <= tuple(other) else np.array([other, one])


def on_surface(edged: FeatureView, carrier: FeatureView, limits: Limits) -> EdgeContact | None:
    """Contact of an edge or a rim with a plane, or of a vertex with any surface; the first feature has the edge."""
    surface, segments = carrier.geometry, edged.sides
    if not len(segments):
        return None
    triangles = carrier.triangles
    slack = limits.slack + 2.0 * deflection(surface, triangles)
    ends = segments.reshape(-1, 3)
    off = np.abs(surface.distance(ends))
    near = off <= limits.slack
    near[near] = reached(ends[near], triangles, slack)
    if not near.any():
        return None
    gap, points = float(off[near].max()), _farthest(ends[near])
    middle = points.mean(axis=0)
    normal = np.asarray(surface.normals(middle)[0]) * -carrier.feature.sense
    across = np.linalg.norm(np.cross(ends[near] - points[0], points[-1] - points[0]), axis=1)
    length = float(np.linalg.norm(points[-1] - points[0]))
    round_edge = isinstance(edged.geometry, Cylinder | Cone)
    if isinstance(surface, Plane) and length > 10.0 * limits.slack:
        if across.max() > limits.slack * length or round_edge or _chord(points, segments):
            return None
        line = Line(middle, points[1] - points[0])
        words = f"an edge lies in a plane along {millimetres(length)}, {millimetres(gap)} off"
        return EdgeContact("contact", (line, surface), points, gap, normal, words, slack)
    if length > 10.0 * limits.slack:
        return None
    if round_edge and isinstance(surface, Plane):
        rim = _rim(edged.geometry, middle)
        words = f"a rim Ø{2e3 * rim.radius:.6g} mm stands on a plane, {millimetres(gap)} off"
        return EdgeContact("contact", (rim, surface), middle[None], gap, normal, words, slack)
    if not _corner(middle, segments, limits.slack):
        return None
    words = f"a vertex touches a {surface.kind}, {millimetres(gap)} off"
    return EdgeContact("contact", (Point(middle), surface), middle[None], gap, normal, words, slack)


def _rim(surface: Cylinder | Cone, point: Vector) -> Circle:
    """The circle about its axis through a point."""
    start = surface.origin if isinstance(surface, Cylinder) else surface.apex
    foot = start + ((point - start) @ surface.axis) * surface.axis
    return Circle(foot, surface.axis, float(np.linalg.norm(point - foot)))


def _at(point: Vector, segments: Array, slack: float) -> Array:
    """(k, 3) unit directions of the boundary's sides that start at one of its vertices."""
    out = []
    for one, other in ((0, 1), (1, 0)):
        here = np.linalg.norm(segments[:, one] - point, axis=1) <= slack
        out.append(segments[here, other] - segments[here, one])
    away = np.concatenate(out)
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def _corner(point: Vector, segments: Array, slack: float) -> bool:
    """Whether the boundary turns sharply at this vertex."""
    away = _at(point, segments, slack)
    return len(away) == 2 and float(np.arccos(np.clip(-away[0] @ away[1], -1.0, 1.0))) > CORNER


def _chord(points: Array, segments: Array) -> bool:
    """Whether an edge is one side of a polygon that approximates a curve: it turns little at both its ends."""
    length = float(np.linalg.norm(points[1] - points[0]))
    turns = []
    for point in points:
        away = _at(point, segments, 1e-6 * length)
        if len(away) == 2:
            turns.append(float(np.arccos(np.clip(-away[0] @ away[1], -1.0, 1.0))))
    return bool(turns) and max(turns) <= CORNER


def crossing(a: FeatureView, b: FeatureView, limits: Limits) -> EdgeContact | None:
    """Contact of two straight edges that cross, or of a straight edge across a shaft, in a point inside both."""
    for first, second in ((a, b), (b, a)):
        if isinstance(first.geometry, Cylinder) and isinstance(second.geometry, Plane) and first.feature.sense > 0:
            found = _across_shaft(first, second, limits)
            if found is not None:
                return found if first is a else _swapped(found)
    if not (isinstance(a.geometry, Plane) and isinstance(b.geometry, Plane)):
        return None
    s, t = _within(a.sides, b.sides, limits.slack), _within(b.sides, a.sides, limits.slack)
    u, v, w = s[:, 1] - s[:, 0], t[:, 1] - t[:, 0], t[None, :, 0] - s[:, None, 0]
    n = np.cross(u[:, None], v[None])
    size = np.linalg.norm(n, axis=2)
    lengths = np.linalg.norm(u, axis=1)[:, None], np.linalg.norm(v, axis=1)[None]
    cross = size > CROSSING * lengths[0] * lengths[1]
    square = np.where(cross, size, 1.0) ** 2
    x = np.einsum("ijk,ijk->ij", np.cross(w, v[None]), n) / square
    y = np.einsum("ijk,ijk->ij", np.cross(w, u[:, None]), n) / square
    gap = np.abs(np.einsum("ijk,ijk->ij", w, n)) / np.sqrt(square)
    inside = _inside(x, lengths[0], limits.slack) & _inside(y, lengths[1], limits.slack)
    for i, j in np.argwhere(cross & inside & (gap <= limits.slack))[:1]:
        normal = n[i, j] / size[i, j] * (1.0 if n[i, j] @ (b.center - a.center) >= 0.0 else -1.0)
        one, other = s[i, 0] + x[i, j] * u[i], t[j, 0] + y[i, j] * v[j]
        words = f"two edges cross, {millimetres(gap[i, j])} apart"
        lines = Line(one, u[i]), Line(other, v[j])
        return EdgeContact("contact", lines, one[None], float(gap[i, j]), normal, words, limits.slack)
    return None


def _within(sides: Array, others: Array, slack: float) -> Array:
    """The sides (k, 2, 3) whose boxes overlap the box of the others."""
    low, high = others.min(axis=(0, 1)) - slack, others.max(axis=(0, 1)) + slack
    return sides[((sides.max(axis=1) >= low) & (sides.min(axis=1) <= high)).all(axis=1)]


def _inside(s: Array, length: Array, slack: float) -> NDArray[np.bool_]:
    """Whether points at s (fraction of the length) lie between the ends of a side, and on neither."""
    margin = 10.0 * slack / length
    return (margin < s) & (s < 1.0 - margin)


def _across_shaft(shaft: FeatureView[Cylinder], edged: FeatureView, limits: Limits) -> EdgeContact | None:
    g = shaft.geometry
    sides, triangles = edged.sides, shaft.triangles
    slack = limits.slack + 2.0 * deflection(g, triangles)
    u, w = sides[:, 1] - sides[:, 0], sides[:, 0] - g.origin
    n = np.cross(g.axis, u)
    size, length = np.linalg.norm(n, axis=1), np.linalg.norm(u, axis=1)
    cross = size > CROSSING * length
    square = np.where(cross, size, 1.0) ** 2
    x = np.einsum("ij,ij->i", np.cross(w, g.axis), n) / square
    height = np.einsum("ij,ij->i", w, n) / np.sqrt(square)
    gap = np.abs(np.abs(height) - g.radius)
    for i in np.flatnonzero(cross & _inside(x, length, limits.slack) & (gap <= limits.slack)):
        point = sides[i, 0] + x[i] * u[i]
        if reached(point[None], triangles, slack)[0]:
            words = f"an edge lies across a shaft Ø{2e3 * g.radius:.6g} mm, {millimetres(gap[i])} off"
            normal = n[i] / size[i] * np.sign(height[i])
            return EdgeContact("contact", (g, Line(point, u[i])), point[None], float(gap[i]), normal, words, slack)
    return None


def _swapped(t: EdgeContact) -> EdgeContact:
    """The contact with a and b exchanged."""
    return EdgeContact(t.kind, (t.features[1], t.features[0]), t.points, t.gap, -t.normal, t.words, t.slack)


def edge_contact(a: FeatureView, b: FeatureView, limits: Limits) -> EdgeContact | None:
    """Return the contact of two features that neither fit nor are tangent; None without one of the known types."""
    flush = coplanar(a, b, limits)
    if flush is not None:
        return flush
    first, second = on_surface(a, b, limits), on_surface(b, a, limits)
    if first is None and second is None:
        return crossing(a, b, limits)
    if first is None or (second is not None and second.length > first.length):
        return _swapped(second) if second is not None else None
    return first


def as_match(t: EdgeContact, a: FeatureView, b: FeatureView, limits: Limits) -> Match:
    """Return the contact as a `Match` with `share` 0, so that it ranks below fits."""
    middle = t.points.mean(axis=0)
    return Match(
        kind=t.kind,
        residual=t.gap,
        angle=0.0,
        fit=None,
        overlap=t.length,
        share=0.0,
        closed=False,
        approach=t.normal,
        origin=middle,
        local=a.pose.actInv(middle),
        direction=t.normal,
        size=max(0.5 * t.length, limits.linear),
        words=t.words,
        features=(t.features[0].transformed(a.pose.inverse()), t.features[1].transformed(b.pose.inverse())),
    )


def without_implied_contacts(
    found: Sequence[tuple[Pair, EdgeContact]],
    better: Iterable[tuple[Pair, float | None]],
    view: Callable[[int, int], FeatureView],
) -> list[tuple[Pair, EdgeContact]]:
    """Return the contacts that no match and no longer contact of the same two bodies implies; flush faces are kept.

    better: pairs of features with a match, and the fit (m) of round ones. view: callback(body, feature), in the world.
    """
    covers: dict[tuple[int, int], list[tuple[FeatureView, FeatureView, float]]] = {}
    for (a, fa, b, fb), fit in better:
        covers.setdefault((a, b), []).append((view(a, fa), view(b, fb), abs(fit or 0.0)))
    kept: list[tuple[Pair, EdgeContact]] = []
    for pair, t in sorted(found, key=lambda x: (x[1].kind != "coplanar", -x[1].length, x[0])):
        a, _, b, _ = pair
        implied = t.kind == "contact" and (
            any(_covered(t, *c) for c in covers.get((a, b), ()))
            or any(_beside(t.points, k.points, t.slack) for (i, _, j, _), k in kept if (i, j) == (a, b))
        )
        if not implied:
            kept.append((pair, t))
    return kept


def _covered(t: EdgeContact, a: FeatureView, b: FeatureView, fit: float) -> bool:
    """Whether all points of a contact lie on both of two features that fit each other."""
    for v in (a, b):
        triangles = v.triangles
        if not reached(t.points, triangles, t.slack + fit + 2.0 * deflection(v.geometry, triangles)).all():
            return False
    return True


def _beside(points: Array, line: Array, slack: float) -> bool:
    """Whether all points lie on the segment (or point) of another contact."""
    ends = np.array([line[0], line[-1], line[-1]])
    return bool(reached(points, ends[None], 2.0 * slack).all())
