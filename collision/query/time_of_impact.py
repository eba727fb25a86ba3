"""First time of impact along a motion; thin objects are not passed, at any speed.

Each moving object goes from its pose to its target along one screw, the SE(3) geodesic: at time t in [0, 1] it is at
T0·exp(t·log(T0⁻¹·T1)); all move at once. Two surfaces come into contact when their distance falls to the tolerance.

- Never late: before the time returned no two surfaces that were apart have met.
- Early by no more than the tolerance: at that time two surfaces are within `Tolerance.linear` of each other.

Surfaces in contact at the start, at most the tolerance apart, could not separate if contact alone stopped them. Such a
pair stops the motion only if its surfaces approach each other. Its signed distance (that of the triangles, and where
they meet minus the shortest translation that separates the two triangles) may fall by `Tolerance.slop`, a tenth of the
tolerance, below its value at the start, so that surfaces can slide. The level reached then stops the motion; the time
returned is the last above it, to within 1.5 slops. However often motions are repeated, a pair that is not deeper at
the start gets no deeper than the tolerance, or than `deflection` if that is given: the tessellations of a shaft and its
bore penetrate each other by that much though the surfaces fit. Only triangles smaller than that depth may be passed,
and only by the pair of surfaces that is already in contact.

Conservative advancement: the step is the least of the times for which pairs of boxes or triangles are known to stay
apart (`collision.triangle.motion`), found best first (Tang, Kim & Manocha, "C²A: Controlled Conservative Advancement",
ICRA 2009; here any separating direction makes a certificate, and its second-order term distinguishes motion along a
surface from motion towards it).
"""

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
    float_limit,
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
from collision.query.distance import clearance_entry, contacts_between, lanes_of, rounding_of
from collision.query.intersection import ALL_ENABLED
from collision.query.signed_distance import least_signed_distance, signed_distances_of
from collision.reference.shape import ShapeMesh
from collision.triangle.motion import RelativeMotion, pair_step

if TYPE_CHECKING:
    import pinocchio as pin


ROUNDING: Final = 64.0 * 2.0**-53
"""1: generous error bound of a box moved by a pose, per unit of the coordinates: six operations and the pose's error"""
LESS: Final = 1.0 - 2.0**-20
"""1: factor from the certified time of a pair to the step, so that pairs equal up to rounding are not tested again"""
EARLY: Final = 2.0**-10
"""1: time up to which the first advancement of a pair has priority"""
STEPS = 20000
"""advancements after which a pair counts as in contact at the time reached, which is safe"""


# --- kernels ---------------------------------------------------------------------------------------------------------


class Sweep(NamedTuple):
    """Task: find a time for which all pairs of triangles stay above the signed distances that stop the motion."""

    level: Any
    """(ka·kb,) float64, m: signed distance at which a pair of surfaces stops the motion, -inf for never; (0,): all at
    `tolerance`"""
    tolerance: Any
    """m"""
    slop: Any
    """m: steps aim at half of it below a pair's own level, at the whole below `tolerance`, so that the level is crossed
    by at most that"""
    rates: Any
    """(RATES,) float32, see `simd.RATES`"""
    motion: Any
    """(15,) float64: see `_set_rates`"""
    step: Any
    """(2,) float64: time certified for all pairs visited so far; error bound of a float64 distance, m"""
    hit: Any
    """(4,) int64: surfaces and lanes of the pair with the shortest time"""
    terms: Any
    """(TERMS,) float32, see `simd.perhaps_nearing`"""

    def is_open(self, ws, bound):
        """Whether a pair of boxes that stays apart for this time may shorten the step."""
        return bound < self.step[0]

    def children_of_a(self, a, b, ws, node, lane_b):
        """Bits: which boxes of a node of a may come near a box of b within the step."""
        stop, aim = _stops(self, b, _node_surface(a, node), b.surface[lane_b])
        if stop == -np.inf:
            return 0
        ws.counts[TRIANGLE_BOXES] += LANES
        aim, until = float_limit(aim), float_limit(self.step[0])
        return apart_lane_a(a.boxes, NODE * node, ws.moved, box_at(lane_b), self.rates, aim, until, ws.bounds)

    def children_of_b(self, a, b, ws, lane_a, node):
        """Bits: which boxes of a node of b may come near a box of a within the step."""
        stop, aim = _stops(self, b, a.surface[lane_a], _node_surface(b, node))
        if stop == -np.inf:
            return 0
        ws.counts[TRIANGLE_BOXES] += LANES
        aim, until = float_limit(aim), float_limit(self.step[0])
        return apart_lane_b(ws.moved, NODE * node, a.boxes, box_at(lane_a), self.rates, aim, until, ws.bounds)

    def visit(self, a, b, ws, lane_a, lane_b):
        """Shorten the step by the triangles of two packets; return whether any are at their level now."""
        s, u = a.surface[lane_a], b.surface[lane_b]
        level, aim = _stops(self, b, s, u)
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
            self.terms[9], at, to = float_limit(step), PREPARED * p, PREPARED * q + tb - first_b
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


@inline_kernel
def _stops(task, b, s, u):
    """(signed distance at which surfaces s of a and u of b stop the motion, signed distance that steps aim at).

    s, u: -1 for boxes of several surfaces, for which the greatest level, `tolerance`, is safe.
    """
    pair = _pair_of(b, s, u)
    if pair >= 0 and len(task.level) > 0 and task.level[pair] < task.tolerance:
        return task.level[pair], task.level[pair] - 0.5 * task.slop
    return task.tolerance, task.tolerance - task.slop


@inline_kernel
def _pair_of(b, s, u):
    """The pair of surfaces s of a and u of b; -1 if either is -1."""
    return np.int64(s) * len(b.root) + u if s >= 0 and u >= 0 else np.int64(-1)


@inline_kernel
def _node_surface(bvh, node):
    """The surface of all boxes of a node, -1 for several; a node with one box is above the surfaces."""
    s = bvh.surface[LANES * node]
    return s if s == bvh.surface[LANES * node + 1] else np.int32(-1)


@inline_kernel
def _motion_of(matrix, motion, middle, half):
    """The `RelativeMotion` of the points of a box of b; middle, half: its middle and half edges in b's frame, m."""
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

    The error bound along any direction: 20 roundings of float32 of coordinates about the middle of a's box, plus the
    error of the float64 vertices.
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
    terms[7], terms[8] = float_limit(most), float_limit(aim)


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
    own = sub(moved, cross(turned, at))  # velocity of the point of b at a's origin
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
        rates[15 + d] = float_limit(np.sqrt(wa[e] * wa[e] + wa[f] * wa[f]))
        rates[18 + d] = float_limit(np.sqrt(dw[e] * dw[e] + dw[f] * dw[f]) + bend)
        speed += abs(dv[d]) + abs(velocity[d]) + abs(own[d]) + abs(of_dw[d])
        extent += abs(at[d]) + a_frame[3 + d] + abs(centre[d]) + 2.0 * (b_frame[3 + d] + abs(b_frame[d]))
    rates[12], rates[13], rates[14] = float_limit(norm(dw)), float_limit(norm(w)), float_limit(norm(wa))
    rates[21] = float_limit(norm(dw) + bend)
    rates[22] = float_limit(2.0**-19 * (speed + (norm(dw) + norm(turned)) * extent) + 1e-30)


class SweepWorkspace(NamedTuple):
    """Arrays and state of the advancement of a pair of objects."""

    task: Sweep
    poses: Any
    """(2, 12) float64: of a and b at the time reached, m"""
    least: Any
    """(2,) float64, m: see `SignedDistance`"""
    found: Any
    """(5,) float64, see the places below"""


REACHED, BEFORE, STATE, LEVELS, TAKEN = range(5)
"""places in `SweepWorkspace.found`: time before which no pair of surfaces is at its level; that of the advancement
before; NEW, UNDER_WAY, STOPPED or PASSED; whether `Sweep.level` is in use; number of advancements"""
NEW, UNDER_WAY, STOPPED, PASSED = 0.0, 1.0, 2.0, 3.0


@inline_kernel
def _move_to(a, b, ws, screws, t, work):
    """Start a query of a and b at time t; `task.step[1]` and `least[1]` become its rounding error."""
    screw_pose(screws[0], t, work.poses[0])
    screw_pose(screws[1], t, work.poses[1])
    relative_pose(work.poses[0], work.poses[1], ws.pose.matrix)
    start(a, b, ws)
    work.task.step[1] = work.least[1] = rounding_of(a, b, ws.pose.matrix)


@inner_kernel
def _set_levels(a, b, ws, near, limits, enabled, work):
    """Fill `work.task.level`; the pairs of surfaces in contact, among the first `near` of `ws.pairs`, get their own.

    A pair that the motion cannot bring to its level gets -inf: its signed distance is not computed.
    """
    task, kb = work.task, len(b.root)
    until, deflection = limits[0], limits[2]
    tolerance, slop = task.tolerance, task.slop
    for pair in range(len(a.root) * kb):
        task.level[pair] = -np.inf if len(enabled) > 0 and enabled[pair] == 0 else tolerance
    frame = b.frame
    motion = _motion_of(ws.pose.matrix, task.motion, _vector(frame, 0), _vector(frame, 3))
    travel = until * motion.fastest * (1.0 + 1e-9) + 4.0 * work.least[1]
    for k in range(near):
        pair = ws.pairs[k]
        if task.level[pair] == -np.inf:
            continue
        if travel < 0.01 * slop:
            task.level[pair] = -np.inf
            continue
        short = travel < slop
        within = slop - tolerance if short else tolerance * (1.0 + 2.0**-50)
        depth = least_signed_distance(a, b, ws, pair, within, work.least)
        if short and depth >= within:
            task.level[pair] = -np.inf
        elif depth <= tolerance:
            lowest_level = max(depth - slop, -tolerance) if depth > slop - tolerance else depth - 0.01 * slop
            task.level[pair] = min(lowest_level, -deflection) if deflection > 0.0 else lowest_level


@inner_kernel
def _last_above(a, b, ws, screws, before, pair, work):
    """A time from `before` on at which the signed distance of a pair of surfaces is above its level by at most 1.5
    slops, by bisection.

    It is above its level at `before`, and at most at it at `work.found[REACHED]`; in between every pair stays above
    the signed distance that the advancement aimed at.
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
    """Advance a pair of objects until it is STOPPED, has PASSED `until`, or the time reached is later than `lead`.

    screws: (2, 18) float64, pose at t = 0 and body twist (v, w) per unit of time, of a and of b. limits: (4,) float64,
    until, lead, deflection (m), advancements after which the pair counts as stopped at the time reached. enabled:
    (ka·kb,) uint8, 0 for pairs of surfaces to leave out; (0,) enables all. work: NEW, or as left by the last call. The
    surfaces that stop the motion are the first two numbers of `work.task.hit`. Returns the length that `ws.pairs` must
    have, 0 if it is long enough.
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
        # the pair that limited the last step often limits this one: visited first, it excludes many others
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
    """Return the first impact while the objects in `moves` go from their poses to their targets, all at once.

    Parameters
    ----------
    moves: target pose (`pinocchio.SE3` or (4, 4)) by object; other objects do not move.
    deflection: m, depth by which surfaces in contact at the start may penetrate each other because of tessellation.

    Ignored pairs of objects and of surfaces do not stop a motion.

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
    pairs = [_Advancement(objects, pair) for pair in _pairs(objects, screws, ends)]
    first = _first_impact(pairs, screws, starts, deflection)
    stops = [pair for pair in pairs if pair.found[STATE] == STOPPED and pair.found[REACHED] == first]
    at_first = {i: _at(screws[i], first) for i in sorted(moves)}
    rows = joined([_contacts(pair, at_first) for pair in stops])
    return TimeOfImpact(first, rows, at_first)


class _Advancement:
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
        """Allocate the arrays of `advance`. starts: (n, 12) poses of all objects; those without a screw do not move."""
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
        """Advance the pair, see `advance`; return its state."""
        a, b, limits = self.a, self.b, np.array([until, lead, deflection, STEPS])
        mask = ALL_ENABLED if self.enabled is None else self.enabled.ravel()
        while wanted := _advance.call(a, b, workspace_for(a, b), self.screws, limits, mask, self.work):
            workspace(pairs=wanted)
        return float(self.found[STATE])


def _first_impact(
    pairs: list[_Advancement], screws: Mapping[int, NDArray[np.float64]], starts: NDArray[np.float64],
    deflection: float,
) -> float:  # fmt: skip
    """Advance pairs in the order of the times reached until the first impact is known; return its time, 1 without one.

    Unstarted pairs have time `EARLY`: a pair below it is advanced first, so that if a motion is stopped at once, the
    pairs after the one that stops it are not computed.
    """
    first, queue = 1.0, [(EARLY, k) for k in range(len(pairs))]
    while queue and first > 0.0:
        reached, k = heappop(queue)
        pair = pairs[k]
        if pair.found[STATE] == NEW:
            pair.begin(screws, starts)
        elif reached > first:
            continue
        state = pair.advance(first, queue[0][0] if queue else 1.0, deflection)
        if state == UNDER_WAY:
            heappush(queue, (float(pair.found[REACHED]), k))
        elif state == STOPPED:
            first = min(first, float(pair.found[REACHED]))
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
    """Enabled pairs i < j of objects, at least one of them moving, whose swept boxes come near each other."""
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
    """Bound of the distance (m) of points of a ball from their chords on a screw: each turns about its axis by |w|."""
    vx, vy, vz, wx, wy, wz = twist
    turn = math.sqrt(wx * wx + wy * wy + wz * wz)
    if turn == 0.0:
        return 0.0
    cx, cy, cz = center
    x, y, z = wy * cz - wz * cy + vx, wz * cx - wx * cz + vy, wx * cy - wy * cx + vz
    along = (x * wx + y * wy + z * wz) / (turn * turn)
    arm = math.hypot(x - along * wx, y - along * wy, z - along * wz)
    return (arm / turn + radius) * (1.0 - math.cos(0.5 * min(turn, math.pi)))


def _contacts(pair: _Advancement, at_first: Mapping[int, pin.SE3]) -> NDArray[Any]:
    """The pairs of surfaces that stop two objects: the one found, and those that come into contact at the same time.

    at_first: poses of the moving objects at the time of impact.
    """
    (i, j), a, b, linear = pair.pair, pair.a, pair.b, pair.objects.tolerance.linear
    s, t = (int(k) for k in pair.work.task.hit[:2])
    shape = len(a.root), len(b.root)
    mask = np.ones(shape, np.uint8) if pair.enabled is None else pair.enabled.copy()
    if pair.found[LEVELS]:
        level = pair.work.task.level.reshape(shape)
        unknown = np.argwhere((level == -np.inf) & (mask != 0))
        mask[level < linear] = 0
        if len(unknown):  # `_set_levels` did not compute their signed distances
            start = poses.pack_rigid(pair.objects.relative_pose(i, j))
            depths = signed_distances_of(a, b, start, unknown, float(np.nextafter(linear, np.inf)))
            mask[tuple(unknown[depths > linear].T)] = 1
    mask[s, t] = 0
    where = pair.screws[:, :12].copy()
    for pose, k in zip(where, pair.pair, strict=True):
        if k in at_first:
            pose[:] = poses.pack_rigid(at_first[k])
    nearest = np.zeros(1, CONTACT_DTYPE)
    clearance_entry.call(a, b, workspace_for(a, b), where, 0, 1, np.inf, lanes_of(a, b, s, t), nearest)
    nearest["surface_a"], nearest["surface_b"] = s, t
    rows = joined([contacts_between(a, b, where, linear, mask), nearest])
    rows["object_a"], rows["object_b"] = i, j
    return rows if len(rows) == 1 else picked(rows, np.lexsort((rows["surface_b"], rows["surface_a"])))
