"""How fast a run goes, and where it stands in one line."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Iterable

from vpframe.app.progress import bar, duration
from vpframe.hands.gripper import Gripper

STEPS = 61
"""beats over which the pace is taken"""


class Pace:
    """Seconds of the clock that steps took lately."""

    def __init__(self) -> None:
        self._beats: deque[float] = deque(maxlen=STEPS)

    def beat(self) -> None:
        """A step is over, or the first begins."""
        self._beats.append(clock.monotonic())

    @property
    def seconds(self) -> float:
        """That a step took lately; 0 before the first."""
        beats = list(self._beats)  # another thread may add to them
        return (beats[-1] - beats[0]) / (len(beats) - 1) if len(beats) > 1 else 0.0


def catching_up(steps: int, left: int, pace: Pace) -> str:
    """Where a run stands that goes over `left` more steps of an earlier one."""
    fraction, ahead = steps / max(steps + left, 1), pace.seconds * left
    return f"going over the steps of the earlier run  {bar(fraction, 0.0, ahead or None)}"


def under_way(time: float, dt: float, hands: Iterable[Gripper], pace: Pace, ending: bool) -> str:
    """Where a run stands: time, motions, and how long these will take at the pace so far."""
    parts = [f"{time:.2f} s of the task"]
    for hand in hands:
        segment = hand.segment
        if segment is not None and segment.path.duration > 0.0:
            done = min(hand.clock / segment.path.duration, 1.0)
            ahead = segment.path.duration * (1.0 - done) / dt * pace.seconds
            at_most = "at most " if segment.until is not None else ""
            parts.append(f"{hand.doing} {100 * done:.0f} %, {at_most}{duration(ahead)} left")
    if ending:
        parts.append("ending after this step (Ctrl-C again: at once)")
    return "  ".join(parts)
