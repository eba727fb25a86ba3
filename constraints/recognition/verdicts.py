"""Cache of the constraint kinds of pairs of features, measured again only once a result may have changed.

A verdict is the kind of a pair of features, or None. Its margin is the distance that the points of one feature may
move, relative to the other, before the verdict can change (Lipschitz bounds on gap, angle, offset and overlap, as in
conservative advancement). A pair that slides along its mate is measured once in many steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from constraints.geometry.overlap import shared_height
from constraints.geometry.surfaces import Cylinder, Plane, cross, norm, perpendicular
from constraints.geometry.views import FeatureView, Limits
from constraints.recognition.candidate import Match, Pair
from constraints.recognition.pairings import Pairing, line_angle, of_thread

Array = NDArray[np.float64]
SAFE = 0.9
"""1: fraction of a margin that is used, against rounding"""
TILT = 0.1
"""rad: tilt above which there is no bound of the change of an overlap"""


class KeptVerdict(NamedTuple):
    """One verdict."""

    kind: str | None
    center: Array
    """(3,) of a ball about both features, in the frame of body b"""
    radius: float
    seat: Array
    """(4, 4) pose of b in a's frame when it was measured"""
    margin: float
    """m: distance that any point of the ball may move from there, in a's frame, before the verdict may change"""


class VerdictTable:
    """The verdicts of pairs that are queried in every step, as arrays with one row for each pair."""

    def __init__(self, pairs: Sequence[Pair], known: Sequence[KeptVerdict | None]) -> None:
        self.pairs = list(pairs)
        self.bodies = sorted({body for pair in pairs for body in (pair[0], pair[2])})
        place = {body: k for k, body in enumerate(self.bodies)}
        self.a = np.array([place[pair[0]] for pair in pairs], np.int64)
        self.b = np.array([place[pair[2]] for pair in pairs], np.int64)
        self.kinds: list[str | None] = [None] * len(pairs)
        self.center, self.radius = np.zeros((len(pairs), 3)), np.zeros(len(pairs))
        self.seat, self.margin = np.zeros((len(pairs), 4, 4)), np.full(len(pairs), -1.0)
        for k, verdict in enumerate(known):
            if verdict is not None:
                self.set(k, verdict)

    def set(self, k: int, verdict: KeptVerdict) -> None:
        """Set the verdict in row k."""
        self.kinds[k] = verdict.kind
        self.center[k], self.radius[k], self.seat[k], self.margin[k] = verdict[1:]

    def at(self, poses: Sequence[pin.SE3]) -> Array:
        """Return (n, 4, 4): the poses of `bodies`."""
        return np.array([poses[body].homogeneous for body in self.bodies]).reshape(-1, 4, 4)

    def stale(self, at: Array) -> NDArray[np.int64]:
        """Return the rows of the pairs that have moved beyond their margin, or were never measured. at: see `at`."""
        out = np.empty(len(self.pairs), np.bool_)
        _beyond(self.a, self.b, at, self.center, self.radius, self.seat, self.margin, out)
        return np.flatnonzero(out)


class Measures(Protocol):
    """Methods of a `Recogniser` that are called."""

    def matches(
        self, pair: Pair, poses: Sequence[pin.SE3], limits: Limits, rows: tuple[Pairing[Any, Any], ...]
    ) -> Match | None: ...
    def view(self, body: int, feature: int, pose: pin.SE3) -> FeatureView[Any]: ...
    def limits_of(self, pair: Pair, limits: Limits) -> Limits: ...


class Verdicts:
    """Verdicts of one recogniser."""

    def __init__(self, recogniser: Measures) -> None:
        self.recogniser = recogniser
        self._known: dict[tuple[Pair, Limits, int], KeptVerdict] = {}
        self._planes: dict[Pair, tuple[float, ...] | None] = {}
        self._tables: dict[str, tuple[Any, VerdictTable]] = {}

    def forget(self) -> None:
        """Drop all tables: one may have been interrupted while it was updated."""
        self._tables = {}

    def kinds(
        self, name: str, pairs: Sequence[Pair], poses: Sequence[pin.SE3], limits: Limits,
        rows: tuple[Pairing[Any, Any], ...],
    ) -> list[str | None]:  # fmt: skip
        """Return the kind of each pair at `poses`, None without match. name: of the table kept between calls."""
        key = (pairs, limits, len(rows))
        known = self._tables.get(name)
        if known is None or known[0] != key:
            table = VerdictTable(pairs, [self._known.get((pair, limits, len(rows))) for pair in pairs])
            known = self._tables[name] = key, table
        table = known[1]
        if not table.pairs:
            return []
        at = table.at(poses)
        stale = table.stale(at).tolist()
        if [row.kind for row in rows if row.first is row.second is Plane] == ["against"]:
            stale = self._skip_planes(table, stale, at, limits, len(rows))
        for k in stale:
            pair = table.pairs[k]
            found = self.recogniser.matches(pair, poses, limits, rows)
            a, fa, b, fb = pair
            first, second = self.recogniser.view(a, fa, poses[a]), self.recogniser.view(b, fb, poses[b])
            center, radius = _ball(first, second)
            seat = poses[a].actInv(poses[b]).homogeneous
            safe = margin(found, first, second, radius, self.recogniser.limits_of(pair, limits), rows)
            verdict = KeptVerdict(None if found is None else found.kind, center, radius, seat, SAFE * safe)
            self._known[pair, limits, len(rows)] = verdict
            table.set(k, verdict)
        return table.kinds

    def _skip_planes(
        self, table: VerdictTable, stale: Sequence[int], at: Array, limits: Limits, rows: int
    ) -> list[int]:
        """Set the verdict None of pairs of planes too tilted or too distant to face each other; return the other rows.

        Most pairs of planes of two parts are such; a few array operations handle all of them.
        """
        planes = {k: row for k in stale if (row := self._planes_of(table.pairs[k])) is not None}
        if not planes:
            return list(stale)
        places, numbers = list(planes), np.array(list(planes.values()))
        seat, radius, safe = _planes_apart(numbers, at[table.a[places]], at[table.b[places]], limits)
        for j in np.flatnonzero(safe > 0.0).tolist():
            k = places[j]
            verdict = KeptVerdict(None, numbers[j, 17:], float(radius[j]), seat[j], SAFE * float(safe[j]))
            self._known[table.pairs[k], limits, rows] = verdict
            table.set(k, verdict)
            del planes[k]
        return [k for k in stale if k in planes or self._planes_of(table.pairs[k]) is None]

    def _planes_of(self, pair: Pair) -> tuple[float, ...] | None:
        """Normals, origins and bounding balls of two planes of solids, each in its body's frame; None for others."""
        if pair not in self._planes:
            a, fa, b, fb = pair
            first, second = (self.recogniser.view(i, f, pin.SE3.Identity()) for i, f in ((a, fa), (b, fb)))
            p, q, found = first.geometry, second.geometry, None
            if type(p) is type(q) is Plane and first.feature.sense == second.feature.sense == 1:
                (c, r), (d, s) = first.extent.ball, second.extent.ball
                found = (*p.normal, *p.origin, *q.normal, *q.origin, r, s, *c, *d)
            self._planes[pair] = found
        return self._planes[pair]


def _planes_apart(planes: Array, first: Array, second: Array, limits: Limits) -> tuple[Array, Array, Array]:
    """Seats (n, 4, 4), radii (n,) and margins (n,), m, as in `KeptVerdict`, of planes that do not face each other.

    planes: (n, 20), see `Verdicts._planes_of`. first, second: (n, 4, 4) poses of the bodies. The margin is a lower
    bound of the travel of any point until the two can face each other, as in `_against`; 0 if they already may.
    """
    n, p, m, q = planes[:, 0:3], planes[:, 3:6], planes[:, 6:9], planes[:, 9:12]
    r, s, c, d = planes[:, 12], planes[:, 13], planes[:, 14:17], planes[:, 17:20]
    seat = np.zeros_like(first)
    turned = first[:, :3, :3].transpose(0, 2, 1)
    seat[:, :3, :3] = turned @ second[:, :3, :3]
    seat[:, :3, 3] = (turned @ (second[:, :3, 3] - first[:, :3, 3])[:, :, None])[:, :, 0]
    seat[:, 3, 3] = 1.0

    def seen(points: Array) -> Array:
        return (seat[:, :3, :3] @ points[:, :, None])[:, :, 0]

    radius = np.maximum(s, np.linalg.norm(c - seen(d) - seat[:, :3, 3], axis=1) + r)
    m = seen(m)
    sine = np.linalg.norm(np.cross(n, m), axis=1)
    angle = np.arctan2(sine, -(n * m).sum(axis=1))
    height = ((seen(q) + seat[:, :3, 3] - p) * n).sum(axis=1)
    tilt = np.full(len(planes), np.inf)
    slight = angle < 1.5
    tilt[slight] = 2.0 * radius[slight] * np.tan(angle[slight])
    turn = radius * 2.0 * np.sin(0.5 * np.clip(angle - min(limits.angular, 0.5 * np.pi), 0.0, np.pi))
    return seat, radius, np.maximum(turn, np.abs(height) - tilt - limits.linear)


def _ball(first: FeatureView[Any], second: FeatureView[Any]) -> tuple[Array, float]:
    """Centre (3,) in the frame of the second body, and radius, of a ball that contains both features and their axes."""
    (c, r), (d, s) = first.extent.ball, second.extent.ball
    away = second.pose.actInv(first.pose.act(c)) - d
    return d, max(s, float(np.sqrt(away @ away)) + r)


def margin(
    found: Match | None,
    a: FeatureView[Any],
    b: FeatureView[Any],
    radius: float,
    limits: Limits,
    rows: Sequence[Pairing[Any, Any]],
) -> float:
    """Return the distance, m, that any point of a ball of `radius` about both features may move before the verdict
    `found` may change; 0 without a bound, so that the pair is measured in every step.
    """
    mine = [row for row in rows if row.applies_to(a, b) or row.applies_to(b, a)]
    if not mine:
        return np.inf
    types = type(a.geometry), type(b.geometry)
    if types == (Plane, Plane):
        return _against(found, a, b, radius, limits) if len(mine) == 1 else 0.0
    if types != (Cylinder, Cylinder) or a.feature.sense == b.feature.sense:
        return 0.0
    solid, hollow = (a, b) if a.feature.sense > 0 else (b, a)
    judged = {"concentric": limits}
    if limits.thread is not None:
        judged["screw"] = of_thread(limits, solid.geometry.radius)
    kinds = {row.kind for row in mine} - ({"screw"} - judged.keys())
    if found is None:
        margins = [_concentric(None, solid, hollow, radius, judged[kind]) for kind in kinds if kind in judged]
        return min(margins) if len(margins) == len(kinds) else 0.0
    if found.kind == "concentric" and "screw" in judged:
        return 0.0  # unless it became a screw
    return _concentric(found, solid, hollow, radius, judged.get(found.kind, limits)) if found.kind != "tangent" else 0.0


def _chord(angle: float) -> float:
    """Chord of an arc of radius 1 and an angle (rad, at most π)."""
    return 2.0 * float(np.sin(0.5 * min(max(angle, 0.0), np.pi)))


def _against(found: Match | None, a: FeatureView[Plane], b: FeatureView[Plane], radius: float, limits: Limits) -> float:
    p, q = a.geometry, b.geometry
    most = min(limits.angular, 0.5 * np.pi)
    angle = float(np.arctan2(norm(cross(p.normal, q.normal)), -(p.normal @ q.normal)))
    height = float((q.origin - b.center) @ p.normal) + float((b.center - p.origin) @ p.normal)
    tilt = 2.0 * radius * float(np.tan(angle)) if angle < 1.5 else np.inf
    if found is None:
        beside = abs(height) - tilt - limits.linear
        return max(0.0, radius * _chord(angle - most), beside, _apart(a.triangles, b.triangles, p.normal))
    small = a if a.feature.area <= b.feature.area else b
    width = float(np.sqrt(small.feature.area))
    turn = radius * _chord(min(most - angle, TILT if angle < TILT else 0.0))
    beside = np.inf if np.isinf(limits.linear) else limits.linear - abs(height) - tilt
    sides = small.extent.sides
    length = float(np.sqrt(((sides[:, 1] - sides[:, 0]) ** 2).sum(axis=1)).sum())
    # moved by d, the overlap of two regions loses at most what lies within d of the boundary, of length L, of one of
    # them: 2 L d + π d² per corner; a change of the slant by TILT reduces it by 2 %
    spare = 0.97 * found.overlap - min(limits.strip, 0.1 * width) * width
    shared = min(spare / (3.0 * length), length / (np.pi * len(sides))) if length > 0.0 else 0.0
    return max(0.0, min(turn, beside, shared))


def _apart(first: Array, second: Array, normal: Array) -> float:
    """Greatest gap of two sets of triangles along two directions in the plane, m, at least 0."""
    u = perpendicular(normal)
    best = 0.0
    for direction in (u, cross(normal, u)):
        x, y = first @ direction, second @ direction
        best = max(best, float(y.min() - x.max()), float(x.min() - y.max()))
    return best


def _concentric(
    found: Match | None, solid: FeatureView[Cylinder], hollow: FeatureView[Cylinder], radius: float, limits: Limits
) -> float:
    s, h = solid.geometry, hollow.geometry
    fit = h.radius - s.radius
    if not limits.fit(s.radius, fit):
        return np.inf
    angle = line_angle(s.axis, h.axis)
    sign = 1 if s.axis @ h.axis >= 0 else -1
    start = float((s.origin - h.origin) @ h.axis)
    spans = solid.extent.spans, hollow.extent.spans
    overlap = shared_height(start + sign * spans[0][:, ::sign], spans[1])[0]
    pieces = max(len(spans[0]), len(spans[1]))
    if found is None:
        turn, upright = radius * _chord(angle - limits.angular), radius * _chord(0.5 * np.pi - angle)
        return max(0.0, turn, min(upright, (limits.overlap - overlap) / pieces))
    turn = radius * _chord(min(limits.angular - angle, TILT if angle < TILT else 0.0))
    along = (overlap - limits.overlap) / pieces
    jump = 0.0 if pieces == 1 else 2.0 * radius * float(np.tan(min(angle, 1.5)))
    aside = 0.5 * (limits.linear + max(fit, 0.0) - found.residual - jump)
    loose = 0.5 * (abs(found.residual - fit) - limits.slack - jump) if fit > limits.clearance else np.inf
    return max(0.0, min(turn, along, aside, loose))


@kernel
def _beyond(a, b, at, center, radius, seat, margin, out):  # pragma: no cover - compiled
    """Set out (k,): whether a point of the ball about `center` (k, 3) may have moved farther than its margin (k,).

    at (n, 4, 4): poses of bodies. seat (k, 4, 4): of b[k] in the frame of a[k], when the margin was measured.
    """
    for k in range(len(a)):
        i, j = a[k], b[k]
        turned = shifted = 0.0
        for d in range(3):
            moved = 0.0
            for e in range(3):
                now = 0.0
                for f in range(3):
                    now += at[i, f, d] * at[j, f, e]
                off = now - seat[k, d, e]
                turned += off * off
                moved += off * center[k, e]
                moved += at[i, e, d] * (at[j, e, 3] - at[i, e, 3])
            moved -= seat[k, d, 3]
            shifted += moved * moved
        # |R - R'| <= Frobenius norm / √2 for two rotations
        out[k] = not np.sqrt(shifted) + np.sqrt(0.5 * turned) * radius[k] < margin[k]
