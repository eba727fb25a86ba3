"""The pairing table: the constraint kinds of pairs of features, and the rules that measure them.

One row for each pair of surface types; the rule measures the two features at their poses and returns a `Match`, or
None out of limits. Names follow Mukherjee, Sacks and Joskowicz (contact pairs) and the mates of D-Cubed and SolidWorks.

===================  =====================  ==============  =========================================================
solid surface        other surface          kind            measured
===================  =====================  ==============  =========================================================
plane                plane, facing          against         gap over the shared area
cylinder             hollow cylinder        screw           offset of the axes, if the two represent a metric thread,
                                                            with evidence (`constraints.recognition.thread_evidence`)
cylinder             hollow cylinder        concentric      offset of the axes over the shared length, radial fit
cone                 hollow cone            conical         offset of the apexes across the surface, half angles
sphere               hollow sphere          spherical       offset of the centres, radial fit
torus                hollow torus           toroidal        offset of the centres, axes, radial fit
sphere               hollow cylinder, torus groove          offset of the centre from the groove's, radial fit
cylinder, cone,      plane                  tangent         gap at the nearest line or point
sphere, torus
cylinder             cylinder               tangent         gap: outside or inside where parallel, else crossed
sphere               cylinder, cone, torus, tangent         gap, outside or inside
                     sphere
===================  =====================  ==============  =========================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from constraints.geometry.overlap import facing_area, shared_height
from constraints.geometry.reach import deflection, reached
from constraints.geometry.round_fit import RoundFit, round_fit
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus, Vector, cross, norm
from constraints.geometry.views import FeatureView, Limits
from constraints.geometry.words import millimetres
from constraints.recognition.candidate import Match
from constraints.recognition.tangencies import TANGENCIES


def _gap_words(gap: float) -> str:
    if abs(gap) < 1e-9:
        return "no gap"
    return f"{millimetres(abs(gap))} {'apart' if gap > 0 else 'of overlap'}"


def line_angle(u: Vector, v: Vector) -> float:
    """Return the angle (rad) between two lines along u and v, accurate near 0."""
    return float(np.arctan2(norm(cross(u, v)), abs(u @ v)))


def against(a: FeatureView[Plane], b: FeatureView[Plane], limits: Limits) -> Match | None:
    """Return the match of two planes that face each other and share an area."""
    p, q = a.geometry, b.geometry
    angle = line_angle(p.normal, q.normal)
    if p.normal @ q.normal >= 0.0 or angle > limits.angular:
        return None
    region = facing_area(p.origin, p.normal, a.triangles, b.triangles, q.origin, q.normal)
    smaller = min(a.feature.area, b.feature.area)
    width = float(np.sqrt(smaller))
    if region.area <= min(limits.strip, 0.1 * width) * width:
        return None
    gap = float((q.origin - region.centroid) @ q.normal / (p.normal @ q.normal))
    # `angle` limits a slight tilt of large faces; without reach the whole region must be flush
    residual = max(abs(region.gap_min), abs(region.gap_max)) if angle <= limits.linear / width else abs(gap)
    if residual > limits.linear:
        return None
    share = min(1.0, region.area / smaller)
    words = f"planes face each other, {_gap_words(gap)}, over {region.area * 1e6:.4g} mm² ({share:.0%} of the smaller)"
    return Match(
        kind="against",
        residual=residual,
        angle=angle,
        fit=None,
        overlap=region.area,
        share=share,
        closed=False,
        approach=p.normal,
        origin=region.centroid,
        local=a.pose.actInv(region.centroid),
        direction=p.normal,
        size=0.5 * float(np.sqrt(region.area)),
        words=words,
    )


class _Seat(NamedTuple):
    """Position of a solid surface of revolution in a hollow one."""

    origin: Vector
    """(3,) world"""
    axis: Vector
    """(3,) unit, world"""
    size: float
    """m"""
    offset: float
    """m, of the axes or centres"""
    angle: float
    """rad, of the axes"""
    overlap: float
    """m"""
    smaller: float
    """m: length of the shorter of the two"""
    open: float
    """rad: greatest angle about the axis that the hollow surface does not cover"""


def _round(kind: str, solid: FeatureView, hollow: FeatureView, seat: _Seat, fit: RoundFit, words: str) -> Match:
    """The match of two surfaces of revolution."""
    origin, axis, overlap, smaller = seat.origin, seat.axis, seat.overlap, seat.smaller
    along = float((hollow.center - solid.center) @ axis)
    return Match(
        kind=kind,
        residual=seat.offset,
        angle=seat.angle,
        fit=fit.clearance,
        press=fit.press,
        overlap=overlap,
        share=min(1.0, max(0.0, overlap / smaller)) if smaller > 0 else 1.0,
        closed=seat.open < np.pi * (1 - 1e-6),
        approach=axis if along >= 0 else -axis,
        origin=origin,
        local=solid.pose.actInv(origin),
        direction=axis,
        size=seat.size,
        words=f"{words}, {fit.words}",
    )


def concentric(solid: FeatureView[Cylinder], hollow: FeatureView[Cylinder], limits: Limits) -> Match | None:
    """Return the match of a solid cylinder in a hollow one: radii fit, axes coincide, lengths overlap."""
    s, h = solid.geometry, hollow.geometry
    fit = h.radius - s.radius
    angle = line_angle(s.axis, h.axis)
    if not limits.fit(s.radius, fit) or angle > limits.angular:
        return None
    axis = h.axis
    sign = 1.0 if s.axis @ axis >= 0 else -1.0
    start = float((s.origin - h.origin) @ axis)
    overlap, low, high = shared_height(start + sign * solid.extent.spans[:, :: int(sign)], hollow.extent.spans)
    if overlap <= limits.overlap:
        return None
    direction = s.axis / (s.axis @ axis)
    heights = np.array([low, high])
    on_solid = s.origin + (heights[:, None] - start) * direction
    on_hollow = h.origin + heights[:, None] * axis
    offset = float(np.linalg.norm(on_solid - on_hollow, axis=1).max())
    if offset > limits.linear + max(fit, 0.0):
        return None
    if fit > limits.clearance and abs(offset - fit) <= limits.slack:
        return None  # a loose shaft at the wall of its bore: tangent
    smaller = min(solid.extent.length, hollow.extent.length)
    words = (
        f"Ø{2e3 * s.radius:.6g} in Ø{2e3 * h.radius:.6g} mm{over(overlap)}, "
        f"axes {millimetres(offset)} apart{', ' + limits.fit_class if limits.fit_class else ''}"
    )
    found = limits.round_fit(h.radius, fit, _kept(offset, limits))
    seat = _Seat(on_hollow.mean(axis=0), axis, h.radius, offset, angle, overlap, smaller, hollow.extent.open)
    return _round("concentric", solid, hollow, seat, found, words)


def _kept(offset: float, limits: Limits) -> float:
    """Offset of two axes or centres, m; 0 if the constraint removes it."""
    return offset if offset <= limits.slack else 0.0


def over(overlap: float) -> str:
    """Return words for the overlap (m) of two surfaces along their axis; negative for the gap between their ends."""
    length = millimetres(abs(overlap))
    if length == millimetres(0.0):
        return ", end to end"
    return f" over {length}" if overlap > 0.0 else f", ends {length} apart"


def screw(solid: FeatureView[Cylinder], hollow: FeatureView[Cylinder], limits: Limits) -> Match | None:
    """Return the match of a screw in its tapped hole, drawn as coaxial cylinders that overlap by a thread's depth."""
    s, h, thread = solid.geometry, hollow.geometry, limits.thread
    if thread is None:
        return None
    found = concentric(solid, hollow, of_thread(limits, s.radius))
    if found is None:
        return None
    words = (
        f"thread {thread.size.name}: Ø{2e3 * s.radius:.6g} in Ø{2e3 * h.radius:.6g} mm tapping hole, {thread.evidence}"
        f"{over(found.overlap)}, axes {millimetres(found.residual)} apart"
    )
    return replace(found, kind="screw", press=0.0, words=words, parameters={"pitch": thread.size.pitch})


def of_thread(limits: Limits, radius: float) -> Limits:
    """Return the limits for a screw of `radius` (m) in its tapped hole, which is smaller by the depth of the thread."""
    return replace(limits, interference=radius, fit_class="")


def conical(solid: FeatureView[Cone], hollow: FeatureView[Cone], limits: Limits) -> Match | None:
    """Return the match of a solid cone seated in a hollow one of the same half angle."""
    s, h = solid.geometry, hollow.geometry
    angle = line_angle(s.axis, h.axis)
    flare = abs(s.half_angle - h.half_angle)
    if s.axis @ h.axis <= 0.0 or max(angle, flare) > limits.angular:
        return None
    along = float((s.apex - h.apex) @ h.axis)
    fit = along * float(np.sin(h.half_angle))  # gap across the surface for this distance of the apexes
    overlap, low, high = shared_height(solid.extent.spans + along, hollow.extent.spans)
    if overlap <= limits.overlap:
        return None
    height = 0.5 * (low + high)  # the offset of the axes is measured where the surfaces meet, not at distant apexes
    middle = h.apex + height * h.axis
    offset = float(np.linalg.norm(s.apex + (height - along) / (s.axis @ h.axis) * s.axis - middle))
    residual = max(offset, abs(fit))
    if residual > limits.linear:
        return None
    smaller = min(solid.extent.length, hollow.extent.length)
    size = height * float(np.tan(h.half_angle))
    words = f"cones of half angle {np.degrees(h.half_angle):.4g}°{over(overlap)}"
    found = round_fit(fit, 0.0, 0.0, limits.slack)  # the axial position of a cone is no press fit
    seat = _Seat(middle, h.axis, size, residual, max(angle, flare), overlap, smaller, hollow.extent.open)
    return _round("conical", solid, hollow, seat, found, words)


def spherical(solid: FeatureView[Sphere], hollow: FeatureView[Sphere], limits: Limits) -> Match | None:
    """Return the match of a ball in its socket."""
    s, h = solid.geometry, hollow.geometry
    fit = h.radius - s.radius
    offset = float(np.linalg.norm(s.center - h.center))
    if not limits.snug(h.radius, fit) or offset > limits.linear + max(fit, 0.0):
        return None
    toward = hollow.center - solid.center
    length = float(np.linalg.norm(toward))
    axis = toward / length if length > 0 else np.array([0.0, 0.0, 1.0])
    words = f"ball Ø{2e3 * s.radius:.6g} in socket Ø{2e3 * h.radius:.6g} mm, centres {millimetres(offset)} apart"
    found = limits.round_fit(h.radius, fit, _kept(offset, limits))
    depth = hollow.feature.area / (2 * np.pi * h.radius)  # Archimedes: height of the socket's zone
    zone, opening = min(depth, 2 * h.radius), 0.0 if depth > h.radius else 2 * np.pi
    seat = _Seat(h.center, axis, h.radius, offset, 0.0, zone, zone, opening)
    return _round("spherical", solid, hollow, seat, found, words)


def toroidal(solid: FeatureView[Torus], hollow: FeatureView[Torus], limits: Limits) -> Match | None:
    """Return the match of a ring in its groove."""
    s, h = solid.geometry, hollow.geometry
    fit = h.minor - s.minor
    angle = line_angle(s.axis, h.axis)
    offset = float(np.linalg.norm(s.center - h.center))
    if not limits.snug(h.minor, fit) or abs(h.major - s.major) > limits.clearance or angle > limits.angular:
        return None
    if offset > limits.linear + max(fit, 0.0):
        return None
    words = f"tori Ø{2e3 * h.major:.6g} × Ø{2e3 * h.minor:.6g} mm, centres {millimetres(offset)} apart"
    found = limits.round_fit(h.minor, fit, _kept(offset, limits))
    depth = hollow.extent.length
    smaller = min(depth, solid.extent.length)
    seat = _Seat(h.center, h.axis, h.major, offset, angle, depth, smaller, hollow.extent.open)
    return _round("toroidal", solid, hollow, seat, found, words)


def groove(
    ball: FeatureView[Sphere], hollow: FeatureView[Cylinder] | FeatureView[Torus], limits: Limits
) -> Match | None:
    """Return the match of a ball in a groove of its radius, straight or about an axis."""
    s, h = ball.geometry, hollow.geometry
    fit = _radius(h) - s.radius
    normal = np.asarray(h.normals(s.center)[0])
    offset = float(h.distance(s.center)[0]) + _radius(h)  # of the centre from the groove's centre line
    middle = s.center - offset * normal
    if not limits.snug(_radius(h), fit) or offset > limits.linear + max(fit, 0.0):
        return None
    triangles = hollow.triangles
    if not reached(middle[None], triangles, _radius(h) + 2.0 * deflection(h, triangles) + limits.linear)[0]:
        return None  # beyond the end of the groove
    axis = h.axis if isinstance(h, Cylinder) else np.cross(h.axis, middle - h.center) / h.major
    what = "straight" if isinstance(h, Cylinder) else f"ring Ø{2e3 * h.major:.6g} mm"
    words = (
        f"ball Ø{2e3 * s.radius:.6g} in groove Ø{2e3 * _radius(h):.6g} mm, {what}, centres {millimetres(offset)} apart"
    )
    found = limits.round_fit(_radius(h), fit, _kept(offset, limits))
    opening = hollow.extent.open if isinstance(h, Cylinder) else 2.0 * np.pi
    seat = _Seat(middle, axis, s.radius, offset, 0.0, 1.0, 1.0, opening)
    return _round("groove", ball, hollow, seat, found, words)


def _radius(geometry: Geometry) -> float:
    """Radius of curvature of a surface that encloses a ball, m; infinite for a cone, which widens."""
    match geometry:
        case Cylinder() | Sphere():
            return geometry.radius
        case Torus():
            return geometry.minor
    return np.inf


def tangent(first: FeatureView, second: FeatureView, limits: Limits) -> Match | None:
    """Return the match of surfaces that touch along a line or in a point which the faces of both reach.

    second: solid.
    """
    hollow = first.feature.sense < 0
    if hollow and _radius(first.geometry) - _radius(second.geometry) <= limits.clearance:
        return None  # radii this similar make a fit, good or bad
    rule = TANGENCIES[type(first.geometry), type(second.geometry)]
    touch = rule(first.geometry, second.geometry, _span(first, second), hollow)
    if touch is None or abs(touch.gap) > limits.linear or touch.angle > limits.angular:
        return None
    both = np.ones(len(touch.points), bool)
    for view in (first, second):
        triangles = view.triangles
        both &= reached(
            touch.points, triangles, 2.0 * deflection(view.geometry, triangles) + limits.linear + abs(touch.gap)
        )
    if not both.any():
        return None
    points = touch.points[both]
    middle = points.mean(axis=0)
    length = float(np.linalg.norm(points[-1] - points[0]))
    if len(touch.points) > 1 and length < limits.linear:
        return None  # only the end of the line touches: an edge contact, not a tangency
    where = f"along {millimetres(length)}" if len(touch.points) > 1 else "in a point"
    return Match(
        kind="tangent",
        residual=abs(touch.gap),
        angle=touch.angle,
        fit=None,
        overlap=length,
        share=float(both.mean()),
        closed=False,
        approach=-touch.normal if hollow else touch.normal,
        origin=middle,
        local=first.pose.actInv(middle),
        direction=touch.normal,
        size=max(0.5 * length, limits.linear),
        words=(
            f"{first.geometry.kind} and {second.geometry.kind} touch {where}, {touch.mode}, {_gap_words(touch.gap)}"
        ),
        parameters={"mode": touch.mode},
    )


def _span(first: FeatureView, second: FeatureView) -> tuple[float, float]:
    """(low, high) heights along the second's axis of a possible line contact, m; of a cylinder only near the first."""
    low, high = float(second.extent.spans[0, 0]), float(second.extent.spans[-1, 1])
    g = second.geometry
    if isinstance(g, Cylinder):
        heights = (first.triangles - g.origin) @ g.axis
        low, high = max(low, float(heights.min())), min(high, float(heights.max()))
    return (low, high) if low <= high else (0.5 * (low + high),) * 2


F = TypeVar("F", bound=Geometry)
S = TypeVar("S", bound=Geometry)


@dataclass(frozen=True)
class Pairing(Generic[F, S]):
    """A row of the pairing table."""

    kind: str
    first: type[F]
    second: type[S]
    senses: tuple[tuple[int, int], ...]
    """senses of the first and the second feature: +1 solid, -1 hollow"""
    rule: Callable[[FeatureView[F], FeatureView[S], Limits], Match | None]
    """called with the features in the order of the row"""

    def match(self, a: FeatureView, b: FeatureView, limits: Limits) -> Match | None:
        """Return the match of two features in either order; None without one, or if the row does not apply."""
        if self.applies_to(a, b):
            return self.rule(a, b, limits)
        if not self.applies_to(b, a):
            return None
        found = self.rule(b, a, limits)
        return found and replace(found, approach=-found.approach, local=a.pose.actInv(found.origin))

    def applies_to(self, a: FeatureView, b: FeatureView) -> bool:
        """Whether two features, in this order, are of this row's types and senses."""
        first, second = a.feature, b.feature
        return self.fits_types((type(first.geometry), first.sense), (type(second.geometry), second.sense))

    def fits_types(self, a: tuple[type, int], b: tuple[type, int]) -> bool:
        """Whether two features of these types and senses, in this order, are of this row."""
        return a[0] is self.first and b[0] is self.second and (a[1], b[1]) in self.senses


_SOLID = ((1, 1),)
_IN_HOLLOW = ((1, -1),)
_ON_OR_IN = ((1, 1), (-1, 1))
PAIRINGS: tuple[Pairing[Any, Any], ...] = (
    Pairing("against", Plane, Plane, _SOLID, against),
    Pairing("screw", Cylinder, Cylinder, _IN_HOLLOW, screw),
    Pairing("concentric", Cylinder, Cylinder, _IN_HOLLOW, concentric),
    Pairing("conical", Cone, Cone, _IN_HOLLOW, conical),
    Pairing("spherical", Sphere, Sphere, _IN_HOLLOW, spherical),
    Pairing("toroidal", Torus, Torus, _IN_HOLLOW, toroidal),
    Pairing("groove", Sphere, Cylinder, _IN_HOLLOW, groove),
    Pairing("groove", Sphere, Torus, _IN_HOLLOW, groove),
    Pairing("tangent", Plane, Cylinder, _SOLID, tangent),
    Pairing("tangent", Plane, Cone, _SOLID, tangent),
    Pairing("tangent", Plane, Sphere, _SOLID, tangent),
    Pairing("tangent", Plane, Torus, _SOLID, tangent),
    Pairing("tangent", Cylinder, Cylinder, _ON_OR_IN, tangent),
    Pairing("tangent", Cylinder, Sphere, _ON_OR_IN, tangent),
    Pairing("tangent", Cone, Sphere, _ON_OR_IN, tangent),
    Pairing("tangent", Torus, Sphere, _ON_OR_IN, tangent),
    Pairing("tangent", Sphere, Sphere, _ON_OR_IN, tangent),
)
FITS = ("against", "concentric", "conical", "groove", "screw", "spherical", "toroidal")
"""kinds whose surfaces coincide, offered to hands, which pass many tangencies on their paths"""
DEFAULT_KINDS = (*FITS, "tangent")
"""kinds that `recognise` offers by default"""
SLIGHT = ("contact", "coplanar")
"""kinds that are often unintended: edges and vertices that touch, flush faces"""


def rows_for(kinds: Set[str]) -> tuple[Pairing[Any, Any], ...]:
    """Return the rows of the table up to the last of these kinds: a row counts only if none before it matches."""
    last = max((n for n, row in enumerate(PAIRINGS, 1) if row.kind in kinds), default=0)
    return PAIRINGS[:last]


def matches(
    a: FeatureView, b: FeatureView, limits: Limits, rows: Sequence[Pairing[Any, Any]] = PAIRINGS
) -> Match | None:
    """Return the match of two features by the first row of the table that matches; None if none does.

    rows: the first rows of the table, see `rows_for`.
    """
    first, second = a.feature, b.feature
    mine = _rows_of(len(rows), (type(first.geometry), first.sense), (type(second.geometry), second.sense))
    found = (row.match(a, b, limits) for row in mine)
    return next((match for match in found if match is not None), None)


@cache
def _rows_of(n: int, a: tuple[type, int], b: tuple[type, int]) -> tuple[Pairing[Any, Any], ...]:
    """The rows among the first n of the table that apply to two features' types and senses, in either order."""
    return tuple(row for row in PAIRINGS[:n] if row.fits_types(a, b) or row.fits_types(b, a))
