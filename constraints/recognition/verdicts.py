"""What pairs of features mean to each other, measured anew only when they have moved far enough for it to change.

A verdict is the kind that a pair of features makes, or none. With it comes its margin: the distance that the points of
the one feature may go, seen from the other, before the verdict can change (Lipschitz bounds on gap, angle, offset and
overlap, as in conservative advancement). A pair that slides along its mate is measured once in many steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from constraints.geometry.metric_threads import metric_thread
from constraints.geometry.overlap import shared_height
from constraints.geometry.surfaces import Cylinder, Plane, perpendicular
from constraints.geometry.views import Limits, View
from constraints.recognition.candidate import Match, Pair
from constraints.recognition.pairings import Pairing

Array = NDArray[np.float64]
SAFE = 0.9
"""of a margin, against rounding"""
TILT = 0.1
"""rad: beyond it no bound is known of how long an overlap lasts"""


class Known(NamedTuple):
    """One verdict."""

    kind: str | None
    center: Array
    """(3,) of a ball about both features, in the frame of body b"""
    radius: float
    seat: Array
    """(4, 4) pose of b in a when it was measured"""
    margin: float
    """m: how far any point of the ball may go from there, seen from a, before the verdict may change"""


class Question:
    """The verdicts on some pairs, asked for again and again: as arrays, one row a pair."""

    def __init__(self, pairs: Sequence[Pair], known: Sequence[Known | None]) -> None:
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

    def set(self, k: int, verdict: Known) -> None:
        """Take a verdict in."""
        self.kinds[k] = verdict.kind
        self.center[k], self.radius[k], self.seat[k], self.margin[k] = verdict[1:]

    def stale(self, poses: Sequence[pin.SE3]) -> NDArray[np.int64]:
        """Places of the pairs that have moved beyond their margin, or were never measured."""
        at = np.array([poses[body].homogeneous for body in self.bodies]).reshape(-1, 4, 4)
        out = np.empty(len(self.pairs), np.bool_)
        _beyond(self.a, self.b, at, self.center, self.radius, self.seat, self.margin, out)
        return np.flatnonzero(out)


class Measures(Protocol):
    """What is asked of a `Recogniser`."""

    def matches(
        self, pair: Pair, poses: Sequence[pin.SE3], limits: Limits, rows: tuple[Pairing[Any, Any], ...]
    ) -> Match | None: ...
    def view(self, body: int, feature: int, pose: pin.SE3) -> View[Any]: ...
    def limits_of(self, pair: Pair, limits: Limits) -> Limits: ...


class Verdicts:
    """Keeps the verdicts of one recogniser."""

    def __init__(self, recogniser: Measures) -> None:
        self.recogniser = recogniser
        self._known: dict[tuple[Pair, Limits, int], Known] = {}
        self._questions: dict[str, tuple[Any, Question]] = {}

    def forget(self) -> None:
        """Draw up all questions anew: one may have been interrupted while it was answered."""
        self._questions = {}

    def kinds(
        self, name: str, pairs: Sequence[Pair], poses: Sequence[pin.SE3], limits: Limits,
        rows: tuple[Pairing[Any, Any], ...],
    ) -> list[str | None]:  # fmt: skip
        """The kind that each pair makes at `poses`, None where none; `name` tells apart who asks again and again."""
        key = (pairs, limits, len(rows))
        known = self._questions.get(name)
        if known is None or known[0] != key:
            question = Question(pairs, [self._known.get((pair, limits, len(rows))) for pair in pairs])
            known = self._questions[name] = key, question
        question = known[1]
        if not question.pairs:
            return []
        for k in question.stale(poses).tolist():
            pair = question.pairs[k]
            found = self.recogniser.matches(pair, poses, limits, rows)
            a, fa, b, fb = pair
            first, second = self.recogniser.view(a, fa, poses[a]), self.recogniser.view(b, fb, poses[b])
            center, radius = _ball(first, second)
            seat = poses[a].actInv(poses[b]).homogeneous
            room = margin(found, first, second, radius, self.recogniser.limits_of(pair, limits), rows)
            verdict = Known(None if found is None else found.kind, center, radius, seat, SAFE * room)
            self._known[pair, limits, len(rows)] = verdict
            question.set(k, verdict)
        return question.kinds


def _ball(first: View[Any], second: View[Any]) -> tuple[Array, float]:
    """Centre (3,) in the frame of the second's body and radius of a ball that holds both features and their axes."""
    (c, r), (d, s) = first.extent.ball, second.extent.ball
    away = second.pose.actInv(first.pose.act(c)) - d
    return d, max(s, float(np.sqrt(away @ away)) + r)


def margin(
    found: Match | None, a: View[Any], b: View[Any], radius: float, limits: Limits, rows: Sequence[Pairing[Any, Any]]
) -> float:
    """m: how far any point of a ball of `radius` about both features may go before the verdict `found` may change.

    0 where no bound is known: such a pair is measured at every step.
    """
    mine = [row for row in rows if row.speaks_of(a, b) or row.speaks_of(b, a)]
    if not mine:
        return np.inf
    types = type(a.geometry), type(b.geometry)
    if types == (Plane, Plane):
        return _against(found, a, b, radius, limits) if len(mine) == 1 else 0.0
    if types != (Cylinder, Cylinder) or a.feature.sense == b.feature.sense:
        return 0.0
    solid, hollow = (a, b) if a.feature.sense > 0 else (b, a)
    judged = {"concentric": limits}
    if metric_thread(2.0 * solid.geometry.radius, 2.0 * hollow.geometry.radius) is not None:
        judged["screw"] = replace(limits, clearance=solid.geometry.radius, fit_class="")
    kinds = {row.kind for row in mine} - ({"screw"} - judged.keys())
    if found is None:
        asked = [_concentric(None, solid, hollow, radius, judged[kind]) for kind in kinds if kind in judged]
        return min(asked) if len(asked) == len(kinds) else 0.0
    if found.kind == "concentric" and "screw" in judged:
        return 0.0  # unless it became a screw
    return _concentric(found, solid, hollow, radius, judged.get(found.kind, limits)) if found.kind != "tangent" else 0.0


def _chord(angle: float) -> float:
    """How far a turn by an angle (rad, at most π) takes a point at distance 1 from its axis."""
    return 2.0 * float(np.sin(0.5 * min(max(angle, 0.0), np.pi)))


def _against(found: Match | None, a: View[Plane], b: View[Plane], radius: float, limits: Limits) -> float:
    p, q = a.geometry, b.geometry
    most = min(limits.angular, 0.5 * np.pi)
    angle = float(np.arctan2(np.linalg.norm(np.cross(p.normal, q.normal)), -(p.normal @ q.normal)))
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
    # moved by d, what two regions share loses what lies within d of the boundary of one of them, of length L: at most
    # 2 L d + π d² a corner; seen at a slant that differs by TILT it is smaller by 2 %
    spare = 0.97 * found.overlap - min(limits.strip, 0.1 * width) * width
    shared = min(spare / (3.0 * length), length / (np.pi * len(sides))) if length > 0.0 else 0.0
    return max(0.0, min(turn, beside, shared))


def _apart(first: Array, second: Array, normal: Array) -> float:
    """m: how far apart two sets of triangles are along one of two directions in the plane."""
    u = perpendicular(normal)
    best = 0.0
    for direction in (u, np.cross(normal, u)):
        x, y = first @ direction, second @ direction
        best = max(best, float(y.min() - x.max()), float(x.min() - y.max()))
    return best


def _concentric(
    found: Match | None, solid: View[Cylinder], hollow: View[Cylinder], radius: float, limits: Limits
) -> float:
    s, h = solid.geometry, hollow.geometry
    fit = h.radius - s.radius
    if not limits.fit(s.radius, fit):
        return np.inf
    angle = _angle(s.axis, h.axis)
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


def _angle(u: Array, v: Array) -> float:
    """Angle (rad) between two lines."""
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), abs(u @ v)))


@kernel
def _beyond(a, b, at, center, radius, seat, margin, out):  # pragma: no cover - compiled
    """Set out (k,): whether a point of the ball about `center` (k, 3) may have gone farther than its margin (k,).

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
