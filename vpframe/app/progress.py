"""A progress line on standard error for work that takes over two seconds, with the estimated remaining time.

    with Progress("loading gearbox.step") as progress:
        scene = vp.load(path, progress=progress)        # calls progress(fraction, "meshing shaft")

While kernels are compiled the line shows their number; that time does not count in the estimate. Nothing is written if
standard error is not a terminal, or if the work is faster than the delay. Other output during the work must use `say`
or `warn`.
"""

from __future__ import annotations

import re
import shutil
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TYPE_CHECKING, TextIO, TypeVar

from vpframe.text import plain, plain_lines

if TYPE_CHECKING:
    from collision.numeric.kernel import Compilation

Item = TypeVar("Item")

DELAY = 2.0
"""time before the line appears, s"""
INTERVAL = 0.1
"""time between two updates, s"""
WIPE = "\r\x1b[K"
WINDOW = 10.0
"""work time over which the rate is averaged, and without news after which no estimate is shown, s"""
FEW = 4
"""number of updates over which the rate is averaged if they are rarer"""
LEAST = 1.0
"""work time before the first estimate, s"""
CLIMB = 1.25
"""growth of the estimate at which it is dropped until there is a new rate"""

_drawing = threading.RLock()
_drawn: dict[int, TextIO] = {}
_current: list[Progress] = []


def say(text: str) -> None:
    """Print lines on standard output, escaped by `plain`; a progress line on the same terminal is erased first."""
    with _drawing:
        for stream in list(_drawn.values()):
            _wipe(stream)
        print(plain_lines(text), flush=True)


def warn(text: str) -> None:
    """Print lines on standard error, escaped by `plain`, from the start of a terminal line (after an echoed `^C`)."""
    with _drawing:
        for stream in list(_drawn.values()):
            _wipe(stream)
        print((WIPE if sys.stderr.isatty() else "") + plain_lines(text), file=sys.stderr, flush=True)


def report(fraction: float | None, text: str = "") -> None:
    """Report progress to the innermost running `Progress`, if there is one."""
    if _current:
        _current[-1](fraction, text)


class _Line:
    """A terminal line that is drawn from a thread and erased."""

    def __init__(self, stream: TextIO | None, quiet: bool = False) -> None:
        self.stream = stream if stream is not None else sys.stderr
        self.quiet = quiet or not self.stream.isatty()
        self.compilation: Compilation | None = None

    def listen(self) -> None:
        """Observe compilation from now on."""
        if self.compilation is None:
            from collision.numeric.kernel import compilation

            self.compilation = compilation
            if not self.quiet:
                compilation.announced = True  # this line shows it

    @property
    def compiling(self) -> bool:
        """Whether a kernel is being compiled in this process."""
        return self.compilation is not None and self.compilation.active

    @property
    def compiled(self) -> float:
        """Total compile time of this process, s."""
        return 0.0 if self.compilation is None else self.compilation.seconds

    def count(self) -> str:
        """Return `compiling kernels, once: 34 so far`."""
        from collision.numeric.kernel_cache import kept

        compiled = 0 if self.compilation is None else self.compilation.kernels
        return f"compiling kernels, once: {max(kept(), compiled)} so far"

    def draw(self, text: str) -> None:
        columns = shutil.get_terminal_size().columns - 1
        with _drawing:
            self.stream.write(WIPE + fitted(plain(text), columns))
            self.stream.flush()
            _drawn[id(self.stream)] = self.stream

    def wipe(self) -> None:
        with _drawing:
            if id(self.stream) in _drawn:
                _wipe(self.stream)


def _wipe(stream: TextIO) -> None:
    stream.write(WIPE)
    stream.flush()
    del _drawn[id(stream)]


class Remaining:
    """Estimate of the remaining time from the recent rate. It never grows: it is dropped instead."""

    def __init__(self) -> None:
        self._samples = deque([(0.0, 0.0)])
        """(work time (s), fraction), oldest first: updates in the window, and one before it"""
        self._claim: tuple[float, float] | None = None
        """(work time (s), remaining time (s)) of the last estimate"""

    def seconds(self, worked: float, fraction: float) -> float | None:
        """Return the remaining time (s) after `worked` seconds at `fraction`; None if unknown."""
        samples = self._samples
        if fraction < samples[-1][1]:  # a new task has begun
            self._begin(worked, fraction)
        elif fraction > samples[-1][1]:
            samples.append((worked, fraction))
        samples = self._samples
        while len(samples) > FEW and samples[1][0] <= worked - WINDOW:
            samples.popleft()
        (since, before), (last, _) = samples[0], samples[-1]
        if worked - since < LEAST or not before < fraction < 1.0:
            return None
        if worked - last > max(WINDOW, 2.0 * (last - since) / (len(samples) - 1)):  # no progress
            return None
        left = (1.0 - fraction) * (worked - since) / (fraction - before)
        if self._claim is not None:
            claimed = max(self._claim[1] - (worked - self._claim[0]), 0.0)
            if left > CLIMB * claimed + 1.0:
                self._begin(worked, fraction)
                return None
            left = min(left, claimed)
        self._claim = worked, left
        return left

    def _begin(self, worked: float, fraction: float) -> None:
        self._samples = deque([(worked, fraction)])
        self._claim = None


class Progress:
    """A progress bar; call it with the fraction done (0 … 1, None if unknown) and the present task.

    Parameters
    ----------
    title: name of the work.
    stream: output stream, by default standard error.
    delay: time before the line appears, s.
    quiet: draw nothing.
    """

    def __init__(
        self,
        title: str,
        stream: TextIO | None = None,
        delay: float = DELAY,
        quiet: bool = False,
    ) -> None:
        self.title = title
        self._line = _Line(stream, quiet)
        self._delay = delay
        self._fraction: float | None = None
        self._text = ""
        self._remaining = Remaining()
        self._due = False
        """whether the delay has passed"""
        self._began = self._compiled = 0.0
        self._done = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        self._line.listen()
        self._began, self._compiled = time.monotonic(), self._line.compiled
        _current.append(self)
        if not self._line.quiet:
            self._thread = threading.Thread(target=self._draw_on, name="vpframe progress", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        _current.remove(self)
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        self._line.wipe()

    def __call__(self, fraction: float | None, text: str = "") -> None:
        """Report progress; cheap enough for every update."""
        self._fraction = None if fraction is None else min(max(float(fraction), 0.0), 1.0)
        self._text = text

    def over(self, items: Iterable[Item], text: str = "") -> Iterator[Item]:
        """Yield the items and report their count."""
        total = len(items) if isinstance(items, Sized) else 0
        for number, item in enumerate(items):
            self(number / total if total else None, text)
            yield item

    def line(self, elapsed: float) -> str:
        """Return the line `elapsed` seconds after the start."""
        if self._line.compiling:
            return f"{self.title}  {self._line.count()}"
        fraction, worked = self._fraction, elapsed - (self._line.compiled - self._compiled)
        left = None if fraction is None else self._remaining.seconds(worked, fraction)
        return f"{self.title}  {bar(fraction, elapsed, left)}" + (f"  {self._text}" if self._text else "")

    def _draw_on(self) -> None:
        if self._done.wait(self._delay):
            return
        self._due = True
        while True:
            line = self.line(time.monotonic() - self._began)
            with _drawing:
                if self is _shown(self._line.stream):
                    self._line.draw(line)
            if self._done.wait(INTERVAL):
                return


def _shown(stream: TextIO) -> Progress | None:
    """Return the progress shown on a stream: the innermost one whose delay has passed."""
    return next((p for p in reversed(_current) if p._due and p._line.stream is stream), None)


class Watch:
    """A status line while one of many short tasks, such as a step of a session, takes long.

    Use it as a context manager around each task; its cost is two assignments. `text()` returns the status of the whole
    work when the line is drawn. With `always` the line is shown from `delay` seconds after the first task on.
    """

    def __init__(
        self,
        text: Callable[[], str],
        stream: TextIO | None = None,
        delay: float = DELAY,
        always: bool = False,
    ) -> None:
        self.text = text
        self._line = _Line(stream)
        self._delay = delay
        self._always = always
        self._first: float | None = None
        self._began: float | None = None
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()

    def __enter__(self) -> Watch:
        self._began = time.monotonic()
        if self._first is None:
            self._line.listen()
            self._first = self._began
            if not self._line.quiet:
                self._thread = threading.Thread(target=self._look, name="vpframe watch", daemon=True)
                self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._began = None
        if not self._always and _drawn:
            self._line.wipe()

    @property
    def compiling(self) -> bool:
        """Whether a kernel is being compiled in this process."""
        return self._line.compiling

    def close(self) -> None:
        """Stop watching and erase the line."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
        self._line.wipe()

    def _look(self) -> None:
        while not self._closed.wait(min(self._delay, 2.0 * INTERVAL)):
            began, now = self._began, time.monotonic()
            since = self._first if self._always else began
            if since is None or now - since < self._delay:
                continue
            if self._line.compiling:
                text = self._line.count()
            else:
                text = self.text()
                if began is not None and now - began > self._delay:
                    text += f"  (this step: {duration(now - began)})"
            with _drawing:
                if not self._always and self._began is None:  # the task has ended meanwhile
                    continue
                if _shown(self._line.stream) is not None:
                    continue
                self._line.draw(text)


def bar(fraction: float | None, elapsed: float, left: float | None = None) -> str:
    """Return `[######..................]  25 %  15 s left`; the elapsed time if the fraction is unknown."""
    if fraction is None:
        return duration(elapsed)
    filled = round(24 * fraction)
    words = "" if left is None else f"  {duration(left)} left"
    return f"[{'#' * filled}{'.' * (24 - filled)}] {100 * fraction:3.0f} %{words}"


TAIL = 24
"""number of characters kept at the end of a shortened line"""


def fitted(text: str, columns: int) -> str:
    """Shorten text to `columns` characters: first the bar is dropped, then the middle is cut."""
    if len(text) > columns:
        text = re.sub(r"\[#*\.*\] +", "", text)
    if len(text) <= columns:
        return text
    end = min(TAIL, columns // 2)
    return text[: max(columns - 1 - end, 0)] + "…" + text[len(text) - end :]


def duration(seconds: float) -> str:
    """Format seconds: `12 s`, `3 min 05 s`, `1 h 20 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
