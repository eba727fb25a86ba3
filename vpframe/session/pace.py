"""Speed of a run, and its status line."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Iterable

from vpframe.app.progress import bar, duration
from vpframe.hands.gripper import Gripper

STEPS = 61
"""number of time stamps over which the speed is averaged"""


class Pace:
    """Average computing time of the latest steps."""

    def __init__(self) -> None:
        self._beats: deque[float] = deque(maxlen=STEPS)

    def beat(self) -> None:
        """Add a time stamp: a step has ended, or the first one begins."""
        self._beats.append(clock.monotonic())

    @property
    def seconds(self) -> float:
        """Average time of a step, s; 0 before the first step has ended."""
        beats = list(self._beats)  # copied, because another thread may append
        return (beats[-1] - beats[0]) / (len(beats) - 1) if len(beats) > 1 else 0.0


def catching_up(steps: int, left: int, pace: Pace) -> str:
    """Return the status line of a run that replays `left` more steps of an earlier run."""
    fraction, ahead = steps / max(steps + left, 1), pace.seconds * left
    return f"replaying the steps of the earlier run  {bar(fraction, 0.0, ahead or None)}"


def under_way(time: float, dt: float, hands: Iterable[Gripper], pace: Pace, ending: bool) -> str:
    """Return the status line of a run: time, motions, and the remaining computing time of each."""
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
