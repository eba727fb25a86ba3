"""One line on a terminal's standard error for whatever takes over two seconds: what is done, and the time that is left.

    with Progress("loading gearbox.step") as progress:
        scene = vp.load(path, progress=progress)        # calls progress(fraction, "meshing shaft")

While kernels are compiled the line says how far that is; their time does not count in the estimate of the work itself.
Nothing is written when standard error is not a terminal, or when the work is done before the delay is over. Whoever
prints while a line may be drawn does so by `say`.
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
"""s before a line appears"""
INTERVAL = 0.1
"""s between two drawings"""
WIPE = "\r\x1b[K"
WINDOW = 10.0
"""s of work that the rate is taken over, and without news after which nothing is claimed"""
FEW = 4
"""pieces of news that the rate is taken over where they come more slowly"""
LEAST = 1.0
"""s of work before anything is claimed"""
CLIMB = 1.25
"""by how much the time left may be more than was claimed; the claim is given up then, until there is a new rate"""

_drawing = threading.RLock()
_drawn: dict[int, TextIO] = {}
_current: list[Progress] = []


def say(text: str) -> None:
    """Print lines on standard output, `plain`; a line of progress on the same terminal makes room for them."""
    with _drawing:
        for stream in list(_drawn.values()):
            _wipe(stream)
        print(plain_lines(text), flush=True)


def warn(text: str) -> None:
    """Print lines on standard error, `plain`, from the beginning of a line of the terminal (that `^C` is echoed to)."""
    with _drawing:
        for stream in list(_drawn.values()):
            _wipe(stream)
        print((WIPE if sys.stderr.isatty() else "") + plain_lines(text), file=sys.stderr, flush=True)


def report(fraction: float | None, text: str = "") -> None:
    """Tell the innermost `Progress` that runs how far its work is; nothing when there is none."""
    if _current:
        _current[-1](fraction, text)


class _Line:
    """A line that is drawn from a thread of its own, and wiped."""

    def __init__(self, stream: TextIO | None, quiet: bool = False) -> None:
        self.stream = stream if stream is not None else sys.stderr
        self.quiet = quiet or not self.stream.isatty()
        self.compilation: Compilation | None = None

    def listen(self) -> None:
        """Hear of what is compiled from now on."""
        if self.compilation is None:
            from collision.numeric.kernel import compilation

            self.compilation = compilation
            if not self.quiet:
                compilation.announced = True  # the line says it

    @property
    def compiling(self) -> bool:
        """Whether a kernel is being compiled, as far as it is known here."""
        return self.compilation is not None and self.compilation.active

    @property
    def compiled(self) -> float:
        """s of compiling so far in this process."""
        return 0.0 if self.compilation is None else self.compilation.seconds

    def count(self) -> str:
        """`compiling kernels, once: 34 so far`."""
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
    """The time that is left, by the rate of the last seconds. What is claimed never climbs: it is given up instead."""

    def __init__(self) -> None:
        self._samples = deque([(0.0, 0.0)])
        """(s of work, fraction), the oldest first: when there was news, and one before the window"""
        self._claim: tuple[float, float] | None = None
        """(s of work, s left)"""

    def seconds(self, worked: float, fraction: float) -> float | None:
        """s left after `worked` seconds at `fraction`; None while that is not known."""
        samples = self._samples
        if fraction < samples[-1][1]:  # other work has begun
            self._begin(worked, fraction)
        elif fraction > samples[-1][1]:
            samples.append((worked, fraction))
        samples = self._samples
        while len(samples) > FEW and samples[1][0] <= worked - WINDOW:
            samples.popleft()
        (since, before), (last, _) = samples[0], samples[-1]
        if worked - since < LEAST or not before < fraction < 1.0:
            return None
        if worked - last > max(WINDOW, 2.0 * (last - since) / (len(samples) - 1)):  # it stands still
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
    """A bar while work runs; call it with the fraction done (0 … 1, None if unknown) and what is being done.

    Parameters
    ----------
    title: what the work is.
    stream: where to draw, standard error by default.
    delay: s before anything is drawn.
    quiet: never draw.
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
        """whether the delay is over"""
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
        """Say how far the work is; cheap, call it as often as there is news."""
        self._fraction = None if fraction is None else min(max(float(fraction), 0.0), 1.0)
        self._text = text

    def over(self, items: Iterable[Item], text: str = "") -> Iterator[Item]:
        """The items, counted."""
        total = len(items) if isinstance(items, Sized) else 0
        for number, item in enumerate(items):
            self(number / total if total else None, text)
            yield item

    def line(self, elapsed: float) -> str:
        """What is drawn `elapsed` seconds after the start."""
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
    """The one whose line a stream shows: the innermost of those whose delay is over."""
    return next((p for p in reversed(_current) if p._due and p._line.stream is stream), None)


class Watch:
    """A line on standard error while one of many short pieces of work takes long, such as a step of a session.

    Use it as a context manager around each piece; a piece costs two assignments. `text()` is asked for when the line is
    drawn: where the work as a whole stands. With `always` it is drawn from `delay` seconds after the first piece on.
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
        """Whether a kernel is being compiled, as far as it is known here."""
        return self._line.compiling

    def close(self) -> None:
        """Stop to look, and wipe the line."""
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
                if not self._always and self._began is None:  # the piece ended meanwhile
                    continue
                if _shown(self._line.stream) is not None:
                    continue
                self._line.draw(text)


def bar(fraction: float | None, elapsed: float, left: float | None = None) -> str:
    """`[######..................]  25 %  15 s left`; the seconds so far where the fraction is not known."""
    if fraction is None:
        return duration(elapsed)
    filled = round(24 * fraction)
    words = "" if left is None else f"  {duration(left)} left"
    return f"[{'#' * filled}{'.' * (24 - filled)}] {100 * fraction:3.0f} %{words}"


TAIL = 24
"""characters at the end of a line that stay when it is too long"""


def fitted(text: str, columns: int) -> str:
    """The text in at most `columns` characters: first without its bar, then shortened before its end."""
    if len(text) > columns:
        text = re.sub(r"\[#*\.*\] +", "", text)
    if len(text) <= columns:
        return text
    end = min(TAIL, columns // 2)
    return text[: max(columns - 1 - end, 0)] + "…" + text[len(text) - end :]


def duration(seconds: float) -> str:
    """`12 s`, `3 min 05 s`, `1 h 20 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
