"""`Fitter`: inserts a shaft into a bore: the best fit, the way in, and the seat where the motion ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cylinder
from constraints.geometry.views import Limits
from constraints.geometry.words import millimetres
from vpframe.errors import TaskError
from vpframe.hands.conditions import as_condition
from vpframe.hands.gripper import Gripper
from vpframe.hands.reach import points_at
from vpframe.hands.segment import Condition, Outcome, Verb, verb
from vpframe.hands.verbs import Mover
from vpframe.scene.scene import Part

Vector = NDArray[np.float64]

STILL = 1e-5
"""travel in a step below which a part does not advance, m"""
STEPS = 3
"""number of steps without advance, against an opposing part, that make a seat"""
PRESS = 2e-3
"""travel beyond the end of the shaft so that a collar seats, m"""


class Fitter(Mover):
    """A hand that inserts parts."""

    @verb
    def insert(
        self,
        into: str,
        until: Condition | str | None = None,
        speed: float | None = None,
        gap: float = 3e-3,
        required: bool = True,
        depth: float | None = None,
    ) -> Verb:
        """Insert the best fitting shaft of the held parts into its bore in `into`: align in front of it, then slide in.

        depth: travel of the tip past the bore's mouth, m. until: as in `slide`. By default the motion ends when the
        part is seated on any part, or at the largest overlap of shaft and bore.
        """
        parts, targets, verb = self.bodies("insert"), self.others("insert", into), f"insert({into!r})"
        here, names = self.subject, (self.holding(), into)
        gap = self.length(gap, "insert", "gap", least=0.0)
        if depth is not None:
            depth = self.length(depth, "insert", "depth", above=0.0)
        fit = best_fit(parts, targets, self.session.tolerance, names)
        entry = in_front(parts, fit, gap)
        way = entry.way, f"{np.round(entry.way, 3).tolist()}"
        yield from self._move_to(entry.aligned * fit[0].pose.actInv(here))
        if depth is not None or until is not None:
            distance = None if depth is None else entry.tip + depth
            return (yield from self._slide(verb, way, distance, as_condition(until), speed, required))
        seat = Seat(self, entry)
        outcome = yield from self._slide(verb, way, entry.end, seat.condition, speed, False)
        return seat.judged(outcome, required, f"{self.title}.{verb}")


Fit = tuple[Part, Feature, Part, Feature]
"""part and its cylinder, target part and its cylinder: shaft and bore, or ring and pin"""


def best_fit(parts: Sequence[Part], targets: Sequence[Part], tolerance: Tolerance, names: tuple[str, str]) -> Fit:
    """Return the shaft of one of `parts` and the bore of one of `targets` (or vice versa) that fit best.

    Clearances within `Tolerance.clearance` come first, then clearance holes; then the largest shared area, and among
    equal ones (within 1 %) the nearest. names: of the two groups, for the message.
    """
    limits = Limits.offer(tolerance)

    def cylinders(of: Sequence[Part], sense: int) -> list[tuple[Part, Feature]]:
        return [(p, f) for p in of for f in p.features if isinstance(f.geometry, Cylinder) and f.sense == sense]

    pairs = [(*a, *b) for s in (1, -1) for a in cylinders(parts, s) for b in cylinders(targets, -s)]
    loose = [fit for fit in pairs if limits.fit(*_shaft_and_clearance(fit[1], fit[3]))]
    fits = [fit for fit in loose if abs(_radius(fit[1]) - _radius(fit[3])) <= tolerance.clearance] or loose
    if not fits:
        raise TaskError(
            f"nothing of {names[0]} fits into {names[1]}: no shaft and bore with a radial clearance of at most "
            f"{tolerance.clearance * 1e3:g} mm, or {tolerance.clearance_relative:.2g} of the shaft's diameter "
            f"(Tolerance.clearance, clearance_relative){_tightest(pairs, limits)}"
        )
    largest = max(min(s.area, b.area) for _, s, _, b in fits)
    return min((f for f in fits if min(f[1].area, f[3].area) > 0.99 * largest), key=_aside)


def _tightest(pairs: Sequence[Fit], limits: Limits) -> str:
    """Words for the pair of least interference among those that are larger than a press fit; empty without one."""
    tight = [(-clearance, radius) for radius, clearance in (_shaft_and_clearance(p[1], p[3]) for p in pairs)]
    tight = [(interference, radius) for interference, radius in tight if interference > 0.0]
    if not tight:
        return ""
    interference, radius = min(tight)
    most = limits.most_interference(radius - interference)
    return (
        f"; Ø{2e3 * radius:.6g} in Ø{2e3 * (radius - interference):.6g} mm is {millimetres(interference)} too large, a "
        f"press fit {limits.fit_class or limits.press_fit} may be {millimetres(most)} (Tolerance.press_fit)"
    )


def _shaft_and_clearance(s: Feature, b: Feature) -> tuple[float, float]:
    """Radius of the convex cylinder, and the radial clearance in the concave one, m."""
    shaft, bore = (s, b) if s.sense > 0 else (b, s)
    return _radius(shaft), _radius(bore) - _radius(shaft)


def _aside(fit: Fit) -> float:
    """Distance from the middle of the shaft to the axis of the bore, m."""
    part, shaft, target, bore = fit
    assert isinstance(bore.geometry, Cylinder)
    to = target.pose.actInv(part.pose.act(shaft.samples.mean(0))) - bore.geometry.origin
    return float(np.linalg.norm(np.cross(to, bore.geometry.axis)))


@dataclass(frozen=True)
class Entry:
    """Geometry of an insertion into a bore; lengths are m along `way` from `aligned`."""

    way: Vector
    """(3,) unit, world"""
    aligned: pin.SE3
    """pose of the fitting part on the bore's axis, in front of the bore"""
    tip: float
    """travel until the tip of the shaft is at the bore's mouth"""
    flush: float
    """travel of largest overlap: beyond it the shaft leaves the bore again"""
    end: float
    """travel of the insertion: `flush`, and a little more if a collar wider than the bore follows the shaft and must
    seat"""


def in_front(parts: Sequence[Part], fit: Fit, gap: float) -> Entry:
    """Return how `parts`, moving as one, enter the bore of a fit, from `gap` (m) in front of its mouth.

    They enter from the side they are on, and keep their heading as far as the axis allows.
    """
    part, shaft, target, bore = fit
    assert isinstance(shaft.geometry, Cylinder) and isinstance(bore.geometry, Cylinder)
    axis = target.pose.rotation @ bore.geometry.axis
    mouth = target.pose.act(bore.samples.mean(0))
    here = part.pose.act(shaft.samples.mean(0))
    way = axis if (mouth - here) @ axis >= 0.0 else -axis
    own = part.pose.rotation @ shaft.geometry.axis
    if own @ way < 0.0:
        own = -own
    rotation = pin.Quaternion.FromTwoVectors(own, way).toRotationMatrix() @ part.pose.rotation
    on_axis = target.pose.act(np.array(bore.geometry.origin))
    turned = pin.SE3(rotation, on_axis - rotation @ shaft.geometry.origin)
    points = np.concatenate([points_at(p, turned * part.pose.actInv(p.pose)) for p in parts]) - on_axis
    along = points @ way
    hole = (bore.samples @ target.pose.rotation.T + target.pose.translation - on_axis) @ way
    entry = float(hole.min())
    back = entry - gap - float(along.max())
    rod = (shaft.samples @ turned.rotation.T + turned.translation - on_axis) @ way
    off = np.linalg.norm(points - along[:, None] * way, axis=1)
    within = along[off <= 1.01 * _radius(shaft)] if shaft.sense > 0 else rod
    behind = along <= rod.min() + 0.01 * (rod.max() - rod.min())
    collar = along[behind & (off > _radius(bore))] if shaft.sense > 0 else np.empty(0)
    last = float(collar.max() if len(collar) else rod.min())
    flush = max(entry - float(rod.min()), float(hole.max()) - float(rod.max()), entry - last) - back
    return Entry(
        way,
        pin.SE3(rotation, turned.translation + back * way),
        tip=entry - float(within.max()) - back,
        flush=flush,
        end=flush + (PRESS if len(collar) else 0.0),
    )


def _radius(feature: Feature) -> float:
    assert isinstance(feature.geometry, Cylinder)
    return feature.geometry.radius


class Seat:
    """Watches a held part move along an `Entry` from its present pose.

    It is seated when an against constraint opposes the motion, or when it stops against an opposing part. An obstacle
    in front of the bore's mouth is no seat.
    """

    def __init__(self, hand: Gripper, entry: Entry) -> None:
        self.hand, self.entry = hand, entry
        self.begin = np.array(hand.subject.translation)
        self.last = 0.0
        self.still = 0
        self.on: tuple[str, ...] = ()
        self.known = frozenset(c.id for c in hand.againsts())
        self.condition = Condition("seated", lambda session, holder: self._seated())

    def _advance(self) -> float:
        return float((self.hand.subject.translation - self.begin) @ self.entry.way)

    def _seated(self) -> bool:
        hand, way = self.hand, self.entry.way
        advance = self._advance()
        self.still = self.still + 1 if hand.stopped_by and advance < self.last + STILL else 0
        self.last = advance
        if advance < self.entry.tip:
            return False
        mine = hand.parts
        facing = [c for c in hand.againsts() if c.id not in self.known and hand.leaving(c) @ way < -0.9]
        on = [name for c in facing for name in c.parts if name not in mine]
        if not on and self.still >= STEPS:
            contacts = [c for name in mine for c in hand.session.contacts(name) if c.other not in mine]
            on = [c.other for c in contacts if c.normal @ way < -0.5]
        self.on = tuple(dict.fromkeys(on))
        return bool(on)

    def judged(self, outcome: Outcome, required: bool, verb: str) -> Outcome:
        """Return the outcome of the insertion: seated, at the largest overlap, or stopped (TaskError if `required`)."""
        depth = self._advance() - self.entry.tip
        if outcome.done:
            return Outcome(True, f"seated on {', '.join(self.on)}, {depth * 1e3:.2f} mm deep", outcome.time)
        if self._advance() >= self.entry.flush - self.hand.slack:
            return Outcome(True, f"{depth * 1e3:.2f} mm deep, the greatest overlap of shaft and bore", outcome.time)
        if required:
            raise TaskError(f"{verb}: {outcome.reason}")
        return outcome
