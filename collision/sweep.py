"""The first time of contact along a motion: nothing thin is passed, at any speed.

Each object that moves goes from its pose to its target along one screw, the SE(3) geodesic: at time t in [0, 1] it is
at T0·exp(t·log(T0⁻¹·T1)); all move at once. Contact is when the distance of two surfaces falls to the tolerance.

- Never late: before the time that is returned no two surfaces that were apart have met.
- Early by no more than the tolerance: at that time two surfaces are within `Tolerance.linear` of each other.

Surfaces in contact at the start, at most the tolerance apart, could not part if that alone stopped them. Such a pair
stops the motion only if it approaches. Its signed distance (that of the triangles, and where they meet minus the
shortest translation that parts the two triangles) may shrink by `Tolerance.play`, a tenth of the tolerance, below what
it is at the start, so that surfaces slide; a pair that is pressed further stops the motion before it has begun to. The
time is the last at which it had not got there, to within one and a half times that tenth. However often that is asked,
a pair that is not deeper already is let no deeper than the tolerance, or than the deflection if that is given: the
tessellations of a shaft and its bore reach into each other by as much while the surfaces fit. Triangles smaller than
that depth are the one thing that may be passed, by the very pair of surfaces that is in contact already.

Advancement by certificates, see `collision.kernels_sweep` and `collision.kernels_hold`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from collision import poses
from collision.contact import CONTACT_DTYPE
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.proximity import mesh_clearance, near_surfaces, surface_contacts
from collision.shape import ShapeMesh
from collision.tree import MeshTree, tree_of

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.manager import CollisionManager

ROUNDING = 64.0 * 2.0**-53
"""of a box moved by a pose: three products and three sums a coordinate, and the pose's own error, generously"""


@dataclass(frozen=True, slots=True, eq=False)
class TimeOfContact:
    """The first contact on the way of some objects to their targets."""

    t: float
    """in [0, 1]: how far along the motion; 1 where nothing stops it"""
    contacts: NDArray[Any]
    """CONTACT_DTYPE rows of the surface pairs that stop it, at that time, world frame; none where nothing does"""
    poses: Mapping[int, pin.SE3]
    """where the moving objects are at that time"""

    @property
    def hit(self) -> bool:
        """Whether something stops the motion."""
        return len(self.contacts) > 0

    @property
    def rows(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface of the pairs that stop the motion, sorted."""
        names = ("object_a", "surface_a", "object_b", "surface_b")
        return np.stack([self.contacts[name] for name in names], axis=1).astype(np.int32).reshape(-1, 4)


@dataclass(frozen=True, slots=True, eq=False)
class _Mover:
    """One object on its way, or standing: pose at t = 0 and body twist over the unit of time."""

    mesh: SurfaceMesh
    tree: MeshTree
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    twist: NDArray[np.float64]
    end: tuple[NDArray[np.float64], NDArray[np.float64]]
    """rotation and translation at t = 1"""

    def at(self, t: float) -> pin.SE3:
        import pinocchio as pin

        return pin.SE3(self.rotation, self.translation) * pin.exp6(pin.Motion(t * self.twist))


def time_of_contact(manager: CollisionManager, moves: Mapping[int, Any], deflection: float = 0.0) -> TimeOfContact:
    """The first contact while the objects `moves` go from their poses to their targets, all at once.

    Parameters
    ----------
    moves: target pose (`pinocchio.SE3` or (4, 4)) by object; whatever is not named stays where it is.
    deflection: m, how deep surfaces in contact at the start may reach into each other because of their tessellation.

    Ignored pairs of objects and of surfaces stop nothing.
    """

    if not 0.0 <= deflection < np.inf:
        raise CollisionError(f"deflection is {deflection!r}; give a finite length of at least 0 m")
    moving = {i: _mover(manager, i, _target(manager, i, target)) for i, target in moves.items()}
    movers = dict(moving)
    first = 1.0
    stops: list[tuple[int, int, tuple[int, int], set[tuple[int, int]]]] = []
    for i, j in _pairs(manager, moving):
        for k in (i, j):
            if k not in movers:
                movers[k] = _mover(manager, k, None)
        t, pair, touching = _pair_time(manager, movers[i], movers[j], i, j, first, deflection)
        if t <= first and pair[0] >= 0:
            if t < first:
                stops.clear()
            first = min(first, t)
            stops.append((i, j, pair, touching))
    contacts = [_contacts(manager, movers, i, j, pair, touching, first) for i, j, pair, touching in stops]
    rows = np.concatenate([np.empty(0, CONTACT_DTYPE), *contacts])
    return TimeOfContact(first, rows, {i: moving[i].at(first) for i in sorted(moving)})


def _target(manager: CollisionManager, i: int, target: Any) -> NDArray[np.float64]:
    return poses.pack(target, f"target of object {i} ({manager.mesh(i).name})", i, manager.tolerance.rigid)


def _mover(manager: CollisionManager, i: int, end: NDArray[np.float64] | None) -> _Mover:
    """An object on its way to the (12,) pose `end`, or standing."""
    import pinocchio as pin

    mesh, pose = manager.mesh(i), manager.pose(i)
    rotation, translation = np.ascontiguousarray(pose.rotation), np.array(pose.translation)
    twist, last = np.zeros(6), (rotation, translation)
    if end is not None:
        last = end[:9].reshape(3, 3), end[9:]
        twist = np.array(pin.log6(pose.actInv(pin.SE3(*last))))
    return _Mover(mesh, tree_of(mesh), rotation, translation, twist, last)


def _pairs(manager: CollisionManager, moving: Mapping[int, _Mover]) -> list[tuple[int, int]]:
    """Pairs i < j of which one moves, that are heeded, and whose ways come near each other."""
    box = manager.world_boxes().copy()
    for i, mover in moving.items():
        own = mover.tree.box[0]
        center, half = 0.5 * (own[:3] + own[3:]), 0.5 * (own[3:] - own[:3])
        rotation, translation = mover.end
        middle, reach = rotation @ center + translation, np.abs(rotation) @ half
        reach += ROUNDING * float((np.abs(translation) + np.abs(center) + half).sum())  # for rounding
        beyond = _sagitta(mover.twist, center, float(np.sqrt(half @ half)))
        box[i, :3] = np.minimum(box[i, :3], middle - reach) - beyond
        box[i, 3:] = np.maximum(box[i, 3:], middle + reach) + beyond
    objects = manager.objects
    out = set()
    for i in moving:
        low, high = box[i, :3] - manager.tolerance.linear, box[i, 3:] + manager.tolerance.linear
        near = np.all((box[:, :3] <= high) & (box[:, 3:] >= low), axis=1).tolist()
        out |= {(min(i, j), max(i, j)) for j in objects if near[j] and j != i}
    return sorted(pair for pair in out if not manager.ignored(*pair))


def _sagitta(twist: NDArray[np.float64], center: NDArray[np.float64], radius: float) -> float:
    """How far points of a ball stray from their chords on the screw: each turns about its axis by |w|."""
    vx, vy, vz, wx, wy, wz = twist.tolist()
    turn = math.sqrt(wx * wx + wy * wy + wz * wz)
    if turn == 0.0:
        return 0.0
    cx, cy, cz = center.tolist()
    x, y, z = wy * cz - wz * cy + vx, wz * cx - wx * cz + vy, wx * cy - wy * cx + vz
    along = (x * wx + y * wy + z * wz) / (turn * turn)
    arm = math.hypot(x - along * wx, y - along * wy, z - along * wz)
    return (arm / turn + radius) * (1.0 - math.cos(0.5 * min(turn, math.pi)))


def _pair_time(
    manager: CollisionManager, a: _Mover, b: _Mover, i: int, j: int, until: float, deflection: float
) -> tuple[float, tuple[int, int], set[tuple[int, int]]]:
    """(time or infinity, the pair of surfaces, the pairs in contact at the start)."""
    from collision import kernels_sweep
    from collision.kernels_distance import rounding_of

    for mesh in (a.mesh, b.mesh):
        if isinstance(mesh, ShapeMesh):
            raise CollisionError(f"{mesh.name}: a shape without triangles is not swept; give it as a SurfaceMesh")
    tolerance = manager.tolerance.linear
    play = manager.tolerance.play * tolerance
    heeded = manager.heeded_surfaces(i, j)
    start = manager.relative_pose(i, j)
    rotation, translation = np.ascontiguousarray(start.rotation), start.translation
    rounding = rounding_of(a.tree.box, b.tree.box, rotation, translation)
    room = _room()
    near = near_surfaces(a.tree, b.tree, rotation, translation, tolerance + rounding, heeded)
    depths = _signed_distances(a, b, near, rotation, translation, np.nextafter(tolerance, np.inf), rounding, room)
    touching = depths <= tolerance
    surfaces, depths = near[touching], depths[touching]
    level = np.empty((0, 0))
    if heeded is not None or len(surfaces):
        level = np.full((a.mesh.n_surfaces, b.mesh.n_surfaces), tolerance)
        if heeded is not None:
            level[heeded == 0] = -np.inf
        lowest = np.where(depths > play - tolerance, np.maximum(depths - play, -tolerance), depths - 0.01 * play)
        level[surfaces[:, 0], surfaces[:, 1]] = np.minimum(lowest, -deflection) if deflection > 0.0 else lowest
    hit = np.empty(2, np.int64)
    time, before = kernels_sweep.sweep(
        a.mesh.vertices, a.tree.box, a.tree.second, a.tree.first, a.tree.count, a.tree.corner, a.tree.surface,
        b.mesh.vertices, b.tree.box, b.tree.second, b.tree.first, b.tree.count, b.tree.corner, b.tree.surface,
        a.rotation, a.translation, a.twist, b.rotation, b.translation, b.twist,
        until, tolerance, play, kernels_sweep.STEPS, level, hit, *room,
        np.empty((3, 3, 3)), np.empty((3, 3)),
    )  # fmt: skip
    pair, pairs = (int(hit[0]), int(hit[1])), set(map(tuple, surfaces.tolist()))
    if pair in pairs and time <= until:
        time = _last_above(a, b, pair, before, time, float(level[pair]), play)
    return float(time), pair, pairs


def _room() -> tuple[NDArray[Any], ...]:
    """What the kernels work in: workspace, stack, and what is safe on the stack."""
    from collision.kernels_distance import STACK
    from collision.predicates import workspace

    return workspace(), np.empty((STACK, 2), np.int64), np.empty(STACK)


def _signed_distances(
    a: _Mover, b: _Mover, pairs: NDArray[np.int32], rotation: NDArray[np.float64], translation: NDArray[np.float64],
    within: float, rounding: float, room: tuple[NDArray[Any], ...],
) -> NDArray[np.float64]:  # fmt: skip
    """(n,) m of surface pairs (n, 2), b at a pose in a's frame; `within` (>= 0) where it is more."""
    from collision.kernels_signed import depths_of

    depths = np.empty(len(pairs))
    depths_of(
        pairs, a.tree.root, b.tree.root,
        a.mesh.vertices, a.tree.box, a.tree.second, a.tree.first, a.tree.count, a.tree.corner,
        b.mesh.vertices, b.tree.box, b.tree.second, b.tree.first, b.tree.count, b.tree.corner,
        rotation, translation, within, rounding, depths, *room,
    )  # fmt: skip
    return depths


def _last_above(
    a: _Mover, b: _Mover, pair: tuple[int, int], before: float, time: float, level: float, play: float
) -> float:
    """A time from `before` on at which the signed distance of a pair of surfaces is above `level` by `play` at most.

    It is above at `before`, and at or below at `time`; in between nothing gets below what the advancement held to.
    """
    from collision.kernels_distance import rounding_of

    surfaces, room = np.array([pair], np.int32), _room()

    def signed_distance(t: float) -> float:
        pose = a.at(t).actInv(b.at(t))
        rotation, translation = np.ascontiguousarray(pose.rotation), pose.translation
        rounding = rounding_of(a.tree.box, b.tree.box, rotation, translation)
        within = max(0.0, level + 2.0 * play)
        return float(_signed_distances(a, b, surfaces, rotation, translation, within, rounding, room)[0])

    apart = signed_distance(before)
    while apart > level + 1.5 * play:
        middle = 0.5 * (before + time)
        if not before < middle < time:
            break
        there = signed_distance(middle)
        if there > level:
            before, apart = middle, there
        else:
            time = middle
    return before


def _contacts(
    manager: CollisionManager, movers: Mapping[int, _Mover], i: int, j: int, pair: tuple[int, int],
    touching: set[tuple[int, int]], t: float,
) -> NDArray[Any]:  # fmt: skip
    """The pairs of surfaces that stop objects i and j at time t: `pair`, and those that come into contact with it."""
    world = movers[i].at(t)
    relative = world.actInv(movers[j].at(t))
    rows = surface_contacts(
        movers[i].mesh, movers[j].mesh, relative, manager.tolerance.linear, manager.heeded_surfaces(i, j)
    )
    chosen = []
    for row in rows:
        surfaces = (int(row["surface_a"]), int(row["surface_b"]))
        chosen.append(surfaces != pair and surfaces not in touching)
    nearest = mesh_clearance(movers[i].mesh, movers[j].mesh, relative, *pair)
    assert nearest is not None  # nothing is beyond an infinite bound
    rows = np.concatenate([rows[np.array(chosen, bool)], nearest])
    rows = rows[np.lexsort((rows["surface_b"], rows["surface_a"]))]
    rows["object_a"], rows["object_b"] = i, j
    for point in ("point_a", "point_b"):
        rows[point] = rows[point] @ world.rotation.T + world.translation
    return rows
