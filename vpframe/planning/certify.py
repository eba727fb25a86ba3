"""What a way is worth: that nothing stops it, its least clearance and where, and its track."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import pinocchio as pin

from collision.query.blocking import Pairing
from vpframe.planning.assembly import Array, Assembly, Knots

SEARCHES: Final = 8
"""sweeps a pair that the least clearance is found with, to within a twentieth or so"""
MANY: Final = 9
"""knots: of longer ways, threads above all, the least clearance is known less well"""
TRIED: Final = (1.0 - 1e-6, 0.95)
"""of the least distance at a knot: what is tried first, before it is halved"""
STRAY: Final = 1e-6
"""m: by which straight lines between the rows of a track leave the screw that was certified, at most"""
SPEED, TURN_SPEED = 0.05, 0.5 * np.pi
"""m/s and rad/s, of tracks"""
COLUMNS: Final = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True, eq=False)
class Clearance:
    """The least distance, along a way, of surfaces that did not touch where it began."""

    distance: float
    """m: no two such surfaces come nearer; infinite where none come near at all"""
    parts: tuple[int, int] | None = None
    surfaces: tuple[int, int] | None = None
    at: Array | None = None
    """(3,) world, m"""


def free(assembly: Assembly, group: Sequence[int], others: Iterable[int], knots: Knots) -> bool:
    """Whether nothing stops a group on its way: every leg is swept, and a sweep is never late."""
    others = tuple(others)
    return all(assembly.first_stop(group, others, a, b) is None for a, b in pairwise(knots))


def least_clearance(
    assembly: Assembly, group: Sequence[int], others: Iterable[int], knots: Knots, ignore: float = 0.0
) -> Clearance:
    """The least distance of surfaces along a way; left out are those of fits and threads, and those that touch or are
    within `ignore` m of each other where it begins.

    A sweep that stops at a distance, and is not stopped, proves that nothing comes nearer; the greatest such distance
    is found by bisection. It counts nothing beyond the group's own size.
    """
    linear = assembly.tolerance.linear
    limit = max(assembly.size(i) for i in group)
    best = Clearance(np.inf)
    boxes = {i: assembly.with_tolerance(limit).way_box(i, knots) for i in group}
    for j in others:
        for i in group:
            if frozenset((i, j)) in assembly.authorised or not assembly.sweeps.box_meets(j, *boxes[i]):
                continue
            best = _of_pair(assembly, i, j, knots, max(ignore, 2.0 * linear), min(limit, best.distance), best)
    return best


def _of_pair(
    assembly: Assembly, i: int, j: int, knots: Knots, ignore: float, limit: float, best: Clearance
) -> Clearance:
    wide = assembly.with_tolerance(limit)
    if not any(wide._boxes_meet(i, j, a, b) for a, b in pairwise(knots)):
        return best
    sweeps = assembly.sweeps
    rows = sweeps.near(i, j, knots[0], knots[1], ignore)
    together: tuple[Pairing, ...] = tuple(((int(r["surface_a"]),), (int(r["surface_b"]),)) for r in rows)
    together += assembly.excused(i, j)
    for start, end in pairwise(knots):
        rows = sweeps.near(i, j, start, end, limit, together)
        if len(rows) and rows["distance"].min() < limit:
            row = rows[np.argmin(rows["distance"])]
            limit = float(row["distance"])
            best = _told(limit, i, j, row)
    low, high = assembly.tolerance.linear, limit
    for k in range(SEARCHES if len(knots) <= MANY else 3):
        if high <= 1.06 * low:
            break
        middle = high * TRIED[k] if k < len(TRIED) else float(np.sqrt(low * high))
        stop = assembly.with_tolerance(middle).stop(i, j, knots, together)
        if stop is None:
            low = middle
            if k == 0:
                return best  # nowhere nearer than at a knot, or than `limit`
        else:
            high = middle
            best = _told(low, i, j, stop.contacts[0]) if len(stop.contacts) else best
    return Clearance(low, best.parts, best.surfaces, best.at)


def _told(distance: float, i: int, j: int, row: np.void) -> Clearance:
    middle = 0.5 * (row["point_a"] + row["point_b"])
    return Clearance(distance, (i, j), (int(row["surface_a"]), int(row["surface_b"])), np.array(middle))


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of a part over time: what `Hand.follow` goes along."""

    times: Array
    """(n,) s"""
    poses: tuple[pin.SE3, ...]
    """of the part, world"""

    @property
    def length(self) -> float:
        """m: how far the part's origin goes."""
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


def track(pose: pin.SE3, knots: Knots) -> Track:
    """The track of a part that stands at a pose, along the knots; dense enough that a hand's straight lines between
    its rows leave the certified screws by no more than STRAY."""
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
    return Track(np.array(times), tuple(poses))
