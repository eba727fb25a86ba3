"""Directions, lines and places that a script names ("axis", "up", a bore, a top), found in the present scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.geometry.views import Limits
from constraints.geometry.words import millimetres
from vpframe.errors import TaskError
from vpframe.events import ConstraintView
from vpframe.hands.arguments import vector
from vpframe.hands.gripper import Gripper
from vpframe.scene.boxes import box_of
from vpframe.scene.scene import Part

Vector = NDArray[np.float64]

_DIRECTIONS = {
    "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0), "z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
_AXIAL = ("concentric", "screw", "conical fit", "toroidal fit", "spherical fit")
"""constraint kinds that define "axis", in order of preference"""
OPPOSITE = -0.5
"""cosine of two directions up to which they are opposite"""


def direction(hand: Gripper, along: str | ArrayLike, outward: bool) -> Vector:
    """Return the direction (3,), unit, world, for "axis", "up", "-x" or a vector."""
    if not isinstance(along, str):
        v = vector(along, "along")
        if not np.linalg.norm(v) > 0.0:
            raise TaskError("along is the zero vector; give a direction")
        return v / np.linalg.norm(v)
    if along in _DIRECTIONS:
        return np.array(_DIRECTIONS[along])
    if along != "axis":
        raise TaskError(f"along={along!r}: give 'axis', one of {', '.join(_DIRECTIONS)}, or a vector of three numbers")
    held_part(hand, "along='axis'")
    fit = _axial(hand)
    axis = np.array(fit.direction)
    mine = 0 if fit.parts[0] in grip(hand) else 1
    sign = _out_sign(hand, hand.session.scene[fit.parts[mine]], fit.parts[1 - mine], axis)
    return axis * (sign if outward else -sign)


def _out_sign(hand: Gripper, part: Part, partner: str, axis: Vector) -> float:
    """Return +1 if the part leaves along +axis: away from what it rests on, else from the partner's middle."""
    for c in resting(hand, partner):
        if abs(c.direction @ axis) > 0.9:
            return 1.0 if leaving(hand, c) @ axis > 0.0 else -1.0
    other = hand.session.scene[partner]
    return 1.0 if (middle(part) - middle(other)) @ axis >= 0.0 else -1.0


def grip(hand: Gripper) -> tuple[str, ...]:
    """Return the parts that a hand holds and carries, the held one first."""
    return (hand.held, *hand.carried) if hand.held else ()


def resting(hand: Gripper, partner: str = "") -> list[ConstraintView]:
    """Return the against constraints of the parts in the hand, those with what the parts rest on first.

    Parts rest on a fixed part rather than on a loose one, and on a larger part rather than on a smaller one (by the
    volume of the bounding box): a cover on its housing, not on the heads of its screws. partner: the first of equals.
    """
    scene, mine = hand.session.scene, grip(hand)

    def rank(c: ConstraintView) -> tuple[bool, float, bool]:
        other = scene[c.parts[1] if c.parts[0] in mine else c.parts[0]]
        low, high = box_of(other.mesh)
        return not other.fixed, -float((high - low).prod()), other.name != partner

    return sorted((c for c in hand.session.constraints_of(*mine) if c.kind == "against"), key=rank)


def leaving(hand: Gripper, against: ConstraintView) -> Vector:
    """Return the direction (3,), unit, world, away from the partner of an against constraint."""
    # an against's direction is the normal of its first part's plane, which points at the second part
    return -against.direction if against.parts[0] in grip(hand) else against.direction


def way_out(hand: Gripper, along: str | ArrayLike | None) -> Vector:
    """Return the direction (3,), unit, world, of `along`; default: outward axis, else off what it rests on, else up."""
    if along is not None:
        return direction(hand, along, outward=True)
    if any(c.kind in _AXIAL for c in hand.session.constraints_of(*grip(hand))):
        return direction(hand, "axis", outward=True)
    ways = [leaving(hand, c) for c in resting(hand)]
    away = sum((way for way in ways if way @ ways[0] > OPPOSITE), np.zeros(3))
    length = float(np.linalg.norm(away))
    return away / length if length > 0.1 else np.array([0.0, 0.0, 1.0])


def line(hand: Gripper, about: str | ArrayLike | tuple[ArrayLike, ArrayLike]) -> tuple[Vector, Vector]:
    """Return (origin, unit direction), world, of the line that a script's `about` names."""
    if isinstance(about, tuple) and len(about) == 2:
        return vector(about[0], "about"), direction(hand, about[1], outward=True)
    if isinstance(about, str) and about == "axis":
        held_part(hand, "about='axis'")
        fit = _axial(hand)
        return np.array(fit.origin), np.array(fit.direction)
    where = middle(hand.session.scene[hand.held]) if hand.held else np.array(hand.pose.translation)
    return where, direction(hand, about, outward=True)  # type: ignore[arg-type]


def _axial(hand: Gripper) -> ConstraintView:
    on_it = hand.session.constraints_of(*grip(hand))
    fits = [c for c in on_it if c.kind in _AXIAL]
    if not fits:
        have = ", ".join(c.kind for c in on_it) or "none"
        raise TaskError(f"{hand.load} has no axis to go by: no concentric fit holds it (its constraints: {have})")
    return min(fits, key=lambda c: (_AXIAL.index(c.kind), c.id))


Fit = tuple[Part, Feature, Part, Feature]
"""part and its cylinder, target part and its cylinder: shaft and bore, or ring and pin"""


def best_fit(parts: Sequence[Part], targets: Sequence[Part], tolerance: Tolerance, names: tuple[str, str]) -> Fit:
    """Return the shaft of one of `parts` and the bore of one of `targets` (or vice versa) that fit best.

    Clearances within `Tolerance.clearance` come first, then clearance holes; then the largest shared area, and among
    equal ones (within 1 %) the nearest. names: of the two groups, for the message.
    """
    limits = Limits.offer(tolerance)

    def cylinders(of: Sequence[Part], sense: int) -> list[tuple[Part, Feature]]:
        return [(p, f) for p in of for f in p.features if isinstance(f.geometry, Cylinder) and f.sense == sense]

    pairs = [(*a, *b) for s in (1, -1) for a in cylinders(parts, s) for b in cylinders(targets, -s)]
    loose = [fit for fit in pairs if limits.fit(*_shaft_and_clearance(fit[1], fit[3]))]
    fits = [fit for fit in loose if abs(_radius(fit[1]) - _radius(fit[3])) <= tolerance.clearance] or loose
    if not fits:
        raise TaskError(
            f"nothing of {names[0]} fits into {names[1]}: no shaft and bore with a radial clearance of at most "
            f"{tolerance.clearance * 1e3:g} mm, or {tolerance.clearance_relative:.2g} of the shaft's diameter "
            f"(Tolerance.clearance, clearance_relative){_tightest(pairs, limits)}"
        )
    largest = max(min(s.area, b.area) for _, s, _, b in fits)
    return min((f for f in fits if min(f[1].area, f[3].area) > 0.99 * largest), key=_aside)


def _tightest(pairs: Sequence[Fit], limits: Limits) -> str:
    """Words for the pair of least interference among those that are larger than a press fit; empty without one."""
    tight = [(-clearance, radius) for radius, clearance in (_shaft_and_clearance(p[1], p[3]) for p in pairs)]
    tight = [(interference, radius) for interference, radius in tight if interference > 0.0]
    if not tight:
        return ""
    interference, radius = min(tight)
    most = limits.most_interference(radius - interference)
    return (
        f"; Ø{2e3 * radius:.6g} in Ø{2e3 * (radius - interference):.6g} mm is {millimetres(interference)} too large, a "
        f"press fit {limits.fit_class or limits.press_fit} may be {millimetres(most)} (Tolerance.press_fit)"
    )


def _shaft_and_clearance(s: Feature, b: Feature) -> tuple[float, float]:
    """Radius of the convex cylinder, and the radial clearance in the concave one, m."""
    shaft, bore = (s, b) if s.sense > 0 else (b, s)
    return _radius(shaft), _radius(bore) - _radius(shaft)


def _aside(fit: Fit) -> float:
    """Distance from the middle of the shaft to the axis of the bore, m."""
    part, shaft, target, bore = fit
    assert isinstance(bore.geometry, Cylinder)
    to = target.pose.actInv(part.pose.act(shaft.samples.mean(0))) - bore.geometry.origin
    return float(np.linalg.norm(np.cross(to, bore.geometry.axis)))


@dataclass(frozen=True)
class Entry:
    """Geometry of an insertion into a bore; lengths are m along `way` from `aligned`."""

    way: Vector
    """(3,) unit, world"""
    aligned: pin.SE3
    """pose of the fitting part on the bore's axis, in front of the bore"""
    tip: float
    """travel until the tip of the shaft is at the bore's mouth"""
    flush: float
    """travel of largest overlap: beyond it the shaft leaves the bore again"""
    collar: bool
    """whether a collar wider than the bore follows the shaft and must seat"""


def in_front(parts: Sequence[Part], fit: Fit, gap: float) -> Entry:
    """Return how `parts`, moving as one, enter the bore of a fit, from `gap` (m) in front of its mouth.

    They enter from the side they are on, and keep their heading as far as the axis allows.
    """
    part, shaft, target, bore = fit
    assert isinstance(shaft.geometry, Cylinder) and isinstance(bore.geometry, Cylinder)
    axis = target.pose.rotation @ bore.geometry.axis
    mouth = target.pose.act(bore.samples.mean(0))
    here = part.pose.act(shaft.samples.mean(0))
    way = axis if (mouth - here) @ axis >= 0.0 else -axis
    own = part.pose.rotation @ shaft.geometry.axis
    if own @ way < 0.0:
        own = -own
    rotation = pin.Quaternion.FromTwoVectors(own, way).toRotationMatrix() @ part.pose.rotation
    on_axis = target.pose.act(np.array(bore.geometry.origin))
    turned = pin.SE3(rotation, on_axis - rotation @ shaft.geometry.origin)
    points = np.concatenate([_points(p, turned * part.pose.actInv(p.pose)) for p in parts]) - on_axis
    along = points @ way
    hole = (bore.samples @ target.pose.rotation.T + target.pose.translation - on_axis) @ way
    entry = float(hole.min())
    back = entry - gap - float(along.max())
    rod = (shaft.samples @ turned.rotation.T + turned.translation - on_axis) @ way
    off = np.linalg.norm(points - along[:, None] * way, axis=1)
    within = along[off <= 1.01 * _radius(shaft)] if shaft.sense > 0 else rod
    behind = along <= rod.min() + 0.01 * (rod.max() - rod.min())
    collar = along[behind & (off > _radius(bore))] if shaft.sense > 0 else np.empty(0)
    last = float(collar.max() if len(collar) else rod.min())
    return Entry(
        way,
        pin.SE3(rotation, turned.translation + back * way),
        tip=entry - float(within.max()) - back,
        flush=max(entry - float(rod.min()), float(hole.max()) - float(rod.max()), entry - last) - back,
        collar=len(collar) > 0,
    )


def _points(part: Part, pose: pin.SE3) -> Vector:
    """Vertices (n, 3) of a part at a pose, world, m."""
    return part.mesh.vertices[np.unique(part.mesh.triangles)] @ pose.rotation.T + pose.translation


def top_of(parts: Sequence[Part], name: str) -> tuple[float, Vector]:
    """Return height (m, world z) and middle (x, y) of the largest upward plane of some parts; name: for the message."""
    flat = []
    for part, feature in ((p, f) for p in parts for f in p.features):
        if isinstance(feature.geometry, Plane) and (part.pose.rotation @ feature.geometry.normal)[2] > 0.999:
            points = feature.samples @ part.pose.rotation.T + part.pose.translation
            flat.append((feature.area, float(points[:, 2].mean()), 0.5 * (points.min(0) + points.max(0))[:2]))
    if not flat:
        raise TaskError(f"{name} has no flat top to place anything on")
    _, height, middle = max(flat, key=lambda f: f[0])
    return height, middle


def _radius(feature: Feature) -> float:
    assert isinstance(feature.geometry, Cylinder)
    return feature.geometry.radius


def held_part(hand: Gripper, verb: str) -> Part:
    """Return the held part; TaskError if the hand is empty."""
    if hand.held is None:
        raise TaskError(f"{hand.name}.{verb}: the hand is empty; grab a part first")
    return hand.session.scene[hand.held]


def held_parts(hand: Gripper, verb: str) -> tuple[Part, ...]:
    """Return the held and carried parts, the held one first; TaskError if the hand is empty."""
    held_part(hand, verb)
    return tuple(hand.session.scene[name] for name in grip(hand))


def other_parts(hand: Gripper, verb: str, name: str) -> tuple[Part, ...]:
    """Return the parts of a verb's target; TaskError if one of them is in the hand."""
    group = hand.session.group(name)
    if not set(group).isdisjoint(grip(hand)):
        raise TaskError(f"{who(hand)}.{verb}({name!r}): that is the part in the hand; name another")
    return tuple(hand.session.scene[name] for name in group)


def who(hand: Gripper) -> str:
    """Return the hand's name, with the name of the held part."""
    return f"{hand.name}[{hand.load}]" if hand.held else hand.name


def extent(parts: Sequence[Part]) -> tuple[float, Vector]:
    """Lowest z and middle (3,) of the bounding box of some parts, world, m."""
    points = np.concatenate([_points(part, part.pose) for part in parts])
    return float(points[:, 2].min()), 0.5 * (points.min(0) + points.max(0))


def spans(parts: Sequence[Part], way: Vector) -> tuple[float, float]:
    """Least and greatest coordinate of some parts along a world direction (3,), m."""
    along = np.concatenate([_points(part, part.pose) @ way for part in parts])
    return float(along.min()), float(along.max())


def middle(part: Part) -> Vector:
    """Middle (3,) of the part's bounding box, world, m."""
    return extent((part,))[1]
