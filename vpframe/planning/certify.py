"""Certify a path: collision-free, with its least clearance; and the timed track of each part."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import pinocchio as pin

from collision import SurfacePairs
from constraints.recognition.mated import adjacent_surfaces
from vpframe.planning.assembly import Array, Assembly, Knots

SAMPLES: Final = 32
"""poses of a path, about, at which distances are measured before the sweeps"""
MARGIN: Final = 1e-3
"""1: of the least distance measured: how much less is proven first, and how exactly; twice as much after each stop"""
SEARCHES: Final = 9
"""sweeps a pair until one is not stopped"""
DIP: Final = 9
"""poses of a part of a leg at which the least distance is looked for; then as many between the two beside it"""
STRAY: Final = 1e-6
"""m: by which straight lines between the rows of a track leave the screw that was certified, at most"""
SPEED, TURN_SPEED = 0.05, 0.5 * np.pi
"""m/s and rad/s, of tracks"""
COLUMNS: Final = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True, eq=False)
class PathClearance:
    """The least distance, along a way, of surfaces that did not touch where it began."""

    distance: float
    """m: no two such surfaces come nearer; infinite where none come near at all"""
    parts: tuple[int, int] | None = None
    surfaces: tuple[int, int] | None = None
    at: Array | None = None
    """(3,) world, m"""
    ignored: tuple[tuple[int, int], ...] = ()
    """parts that move and parts that they may pass through, near the way: not among those measured"""


def free(assembly: Assembly, group: Sequence[int], others: Iterable[int], knots: Knots) -> bool:
    """Whether a group moves along a path without a stop: every leg is swept, conservatively."""
    others = tuple(others)
    return all(assembly.first_stop(group, others, a, b) is None for a, b in pairwise(knots))


def least_clearance(
    assembly: Assembly, group: Sequence[int], others: Iterable[int], knots: Knots, ignore: float = 0.0
) -> PathClearance:
    """The least distance of surfaces along a path, at most the group's size.

    Excluded are surfaces of fits and threads that a leg keeps, surfaces within `ignore` m of each other at the start,
    and surfaces of an overlap there with their neighbours. Ignored pairs of parts near the path are listed.

    Distances at sampled poses are an upper bound; a sweep that stops at a distance, and reaches the end, proves a lower
    bound, which is returned.
    """
    limit = max(assembly.size(i) for i in group)
    wide = assembly.with_tolerance(limit, 1.0)
    boxes = {i: wide.way_box(i, knots) for i in group}
    measured, ignored = [], []
    nearest = limit
    for j in others:
        for i in group:
            if frozenset((i, j)) in assembly.ignored:
                if any(assembly.sweeps.boxes_meet(i, j, a, b) for a, b in pairwise(knots)):
                    ignored.append((i, j))
                continue
            if not assembly.sweeps.box_meets(j, *boxes[i]):
                continue
            if not any(wide.boxes_meet(i, j, a, b) for a, b in pairwise(knots)):
                continue
            rows = assembly.sweeps.near(i, j, knots[0], knots[1], max(ignore, 2.0 * assembly.tolerance.linear))
            together: tuple[SurfacePairs, ...] = tuple(((int(r["surface_a"]),), (int(r["surface_b"]),)) for r in rows)
            kept = (pairing for a, b in pairwise(knots) for pairing in assembly.left_out(i, j, a, b) or ())
            together += tuple(dict.fromkeys(kept))
            mine, theirs = assembly.sweeps.overlap(i, j, tuple(assembly.left_out(i, j, knots[0], knots[1]) or ()))
            mine += adjacent_surfaces(assembly.meshes[i], mine)
            together += ((mine, theirs + adjacent_surfaces(assembly.meshes[j], theirs)),)
            found = _measured(assembly, i, j, knots, together, nearest)
            nearest = min(nearest, found.distance)
            measured.append((found, i, j, together))
    best = PathClearance(np.inf)
    for found, i, j, together in sorted(measured, key=lambda m: m[0].distance):
        best = _proven(assembly, i, j, knots, together, found, min(limit, best.distance), best)
    return replace(best, ignored=tuple(ignored))


def _measured(
    assembly: Assembly, i: int, j: int, knots: Knots, together: tuple[SurfacePairs, ...], within: float
) -> PathClearance:
    """The least distance below `within` m at sampled poses of a path; infinite without one."""
    out, each = PathClearance(np.inf), max(1, SAMPLES // (len(knots) - 1))
    for leg in pairwise(knots):
        found, _ = _least_at(assembly, i, j, leg, np.arange(each) / each, together, within)
        if found.distance < within:
            out, within = found, found.distance
    return out


def _least_at(
    assembly: Assembly, i: int, j: int, leg: tuple[pin.SE3, pin.SE3], times: Array, together: tuple[SurfacePairs, ...],
    within: float,
) -> tuple[PathClearance, int]:  # fmt: skip
    """The least distance below `within` m at the given times of a leg, and the index of its time; infinite without."""
    out, at = PathClearance(np.inf), 0
    start, end = leg
    way = pin.log6(start.actInv(end))
    for k, t in enumerate(times):
        rows = assembly.sweeps.near(i, j, start * pin.exp6(way * t), end, within, together)
        if len(rows) and rows["distance"].min() < within:
            row = rows[np.argmin(rows["distance"])]
            within, at = float(row["distance"]), k
            out = _told(within, i, j, row)
    return out, at


def _least_near(
    assembly: Assembly, i: int, j: int, leg: tuple[pin.SE3, pin.SE3], begin: float, together: tuple[SurfacePairs, ...],
    within: float,
) -> PathClearance:  # fmt: skip
    """A local minimum of the distance on a leg after a time, below `within` m, by successive refinement."""
    times, best = np.linspace(begin, 1.0, DIP), PathClearance(np.inf)
    while times[-1] - times[0] > 1e-4:
        found, at = _least_at(assembly, i, j, leg, times, together, within)
        if found.distance == np.inf:
            break
        best, within = found, found.distance * (1.0 + 1e-9)
        times = np.linspace(times[max(at - 1, 0)], times[min(at + 1, DIP - 1)], DIP)
    return best


def _proven(
    assembly: Assembly, i: int, j: int, knots: Knots, together: tuple[SurfacePairs, ...], found: PathClearance,
    limit: float, best: PathClearance,
) -> PathClearance:  # fmt: skip
    """The lesser of the best clearance and the proven clearance of a pair with measured distances.

    A sweep that stops shows where surfaces are nearer; the local minimum after it is measured, and proven in turn.
    """
    high, margin, least = min(limit, found.distance), MARGIN, assembly.tolerance.linear
    nearer = high < limit
    if nearer:
        best = found
    for _ in range(SEARCHES):
        if high <= least:
            break
        low = high * (1.0 - margin) ** 2
        stop = assembly.with_tolerance(high * (1.0 - margin), margin).stop(i, j, knots, together, graze=False)
        if stop is None:
            return PathClearance(max(low, least), best.parts, best.surfaces, best.at) if nearer else best
        high, nearer, margin = high * (1.0 - margin), True, 2.0 * margin
        there = _least_near(assembly, i, j, (knots[stop.leg], knots[stop.leg + 1]), stop.t, together, high)
        if there.distance < high:
            high, best = there.distance, there
        elif len(stop.contacts):
            best = _told(high, i, j, stop.contacts[0])
    return PathClearance(least, best.parts, best.surfaces, best.at) if nearer else best


def _told(distance: float, i: int, j: int, row: np.void) -> PathClearance:
    middle = 0.5 * (row["point_a"] + row["point_b"])
    return PathClearance(distance, (i, j), (int(row["surface_a"]), int(row["surface_b"])), np.array(middle))


@dataclass(frozen=True, eq=False)
class PartTrack:
    """Poses of a part over time, for `Hand.follow`."""

    times: Array
    """(n,) s"""
    poses: tuple[pin.SE3, ...]
    """of the part, world"""

    @property
    def length(self) -> float:
        """Path length of the part's origin, m."""
        return float(sum(np.linalg.norm(b.translation - a.translation) for a, b in pairwise(self.poses)))

    def text(self) -> str:
        """The CSV that `Hand.follow` reads: `t,x,y,z,qx,qy,qz,qw`, metres and seconds, world."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS)
        for t, pose in zip(self.times, self.poses, strict=True):
            quaternion = pin.Quaternion(pose.rotation).coeffs()
            writer.writerow([repr(float(x) + 0.0) for x in (t, *pose.translation, *quaternion)])
        return out.getvalue()


def track(pose: pin.SE3, knots: Knots) -> PartTrack:
    """The track of a part from its pose along the knots.

    Rows are dense enough that straight lines between them deviate from the certified screws by at most STRAY.
    """
    times, poses = [0.0], [pin.SE3(pose)]
    for start, end in pairwise(knots):
        step = start.actInv(end)
        twist = pin.log6(step)
        turn, first = float(np.linalg.norm(twist.angular)), start * pose
        advance = float(np.linalg.norm((end * pose).translation - first.translation))
        local = first.actInv(end * pose)
        own = pin.log6(local)
        n = 1
        if turn > 1e-12:
            arm = float(np.linalg.norm(np.cross(own.angular, own.linear))) / turn**2
            n = max(1, int(np.ceil(turn / np.sqrt(8.0 * STRAY / max(arm, STRAY)))), int(np.ceil(turn / 0.5)))
        seconds = max(advance / SPEED, turn / TURN_SPEED)
        if seconds <= 0.0:
            continue
        t0 = times[-1]
        for k in range(1, n + 1):
            times.append(t0 + seconds * k / n)
            poses.append(first * pin.exp6(own * (k / n)) if k < n else end * pose)
    if len(poses) == 1:
        times, poses = [0.0, 1.0], [poses[0], poses[0]]
    return PartTrack(np.array(times), tuple(poses))
