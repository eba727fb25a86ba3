"""Candidate paths: straight along fits, contacts and axes, and along threads; and their description in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
import pinocchio as pin

from collision import SurfaceMesh
from constraints.freedom.escape import EscapeCone
from vpframe.analysis.mate_motions import MateMotion
from vpframe.planning.assembly import CLEAR, Array, Assembly, Knots, translation, turned

MOST_TURN: Final = 0.5 * np.pi
"""rad: how far one leg of a screw motion turns"""
MOST_NORMALS: Final = 12
"""directions of contacts along which a straight way is tried; more are those of a round surface"""
MOST_OWN: Final = 5
"""directions of a group's own surfaces along which a straight way is tried, either way"""
SAME: Final = 1e-9
"""1: two directions that differ by less are one"""
NO_TURN: Final = 1e-6
"""rad: a leg that turns by less is a slide"""
LEAST_SLIDE, LEAST_ANGLE = 1e-5, np.radians(0.1)
"""m and rad: shorter legs are left out of the text"""
SAME_AXIS, ON_LINE = 1e-5, 1e-6
"""1 and m: two legs about lines, or along directions, that differ by less are one"""
MOST_LEGS: Final = 6
"""legs of a path in its text"""


@dataclass(frozen=True, eq=False)
class Leg:
    """A stretch of a way: a turn about a line, an advance along it or a slide, or both at once."""

    angle: float
    """rad, >= 0"""
    axis: Array
    """(3,) unit, world: of the turn; zeros without one"""
    point: Array
    """(3,) world, m: on the axis; where the line is far from the group, its middle"""
    shift: Array
    """(3,) world, m: the advance along the axis, or how far the group's middle slides"""

    @property
    def length(self) -> float:
        """m"""
        return float(np.linalg.norm(self.shift))

    @property
    def matters(self) -> bool:
        """Whether it is part of the text."""
        return self.length >= LEAST_SLIDE or self.angle >= LEAST_ANGLE

    @property
    def text(self) -> str:
        """In words."""
        slides, turns = self.length >= LEAST_SLIDE, self.angle >= LEAST_ANGLE
        slide = f"slide {self.length * 1e3:.3g} mm along {_words(self.shift / max(self.length, 1e-300))}"
        angle = f"{np.degrees(self.angle):.3g}° about {_words(self.axis)}"
        if slides:
            return f"{slide}, turning {angle}" if turns else slide
        return f"turn {angle}"

    def joined(self, other: Leg) -> Leg | None:
        """Both legs as one, None where the other leg does not continue this one."""
        same = self._same_screw(other) if self.angle else not other.angle and self._same_slide(other)
        if not same:
            return None
        return Leg(self.angle + other.angle, self.axis, self.point, self.shift + other.shift)

    def _same_slide(self, other: Leg) -> bool:
        across = np.linalg.norm(np.cross(self.shift, other.shift))
        return bool(across <= SAME_AXIS * self.length * other.length and self.shift @ other.shift >= 0.0)

    def _same_screw(self, other: Leg) -> bool:
        shift = self.shift + other.shift
        lead = (other.shift @ self.axis) * self.angle - (self.shift @ self.axis) * other.angle
        return bool(
            np.abs(self.axis - other.axis).max() < SAME_AXIS
            and np.linalg.norm(np.cross(other.point - self.point, self.axis)) <= ON_LINE
            and np.linalg.norm(np.cross(shift, self.axis)) <= ON_LINE
            and abs(lead) <= ON_LINE * max(self.angle, other.angle)
        )


@dataclass(frozen=True, eq=False)
class RemovalPath:
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
    middle: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) world, m: of the group where it stands, for `legs`"""
    radius: float = np.inf
    """m: half the diagonal of the group's box: a turn about a line farther from its middle counts as a slide"""

    @property
    def length(self) -> float:
        """Sum of the translations between knots, m."""
        return sum(float(np.linalg.norm(b.translation - a.translation)) for a, b in pairwise(self.knots))

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Its legs in their order; those that continue each other as one."""
        out: list[Leg] = []
        for start, end in pairwise(self.knots):
            leg = _leg(start, end, self.middle, self.radius)
            both = out[-1].joined(leg) if out else None
            out[-1:] = [both] if both is not None else [*out[-1:], leg]
        return tuple(out)

    @property
    def turned(self) -> float:
        """Turns in all: of a screw `turns`, else the sum over its legs."""
        return self.turns if self.motion == "screw" else sum(leg.angle for leg in self.legs) / (2.0 * np.pi)

    @property
    def text(self) -> str:
        """In words."""
        along = f"along {_words(self.direction)}"
        if self.motion == "screw":
            return f"unscrewed {abs(self.turns):.4g} turns, {along}"
        if self.motion == "straight":
            return f"straight {along}"
        legs = [leg.text for leg in self.legs if leg.matters]
        more = len(legs) - MOST_LEGS
        # the last leg is the way out
        shown = legs if more <= 0 else [*legs[: MOST_LEGS - 1], f"{more} more legs", legs[-1]]
        return ", then ".join(shown) or f"{self.motion} {along}"


def _words(vector: Array) -> str:
    x, y, z = (round(float(c), 4) + 0.0 for c in vector)
    return f"({x:g}, {y:g}, {z:g})"


def _leg(start: pin.SE3, end: pin.SE3, middle: Array, radius: float) -> Leg:
    turn = pin.log3(end.rotation @ start.rotation.T)
    angle, here = float(np.linalg.norm(turn)), start.act(middle)
    slide = end.act(middle) - here
    if angle < NO_TURN:
        return Leg(0.0, np.zeros(3), here, slide)
    axis = turn / angle
    twist = pin.log6(end * start.inverse())
    point = np.cross(axis, twist.linear) / angle
    if np.linalg.norm(np.cross(here - point, axis)) > radius:
        return Leg(angle, axis, here, slide)
    return Leg(angle, axis, point, float(twist.linear @ axis) * axis)


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
    """The escape cone of a group among others; and for each row part, surface, other part, its surface."""
    others = tuple(others)
    points, normals, faces = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    for i in group:
        for j in filter(assembly.partners[i].__contains__, others):
            for patch in assembly.patches(i, j):
                points.append(patch.points)
                normals.append(patch.normals)
                faces += [(i, patch.surfaces[0], j, patch.surfaces[1])] * len(patch.points)
    return EscapeCone.of(np.concatenate(points), np.concatenate(normals), *assembly.ball(group)), tuple(faces)


def mates_between(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> list[MateMotion]:
    """Fits and threads of a group with others."""
    near = frozenset[int]().union(*(assembly.partners[i] for i in group))
    return [mate for j in filter(near.__contains__, others) for i in group for mate in assembly.mates_of(i, j)]


def directions(assembly: Assembly, group: Sequence[int], others: Iterable[int], cone: EscapeCone) -> list[Array]:
    """Candidate directions of straight removal: of fits and of the escape cone, then of own surfaces, then the world's
    axes."""
    axes = [mate.axis for mate in mates_between(assembly, group, others) if mate.axis.any()]
    found = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    flat = np.unique(np.round(cone.rows[:, :3], 9), axis=0) if len(cone.rows) else np.zeros((0, 3))
    normals = [sign * n for n in (flat if len(flat) <= MOST_NORMALS else ()) for sign in (1.0, -1.0)]
    return distinct([*found, *cone.directions(), *own_axes(assembly, group), *AXES, *normals])


def own_axes(assembly: Assembly, group: Iterable[int]) -> list[Array]:
    """Normals of planes and axes of round surfaces of a group, both signs, the largest area first."""
    areas: list[tuple[float, Array]] = []
    for i in group:
        if assembly.scene.parts[i].shape.faceted:
            areas += [(area, unit(assembly.poses[i].rotation @ n)) for area, n in facet_directions(assembly.meshes[i])]
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


def facet_directions(mesh: SurfaceMesh) -> list[tuple[float, Array]]:
    """Areas (m²) and unit normals (3,) of the MOST_OWN directions of a mesh's triangles with the largest area."""
    corners = mesh.vertices[mesh.triangles]
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(vectors, axis=1)
    normals = np.round(vectors[lengths > 0.0] / lengths[lengths > 0.0, None], 6) + 0.0
    first = np.take_along_axis(normals, (normals != 0.0).argmax(axis=1)[:, None], axis=1)
    found, of = np.unique(normals * np.sign(first), axis=0, return_inverse=True)
    areas = 0.5 * np.bincount(of.ravel(), lengths[lengths > 0.0])
    return [(float(areas[k]), found[k]) for k in np.argsort(-areas, kind="stable")[:MOST_OWN]]


def out_of(assembly: Assembly, group: Sequence[int]) -> Array | None:
    """The direction in which a fastener comes out, away from its tip, (3,) unit, world; None of other parts."""
    found = assembly.fasteners.get(group[0]) if len(group) == 1 else None
    return None if found is None else unit(assembly.poses[group[0]].rotation @ -found.axis)


def straight(assembly: Assembly, group: Sequence[int], others: Iterable[int], direction: Array) -> RemovalPath:
    """The straight path along a direction until a perpendicular plane separates the group from all others."""
    far = assembly.far(group, others, direction)
    return RemovalPath("straight", direction, (pin.SE3.Identity(), translation(far * direction)))


def screws(assembly: Assembly, group: Sequence[int], others: Iterable[int]) -> list[RemovalPath]:
    """Screw paths along each thread of a group with others, both signs: until all threads of that axis are disengaged,
    then straight."""
    others = tuple(others)
    threads = []
    for mate in mates_between(assembly, group, others):
        if mate.pitch is not None:
            threads.append((mate, mate.parts[0] in group))
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
            out.append(RemovalPath("screw", direction, tuple(knots), far / mate.pitch, larger))
    return out


def _until_apart(mate: MateMotion, first: bool, direction: Array) -> float:
    """Advance of the moving part of a thread along its axis until it is disengaged, m."""
    forward = (mate.axis @ direction > 0.0) == first
    return mate.apart[0] if forward else mate.apart[1]


def _same_screw(mate: MateMotion, origin: Array, axis: Array, pitch: float) -> bool:
    if mate.pitch is None or abs(mate.pitch - pitch) > 1e-9 or abs(abs(mate.axis @ axis) - 1.0) > 1e-12:
        return False
    shift = mate.origin - origin
    return bool(np.linalg.norm(shift - (shift @ axis) * axis) <= 1e-9)
