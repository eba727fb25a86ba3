"""The first time of impact along a motion: nothing thin is passed, at any speed.

Each object that moves goes from its pose to its target along one screw, the SE(3) geodesic: at time t in [0, 1] it is
at T0·exp(t·log(T0⁻¹·T1)); all move at once. Contact is when the distance of two surfaces falls to the tolerance.

- Never late: before the time that is returned no two surfaces that were apart have met.
- Early by no more than the tolerance: at that time two surfaces are within `Tolerance.linear` of each other.

Surfaces in contact at the start, at most the tolerance apart, could not part if contact alone stopped them. Such a pair
stops the motion only if it approaches. Its signed distance (that of the triangles, and where they meet minus the
shortest translation that parts the two triangles) may shrink by `Tolerance.slop`, a tenth of the tolerance, below what
it is at the start, so that surfaces slide; a pair that is pressed further stops the motion before it has begun to. The
time is the last at which it had not got there, to within one and a half times that tenth. However often it is repeated,
a pair that is not deeper already is let no deeper than the tolerance, or than the deflection if that is given: the
tessellations of a shaft and its bore reach into each other by as much while the surfaces fit. Triangles smaller than
that depth are the one thing that may be passed, by the very pair of surfaces that is in contact already.

Conservative advancement: the least time for which any pair of boxes or of triangles surely stays apart
(`collision.triangle.motion`) is the step, found best first (Tang, Kim & Manocha, "C²A: Controlled Conservative
Advancement", ICRA 2009; here the direction of a certificate is any separating one, and its second-order term lets
motion along a surface be distinguished from motion towards it).
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

import math
from collections.abc import Mapping
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import poses
from collision.bvh.build import bounds_of, bvh_of
from collision.bvh.layout import LANES, NODE, PREPARED
from collision.bvh.packets import box_middle, moved_triangle, triangle_of
from collision.bvh.traverse import (
    TRIANGLE_BOXES,
    TRIANGLES,
    box_at,
    fresh_packets,
    near_surfaces,
    start,
    walk_nearest,
    workspace,
    workspace_for,
)
from collision.contact import CONTACT_DTYPE, TimeOfImpact, joined, picked
from collision.errors import CollisionError
from collision.numeric.kernel import EntryPoint, inline_kernel, inner_kernel, kernel
from collision.numeric.rigid_transforms import relative_pose, rotate, screw_pose, transform
from collision.numeric.simd import RATES, TERMS, apart_lane_a, apart_lane_b, lowest, perhaps_nearing
from collision.numeric.vectors import along, cross, norm, sub
from collision.objects import Objects
from collision.query.distance import clearance_of, contacts_between, lanes_of, rounding_of
from collision.query.intersection import ALL_ENABLED
from collision.query.signed_distance import least_signed_distance, signed_distances_of
from collision.reference.shape import ShapeMesh
from collision.triangle.motion import RelativeMotion, pair_step

if TYPE_CHECKING:
    import pinocchio as pin


ROUNDING: Final = 64.0 * 2.0**-53
"""of a box moved by a pose: three products and three sums a coordinate, and the pose's own error, generously"""
LESS: Final = 1.0 - 2.0**-20
"""1: … of the time a pair holds is the step, so that what holds as long but for rounding needs no second look"""
EARLY: Final = 2.0**-10
"""1: part of the motion"""
STEPS = 20000
"""advancements after which a pair counts as in contact at the time reached: a guard that stays on the safe side"""


# --- kernels ---------------------------------------------------------------------------------------------------------


class Sweep(NamedTuple):
    """Task: how long all pairs of triangles surely stay above the signed distances at which they stop."""

    level: Any
    """(ka·kb,) float64, m: where a pair of surfaces stops the motion, -inf where it never does; (0,): all at
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

    def is_open(self, ws, bound):
        """Whether a pair of boxes that stays apart for this time may shorten the step."""
        return bound < self.step[0]

    def children_of_a(self, a, b, ws, node, lane_b):
        """Bits: which boxes of a node of a may come near a box of b within the step."""
        s, u = a.surface[LANES * node], b.surface[lane_b]
        if s != a.surface[LANES * node + 1]:  # an empty lane has -1, a node of one lane is of surfaces
            s = -1
        stop, aim = _stops(self.level, _pair_of(b, s, u), self.tolerance, self.slop)
        if stop == -np.inf:
            return 0
        ws.counts[TRIANGLE_BOXES] += LANES
        return apart_lane_a(
            a.boxes, NODE * node, ws.moved, box_at(lane_b), self.rates, _up(aim), _up(self.step[0]), ws.bounds
        )

    def children_of_b(self, a, b, ws, lane_a, node):
        """Bits: which boxes of a node of b may come near a box of a within the step."""
        s, u = a.surface[lane_a], b.surface[LANES * node]
        if u != b.surface[LANES * node + 1]:
            u = -1
        stop, aim = _stops(self.level, _pair_of(b, s, u), self.tolerance, self.slop)
        if stop == -np.inf:
            return 0
        ws.counts[TRIANGLE_BOXES] += LANES
        return apart_lane_b(
            ws.moved, NODE * node, a.boxes, box_at(lane_a), self.rates, _up(aim), _up(self.step[0]), ws.bounds
        )

    def visit(self, a, b, ws, lane_a, lane_b):
        """Shorten the step by the triangles of two packets; whether any are at their level now."""
        s, u = a.surface[lane_a], b.surface[lane_b]
        level, aim = _stops(self.level, _pair_of(b, s, u), self.tolerance, self.slop)
        if level == -np.inf:
            return False
        m, rounding = ws.pose.matrix, self.step[1]
        middle, half = box_middle(b, lane_b)
        motion = _motion_of(m, self.motion, middle, half)
        turn, turn_a = motion.turn, motion.turn_a
        most = norm(turn_a) * motion.fastest + (norm(turn) + norm(cross(turn_a, turn))) * motion.own
        step = self.step[0]
        p, q = ~np.int64(a.child[lane_a]), ~np.int64(b.child[lane_b])
        fresh_packets(a, b, ws, p, q)
        _set_terms(self, a, b, ws, lane_a, lane_b, most, aim)
        first_a, first_b = np.int64(a.first[p]), np.int64(b.first[q])
        for tb in range(first_b, np.int64(b.first[q + 1])):
            self.terms[9], at, to = _up(step), PREPARED * p, PREPARED * q + tb - first_b
            ws.counts[TRIANGLE_BOXES] += LANES
            bits = perhaps_nearing(ws.prepared, at, ws.turned, to, self.rates, self.terms)
            if bits == 0:
                continue
            other = moved_triangle(b, tb, m)
            while bits != 0:
                one = triangle_of(a, first_a + lowest(bits))
                bits &= bits - 1
                ws.counts[TRIANGLES] += 1
                d, hold = pair_step(one, other, motion, aim, step, rounding, ws.exact)
                if hold >= step:
                    continue
                step = LESS * hold
                self.hit[0], self.hit[1], self.hit[2], self.hit[3] = s, u, lane_a, lane_b
                if d <= level:
                    self.step[0] = 0.0
                    return True
        self.step[0] = step
        return False


@inner_kernel
def _stops(level, pair, tolerance, slop):
    """(signed distance at which a pair of surfaces stops, or of boxes of several, pair -1; what steps aim at)."""
    if pair >= 0 and len(level) > 0 and level[pair] < tolerance:
        return level[pair], level[pair] - 0.5 * slop
    return tolerance, tolerance - slop  # no level lies above, which is safe for boxes of several surfaces


@inline_kernel
def _pair_of(b, s, u):
    """The pair of surfaces s of a and u of b; -1 if either is -1."""
    return np.int64(s) * len(b.root) + u if s >= 0 and u >= 0 else np.int64(-1)


@inner_kernel
def _up(x):
    """A float32 not below x."""
    return np.float32(x + 2.0**-22 * abs(x) + 1e-37)


@inline_kernel
def _motion_of(matrix, motion, middle, half):
    """The `RelativeMotion` of the points of a box of b."""
    x = transform(matrix, middle)
    velocity, turn, turn_a = _vector(motion, 0), _vector(motion, 3), _vector(motion, 6)
    u, own = cross(turn, x), cross(_vector(motion, 12), middle)
    u, own = along(u, 1.0, velocity), along(own, 1.0, _vector(motion, 9))
    radius = norm(half)
    now, pace = norm(u) + norm(turn) * radius, norm(own) + norm(_vector(motion, 12)) * radius
    return RelativeMotion(velocity, turn, turn_a, now + norm(turn) * pace, pace)


@inner_kernel
def _vector(x, at):
    return x[at], x[at + 1], x[at + 2]


@inline_kernel
def _set_terms(task, a, b, ws, lane_a, lane_b, most, aim):
    """Fill the task's terms for two packets, all but the last. most: bound of the acceleration.

    The error bound: 20 roundings of float32 of coordinates about the middle of a's box, and what float64 vertices are
    off, along any direction.
    """
    m, motion, terms = ws.pose.matrix, task.motion, task.terms
    at_a, _ = box_middle(a, lane_a)
    at_b, _ = box_middle(b, lane_b)
    shift = along(rotate(m, at_b), 1.0, sub(_vector(m, 9), at_a))
    velocity = cross(_vector(motion, 3), at_a)
    for d in range(3):
        terms[d], terms[3 + d] = shift[d], motion[d] + velocity[d]
    size = a.size[lane_a] + b.size[lane_b] + abs(shift[0]) + abs(shift[1]) + abs(shift[2])
    terms[6] = 4.0 * (20.0 * 2.0**-24 * size + ws.pose.motion[22])
    terms[7], terms[8] = _up(most), _up(aim)


@inner_kernel
def _set_rates(a_frame, b_frame, matrix, screws, task):
    """Fill the task's `motion` and `rates` for two screws and the pose of b in a's frame in `matrix`.

    motion: velocity and angular velocity of b against a in a's frame, angular velocity of a; velocity and angular
    velocity of b in b's frame.
    """
    motion, rates, twist_a = task.motion, task.rates, screws[0, 12:]
    v, w = _vector(screws[1], 12), _vector(screws[1], 15)
    moved, turned = rotate(matrix, v), rotate(matrix, w)
    wa, at = _vector(twist_a, 3), _vector(matrix, 9)
    dw = sub(turned, wa)
    own = sub(moved, cross(turned, at))  # of the point of b that is at a's origin
    dv = sub(own, _vector(twist_a, 0))
    for d in range(3):
        motion[d], motion[3 + d], motion[6 + d] = dv[d], dw[d], wa[d]
        motion[9 + d], motion[12 + d] = v[d], w[d]
    centre = _vector(a_frame, 0)
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


class SweepWorkspace(NamedTuple):
    """What the advancement of a pair of objects works in, and where it stands."""

    task: Sweep
    """its `level` (surfaces of a · surfaces of b,) and `hit` are the pair's own, as `found` is"""
    poses: Any
    """(2, 12) float64"""
    least: Any
    """(2,) float64, m: see `SignedDistance`"""
    found: Any
    """(5,) float64, see the places below"""


REACHED, BEFORE, STATE, LEVELS, TAKEN = range(5)
"""places in `SweepWorkspace.found`: no pair of surfaces is at its level before this time; the time an advancement
earlier; NEW, UNDER_WAY, STOPPED or PASSED; whether `Sweep.level` is in use; number of advancements"""
NEW, UNDER_WAY, STOPPED, PASSED = 0.0, 1.0, 2.0, 3.0


@inline_kernel
def _move_to(a, b, ws, screws, t, work):
    """Begin a question about a and b at a time; `task.step[1]` and `least[1]` become its rounding."""
    screw_pose(screws[0], t, work.poses[0])
    screw_pose(screws[1], t, work.poses[1])
    relative_pose(work.poses[0], work.poses[1], ws.pose.matrix)
    start(a, b, ws)
    work.task.step[1] = work.least[1] = rounding_of(a, b, ws.pose.matrix)


@inner_kernel
def _set_levels(a, b, ws, near, limits, enabled, work):
    """Fill `work.task.level`: pairs of surfaces in contact, of the first `near` of `ws.pairs`, have one of their own.

    A motion that is shorter than what a pair may come nearer does not bring it to its level, so it need not be known.
    """
    task, kb = work.task, len(b.root)
    until, deflection = limits[0], limits[2]
    tolerance, slop = task.tolerance, task.slop
    for pair in range(len(a.root) * kb):
        task.level[pair] = -np.inf if len(enabled) > 0 and enabled[pair] == 0 else tolerance
    frame = b.frame
    motion = _motion_of(ws.pose.matrix, task.motion, _vector(frame, 0), _vector(frame, 3))
    way = until * motion.fastest * (1.0 + 1e-9) + 4.0 * work.least[1]
    for k in range(near):
        pair = ws.pairs[k]
        if task.level[pair] == -np.inf:
            continue
        if way < 0.01 * slop:
            task.level[pair] = -np.inf
            continue
        short = way < slop
        within = slop - tolerance if short else tolerance * (1.0 + 2.0**-50)
        depth = least_signed_distance(a, b, ws, pair, within, work.least)
        if short and depth >= within:
            task.level[pair] = -np.inf
        elif depth <= tolerance:
            lowest_level = max(depth - slop, -tolerance) if depth > slop - tolerance else depth - 0.01 * slop
            task.level[pair] = min(lowest_level, -deflection) if deflection > 0.0 else lowest_level


@inner_kernel
def _last_above(a, b, ws, screws, before, pair, work):
    """A time from `before` on at which the signed distance of a pair of surfaces is above its level by little.

    It is above at `before`, and at or below at the time found; in between nothing gets below what the advancement held
    to.
    """
    level, slop, time = work.task.level[pair], work.task.slop, work.found[REACHED]
    within, middle, apart = max(0.0, level + 2.0 * slop), before, np.inf
    while True:
        _move_to(a, b, ws, screws, middle, work)
        there = least_signed_distance(a, b, ws, pair, within, work.least)
        if there > level or apart == np.inf:
            before, apart = middle, there
        else:
            time = middle
        middle = 0.5 * (before + time)
        if apart <= level + 1.5 * slop or not before < middle < time:
            return before


@kernel
def advance(a, b, ws, screws, limits, enabled, work):
    """Advance a pair of objects until it is STOPPED, has PASSED `until`, or what it reached is later than `lead`.

    screws: (2, 18) float64, pose at t = 0 and body twist (v, w) over the unit of time, of a and of b. limits: (4,)
    float64, until, lead, deflection (m), advancements after which the pair counts as stopped where it is. enabled:
    (ka·kb,) uint8, 0 for pairs of surfaces that are left out; (0,) where none is. work: NEW, or as the last call left
    it. The surfaces that stop the motion are the first two numbers of `work.task.hit`. Returns the length that
    `ws.pairs` must have, or 0 if it has.
    """
    task, found, hit = work.task, work.found, work.task.hit
    until, lead, at_start = limits[0], limits[1], found[STATE] == NEW
    if at_start:
        hit[:] = -1
        _move_to(a, b, ws, screws, 0.0, work)
        _set_rates(a.frame, b.frame, ws.pose.matrix, screws, task)
        reach = task.tolerance + work.least[1]
        near = near_surfaces(a, b, ws, reach * reach)
        if near > len(ws.pairs):
            return near
        found[:] = 0.0
        found[STATE] = UNDER_WAY
        found[LEVELS] = near > 0 or len(enabled) > 0
        if found[LEVELS] > 0.0:
            _set_levels(a, b, ws, near, limits, enabled, work)
    if found[LEVELS] == 0.0:
        task = Sweep(task.level[:0], task[1], task[2], task[3], task[4], task[5], task[6], task[7])
    while found[STATE] == UNDER_WAY and found[REACHED] <= lead:
        t = found[REACHED]
        found[TAKEN] += 1
        if t > 0.0 or not at_start:
            _move_to(a, b, ws, screws, t, work)
            _set_rates(a.frame, b.frame, ws.pose.matrix, screws, task)
        task.step[0] = until - t
        last_a, last_b = hit[2], hit[3]
        # the pair that limited the last step is likely to limit this one: visited first, it rules out many others
        for k in range(0 if last_a >= 0 else 1, 2):
            if k == 1:
                last_a, last_b = 0, 0
            if walk_nearest(task, a, b, ws, last_a, last_b, np.float32(0.0)):
                found[STATE] = STOPPED
                break
        if found[STATE] == STOPPED:
            break
        if task.step[0] >= until - t:
            found[STATE] = PASSED
            break
        found[BEFORE] = t
        found[REACHED] = t + task.step[0]
        if found[TAKEN] >= limits[3]:
            found[STATE] = STOPPED
    if found[STATE] == STOPPED and found[LEVELS] > 0.0 and found[REACHED] > 0.0:
        pair = _pair_of(b, hit[0], hit[1])
        if task.level[pair] < task.tolerance:
            found[REACHED] = _last_above(a, b, ws, screws, found[BEFORE], pair, work)
    return 0


# --- from Python -----------------------------------------------------------------------------------------------------

_advance = EntryPoint(advance)


def time_of_impact(objects: Objects, moves: Mapping[int, Any], deflection: float = 0.0) -> TimeOfImpact:
    """The first impact while the objects `moves` go from their poses to their targets, all at once.

    Parameters
    ----------
    moves: target pose (`pinocchio.SE3` or (4, 4)) by object; whatever is not named stays where it is.
    deflection: m, how deep surfaces in contact at the start may reach into each other because of their tessellation.

    Ignored pairs of objects and of surfaces stop nothing.

    Raises
    ------
    UnknownObjectError, PoseError: no such object; a target that is not a finite rigid motion.
    CollisionError: a deflection that is no length; a shape without triangles in the way.
    """
    if not 0.0 <= deflection < np.inf:
        raise CollisionError(f"deflection is {deflection!r}; give a finite length of at least 0 m")
    ends = objects.packed(list(moves), list(moves.values()), "target of object")
    starts = objects.packed_poses()
    screws = {i: _screw(starts[i], end) for i, end in zip(moves, ends, strict=True)}
    ways = [_Way(objects, pair) for pair in _pairs(objects, screws, ends)]
    first = _first_impact(ways, screws, starts, deflection)
    stops = [way for way in ways if way.found[STATE] == STOPPED and way.found[REACHED] == first]
    at_first = {i: _at(screws[i], first) for i in sorted(moves)}
    rows = joined([_contacts(way, at_first) for way in stops])
    return TimeOfImpact(first, rows, at_first)


class _Way:
    """A pair of objects on their screws, and the time up to which it does not stop the motion."""

    def __init__(self, objects: Objects, pair: tuple[int, int]) -> None:
        meshes = [objects.mesh(k) for k in pair]
        for mesh in meshes:
            if isinstance(mesh, ShapeMesh):
                raise CollisionError(f"{mesh.name}: a shape without triangles is not swept; give it as a SurfaceMesh")
        self.objects, self.pair = objects, pair
        self.a, self.b = bvh_of(meshes[0]), bvh_of(meshes[1])
        self.found = np.zeros(5)

    def begin(self, screws: Mapping[int, NDArray[np.float64]], starts: NDArray[np.float64]) -> None:
        """Make what `advance` works in. starts: (n, 12) poses of all objects; what has no screw stays there."""
        self.screws = np.zeros((2, 18))
        for screw, k in zip(self.screws, self.pair, strict=True):
            if k in screws:
                screw[:] = screws[k]
            else:
                screw[:12] = starts[k]
        self.enabled, tolerance = self.objects.enabled_surfaces(*self.pair), self.objects.tolerance
        task = Sweep(
            np.empty(len(self.a.root) * len(self.b.root)), tolerance.linear, tolerance.slop * tolerance.linear,
            np.empty(RATES, np.float32), np.empty(15), np.empty(2), np.empty(4, np.int64), np.empty(TERMS, np.float32),
        )  # fmt: skip
        self.work = SweepWorkspace(task, np.empty((2, 12)), np.empty(2), self.found)

    def advance(self, until: float, lead: float, deflection: float) -> float:
        """Advance it, see `advance`; its state."""
        a, b, limits = self.a, self.b, np.array([until, lead, deflection, STEPS])
        mask = ALL_ENABLED if self.enabled is None else self.enabled.ravel()
        while wanted := _advance.call(a, b, workspace_for(a, b), self.screws, limits, mask, self.work):
            workspace(pairs=wanted)
        return float(self.found[STATE])


def _first_impact(
    ways: list[_Way], screws: Mapping[int, NDArray[np.float64]], starts: NDArray[np.float64], deflection: float
) -> float:
    """Advance pairs, the one of least time first, until the first impact is known; its time, 1 without one.

    Unstarted pairs have time 0, but a pair that is held back before `EARLY` is advanced to its end first: if a motion
    is stopped at once, the pairs after the one that stops it are not computed.
    """
    first, queue = 1.0, [(EARLY, k) for k in range(len(ways))]
    while queue and first > 0.0:
        reached, k = heappop(queue)
        way = ways[k]
        if way.found[STATE] == NEW:
            way.begin(screws, starts)
        elif reached > first:
            continue
        state = way.advance(first, queue[0][0] if queue else 1.0, deflection)
        if state == UNDER_WAY:
            heappush(queue, (float(way.found[REACHED]), k))
        elif state == STOPPED:
            first = min(first, float(way.found[REACHED]))
    return first


def _screw(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """(18,) pose at t = 0 and body twist over the unit of time, of the motion from one (12,) pose to another."""
    import pinocchio as pin

    twist = pin.log6(poses.unpack(start).actInv(poses.unpack(end)))
    return np.concatenate([start, twist.vector])


def _at(screw: NDArray[np.float64], t: float) -> pin.SE3:
    """The pose at time t."""
    import pinocchio as pin

    return poses.unpack(screw[:12]) * pin.exp6(pin.Motion(t * screw[12:]))


def _pairs(
    objects: Objects, screws: Mapping[int, NDArray[np.float64]], ends: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Pairs i < j of which one moves, that are enabled, and whose ways come near each other."""
    known, box, linear = frozenset(objects.objects), objects.world_boxes().copy(), objects.tolerance.linear
    for i, end in zip(screws, ends.tolist(), strict=True):
        x0, y0, z0, x1, y1, z1, _ = bounds_of(objects.mesh(i)).tolist()
        center = (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1))
        half = (0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (z1 - z0))
        now = box[i].tolist()
        rounding = ROUNDING * (sum(map(abs, end[9:])) + sum(map(abs, center)) + sum(half))
        beyond = _sagitta(screws[i][12:].tolist(), center, math.hypot(*half)) + rounding
        for d in range(3):
            r = end[3 * d : 3 * d + 3]
            middle = r[0] * center[0] + r[1] * center[1] + r[2] * center[2] + end[9 + d]
            reach = abs(r[0]) * half[0] + abs(r[1]) * half[1] + abs(r[2]) * half[2]
            now[d], now[3 + d] = min(now[d], middle - reach) - beyond, max(now[3 + d], middle + reach) + beyond
        box[i] = now
    out, low, high = set(), box[:, :3], box[:, 3:]
    for i in screws:
        near = ((low <= high[i] + linear) & (high >= low[i] - linear)).all(axis=1)
        out |= {(min(i, j), max(i, j)) for j in np.flatnonzero(near).tolist() if j != i and j in known}
    return sorted(pair for pair in out if not objects.ignored(*pair))


def _sagitta(twist: list[float], center: tuple[float, float, float], radius: float) -> float:
    """How far points of a ball stray from their chords on the screw: each turns about its axis by |w|."""
    vx, vy, vz, wx, wy, wz = twist
    turn = math.sqrt(wx * wx + wy * wy + wz * wz)
    if turn == 0.0:
        return 0.0
    cx, cy, cz = center
    x, y, z = wy * cz - wz * cy + vx, wz * cx - wx * cz + vy, wx * cy - wy * cx + vz
    along = (x * wx + y * wy + z * wz) / (turn * turn)
    arm = math.hypot(x - along * wx, y - along * wy, z - along * wz)
    return (arm / turn + radius) * (1.0 - math.cos(0.5 * min(turn, math.pi)))


def _contacts(way: _Way, at_first: Mapping[int, pin.SE3]) -> NDArray[Any]:
    """The pairs of surfaces that stop two objects: the one found, and those that come into contact with it.

    at_first: poses of the moving objects at the time of impact.
    """
    (i, j), a, b, linear = way.pair, way.a, way.b, way.objects.tolerance.linear
    s, t = (int(k) for k in way.work.task.hit[:2])
    shape = len(a.root), len(b.root)
    mask = np.ones(shape, np.uint8) if way.enabled is None else way.enabled.copy()
    if way.found[LEVELS]:
        level = way.work.task.level.reshape(shape)
        unknown = np.argwhere((level == -np.inf) & (mask != 0))
        mask[level < linear] = 0
        if len(unknown):  # the motion was too short for them
            start = poses.pack_rigid(way.objects.relative_pose(i, j))
            depths = signed_distances_of(a, b, start, unknown, float(np.nextafter(linear, np.inf)))
            mask[tuple(unknown[depths > linear].T)] = 1
    mask[s, t] = 0
    where = way.screws[:, :12].copy()
    for pose, k in zip(where, way.pair, strict=True):
        if k in at_first:
            pose[:] = poses.pack_rigid(at_first[k])
    nearest = np.zeros(1, CONTACT_DTYPE)
    clearance_of(a, b, workspace_for(a, b), where, 0, 1, np.inf, lanes_of(a, b, s, t), nearest)
    nearest["surface_a"], nearest["surface_b"] = s, t
    rows = joined([contacts_between(a, b, where, linear, mask), nearest])
    rows["object_a"], rows["object_b"] = i, j
    return rows if len(rows) == 1 else picked(rows, np.lexsort((rows["surface_b"], rows["surface_a"])))
