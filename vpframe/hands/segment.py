"""What verbs are made of, and how they end: `MotionSegment`, `Outcome`."""

from __future__ import annotations

from dataclasses import dataclass

from vpframe.hands.conditions import Condition
from vpframe.hands.paths import Path


@dataclass(frozen=True)
class Outcome:
    """How a verb ended."""

    done: bool
    """it arrived, or its `until` came true"""
    reason: str
    """one line: "arrived", the condition that came true, or what stood in the way"""
    time: float
    """s, session time at the end"""

    def __bool__(self) -> bool:
        return self.done


@dataclass(frozen=True, eq=False)
class MotionSegment:
    """One stretch of a hand's motion. `path` moves the held part, or the empty hand."""

    text: str
    path: Path
    until: Condition | None = None
    required: bool = True
    """whether the task fails when the path ends before `until` holds (or, without one, away from its end)"""
