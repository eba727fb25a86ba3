"""Symbols of constraints, freedom, hands and trails: polylines, the same in every back end.

A symbol is drawn once in a frame of its own (z along the axis or normal) and moved by its pose, so that a page or a
recording receives its shape once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import copysign, sqrt

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints.geometry.surfaces import perpendicular
from vpframe.events import ConstraintView, Frame
from vpframe.view import palette

Points = NDArray[np.float64]
X, Y, Z = np.eye(3)

TURNING = ("concentric", "conical", "toroidal", "screw", "gear", "belt")
"""constraint kinds about an axis"""
FLAT = ("against", "coplanar")
"""constraint kinds whose direction is a plane's normal"""
WIDTH = {"active": 3.0, "candidate": 2.0, "refused": 1.0}
"""line width of a constraint by its state, pixels"""


@dataclass(frozen=True, eq=False)
class SceneSymbol:
    """Polylines of one colour that mean one thing."""

    name: str
    """unique in a frame and the same from frame to frame, e.g. "constraint/3" """
    key: tuple[object, ...]
    """two symbols of one key have the same strips, colour and label"""
    strips: tuple[Points, ...]
    """each (n, 3) in the symbol's frame, metres"""
    pose: pin.SE3
    color: palette.Color
    width: float
    """line width, pixels"""
    label: str = ""
    hidden: float = 0.4
    """opacity in 0 … 1 of hidden lines"""

    def world(self) -> tuple[Points, ...]:
        """Return the strips in the world frame."""
        return tuple(strip @ self.pose.rotation.T + self.pose.translation for strip in self.strips)


def constraint_symbol(view: ConstraintView) -> SceneSymbol:
    """Return the symbol of a constraint or candidate, coloured by its state; thin, grey and faint if refused.

    An axis with a ring for what turns about an axis (concentric, conical, screw, …), a ball for what turns about a
    point, a line for what touches along one, a framed square with its normal for what lies on a plane.
    """
    size = _rounded(view.size)
    return SceneSymbol(
        name=f"constraint/{view.id}",
        key=(view.kind, view.state, size, view.parts),
        strips=_constraint_strips(view.kind, size),
        pose=frame_at(view.origin, view.direction),
        color=palette.STATE.get(view.state, palette.CANDIDATE),
        width=WIDTH.get(view.state, WIDTH["candidate"]),
        label=f"{view.kind}: {view.parts[0]} – {view.parts[1]}",
        hidden=0.15 if view.state == "refused" else 0.4,
    )


@lru_cache(maxsize=1024)
def _constraint_strips(kind: str, size: float) -> tuple[Points, ...]:
    if kind in TURNING:
        ring = _helix(1.15 * size) if kind == "screw" else circle(Z, 1.15 * size)
        return _segment(-2.2 * size, 2.2 * size), ring
    if kind in ("spherical", "point", "groove"):
        return tuple(circle(axis, 0.6 * size) for axis in (Z, X, Y))
    if kind in ("line", "tangent", "parallel", "rack-and-pinion"):
        return (_segment(-1.5 * size, 1.5 * size),)
    return _square(size), *arrow(Z, 0.8 * size)


SLIDES: dict[str, tuple[Points, ...]] = {"prismatic": (Z,), "cylindrical": (Z,), "planar": (X, Y)}
TURNS: dict[str, tuple[Points, ...]] = {
    "revolute": (Z,),
    "cylindrical": (Z,),
    "screw": (Z,),
    "planar": (Z,),
    "universal": (X, Y),
    "spherical": (X, Y, Z),
}


def freedom_symbol(part: str, joint: str, pose: pin.SE3, size: float) -> SceneSymbol | None:
    """Return arrows of the freedom of a lower pair, straight for slides, bent for turns; None without freedom.

    `pose`: where the pair sits, z along the direction that names it. `size`: metres.
    """
    strips = _freedom_strips(joint, _rounded(size))
    if not strips:
        return None
    return SceneSymbol(
        f"freedom/{part}", (joint, _rounded(size), part), strips, pose, palette.FREEDOM, 3.0, f"{part}: {joint}", 0.85
    )


@lru_cache(maxsize=1024)
def _freedom_strips(joint: str, size: float) -> tuple[Points, ...]:
    strips: list[Points] = []
    for axis in SLIDES.get(joint, ()):
        strips += arrow(axis, size) + arrow(-axis, size)
    for axis in TURNS.get(joint, ()):
        strips += _turn(axis, 0.62 * size)
    return tuple(strips)


def _rounded(size: float) -> float:
    """Return the size to three digits, so that a symbol is not redrawn for small changes."""
    return float(f"{max(float(size), 1e-9):.3g}")


def frame_symbols(
    frame: Frame, known: dict[int, tuple[ConstraintView, SceneSymbol]] | None = None
) -> tuple[SceneSymbol, ...]:
    """Return the symbols of a frame: constraints, candidates, refused ones, and the freedom of held parts.

    known: symbols by constraint, of the frame before: those of constraints that have not moved are taken from it.
    """
    symbols, known = [], {} if known is None else known
    for view in frame.constraints:
        drawn = known.get(view.id)
        if drawn is None or drawn[0] is not view:
            drawn = known[view.id] = view, constraint_symbol(view)
        symbols.append(drawn[1])
    for name in frame.held:
        mine = [view for view in frame.constraints if view.state == "active" and name in view.parts]
        if not mine or name not in frame.joint:
            continue
        naming = min(mine, key=lambda view: (view.kind in FLAT, view.id))  # prefer an axis to a normal
        pose = frame_at(naming.origin, naming.direction)
        symbol = freedom_symbol(name, frame.joint[name], pose, 2.4 * naming.size)
        if symbol:
            symbols.append(symbol)
    return tuple(symbols)


def hand_symbols(hands: Mapping[str, pin.SE3], size: float) -> tuple[SceneSymbol, ...]:
    """Return a tripod in a ring, `size` m, for each hand."""
    strips = (*(np.array([-size * axis, size * axis]) for axis in (X, Y, Z)), circle(Z, 0.7 * size))
    return tuple(
        SceneSymbol(f"hand/{name}", ("hand", size), strips, pose, palette.HAND, 3.0, name)
        for name, pose in hands.items()
    )


def trail_symbol(name: str, points: ArrayLike) -> SceneSymbol:
    """Return a trail: one polyline (n, 3) in the world."""
    strip = np.asarray(points, dtype=np.float64)
    return SceneSymbol(f"trail/{name}", (len(strip),), (strip,), pin.SE3.Identity(), palette.TRAIL, 2.0, name)


def gap_symbol(a: ArrayLike, b: ArrayLike, scale: float) -> SceneSymbol:
    """Return the least clearance: points `a` and `b` (3,), joined, in visible rings. scale: m, of the picture."""
    line = np.array([a, b], dtype=np.float64)
    middle = line.mean(axis=0)
    radius = max(0.03 * scale, 0.75 * float(np.linalg.norm(line[1] - line[0])))
    rings = [middle + circle(axis, radius) for axis in (X, Y, Z)]
    return SceneSymbol("gap", ("gap",), (line, *rings), pin.SE3.Identity(), palette.GAP, 2.0, "least clearance", 0.85)


def frame_at(origin: ArrayLike, direction: ArrayLike) -> pin.SE3:
    """Return the pose at `origin` (3,) with z along `direction` (3,); along the world's z if that is zero."""
    x, y, z = np.asarray(direction, dtype=np.float64).tolist()
    length = sqrt(x * x + y * y + z * z)
    x, y, z = (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 1.0)
    # Duff et al. 2017, "Building an Orthonormal Basis, Revisited": scalars, because this runs for each symbol and step
    sign = copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    rotation = np.array(
        [[1.0 + sign * x * x * a, b, x], [sign * b, sign + y * y * a, y], [-sign * x, -y, z]], dtype=np.float64
    )
    return pin.SE3(rotation, np.array(origin, dtype=np.float64))


def circle(axis: Points, radius: float, turn: float = 2 * np.pi) -> Points:
    """Return points (n, 3) of a circle about the origin, or of its first `turn` radians."""
    u = perpendicular(axis)
    v = np.cross(axis, u)
    angle = np.linspace(0.0, turn, 49)[:, None]
    return radius * (np.cos(angle) * u + np.sin(angle) * v)


def arrow(axis: Points, length: float) -> list[Points]:
    """Return shaft and four barbs of an arrow from the origin along the unit vector `axis`."""
    u = perpendicular(axis)
    v = np.cross(axis, u)
    tip = length * axis
    barbs = [np.array([tip, 0.78 * tip + 0.09 * length * side]) for side in (u, -u, v, -v)]
    return [np.array([np.zeros(3), tip]), *barbs]


def _segment(start: float, stop: float) -> Points:
    return np.outer([start, stop], Z)


def _square(half: float) -> Points:
    return half * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [1, 1, 0]], dtype=np.float64)


def _helix(radius: float, turns: int = 3) -> Points:
    angle = np.linspace(0.0, 2 * np.pi * turns, 32 * turns + 1)
    rise = radius * np.linspace(-1.0, 1.0, len(angle))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rise])


def _turn(axis: Points, radius: float) -> list[Points]:
    """Return three quarters of a circle with an arrow head at its end."""
    arc = circle(axis, radius, 1.5 * np.pi)
    end = arc[-1]
    outward = end / np.linalg.norm(end)
    along = np.cross(axis, outward)
    head = 0.35 * radius
    return [arc, *(np.array([end, end - head * along + 0.5 * side * head * outward]) for side in (1.0, -1.0))]
