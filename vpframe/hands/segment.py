"""`MotionSegment` and `Outcome`: the parts and the result of a verb."""

from __future__ import annotations

from dataclasses import dataclass

from vpframe.hands.conditions import Condition
from vpframe.hands.paths import Path


@dataclass(frozen=True)
class Outcome:
    """How a verb ended."""

    done: bool
    """whether it arrived or its `until` held"""
    reason: str
    """one line: "arrived", the condition that held, or the obstacle"""
    time: float
    """session time at the end, s"""

    def __bool__(self) -> bool:
        return self.done


@dataclass(frozen=True, eq=False)
class MotionSegment:
    """One segment of a hand's motion. `path` moves the held part, or the empty hand."""

    text: str
    path: Path
    until: Condition | None = None
    required: bool = True
    """whether the task fails if the path ends before `until` holds (or, without `until`, away from its end)"""
