"""The first time of impact along a motion: nothing thin is passed, at any speed.

Each object that moves goes from its pose to its target along one screw, the SE(3) geodesic: at time t in [0, 1] it is
at T0·exp(t·log(T0⁻¹·T1)); all move at once. Contact is when the distance of two surfaces falls to the tolerance.

- Never late: before the time that is returned no two surfaces that were apart have met.
- Early by no more than the tolerance: at that time two surfaces are within `Tolerance.linear` of each other.

Surfaces in contact at the start, at most the tolerance apart, could not part if that alone stopped them. Such a pair
stops the motion only if it approaches. Its signed distance (that of the triangles, and where they meet minus the
shortest translation that parts the two triangles) may shrink by `Tolerance.slop`, a tenth of the tolerance, below what
it is at the start, so that surfaces slide; a pair that is pressed further stops the motion before it has begun to. The
time is the last at which it had not got there, to within one and a half times that tenth. However often that is asked,
a pair that is not deeper already is let no deeper than the tolerance, or than the deflection if that is given: the
tessellations of a shaft and its bore reach into each other by as much while the surfaces fit. Triangles smaller than
that depth are the one thing that may be passed, by the very pair of surfaces that is in contact already.

Conservative advancement: the least time for which any pair of boxes or of triangles surely stays apart
(`collision.triangle.motion`) is the step, found best first (Tang, Kim & Manocha, "C²A: Controlled Conservative
Advancement", ICRA 2009; here the direction of a certificate is any separating one, and its second-order term lets
motion along a surface be told from motion towards it).
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import poses
from collision.bvh.build import bounds_of, bvh_of
from collision.bvh.layout import LANES, NODE, PREPARED
from collision.bvh.packets import box_middle
from collision.bvh.traverse import (
    TRIANGLE_BOXES,
    TRIANGLES,
    Door,
    below_packets,
    box_at,
    children_of_a,
    children_of_b,
    corner_of,
    fresh_packets,
    implements,
    inline_kernel,
    is_bottom,
    is_open,
    moved_corner,
    start,
    visit,
    walk_nearest,
    workspace_for,
)
from collision.contact import CONTACT_DTYPE, TimeOfImpact
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.poses import relative_pose, screw_pose
from collision.numeric.simd import RATES, TERMS, apart_lane_a, apart_lane_b, lowest, perhaps_nearing
from collision.numeric.vectors import cross, norm, sub
from collision.proximity import mesh_clearance, surface_contacts
from collision.query.distance import rounding_of
from collision.query.signed_distance import near_surface_pairs, signed_distances_of
from collision.reference.shape import ShapeMesh
from collision.triangle.distance import planes_part
from collision.triangle.motion import pair_step

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.manager import CollisionManager

ROUNDING: Final = 64.0 * 2.0**-53
"""of a box moved by a pose: three products and three sums a coordinate, and the pose's own error, generously"""
STEPS = 20000
"""advancements after which a pair counts as in contact at the time reached: a guard that stays on the safe side"""


# --- kernels ---------------------------------------------------------------------------------------------------------


class Sweep(NamedTuple):
    """Task: how long all pairs of triangles surely stay above the signed distances at which they stop."""

    level: Any
    """(ka, kb) float64, m: where a pair of surfaces stops the motion, -inf where it never does; (0, 0): all at
    `tolerance`"""
    tolerance: Any
    slop: Any
    """m: steps aim half of it below a pair's own level, the whole below the others': the level is crossed, never by
    more than that"""
    rates: Any
    """(RATES,) float32, see `simd.RATES`"""
    motion: Any
    """(15,) float64: see `_set_rates`"""
    step: Any
    """(2,) float64: for which all pairs looked at hold; how far a float64 distance may be off, m"""
    hit: Any
    """(4,) int64: surfaces and lanes of the pair that holds least long"""
    terms: Any
    """(TERMS,) float32, see `simd.perhaps_nearing`"""


@inner_kernel
def _stops(level, s, u, tolerance, slop):
    """(signed distance at which a pair of boxes, of surfaces s and u or of several (-1), stops; what steps aim at)."""
    if level.shape[0] > 0 and s >= 0 and u >= 0 and level[s, u] < tolerance:
        return level[s, u], level[s, u] - 0.5 * slop
    return tolerance, tolerance - slop  # no level lies above, which is safe for boxes of several surfaces


@inner_kernel
def _up(x):
    """A float32 not below x."""
    return np.float32(x + 2.0**-22 * abs(x) + 1e-37)


implements(is_bottom, Sweep)(below_packets)


@implements(is_open, Sweep)
def may_hold_less(task, ws, bound):
    return bound < task.step[0]


@implements(children_of_a, Sweep)
def shorter_children_of_a(task, a, b, ws, node, lane_b):
    s, u = a.surface[LANES * node], b.surface[lane_b]
    if s != a.surface[LANES * node + 1]:  # an empty lane has -1, a node of one lane is of surfaces
        s = -1
    stop, aim = _stops(task.level, s, u, task.tolerance, task.slop)
    if stop == -np.inf:
        return 0
    ws.counts[TRIANGLE_BOXES] += LANES
    return apart_lane_a(
        a.boxes, NODE * node, ws.moved, box_at(lane_b), task.rates, _up(stop), _up(aim), _up(task.step[0]), ws.bounds
    )


@implements(children_of_b, Sweep)
def shorter_children_of_b(task, a, b, ws, lane_a, node):
    s, u = a.surface[lane_a], b.surface[LANES * node]
    if u != b.surface[LANES * node + 1]:
        u = -1
    stop, aim = _stops(task.level, s, u, task.tolerance, task.slop)
    if stop == -np.inf:
        return 0
    ws.counts[TRIANGLE_BOXES] += LANES
    return apart_lane_b(
        ws.moved, NODE * node, a.boxes, box_at(lane_a), task.rates, _up(stop), _up(aim), _up(task.step[0]), ws.bounds
    )


@inner_kernel
def _speeds(matrix, motion, middle, half):
    """(speed of the fastest point of a box of b against a at any time up to 1, that now, that by b's own motion)."""
    m = matrix
    x = (
        m[0] * middle[0] + m[1] * middle[1] + m[2] * middle[2] + m[9],
        m[3] * middle[0] + m[4] * middle[1] + m[5] * middle[2] + m[10],
        m[6] * middle[0] + m[7] * middle[1] + m[8] * middle[2] + m[11],
    )
    dw, wb = (motion[3], motion[4], motion[5]), (motion[12], motion[13], motion[14])
    u, own = cross(dw, x), cross(wb, middle)
    u = u[0] + motion[0], u[1] + motion[1], u[2] + motion[2]
    own = own[0] + motion[9], own[1] + motion[10], own[2] + motion[11]
    radius = norm(half)
    fastest, pace = norm(u) + norm(dw) * radius, norm(own) + norm(wb) * radius
    return fastest + norm(dw) * pace, fastest, pace


@inline_kernel
def _set_terms(task, a, b, ws, lane_a, lane_b, most, level, aim):
    """Fill the task's terms for two packets, all but the last. The error bound: 20 roundings of float32 of coordinates
    about the middle of a's box, and what float64 vertices are off, along any direction."""
    m, motion, terms = ws.pose.matrix, task.motion, task.terms
    (ax, ay, az), _ = box_middle(a, lane_a)
    (x, y, z), _ = box_middle(b, lane_b)
    shift = (
        m[0] * x + m[1] * y + m[2] * z + (m[9] - ax),
        m[3] * x + m[4] * y + m[5] * z + (m[10] - ay),
        m[6] * x + m[7] * y + m[8] * z + (m[11] - az),
    )
    velocity = cross((motion[3], motion[4], motion[5]), (ax, ay, az))
    for d in range(3):
        terms[d], terms[3 + d] = shift[d], motion[d] + velocity[d]
    size = a.size[lane_a] + b.size[lane_b] + abs(shift[0]) + abs(shift[1]) + abs(shift[2])
    terms[6] = 4.0 * (20.0 * 2.0**-24 * size + ws.pose.motion[22])
    terms[7], terms[8], terms[9] = _up(most), _up(level), _up(aim)


@implements(visit, Sweep)
def step_of_packets(task, a, b, ws, lane_a, lane_b):
    s, u = a.surface[lane_a], b.surface[lane_b]
    level, aim = _stops(task.level, s, u, task.tolerance, task.slop)
    if level == -np.inf:
        return False
    m, motion, rounding = ws.pose.matrix, task.motion, task.step[1]
    dv, dw = (motion[0], motion[1], motion[2]), (motion[3], motion[4], motion[5])
    wa = motion[6], motion[7], motion[8]
    middle, half = box_middle(b, lane_b)
    ever, fastest, pace = _speeds(m, motion, middle, half)
    most = norm(wa) * ever + (norm(dw) + norm(cross(wa, dw))) * pace
    step = task.step[0]
    p, q = ~np.int64(a.child[lane_a]), ~np.int64(b.child[lane_b])
    fresh_packets(a, b, ws, p, q)
    _set_terms(task, a, b, ws, lane_a, lane_b, most, level, aim)
    first_a, first_b = np.int64(a.first[p]), np.int64(b.first[q])
    for tb in range(first_b, np.int64(b.first[q + 1])):
        task.terms[10] = _up(step)
        ws.counts[TRIANGLE_BOXES] += LANES
        bits = perhaps_nearing(
            ws.prepared, PREPARED * p, ws.turned, PREPARED * q + tb - first_b, task.rates, task.terms
        )  # fmt: skip
        if bits == 0:
            continue
        k = moved_corner(b, 3 * tb, m), moved_corner(b, 3 * tb + 1, m), moved_corner(b, 3 * tb + 2, m)
        while bits != 0:
            ta = 3 * (first_a + lowest(bits))
            bits &= bits - 1
            x, y, z = corner_of(a, ta), corner_of(a, ta + 1), corner_of(a, ta + 2)
            reach = max(0.0, level + fastest * step + 0.5 * most * step * step) + rounding
            if planes_part(x, y, z, k[0], k[1], k[2], reach):
                continue
            ws.counts[TRIANGLES] += 1
            d, hold = pair_step(x, y, z, k[0], k[1], k[2], dv, dw, wa, ever, pace, level, aim, step, rounding, ws.exact)
            if d <= level or hold < step:
                step = hold
                task.hit[0], task.hit[1], task.hit[2], task.hit[3] = s, u, lane_a, lane_b
            if d <= level:
                task.step[0] = 0.0
                return True
    task.step[0] = step
    return False


@inner_kernel
def _set_rates(a_frame, b_frame, matrix, twist_a, twist_b, motion, rates):
    """Fill `motion` and `rates` for body twists (v, w) and the pose of b in a's frame in `matrix`.

    motion: velocity and angular velocity of b against a in a's frame, angular velocity of a; velocity and angular
    velocity of b in b's frame.
    """
    m, v, w = matrix, twist_b[:3], twist_b[3:]
    moved = (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )
    turned = (
        m[0] * w[0] + m[1] * w[1] + m[2] * w[2],
        m[3] * w[0] + m[4] * w[1] + m[5] * w[2],
        m[6] * w[0] + m[7] * w[1] + m[8] * w[2],
    )
    wa, at = (twist_a[3], twist_a[4], twist_a[5]), (m[9], m[10], m[11])
    dw = sub(turned, wa)
    own = sub(moved, cross(turned, at))  # of the point of b that is at a's origin
    dv = own[0] - twist_a[0], own[1] - twist_a[1], own[2] - twist_a[2]
    for d in range(3):
        motion[d], motion[3 + d], motion[6 + d] = dv[d], dw[d], wa[d]
        motion[9 + d], motion[12 + d] = v[d], w[d]
    centre = a_frame[0], a_frame[1], a_frame[2]
    velocity, of_dw = cross(dw, centre), cross(turned, centre)
    bend = norm(cross(wa, dw))
    speed, extent = 0.0, 0.0
    for d in range(3):
        rates[d], rates[3 + d] = dv[d] + velocity[d], dw[d]
        rates[6 + d], rates[9 + d] = own[d] + of_dw[d], turned[d]
        e, f = (d + 1) % 3, (d + 2) % 3
        rates[15 + d] = _up(np.sqrt(wa[e] * wa[e] + wa[f] * wa[f]))
        rates[18 + d] = _up(np.sqrt(dw[e] * dw[e] + dw[f] * dw[f]) + bend)
        speed += abs(dv[d]) + abs(velocity[d]) + abs(own[d]) + abs(of_dw[d])
        extent += abs(at[d]) + a_frame[3 + d] + abs(centre[d]) + 2.0 * (b_frame[3 + d] + abs(b_frame[d]))
    rates[12], rates[13], rates[14] = _up(norm(dw)), _up(norm(w)), _up(norm(wa))
    rates[21] = _up(norm(dw) + bend)
    rates[22] = _up(2.0**-19 * (speed + (norm(dw) + norm(turned)) * extent) + 1e-30)


@kernel
def sweep(a, b, ws, screws, limits, level, task_arrays):
    """The first time in [0, until] at which a pair of surfaces comes to its level, or infinity.

    screws: (2, 18) float64, pose at t = 0 and body twist (v, w) over the unit of time, of a and of b. limits: (4,)
    float64, until, tolerance and slop (m), advancements. level: see `Sweep`. hit: the surface pair in the first two
    places, also where the advancements do not suffice and it counts as met where they end.

    Returns (time, time of the advancement before it).
    """
    step, hit, terms, rates, motion, pose = task_arrays
    until, tolerance, slop = limits[0], limits[1], limits[2]
    task = Sweep(level, tolerance, slop, rates, motion, step, hit, terms)
    t, before = 0.0, 0.0
    hit[:] = -1
    for _ in range(np.int64(limits[3])):
        screw_pose(screws[0], t, pose[0])
        screw_pose(screws[1], t, pose[1])
        relative_pose(pose[0], pose[1], ws.pose.matrix)
        start(a, b, ws)
        _set_rates(a.frame, b.frame, ws.pose.matrix, screws[0, 12:], screws[1, 12:], motion, rates)
        step[0], step[1] = until - t, rounding_of(a, b, ws.pose.matrix)
        last_a, last_b = hit[2], hit[3]
        # what held the last step back is likely to hold this one back: looked at first, it rules out much
        for k in range(0 if last_a >= 0 else 1, 2):
            if k == 1:
                last_a, last_b = 0, 0
            if walk_nearest(task, a, b, ws, last_a, last_b, np.float32(0.0)):
                return t, before
        if step[0] >= until - t:
            return np.inf, t
        before = t
        t += step[0]
    return t, before


# --- from Python -----------------------------------------------------------------------------------------------------

_sweep = Door(sweep)


@dataclass(frozen=True, slots=True, eq=False)
class _Mover:
    """One object on its way, or standing: pose at t = 0 and body twist over the unit of time."""

    mesh: SurfaceMesh
    screw: NDArray[np.float64]
    """(18,) pose at t = 0, rotation by rows and translation; body twist (v, w) over the unit of time"""
    end: NDArray[np.float64]
    """(12,) pose at t = 1"""

    def at(self, t: float) -> pin.SE3:
        import pinocchio as pin

        return poses.unpack(self.screw[:12]) * pin.exp6(pin.Motion(t * self.screw[12:]))


def time_of_impact(manager: CollisionManager, moves: Mapping[int, Any], deflection: float = 0.0) -> TimeOfImpact:
    """The first impact while the objects `moves` go from their poses to their targets, all at once.

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
    return TimeOfImpact(first, rows, {i: moving[i].at(first) for i in sorted(moving)})


def _target(manager: CollisionManager, i: int, target: Any) -> NDArray[np.float64]:
    return poses.pack(target, f"target of object {i} ({manager.mesh(i).name})", i, manager.tolerance.rigid)


def _mover(manager: CollisionManager, i: int, end: NDArray[np.float64] | None) -> _Mover:
    """An object on its way to the (12,) pose `end`, or standing."""
    import pinocchio as pin

    mesh, pose = manager.mesh(i), manager.pose(i)
    begin = np.concatenate([pose.rotation.ravel(), pose.translation])
    twist = np.zeros(6) if end is None else np.array(pin.log6(pose.actInv(poses.unpack(end))))
    return _Mover(mesh, np.concatenate([begin, twist]), begin if end is None else end)


def _pairs(manager: CollisionManager, moving: Mapping[int, _Mover]) -> list[tuple[int, int]]:
    """Pairs i < j of which one moves, that are enabled, and whose ways come near each other."""
    box = manager.world_boxes().copy()
    for i, mover in moving.items():
        own = bounds_of(mover.mesh)
        center, half = 0.5 * (own[:3] + own[3:6]), 0.5 * (own[3:6] - own[:3])
        rotation, translation = mover.end[:9].reshape(3, 3), mover.end[9:]
        middle, reach = rotation @ center + translation, np.abs(rotation) @ half
        reach += ROUNDING * float((np.abs(translation) + np.abs(center) + half).sum())  # for rounding
        beyond = _sagitta(mover.screw[12:], center, float(np.sqrt(half @ half)))
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
    for mesh in (a.mesh, b.mesh):
        if isinstance(mesh, ShapeMesh):
            raise CollisionError(f"{mesh.name}: a shape without triangles is not swept; give it as a SurfaceMesh")
    tolerance = manager.tolerance.linear
    slop = manager.tolerance.slop * tolerance
    bvh_a, bvh_b = bvh_of(a.mesh), bvh_of(b.mesh)
    enabled = manager.heeded_surfaces(i, j)
    pose = _relative(a, b, 0.0)
    near = near_surface_pairs(bvh_a, bvh_b, pose, tolerance)
    if enabled is not None:
        near = near[enabled[near[:, 0], near[:, 1]] != 0]
    depths = signed_distances_of(bvh_a, bvh_b, pose, near, float(np.nextafter(tolerance, np.inf)))
    touching = depths <= tolerance
    surfaces, depths = near[touching], depths[touching]
    level = np.empty((0, 0))
    if enabled is not None or len(surfaces):
        level = np.full((a.mesh.n_surfaces, b.mesh.n_surfaces), tolerance)
        if enabled is not None:
            level[enabled == 0] = -np.inf
        lowest = np.where(depths > slop - tolerance, np.maximum(depths - slop, -tolerance), depths - 0.01 * slop)
        level[surfaces[:, 0], surfaces[:, 1]] = np.minimum(lowest, -deflection) if deflection > 0.0 else lowest
    hit = np.empty(4, np.int64)
    room = np.empty(2), hit, np.empty(TERMS, np.float32), np.empty(RATES, np.float32), np.empty(15), np.empty((2, 12))
    time, before = _sweep.call(
        bvh_a, bvh_b, workspace_for(bvh_a, bvh_b), np.stack([a.screw, b.screw]),
        np.array([until, tolerance, slop, STEPS]), level, room,
    )  # fmt: skip
    pair, pairs = (int(hit[0]), int(hit[1])), set(map(tuple, surfaces.tolist()))
    if pair in pairs and time <= until:
        time = _last_above(a, b, pair, before, time, float(level[pair]), slop)
    return float(time), pair, pairs


def _relative(a: _Mover, b: _Mover, t: float) -> NDArray[np.float64]:
    """(12,) the pose of b in a's frame at time t."""
    pose = a.at(t).actInv(b.at(t))
    return np.concatenate([pose.rotation.ravel(), pose.translation])


def _last_above(
    a: _Mover, b: _Mover, pair: tuple[int, int], before: float, time: float, level: float, slop: float
) -> float:
    """A time from `before` on at which the signed distance of a pair of surfaces is above `level` by `slop` at most.

    It is above at `before`, and at or below at `time`; in between nothing gets below what the advancement held to.
    """
    bvh_a, bvh_b, surfaces = bvh_of(a.mesh), bvh_of(b.mesh), np.array([pair], np.int64)

    def signed_distance(t: float) -> float:
        within = max(0.0, level + 2.0 * slop)
        return float(signed_distances_of(bvh_a, bvh_b, _relative(a, b, t), surfaces, within)[0])

    apart = signed_distance(before)
    while apart > level + 1.5 * slop:
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
