"""Breadth-first pushing: straight and turning pushes until something stops them, and again from there.

A group that stalls is pushed every other way, also along what stalled it, and from where its flat faces come level with
those of the others on the way: there a slot or step begins (critical positions: Wilson & Latombe 1994, section 5).
Displacements that were reached before are not tried again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import pinocchio as pin

from constraints.freedom.escape import EscapeCone
from constraints.geometry.surfaces import Cone, Cylinder, Plane, Torus
from vpframe.planning import ways
from vpframe.planning.assembly import Array, Assembly, Budget, BudgetError, translation, turned
from vpframe.planning.pushes import Displacement, Pushes, SearchResult

LEAST: Final = 2e-3
"""of the group's size: shorter pushes do not count, and displacements this near each other are one"""
LEVELS: Final = 6
"""positions on a push at which faces come level that are tried, at most"""
FLAT: Final = 1e-9
"""m: a triangle whose corners differ less in height counts as across the direction"""
MOST: Final = 16
"""directions of straight pushes"""
AXES: Final = 8
"""lines that a group is turned about, at most"""
SHARE: Final = 0.4
"""of the budget"""


def search(
    assembly: Assembly, group: Sequence[int], others: Sequence[int], cone: EscapeCone, budget: Budget
) -> SearchResult:
    """Push a group breadth-first until a straight push frees it, no new displacement is reached, or its share of the
    budget is used up."""
    mine = budget.share(SHARE)
    pushes = Pushes(assembly, group, others, mine)
    try:
        return _breadth_first(pushes, cone)
    except BudgetError:
        return pushes.found(None, mine.ended)
    finally:
        budget.give_back(mine)


def _breadth_first(pushes: Pushes, cone: EscapeCone) -> SearchResult:
    mates = ways.mates_between(pushes.assembly, pushes.group, pushes.others)
    axes = [sign * mate.axis for mate in mates if mate.axis.any() for sign in (1.0, -1.0)]
    own = ways.own_axes(pushes.assembly, pushes.group) or list(ways.AXES)
    directions = ways.distinct([*axes, *cone.directions(), *own])[:MOST]
    lines = _lines(pushes)
    seen, count = {_key(pushes, pushes.nodes[0].at)}, 0
    straight, turns, between = deque([0]), deque[int](), deque[int]()
    turned_to: deque[int] = deque()
    while turned_to or straight or turns or between:
        queue = next(q for q in _order(count, turned_to, straight, turns, between) if q)
        place = queue.popleft()
        node = pushes.nodes[place]
        count += 1
        if queue is turns:
            for origin, axis in lines:
                here, about = node.at.act(origin), node.at.rotation @ axis
                for sign in (1.0, -1.0):
                    _turn(pushes, turned_to, seen, place, here, sign * about)
            continue
        for direction in ways.distinct([*directions, *_along(node, directions)]):
            end = pushes.exit(node.at, direction)
            reached, stop = pushes.push(node.at, end)
            if stop is None:
                return pushes.found(pushes.way(place, end, direction, "slide"))
            far = float((reached.translation - node.at.translation) @ direction)
            if far < LEAST * pushes.length:
                continue
            for s in _levels(pushes, node.at, direction, far):
                _keep(pushes, between, seen, place, [translation(s * direction) * node.at], None)
            _keep(pushes, straight, seen, place, [reached], stop)
        turns.append(place)
    return pushes.found(None)


def _order(
    count: int, turned_to: deque[int], straight: deque[int], turns: deque[int], between: deque[int]
) -> tuple[deque[int], ...]:
    """Queues, in round-robin order after those reached by turns, so that many displacements within a small clearance
    do not starve the others."""
    if count % 3 == 2:
        return turned_to, turns, straight, between
    return (turned_to, between, straight, turns) if count % 7 == 6 else (turned_to, straight, turns, between)


def _turn(pushes: Pushes, queue: deque[int], seen: set[bytes], place: int, origin: Array, axis: Array) -> None:
    """Turn by up to 2π; each quarter, and the stop, are new displacements."""
    at, legs = pushes.nodes[place].at, []
    for _ in range(4):
        target = turned(origin, axis, ways.MOST_TURN) * at
        reached, stop = pushes.push(at, target)
        angle = float(np.linalg.norm(pin.log3(at.rotation.T @ reached.rotation)))
        if angle * pushes.length < LEAST * pushes.length:
            return
        legs.append(reached)
        _keep(pushes, queue, seen, place, legs, stop)
        if stop is not None:
            return
        at = reached


def _keep(pushes: Pushes, queue: deque[int], seen: set[bytes], parent: int, legs: list[pin.SE3], stop: object) -> None:
    key = _key(pushes, legs[-1])
    if key not in seen:
        seen.add(key)
        queue.append(pushes.add(parent, list(legs), stop))  # type: ignore[arg-type]


def _key(pushes: Pushes, at: pin.SE3) -> bytes:
    """A key that is equal for displacements rounded to the same grid cell."""
    grid = LEAST * pushes.length
    middle = np.round(at.act(pushes.center) / grid)
    quaternion = pin.Quaternion(at.rotation).coeffs()
    k = int(np.argmax(np.abs(quaternion)))
    turn = np.round(quaternion * np.sign(quaternion[k]) / (5.0 * LEAST))
    return (np.concatenate([middle, turn]) + 0.0).tobytes()


def _along(node: Displacement, directions: Iterable[Array]) -> list[Array]:
    """The directions projected onto the surfaces that stopped this node."""
    out = []
    for normal in node.normals[:3]:
        for d in directions:
            into = float(d @ normal)
            if -0.999 < into < -1e-6:
                out.append(d - into * normal)
    return out[:12]


def _lines(pushes: Pushes) -> list[tuple[Array, Array]]:
    """Lines (point, unit axis), world, at the initial pose: of fits, round surfaces, and the box."""
    assembly = pushes.assembly
    found = [(m.origin, m.axis) for m in ways.mates_between(assembly, pushes.group, pushes.others) if m.axis.any()]
    round_ones = []
    for i in pushes.group:
        for feature in assembly.scene.parts[i].features:
            g = feature.geometry
            if isinstance(g, Cylinder | Cone | Torus):
                origin = g.apex if isinstance(g, Cone) else g.origin if isinstance(g, Cylinder) else g.center
                round_ones.append((feature.area, assembly.poses[i].act(origin), assembly.poses[i].rotation @ g.axis))
    round_ones.sort(key=lambda entry: -entry[0])
    found += [(origin, axis) for _, origin, axis in round_ones]
    own = ways.own_axes(assembly, pushes.group)[:6:2] or list(np.eye(3))
    found = found[: AXES - len(own)] + [(pushes.center, axis) for axis in own]
    out: list[tuple[Array, Array]] = []
    for origin, axis in found:
        a = ways.unit(axis)
        foot = origin - ((origin - pushes.center) @ a) * a
        if not any(np.linalg.norm(np.cross(a, b)) < 1e-6 and np.linalg.norm(foot - p) < 1e-6 for p, b in out):
            out.append((foot, a))
    return out[:AXES]


def _levels(pushes: Pushes, at: pin.SE3, direction: Array, far: float) -> list[float]:
    """Distances (m) before `far` at which a flat face of the group comes level with one of the others."""
    mine = _heights(pushes.assembly, pushes.group, direction, at)
    theirs = _heights(pushes.assembly, pushes.others, direction, pin.SE3.Identity())
    if not len(mine) or not len(theirs):
        return []
    gaps = np.unique(np.round((theirs[None, :] - mine[:, None]).ravel(), 7))
    gaps = gaps[(gaps > LEAST * pushes.length) & (gaps < far - LEAST * pushes.length)]
    return gaps[:LEVELS].tolist()


def _heights(assembly: Assembly, parts: Iterable[int], direction: Array, at: pin.SE3) -> Array:
    """Heights (m) along a direction of the flat faces across it."""
    out = []
    for i in parts:
        pose = at * assembly.poses[i]
        local = pose.rotation.T @ direction
        if assembly.scene.parts[i].shape.faceted:
            corners = assembly.meshes[i].vertices[assembly.meshes[i].triangles] @ local
            out += (corners[np.ptp(corners, axis=1) < FLAT, 0] + pose.translation @ direction).tolist()
        for feature in assembly.scene.parts[i].features:
            g = feature.geometry
            if isinstance(g, Plane) and abs(abs(float(g.normal @ local)) - 1.0) < 1e-6:
                out.append(float(pose.act(g.origin) @ direction))
    return np.unique(np.round(out, 9))
