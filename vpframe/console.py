"""Progress, messages and questions of the library to whoever runs it.

The library draws nothing and reads no terminal: it posts to the `Console` that is installed. The one that stands here
prints warnings on standard error and nothing else; the command line installs one that draws (`vpframe.app.progress`).

    with console.progress("loading gearbox.step") as progress:
        progress(0.25, "meshing shaft")
"""

from __future__ import annotations

import contextlib
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

from vpframe.text import plain, plain_lines

Progress = Callable[[float | None, str], None]
"""receives the fraction done (0 … 1, None if unknown) and the present task"""

WINDOW = 10.0
"""work time over which the rate is averaged, and without news after which no estimate is shown, s"""
FEW = 4
"""number of updates before the first estimate, and over which the rate is averaged if they are rarer"""
LEAST = 2.0
"""work time before the first estimate, s"""
STEADY = 2.0
"""ratio of the rates of the newer and the older half of the updates up to which there is an estimate"""
CLIMB = 1.25
"""growth of the estimate at which it is dropped until there is a new rate"""


class StatusLine:
    """A status line for many short tasks, such as the steps of a session: a context manager around each of them.

    This one draws nothing.
    """

    def __enter__(self) -> StatusLine:
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    def close(self) -> None:
        """End the status line."""


class Console:
    """Prints lines, draws nothing, and answers no question."""

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Return a context manager for work with a title; it yields the callback that receives its progress."""
        return contextlib.nullcontext(_silent)

    def watch(self, text: Callable[[], str]) -> StatusLine:
        """Return the status line of many short tasks; `text()` returns the status of the whole work."""
        return StatusLine()

    def say(self, text: str) -> None:
        """Print lines on standard output, escaped by `plain`."""
        print(plain_lines(text), flush=True)

    def warn(self, text: str) -> None:
        """Print lines on standard error, escaped by `plain`."""
        print(plain_lines(text), file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        """Print a question on standard error, escaped by `plain`, and return the typed line, empty at the end of
        input."""
        answer = ""
        sys.stderr.write(plain(text) + " ")
        sys.stderr.flush()
        try:
            answer = sys.stdin.readline()
        finally:
            if not (answer.endswith("\n") and sys.stdin.isatty()):  # the terminal has shown no line break
                sys.stderr.write("\n")
        return answer.strip()


def _silent(fraction: float | None, text: str = "") -> None:
    pass


_installed = [Console()]


@contextlib.contextmanager
def installed(console: Console) -> Iterator[None]:
    """Post to a console inside a `with` block."""
    _installed.append(console)
    try:
        yield
    finally:
        _installed.remove(console)


def progress(title: str) -> AbstractContextManager[Progress]:
    """`Console.progress` of the installed console."""
    return _installed[-1].progress(title)


def watch(text: Callable[[], str]) -> StatusLine:
    """`Console.watch` of the installed console."""
    return _installed[-1].watch(text)


def say(text: str) -> None:
    """`Console.say` of the installed console."""
    _installed[-1].say(text)


def warn(text: str) -> None:
    """`Console.warn` of the installed console."""
    _installed[-1].warn(text)


def ask(text: str) -> str:
    """`Console.ask` of the installed console."""
    return _installed[-1].ask(text)


class Remaining:
    """Estimate of the remaining time from the recent rate, None while that is unknown: after fewer than `FEW` updates
    or `LEAST` seconds, while the rate changes by more than `STEADY`, and without news. It never grows: it is dropped
    instead, and each time it takes twice as long until there is another."""

    def __init__(self, fraction: float = 0.0) -> None:
        self._samples = deque([(0.0, fraction)])
        """(work time (s), fraction), oldest first: updates in the window, and one before it"""
        self._claim: float | None = None
        """the last estimate, s"""
        self._least = LEAST

    def seconds(self, worked: float, fraction: float) -> float | None:
        """Return the remaining time (s) after `worked` seconds at `fraction`; None if unknown."""
        if fraction < self._samples[-1][1]:  # a new task has begun
            self._begin(worked, fraction, LEAST)
        elif fraction > self._samples[-1][1]:
            self._samples.append((worked, fraction))
        samples = self._samples
        while len(samples) > FEW + 1 and samples[1][0] <= worked - WINDOW:
            samples.popleft()
        updates = len(samples) - 1
        (since, before), (last, _) = samples[0], samples[-1]
        if updates < FEW or worked - since < self._least or fraction >= 1.0:
            return None
        between = (last - since) / updates
        if worked - last > max(WINDOW, 2.0 * between):  # no progress
            return None
        until = max(last, worked - between)  # the next update is not late before
        halfway, half = samples[(updates + 1) // 2]
        older, newer = (half - before) * (until - halfway), (fraction - half) * (halfway - since)  # rates times both
        if not older <= STEADY * newer <= STEADY * STEADY * older:
            return None
        left = max((1.0 - fraction) * (until - since) / (fraction - before) - (worked - until), 0.0)
        if self._claim is not None:
            if left > CLIMB * self._claim + 1.0:
                self._begin(worked, fraction, min(2.0 * self._least, WINDOW))
                return None
            left = min(left, self._claim)
        self._claim = left
        return left

    def _begin(self, worked: float, fraction: float, least: float) -> None:
        self._samples = deque([(worked, fraction)])
        self._claim, self._least = None, least


def bar(fraction: float | None, elapsed: float, left: float | None = None) -> str:
    """Return `[######..................]  25 %  15 s left`; the elapsed time if the fraction is unknown."""
    if fraction is None:
        return duration(elapsed)
    filled = round(24 * fraction)
    words = "" if left is None else f"  {duration(left)} left"
    return f"[{'#' * filled}{'.' * (24 - filled)}] {100 * fraction:3.0f} %{words}"


def duration(seconds: float) -> str:
    """Format seconds: `12 s`, `3 min 05 s`, `1 h 20 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
