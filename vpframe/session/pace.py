"""Status line of a run, with the remaining computing time where it is known."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable

from collision.numeric.kernel import compilation
from vpframe.console import Remaining, bar, duration
from vpframe.hands.gripper import Gripper


class Pace:
    """Remaining computing time of each task of a run, by its recent speed; compiling kernels does not count."""

    def __init__(self) -> None:
        self._estimates: dict[str, tuple[object, Remaining, float]] = {}
        """by name: task, estimate, work time at its start (s)"""

    def left(self, name: str, task: object, fraction: float) -> float | None:
        """Return the remaining computing time (s) of a task at `fraction`; None if unknown, as at each new task."""
        worked = clock.monotonic() - compilation.seconds
        known, remaining, began = self._estimates.get(name, (None, Remaining(), worked))
        if known is not task:
            remaining, began = Remaining(fraction), worked
            self._estimates[name] = task, remaining, began
        return remaining.seconds(worked - began, fraction)


def catching_up(steps: int, left: int, pace: Pace) -> str:
    """Return the status line of a run that replays `left` more steps of an earlier run."""
    fraction = steps / max(steps + left, 1)
    return f"replaying the steps of the earlier run  {bar(fraction, 0.0, pace.left('', catching_up, fraction))}"


def under_way(time: float, hands: Iterable[Gripper], pace: Pace, ending: bool) -> str:
    """Return the status line of a run: time, motions, and the remaining computing time of each if it is known."""
    parts = [f"{time:.2f} s of the task"]
    for hand in hands:
        segment = hand.segment
        if segment is not None and segment.path.duration > 0.0:
            done = min(hand.clock / segment.path.duration, 1.0)
            text = f"{hand.doing} {100 * done:.0f} %"
            ahead = pace.left(hand.name, segment, done)
            if ahead is not None:
                text += f", {'at most ' if segment.until is not None else ''}{duration(ahead)} left"
            parts.append(text)
    if ending:
        parts.append("ending after this step (Ctrl-C again: at once)")
    return "  ".join(parts)
