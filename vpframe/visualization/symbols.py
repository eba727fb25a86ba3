"""What a constraint, the freedom it leaves, a hand and its trail look like: polylines in the world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from constraints.geometry import perpendicular
from vpframe.events import ConstraintView, Frame
from vpframe.visualization import palette

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Symbol:
    """Polylines of one colour that mean one thing."""

    name: str
    """unique in a frame and the same from frame to frame, e.g. "constraint/3" """
    strips: tuple[Points, ...]
    """each (n, 3) world, metres"""
    color: palette.Color
    width: float
    """of the lines, pixels"""
    label: str = ""


def constraint_symbol(view: ConstraintView) -> Symbol:
    """The symbol of a constraint or candidate, coloured by its state.

    An axis with a ring for what turns about one (concentric, conical, toroidal, gear, screw, …), a ball for what
    turns about a point, a framed square with its normal for what lies on a plane or is held in a direction.
    """
    axis = _unit(view.direction)
    size = view.size
    kind = view.kind
    if kind in ("concentric", "conical", "toroidal", "screw", "gear", "belt"):
        strips = (_segment(view.origin, axis, -2.2 * size, 2.2 * size), circle(view.origin, axis, 1.15 * size))
        if kind == "screw":
            strips = (strips[0], _helix(view.origin, axis, 1.15 * size))
    elif kind in ("spherical", "point"):
        u, v = frame_about(axis)
        strips = tuple(circle(view.origin, n, 0.6 * size) for n in (axis, u, v))
    elif kind in ("line", "tangent", "parallel", "rack"):
        strips = (_segment(view.origin, axis, -1.5 * size, 1.5 * size),)
    else:
        strips = (_square(view.origin, axis, size), *arrow(view.origin, axis, 0.8 * size))
    names = f"{view.parts[0]} – {view.parts[1]}"
    return Symbol(
        f"constraint/{view.id}",
        strips,
        palette.STATE.get(view.state, palette.CANDIDATE),
        3.0 if view.state == "active" else 2.0,
        f"{kind}: {names}",
    )


def freedom_symbol(part: str, joint: str, at: ArrayLike, axis: ArrayLike, size: float) -> Symbol | None:
    """Arrows of the motion that a named lower pair leaves: straight ones slide, bent ones turn. None if there is none.

    `at` (3,), `axis` (3,) in the world: where the pair sits and the direction that names it. size: metres.
    """
    a = _unit(axis)
    u, v = frame_about(a)
    at = np.asarray(at, dtype=np.float64)
    slides: tuple[Points, ...] = {
        "prismatic": (a,),
        "cylindrical": (a,),
        "planar": (u, v),
    }.get(joint, ())  # fmt: skip
    turns: tuple[Points, ...] = {
        "revolute": (a,),
        "cylindrical": (a,),
        "screw": (a,),
        "planar": (a,),
        "spherical": (a, u, v),
        "universal": (u, v),
    }.get(joint, ())  # fmt: skip
    strips: list[Points] = []
    for d in slides:
        strips += arrow(at, d, size) + arrow(at, -d, size)
    for d in turns:
        strips += _turn(at, d, 0.62 * size)
    if not strips:
        return None
    return Symbol(f"freedom/{part}", tuple(strips), palette.FREEDOM, 3.0, f"{part}: {joint}")


def frame_symbols(frame: Frame, refused: bool = False) -> tuple[Symbol, ...]:
    """Symbols of a frame: constraints and candidates (refused ones on request), and the freedom left of what is held."""
    symbols = [constraint_symbol(view) for view in frame.constraints if refused or view.state != "refused"]
    for name in frame.held:
        mine = [view for view in frame.constraints if view.state == "active" and name in view.parts]
        if not mine or name not in frame.joint:
            continue
        # the axis of what turns names the pair; a plane's normal does when there is nothing else
        mine.sort(key=lambda view: (view.kind in ("against", "coplanar"), view.id))
        symbol = freedom_symbol(name, frame.joint[name], mine[0].origin, mine[0].direction, 2.4 * mine[0].size)
        if symbol:
            symbols.append(symbol)
    return tuple(symbols)


def trail_symbol(name: str, points: ArrayLike) -> Symbol:
    """Where something has been: one polyline (n, 3)."""
    return Symbol(f"trail/{name}", (np.asarray(points, dtype=np.float64),), palette.TRAIL, 2.0, name)


def hand_symbols(hands: Mapping[str, object], size: float) -> tuple[Symbol, ...]:
    """A tripod of `size` metres for each hand (name -> pinocchio.SE3)."""
    symbols = []
    for name, pose in hands.items():
        rotation, place = pose.rotation, pose.translation  # type: ignore[attr-defined]
        strips = tuple(np.array([place - size * e, place + size * e]) for e in rotation.T)
        ring = circle(place, rotation[:, 2], 0.7 * size)
        symbols.append(Symbol(f"hand/{name}", (*strips, ring), palette.HAND, 3.0, name))
    return tuple(symbols)


def circle(center: ArrayLike, axis: ArrayLike, radius: float, turn: float = 2 * np.pi, steps: int = 48) -> Points:
    """(n, 3) points of a circle, or of its first `turn` radians."""
    u, v = frame_about(axis)
    angle = np.linspace(0.0, turn, max(int(steps * turn / (2 * np.pi)), 3) + 1)[:, None]
    return np.asarray(center, dtype=np.float64) + radius * (np.cos(angle) * u + np.sin(angle) * v)


def arrow(start: ArrayLike, direction: ArrayLike, length: float) -> list[Points]:
    """Shaft and four barbs of an arrow from `start` along the unit vector `direction`."""
    a = np.asarray(direction, dtype=np.float64)
    start = np.asarray(start, dtype=np.float64)
    tip = start + length * a
    u, v = frame_about(a)
    barbs = [np.array([tip, tip - 0.22 * length * a + 0.09 * length * s]) for s in (u, -u, v, -v)]
    return [np.array([start, tip]), *barbs]


def frame_about(axis: ArrayLike) -> tuple[Points, Points]:
    """Two unit vectors that make a right-handed frame with the unit vector `axis`."""
    u = perpendicular(axis)
    return u, np.cross(axis, u)


def _unit(vector: ArrayLike) -> Points:
    v = np.asarray(vector, dtype=np.float64)
    length = np.linalg.norm(v)
    return v / length if length > 0 else np.array([0.0, 0.0, 1.0])


def _segment(origin: ArrayLike, axis: Points, start: float, stop: float) -> Points:
    return np.asarray(origin, dtype=np.float64) + np.outer([start, stop], axis)


def _square(origin: ArrayLike, normal: Points, half: float) -> Points:
    u, v = frame_about(normal)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * half
    return np.asarray(origin, dtype=np.float64) + corners @ np.array([u, v])


def _helix(origin: ArrayLike, axis: Points, radius: float, turns: float = 3.0) -> Points:
    angle = np.linspace(0.0, 2 * np.pi * turns, 97)[:, None]
    u, v = frame_about(axis)
    rise = (angle / angle[-1] - 0.5) * 2.0 * radius
    return np.asarray(origin, dtype=np.float64) + radius * (np.cos(angle) * u + np.sin(angle) * v) + rise * axis


def _turn(center: Points, axis: Points, radius: float) -> list[Points]:
    """Three quarters of a circle with an arrow head at its end."""
    arc = circle(center, axis, radius, 1.5 * np.pi)
    tangent = _unit(arc[-1] - arc[-2])
    outward = _unit(arc[-1] - center)
    head = 0.35 * radius
    barbs = [np.array([arc[-1], arc[-1] - head * tangent + s * 0.5 * head * outward]) for s in (1.0, -1.0)]
    return [arc, *barbs]


def extent(symbols: Iterable[Symbol]) -> tuple[Points, Points] | None:
    """Lower and upper corner (3,) of all strips; None if there are none."""
    points = [strip for symbol in symbols for strip in symbol.strips]
    if not points:
        return None
    stacked = np.concatenate(points)
    return stacked.min(axis=0), stacked.max(axis=0)
