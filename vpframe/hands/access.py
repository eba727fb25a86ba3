"""`Reach`: whether a straight tool or finger can reach what a hand grabs or turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh, Tolerance
from vpframe.errors import TaskError
from vpframe.hands.arguments import number
from vpframe.hands.reach import spans
from vpframe.scene.boxes import placed_corners
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed

Array = NDArray[np.float64]

SECTORS, RINGS = 16, 3
"""mesh of the capsule: sectors around its axis, and rings on each end"""
OFF = 2e-4
"""gap between the tip and the touched point, m"""
MOST_NAMED = 3
"""maximum number of parts named as in the way"""
PLACES = 48
"""maximum number of points of a part that are tried"""


@dataclass(frozen=True)
class Reach:
    """A straight tool or finger (a capsule) that must reach what the hand grabs or turns, from outside the scene."""

    length: float = 0.1
    """m"""
    diameter: float = 0.012
    """m"""

    def __post_init__(self) -> None:
        number(self.length, "Reach: length", above=0.0), number(self.diameter, "Reach: diameter", above=0.0)
        if self.length < self.diameter:
            raise TaskError(f"Reach: length={self.length!r} is less than the diameter, {self.diameter!r}; swap them?")

    def __str__(self) -> str:
        return f"a straight tool {self.length * 1e3:g} mm long, Ø{self.diameter * 1e3:g} mm"

    def mesh(self) -> SurfaceMesh:
        """Return a mesh that encloses the capsule, about z, with its tip at the origin."""
        angle, bend = np.pi / SECTORS, 0.5 * np.pi / RINGS
        r = 0.5 * self.diameter
        polar = (np.arange(RINGS) + 0.5) * bend  # polygons circumscribed about the circles
        bulge = r / np.cos(0.5 * bend)
        low = [(bulge * np.sin(t) / np.cos(angle), r - bulge * np.cos(t)) for t in polar]
        rings = np.array([*low, *((rho, self.length - z) for rho, z in low[::-1])])
        around = 2.0 * angle * np.arange(SECTORS)
        circle = np.stack([np.cos(around), np.sin(around)], axis=1)
        body = np.concatenate([np.column_stack([rho * circle, np.full(SECTORS, z)]) for rho, z in rings])
        vertices = np.concatenate([body, [[0.0, 0.0, 0.0], [0.0, 0.0, self.length]]])
        n, next_ = np.arange(SECTORS), (np.arange(SECTORS) + 1) % SECTORS
        triangles = [np.column_stack([np.full(SECTORS, len(body)), next_, n])]
        for k in range(len(rings) - 1):
            a, b = k * SECTORS, (k + 1) * SECTORS
            triangles += [np.column_stack([a + n, a + next_, b + next_]), np.column_stack([a + n, b + next_, b + n])]
        top = (len(rings) - 1) * SECTORS
        triangles.append(np.column_stack([top + n, top + next_, np.full(SECTORS, len(body) + 1)]))
        faces = np.concatenate(triangles).astype(np.int32)
        return SurfaceMesh(vertices, faces, np.zeros(len(faces), np.int32))


def reach_of(value: Reach | bool, what: str) -> Reach | None:
    """Return the tool for a flag or a `Reach`; None for False. Raises TaskError that names `what`."""
    if isinstance(value, Reach):
        return value
    if isinstance(value, bool):
        return Reach() if value else None
    raise TaskError(f"{what}={value!r}; give True, False, or vp.Reach(length=0.1, diameter=0.012), in metres")


class Access:
    """Collision queries of a tool among the parts of a scene at their present poses."""

    def __init__(self, scene: Scene, tolerance: Tolerance, reach: Reach, without: Sequence[str] = ()) -> None:
        self.parts = [part for part in scene.parts if part.name not in without]
        self.reach = reach
        self.manager = CollisionManager(tolerance)
        for part in self.parts:
            self.manager.add(part.mesh, part.pose, movable=False)
        self.tool = self.manager.add(reach.mesh(), pin.SE3.Identity())
        points = np.concatenate([placed_corners(part, part.pose) for part in scene.parts])
        low, high = points.min(0), points.max(0)
        self.outside = float(np.linalg.norm(high - low)) + 2.0 * reach.length

    def obstacles(self, tip: Array, axis: Array) -> tuple[str, ...]:
        """Return the parts that keep the tool from a pose, or the first on the way there; empty if it can be reached.

        The tool's tip is at `tip` (3,) m, its body along `axis` (3,) unit, world. It comes straight from outside the
        scene: along its own axis, or along a world axis.
        """
        there = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix(), tip)
        self.manager.set_pose(self.tool, there)
        rows = self.manager.colliding_surfaces([self.tool])
        if len(rows):
            others = np.unique(np.where(rows[:, 0] == self.tool, rows[:, 2], rows[:, 0]))
            return tuple(self.parts[i].name for i in others)
        first = self._on_the_way(there, axis)
        if first is None or any(self._on_the_way(there, way) is None for way in (*np.eye(3), *-np.eye(3))):
            return ()
        return (first,)

    def _on_the_way(self, there: pin.SE3, way: Array) -> str | None:
        """Return the first part that the tool hits on its approach against `way`; None if there is none."""
        self.manager.set_pose(self.tool, pin.SE3(there.rotation, there.translation + self.outside * way))
        impact = self.manager.time_of_impact({self.tool: there})
        if not impact.hit:
            return None
        a, _, b, _ = impact.rows[0].tolist()
        return self.parts[a if a != self.tool else b].name


def to_turn(access: Access, parts: Sequence[Part], origin: Array, axis: Array) -> tuple[str, ...]:
    """Return the parts that keep a tool from the outer end of a screw on its axis; empty if it can be reached.

    access: without `parts`, which turn. origin, axis: (3,) m and (3,) unit, world, pointing outward.
    """
    return access.obstacles(origin + (spans(parts, axis)[1] - float(origin @ axis) + OFF) * axis, axis)


def to_grab(access: Access, parts: Sequence[Part], surface: int | None, hand: Array) -> tuple[str, int, Array]:
    """Find the point of a part, nearest to the hand, that a finger can reach along the normal.

    parts: of a subassembly; the first that can be reached is taken. hand: (3,) m, world. Returns the part, the surface
    and the point (3,), world, m. At most `PLACES` points of a part are tried.

    Raises
    ------
    TaskError: no point of them can be reached; names the parts in the way of the first part, those first that are in
        the way of the point that has fewest in its way.
    """
    met = Counter[str]()
    first: tuple[str, ...] = ()
    for part in parts:
        for point, normal, face in _places(part, surface, hand):
            found = access.obstacles(point + OFF * normal, normal)
            if not found:
                return part.name, face, point
            if part is parts[0]:
                met.update(found)
                if part.name not in found and (not first or len(found) < len(first)):
                    first = found
    name = parts[0].name
    rest = [other for other, _ in sorted(met.items(), key=lambda item: (-item[1], item[0])) if other != name]
    names = tuple(dict.fromkeys((*first, *rest))) or (name,)  # it is in the way of its own faces only
    raise TaskError(refused(access.reach, name if surface is None else f"surface {surface} of {name}", names, first))


def _places(part: Part, surface: int | None, hand: Array) -> Iterator[tuple[Array, Array, int]]:
    """Yield points (3,) m, world, all over a part, nearest to the hand first, with their normals and surfaces."""
    mesh = part.mesh
    corners = mesh.vertices[mesh.triangles] @ part.pose.rotation.T + part.pose.translation
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.where(areas > 0.0, areas, 1.0)[:, None]
    spots = np.hstack([corners.mean(axis=1) / np.linalg.norm(np.ptp(corners, axis=(0, 1))), normals])
    chosen = []
    for s in range(mesh.n_surfaces) if surface is None else (surface,):
        mine = mesh.triangles_of(s)
        mine = mine[np.argsort(-areas[mine], kind="stable")]
        mine = mine[areas[mine] > 0.0]
        chosen.append(mine[_spread(spots[mine], max(1, PLACES // (mesh.n_surfaces if surface is None else 1)))])
    tried = np.concatenate(chosen)
    tried = tried[_spread(spots[tried], PLACES)]
    points = corners[tried].mean(axis=1)
    for k in np.argsort(np.linalg.norm(points - hand, axis=1), kind="stable").tolist():
        yield points[k], normals[tried[k]], int(mesh.surface_of_triangle[tried[k]])


def _spread(spots: Array, count: int) -> list[int]:
    """Return the indices of at most `count` rows, each as far as possible from those before it; the first is row 0."""
    chosen: list[int] = []
    distance = np.full(len(spots), np.inf)
    while len(chosen) < min(count, len(spots)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((spots - spots[chosen[-1]]) ** 2).sum(axis=1))
        distance[chosen] = -1.0
    return chosen


def refused(reach: Reach, what: str, names: Sequence[str], first: Sequence[str] = ()) -> str:
    """Return the error message for a point that the tool cannot reach.

    names: parts in the way. first: those of them that have to go, if not all.
    """
    these = listed(first, MOST_NAMED) if first and set(first) != set(names) else "that" if len(names) == 1 else "them"
    mend = f"remove {these} first, or " if what not in names else ""
    return f"no access to {what} for {reach}: {listed(names, MOST_NAMED)} in the way; {mend}give a smaller Reach"
