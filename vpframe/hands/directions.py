"""What a script means by "axis", "up", a bore or a top: directions, lines and places, found in the scene as it is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.geometry.views import Limits
from vpframe.errors import TaskError
from vpframe.hands.arguments import vector
from vpframe.hands.gripper import Gripper
from vpframe.scene.scene import Part
from vpframe.session.events import ConstraintView

Vector = NDArray[np.float64]

_DIRECTIONS = {
    "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0), "z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
_AXIAL = ("concentric", "screw", "conical fit", "toroidal fit", "spherical fit")
"""kinds whose line is "the axis", the plainest first"""


def direction(hand: Gripper, along: str | ArrayLike, outward: bool) -> Vector:
    """(3,) unit, world: what a script means by "axis", "up", "-x" or a vector."""
    if not isinstance(along, str):
        v = vector(along, "along")
        if not np.linalg.norm(v) > 0.0:
            raise TaskError("along is the zero vector; give a direction")
        return v / np.linalg.norm(v)
    if along in _DIRECTIONS:
        return np.array(_DIRECTIONS[along])
    if along != "axis":
        raise TaskError(f"along={along!r}: give 'axis', one of {', '.join(_DIRECTIONS)}, or a vector of three numbers")
    part = held_part(hand, "along='axis'")
    fit = _axial(hand, part.name)
    axis = np.array(fit.direction)
    partner = fit.parts[1] if fit.parts[0] == part.name else fit.parts[0]
    sign = _out_sign(hand, part, partner, axis)
    return axis * (sign if outward else -sign)


def _out_sign(hand: Gripper, part: Part, partner: str, axis: Vector) -> float:
    """+1 if the part leaves along +axis: away from what it stands against, else away from the partner's middle."""
    resting = [
        c for c in hand.session.constraints_of(part.name) if c.kind == "against" and abs(c.direction @ axis) > 0.9
    ]
    for c in sorted(resting, key=lambda c: partner not in c.parts):
        # an against's direction is the normal of its first part's plane, which points at the second part
        leaving = -c.direction if c.parts[0] == part.name else c.direction
        return 1.0 if leaving @ axis > 0.0 else -1.0
    other = hand.session.scene[partner]
    return 1.0 if (middle(part) - middle(other)) @ axis >= 0.0 else -1.0


def line(hand: Gripper, about: str | ArrayLike | tuple[ArrayLike, ArrayLike]) -> tuple[Vector, Vector]:
    """(origin, unit direction), world, of what a script means by `about`."""
    if isinstance(about, tuple) and len(about) == 2:
        return vector(about[0], "about"), direction(hand, about[1], outward=True)
    if isinstance(about, str) and about == "axis":
        fit = _axial(hand, held_part(hand, "about='axis'").name)
        return np.array(fit.origin), np.array(fit.direction)
    where = middle(hand.session.scene[hand.held]) if hand.held else np.array(hand.pose.translation)
    return where, direction(hand, about, outward=True)  # type: ignore[arg-type]


def _axial(hand: Gripper, part: str) -> ConstraintView:
    fits = [c for c in hand.session.constraints_of(part) if c.kind in _AXIAL]
    if not fits:
        have = ", ".join(c.kind for c in hand.session.constraints_of(part)) or "none"
        raise TaskError(f"{part} has no axis to go by: no concentric fit holds it (its constraints: {have})")
    return min(fits, key=lambda c: (_AXIAL.index(c.kind), c.id))


def best_fit(part: Part, target: Part, tolerance: Tolerance) -> tuple[Feature, Feature]:
    """The shaft of `part` and the bore of `target` (or the other way round: a ring over a pin) that fit best.

    Radii that fit: within `Tolerance.clearance`, else as clearance holes do; of those the largest shared surface; of
    equal ones (within 1 %) the nearest.
    """
    limits = Limits.offer(tolerance)

    def cylinders(of: Part, sense: int) -> list[Feature]:
        return [f for f in of.features if isinstance(f.geometry, Cylinder) and f.sense == sense]

    pairs = [(s, b) for s in cylinders(part, 1) for b in cylinders(target, -1)]
    pairs += [(s, b) for s in cylinders(part, -1) for b in cylinders(target, 1)]
    loose = [(s, b) for s, b in pairs if limits.fit(*_shaft_and_clearance(s, b))]
    fits = [(s, b) for s, b in loose if abs(_radius(s) - _radius(b)) <= tolerance.clearance] or loose
    if not fits:
        raise TaskError(
            f"nothing of {part.name} fits into {target.name}: no shaft and bore with a radial clearance of at most "
            f"{tolerance.clearance * 1e3:g} mm, or {tolerance.clearance_relative:.2g} of the shaft's diameter "
            "(Tolerance.clearance, clearance_relative)"
        )
    largest = max(min(s.area, b.area) for s, b in fits)
    return min((f for f in fits if min(f[0].area, f[1].area) > 0.99 * largest), key=lambda f: _aside(part, target, *f))


def _shaft_and_clearance(s: Feature, b: Feature) -> tuple[float, float]:
    """m: radius of the solid one of two cylinders, and how much wider the hollow one is."""
    shaft, bore = (s, b) if s.sense > 0 else (b, s)
    return _radius(shaft), _radius(bore) - _radius(shaft)


def _aside(part: Part, target: Part, shaft: Feature, bore: Feature) -> float:
    """m: how far the middle of the shaft is from the axis of the bore."""
    assert isinstance(bore.geometry, Cylinder)
    to = target.pose.actInv(part.pose.act(shaft.samples.mean(0))) - bore.geometry.origin
    return float(np.linalg.norm(np.cross(to, bore.geometry.axis)))


def in_front(part: Part, target: Part, shaft: Feature, bore: Feature, gap: float) -> tuple[Vector, pin.SE3]:
    """The way in (3,) and the pose in which `part` stands on the bore's axis, `gap` before the nearest of its mouth.

    The part comes in by the side it is on, and keeps its heading as far as the axis allows.
    """
    assert isinstance(shaft.geometry, Cylinder) and isinstance(bore.geometry, Cylinder)
    axis = target.pose.rotation @ bore.geometry.axis
    mouth = target.pose.act(bore.samples.mean(0))
    here = part.pose.act(shaft.samples.mean(0))
    way = axis if (mouth - here) @ axis >= 0.0 else -axis
    own = part.pose.rotation @ shaft.geometry.axis
    if own @ way < 0.0:
        own = -own
    turn = pin.Quaternion.FromTwoVectors(own, way).toRotationMatrix()
    rotation = turn @ part.pose.rotation
    on_axis = target.pose.act(np.array(bore.geometry.origin))
    point = rotation @ shaft.geometry.origin
    shift = on_axis - point
    vertices = part.mesh.vertices[np.unique(part.mesh.triangles)] @ rotation.T + shift
    lead = float((vertices @ way).max())
    entry = float((bore.samples @ target.pose.rotation.T @ way).min() + target.pose.translation @ way)
    return way, pin.SE3(rotation, shift + (entry - gap - lead) * way)


def top_of(part: Part) -> tuple[float, Vector]:
    """Height (m, world z) and middle (x, y) of the largest upward plane of a part."""
    flat = []
    for feature in part.features:
        if isinstance(feature.geometry, Plane) and (part.pose.rotation @ feature.geometry.normal)[2] > 0.999:
            points = feature.samples @ part.pose.rotation.T + part.pose.translation
            flat.append((feature.area, float(points[:, 2].mean()), 0.5 * (points.min(0) + points.max(0))[:2]))
    if not flat:
        raise TaskError(f"{part.name} has no flat top to place anything on")
    _, height, middle = max(flat, key=lambda f: f[0])
    return height, middle


def _radius(feature: Feature) -> float:
    assert isinstance(feature.geometry, Cylinder)
    return feature.geometry.radius


def held_part(hand: Gripper, verb: str) -> Part:
    """What the hand holds; TaskError if nothing."""
    if hand.held is None:
        raise TaskError(f"{hand.name}.{verb}: the hand is empty; grab a part first")
    return hand.session.scene[hand.held]


def other_part(hand: Gripper, verb: str, name: str) -> Part:
    """The part that the held one is to be brought to."""
    if name == hand.held:
        raise TaskError(f"{who(hand)}.{verb}({name!r}): that is the part in the hand; name another")
    return hand.session.scene[name]


def who(hand: Gripper) -> str:
    """The hand's name, with that of what it holds."""
    return f"{hand.name}[{hand.held}]" if hand.held else hand.name


def extent(part: Part, pose: pin.SE3) -> tuple[float, Vector]:
    """Lowest z and middle (3,) of the part's bounding box, world."""
    points = part.mesh.vertices[np.unique(part.mesh.triangles)] @ pose.rotation.T + pose.translation
    return float(points[:, 2].min()), 0.5 * (points.min(0) + points.max(0))


def middle(part: Part) -> Vector:
    """(3,) m, world: the middle of the part's box."""
    return extent(part, part.pose)[1]
