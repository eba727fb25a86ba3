"""`Seat`: detects when an inserted part is seated, and on which parts."""

from __future__ import annotations

import numpy as np

from vpframe.errors import TaskError
from vpframe.hands.conditions import Condition
from vpframe.hands.directions import Entry, grip, leaving, resting
from vpframe.hands.gripper import Gripper
from vpframe.hands.segment import Outcome

STILL = 1e-5
"""travel in a step below which a part does not advance, m"""
STEPS = 3
"""number of steps without advance, against an opposing part, that make a seat"""
PRESS = 2e-3
"""travel beyond the end of the shaft so that a collar seats, m"""


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
        self.known = frozenset(c.id for c in resting(hand))
        self.condition = Condition("seated", lambda session, holder: self._seated())

    @property
    def farthest(self) -> float:
        """Travel of the insertion, m."""
        return self.entry.flush + (PRESS if self.entry.collar else 0.0)

    def _advance(self) -> float:
        return float((self.hand.subject.translation - self.begin) @ self.entry.way)

    def _seated(self) -> bool:
        hand, way = self.hand, self.entry.way
        advance = self._advance()
        self.still = self.still + 1 if hand.stopped_by and advance < self.last + STILL else 0
        self.last = advance
        if advance < self.entry.tip:
            return False
        mine = grip(hand)
        facing = [c for c in resting(hand) if c.id not in self.known and leaving(hand, c) @ way < -0.9]
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
