"""Ways out that are worth trying first: straight along what holds the parts, and along their threads."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin

from constraints.freedom.escape import EscapeCone
from vpframe.planning.assembly import CLEAR, Array, Assembly, Knots, Mate, translation, turned

MOST_TURN: Final = 0.5 * np.pi
"""rad: how far one leg of a screw motion turns"""
MOST_NORMALS: Final = 12
"""directions of contacts along which a straight way is tried; more are those of a round surface"""
MOST_OWN: Final = 5
"""directions of a group's own surfaces along which a straight way is tried, either way"""
SAME: Final = 1e-9
"""1: two directions that differ by less are one"""


@dataclass(frozen=True, eq=False)
class Way:
    """A motion of a group of parts until it is clear of all others."""

    motion: str
    """"straight", "screw", "slide" or "free\""""
    direction: Array
    """(3,) unit, world: along which it ends"""
    knots: Knots
    turns: float = 0.0
    """of a screw, until it is out of its thread; negative for a left-hand thread"""
    larger: bool = False
    """whether it is the larger part of a thread that turns"""

    @property
    def text(self) -> str:
        """In words."""
        x, y, z = (round(float(c), 4) + 0.0 for c in self.direction)
        along = f"along ({x:g}, {y:g}, {z:g})"
        return f"unscrewed {abs(self.turns):.4g} turns, {along}" if self.motion == "screw" else f"{self.motion} {along}"


def unit(vector: Array) -> Array:
    """The unit vector along (3,), small parts of it that are rounding taken off."""
    v = np.asarray(vector, np.float64) / np.linalg.norm(vector)
    v = np.where(np.abs(v) < 1e-12, 0.0, v)
    return np.asarray(v / np.linalg.norm(v) + 0.0)


def distinct(directions: Iterable[Array]) -> list[Array]:
    """Unit vectors in their order, each once."""
    out: list[Array] = []
    for direction in directions:
        d = unit(direction)
        if not any(np.abs(d - known).max() <= SAME for known in out):
            out.append(d)
    return out


AXES: Final = tuple(unit(sign * axis) for axis in np.eye(3)[::-1] for sign in (1.0, -1.0))
"""the world's, upwards first"""


def cone_of(
    assembly: Assembly, group: Sequence[int], others: Iterable[int]
) -> tuple[EscapeCone, tuple[tuple[int, int, int, int], ...]]:
    """What the contacts of a group with others leave it; and what surfaces face each other in each row."""
    others = tuple(others)
    points, normals, told = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    for i in group:
        for j in others:
            for patch in assembly.patches(i, j):
                points.append(patch.points)
                normals.append(patch.normals)
                told += [(i, patch.surfaces[0], j, patch.surfaces[1])] * len(patch.points)
    corners = np.concatenate([assembly.sweeps.corners(i) for i in group])
    low, high = corners.min(axis=0), corners.max(axis=0)
    cone = EscapeCone.of(
        np.concatenate(points), np.concatenate(normals), 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    )
    return cone, tuple(told)


def mates_between(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> list[Mate]:
    """Fits and threads of a group with others."""
    return [mate for j in others for i in group for mate in assembly.mates_of(i, j)]


def directions(assembly: Assembly, group: Sequence[int], others: Iterable[int], cone: EscapeCone) -> list[Array]:
    """Along which a group may come out straight: what its fits and contacts leave it, then the axes of its surfaces,
    then the world's."""
    axes = [mate.axis for mate in mates_between(assembly, group, others) if mate.axis.any()]
    found = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    flat = np.unique(np.round(cone.rows[:, :3], 9), axis=0) if len(cone.rows) else np.zeros((0, 3))
    normals = [sign * n for n in (flat if len(flat) <= MOST_NORMALS else ()) for sign in (1.0, -1.0)]
    return distinct([*found, *cone.directions(), *own_axes(assembly, group), *AXES, *normals])


def own_axes(assembly: Assembly, group: Iterable[int]) -> list[Array]:
    """Directions that a group's own surfaces have: normals of planes, axes of round ones, those of most area first."""
    areas: list[tuple[float, Array]] = []
    for i in group:
        for feature in assembly.scene.parts[i].features:
            g = feature.geometry
            axis = getattr(g, "normal", getattr(g, "axis", None))
            if axis is None:
                continue
            d = unit(assembly.poses[i].rotation @ axis)
            same = next((k for k, (_, e) in enumerate(areas) if abs(abs(float(d @ e)) - 1.0) < SAME), None)
            if same is None:
                areas.append((feature.area, d))
            else:
                areas[same] = areas[same][0] + feature.area, areas[same][1]
    areas.sort(key=lambda entry: -entry[0])
    return [sign * d for _, d in areas[:MOST_OWN] for sign in (1.0, -1.0)]


def straight(assembly: Assembly, group: Sequence[int], others: Iterable[int], direction: Array) -> Way:
    """Straight along a direction until a plane across it parts the group from all others."""
    far = assembly.far(group, others, direction)
    return Way("straight", direction, (pin.SE3.Identity(), translation(far * direction)))


def screws(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> list[Way]:
    """Along each thread of a group with others, either way: turned until it is out of all threads of that axis, then
    straight."""
    others = tuple(others)
    threads = []
    for j in others:
        for i in group:
            for mate in assembly.mates_of(i, j):
                if mate.pitch is not None:
                    threads.append((mate, mate.parts[0] == i))
    out = []
    done: list[tuple[Array, Array, float]] = []
    for mate, _ in threads:
        assert mate.pitch is not None
        if any(_same_screw(mate, *known) for known in done):
            continue
        done.append((mate.origin, mate.axis, mate.pitch))
        alike = [(m, mine) for m, mine in threads if _same_screw(m, *done[-1])]
        partners = {m.parts[1] if mine else m.parts[0] for m, mine in alike}
        larger = sum(map(assembly.size, group)) > max(map(assembly.size, partners))
        for sign in (1.0, -1.0):
            direction = unit(sign * mate.axis)
            far = max(_until_apart(m, mine, direction) for m, mine in alike)
            if not np.isfinite(far):
                continue
            on = far + 0.9 * CLEAR  # it goes on turning until a session, too, lets the thread go
            angle = sign * on / mate.pitch * 2.0 * np.pi
            n = max(1, int(np.ceil(abs(angle) / MOST_TURN)))
            knots = [turned(mate.origin, mate.axis, angle * k / n, sign * on * k / n) for k in range(n + 1)]
            beyond = assembly.far(group, others, direction, knots[-1])
            knots.append(translation(beyond * direction) * knots[-1])
            out.append(Way("screw", direction, tuple(knots), far / mate.pitch, larger))
    return out


def _until_apart(mate: Mate, first: bool, direction: Array) -> float:
    """m: how far the moving part of a thread goes along a direction of its axis until it is out of it."""
    forward = (mate.axis @ direction > 0.0) == first
    return mate.apart[0] if forward else mate.apart[1]


def _same_screw(mate: Mate, origin: Array, axis: Array, pitch: float) -> bool:
    if mate.pitch is None or abs(mate.pitch - pitch) > 1e-9 or abs(abs(mate.axis @ axis) - 1.0) > 1e-12:
        return False
    shift = mate.origin - origin
    return bool(np.linalg.norm(shift - (shift @ axis) * axis) <= 1e-9)
