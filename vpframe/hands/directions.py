"""Directions, lines and places that a script names ("axis", "up", a top), found in the present scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from constraints.geometry.surfaces import Plane
from vpframe.errors import TaskError
from vpframe.events import ConstraintView
from vpframe.hands.arguments import vector
from vpframe.hands.gripper import Gripper
from vpframe.hands.reach import middle
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
    hand.body("along='axis'")
    for held in hand.session.held_by(*hand.parts):
        sign = held.out or _out_sign(hand, hand.scene[hand.parts[0]], held.other, held.axis)
        return np.asarray(held.axis * (sign if outward else -sign))
    fit = _axial(hand)
    axis, other = np.array(fit.direction), hand.partner(fit)
    sign = _out_sign(hand, hand.scene[fit.parts[1 - other]], fit.parts[other], axis)
    return axis * (sign if outward else -sign)


def _out_sign(hand: Gripper, part: Part, partner: str, axis: Vector) -> float:
    """Return +1 if the part leaves along +axis: away from what it rests on, else from the partner's middle."""
    for c in resting(hand, partner):
        if abs(c.direction @ axis) > 0.9:
            return 1.0 if hand.leaving(c) @ axis > 0.0 else -1.0
    other = hand.scene[partner]
    return 1.0 if (middle(part) - middle(other)) @ axis >= 0.0 else -1.0


def resting(hand: Gripper, partner: str = "") -> list[ConstraintView]:
    """Return the against constraints of the parts in the hand, those with what the parts rest on first.

    Parts rest on a fixed part rather than on a loose one, and on a larger part rather than on a smaller one (by the
    volume of the bounding box): a cover on its housing, not on the heads of its screws. partner: the first of equals.
    """

    def rank(c: ConstraintView) -> tuple[bool, float, bool]:
        other = hand.scene[c.parts[hand.partner(c)]]
        low, high = box_of(other.mesh)
        return not other.fixed, -float((high - low).prod()), other.name != partner

    return sorted(hand.againsts(), key=rank)


def way_out(hand: Gripper, along: str | ArrayLike | None) -> Vector:
    """Return the direction (3,), unit, world, of `along`; default: outward axis, else off what it rests on, else up."""
    if along is not None:
        return direction(hand, along, outward=True)
    if hand.session.held_by(*hand.parts) or any(c.kind in _AXIAL for c in hand.mates()):
        return direction(hand, "axis", outward=True)
    ways = [hand.leaving(c) for c in resting(hand)]
    away = sum((way for way in ways if way @ ways[0] > OPPOSITE), np.zeros(3))
    length = float(np.linalg.norm(away))
    return away / length if length > 0.1 else np.array([0.0, 0.0, 1.0])


def line(hand: Gripper, about: str | ArrayLike | tuple[ArrayLike, ArrayLike]) -> tuple[Vector, Vector]:
    """Return (origin, unit direction), world, of the line that a script's `about` names."""
    if isinstance(about, tuple) and len(about) == 2:
        return vector(about[0], "about"), direction(hand, about[1], outward=True)
    if isinstance(about, str) and about == "axis":
        hand.body("about='axis'")
        for held in hand.session.held_by(*hand.parts):
            return held.origin, held.axis
        fit = _axial(hand)
        return np.array(fit.origin), np.array(fit.direction)
    where = middle(hand.scene[hand.held]) if hand.held else np.array(hand.pose.translation)
    return where, direction(hand, about, outward=True)  # type: ignore[arg-type]


def _axial(hand: Gripper) -> ConstraintView:
    on_it = hand.mates()
    fits = [c for c in on_it if c.kind in _AXIAL]
    if not fits:
        have = ", ".join(c.kind for c in on_it) or "none"
        raise TaskError(f"{hand.load} has no axis to go by: no concentric fit holds it (its constraints: {have})")
    return min(fits, key=lambda c: (_AXIAL.index(c.kind), c.id))


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
