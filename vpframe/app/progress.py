"""A progress line on standard error for work that takes over two seconds, with the estimated remaining time.

    with Progress("loading gearbox.step") as progress:
        scene = vp.load(path, progress=progress)        # calls progress(fraction, "meshing shaft")

While kernels are compiled the line shows their number; that time does not count in the estimate. Nothing is drawn if
standard error is not a terminal or is a dumb one (`TERM=dumb`), or if the work is faster than the delay. There is one
line at a time, that of the innermost work; other text on the terminal, also a script's `print`, erases it first.
"""

from __future__ import annotations

import builtins
import contextlib
import os
import re
import shutil
import sys
import threading
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from vpframe import console
from vpframe.console import Remaining, bar, duration
from vpframe.text import plain, plain_lines

if TYPE_CHECKING:
    from collision.numeric.kernel import Compilation

Item = TypeVar("Item")

DELAY = 2.0
"""time before the line appears, s"""
INTERVAL = 0.1
"""time between two updates, s"""
WIPE = "\r\x1b[K"


class _Screen:
    """The terminal: what is drawn on it, and whether other text is on the cursor's line."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.unfinished = False
        """whether a line of other text has not ended; nothing is drawn meanwhile"""
        self._drawn: dict[int, TextIO] = {}
        self._users = 0
        self._waiting = 0
        self._input = builtins.input

    def draw(self, stream: TextIO, text: str) -> None:
        """Put text in place of the line; raise OSError or ValueError if the terminal is gone."""
        with self.lock:
            if not self.unfinished and not self._waiting:
                stream.write(WIPE + text)
                stream.flush()
                self._drawn[id(stream)] = stream

    def wipe(self, stream: TextIO | None = None) -> None:
        """Erase the line of a stream, by default of all."""
        with self.lock:
            for drawn in list(self._drawn.values()) if stream is None else [stream]:
                if self._drawn.pop(id(drawn), None) is not None:
                    with contextlib.suppress(OSError, ValueError):  # the terminal is gone
                        drawn.write(WIPE)
                        drawn.flush()

    def has(self, stream: TextIO) -> bool:
        """Whether there is a line on a stream."""
        return id(stream) in self._drawn

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Draw nothing while a person answers, whose Enter ends the line of the question."""
        with self.lock:
            self.wipe()
            self._waiting += 1
        try:
            yield
        finally:
            with self.lock:
                self._waiting -= 1
                self.unfinished = False

    def begin(self) -> None:
        """From now on a line may be drawn: standard streams pass through `_Guarded`, and drawing waits for `input`."""
        with self.lock:
            self._users += 1
            if self._users == 1:
                self._input, builtins.input = builtins.input, _input
            for name in ("stdout", "stderr"):
                stream = getattr(sys, name)
                if stream is not None and not isinstance(stream, _Guarded) and stream.isatty():
                    setattr(sys, name, _Guarded(stream))

    def end(self) -> None:
        """Undo `begin`."""
        with self.lock:
            self._users -= 1
            if self._users == 0:
                self.unfinished = False
                if builtins.input is _input:
                    builtins.input = self._input
                for name in ("stdout", "stderr"):
                    setattr(sys, name, _bare(getattr(sys, name)))


class _Guarded:
    """A text stream on a terminal; the progress line is erased before anything is written to it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with _screen.lock:
            _screen.wipe()
            if text:
                _screen.unfinished = not text.endswith("\n")
            return self._stream.write(text)

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _bare(stream: Any) -> Any:
    return stream._stream if isinstance(stream, _Guarded) else stream


def _input(prompt: object = "", /) -> str:
    with _screen.waiting():
        return _screen._input(prompt)


_screen = _Screen()
_current: list[Progress] = []


def say(text: str) -> None:
    """Print lines on standard output, escaped by `plain`; a progress line on the same terminal is erased first."""
    with _screen.lock:
        _screen.wipe()
        print(plain_lines(text), flush=True)


def warn(text: str) -> None:
    """Print lines on standard error, escaped by `plain`, from the start of a terminal line (after an echoed `^C`)."""
    with _screen.lock:
        _screen.wipe()
        print((WIPE if sys.stderr.isatty() else "") + plain_lines(text), file=sys.stderr, flush=True)


class Terminal(console.Console):
    """The console of the command line: progress and status lines, and nothing drawn while a person answers."""

    def progress(self, title: str) -> Progress:
        """Return a progress line."""
        return Progress(title)

    def watch(self, text: Callable[[], str]) -> Watch:
        """Return a status line that is shown as long as the whole work takes."""
        return Watch(text, always=True)

    def say(self, text: str) -> None:
        """Print lines on standard output after erasing the progress line."""
        say(text)

    def warn(self, text: str) -> None:
        """Print lines on standard error after erasing the progress line."""
        warn(text)

    def ask(self, text: str) -> str:
        """Ask a question; no progress line is drawn until the answer is there."""
        with _screen.waiting():
            return super().ask(text)


def report(fraction: float | None, text: str = "") -> None:
    """Report progress to the innermost running `Progress`, if there is one."""
    if _current:
        _current[-1](fraction, text)


class _Line:
    """A terminal line that is drawn from a thread and erased."""

    def __init__(self, stream: TextIO | None, quiet: bool = False) -> None:
        self.stream: TextIO = _bare(stream if stream is not None else sys.stderr)
        self.quiet = quiet or not self.stream.isatty() or os.environ.get("TERM") == "dumb"
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
        """Draw text, shortened to the terminal; nothing more if the terminal is gone."""
        if not self.quiet:
            try:
                _screen.draw(self.stream, fitted(plain(text), width(self.stream) - 1))
            except (OSError, ValueError):
                self.quiet = True

    def wipe(self) -> None:
        _screen.wipe(self.stream)


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
            _screen.begin()
            self._thread = threading.Thread(target=self._draw_on, name="vpframe progress", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        _current.remove(self)
        self._done.set()
        if self._thread is not None:
            self._thread.join()
            self._line.wipe()
            _screen.end()

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
        while not self._done.wait(INTERVAL):
            elapsed = time.monotonic() - self._began
            line = self.line(elapsed)  # also before the delay, so that the rate is known after it
            if elapsed >= self._delay:
                self._due = True
                with _screen.lock:
                    if self is _shown(self._line.stream):
                        self._line.draw(line)


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
                _screen.begin()
                self._thread = threading.Thread(target=self._look, name="vpframe watch", daemon=True)
                self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._began = None
        if not self._always and _screen.has(self._line.stream):
            self._line.wipe()

    def close(self) -> None:
        """Stop watching and erase the line."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._line.wipe()
            _screen.end()

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
            with _screen.lock:
                if not self._always and self._began is None:  # the task has ended meanwhile
                    continue
                if _shown(self._line.stream) is not None:
                    continue
                self._line.draw(text)


TAIL = 24
"""number of characters kept at the end of a shortened line"""


def fitted(text: str, columns: int) -> str:
    """Shorten text to `columns` columns of a terminal: first the bar is dropped, then the middle is cut."""
    if _columns(text) > columns:
        text = re.sub(r"\[#*\.*\] +", "", text)
    if _columns(text) <= columns:
        return text
    end = _prefix(text[::-1], min(TAIL, columns // 2))[::-1]
    return _prefix(text, columns - 1 - _columns(end)) + "…" + end if columns > 0 else ""


def _columns(text: str) -> int:
    """Return the number of columns that a terminal takes for a text; characters of East Asia take two."""
    return len(text) if text.isascii() else sum(map(_column, text))


def _column(character: str) -> int:
    if unicodedata.category(character) in ("Mn", "Me"):  # marks on the character before
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def _prefix(text: str, columns: int) -> str:
    """Return the longest beginning of a text that fits."""
    taken = 0
    for n, character in enumerate(text):
        taken += _column(character)
        if taken > columns:
            return text[:n]
    return text


def width(stream: TextIO) -> int:
    """Return the number of columns of the terminal that a stream is; of standard output, or 80, if it tells none."""
    try:
        columns = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    return columns or shutil.get_terminal_size().columns
