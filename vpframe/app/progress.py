"""The console of the command line: a line on standard error for work that takes over two seconds, with the estimated
remaining time.

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
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from itertools import accumulate
from typing import TYPE_CHECKING, Any, TextIO

from vpframe import console
from vpframe.console import Remaining, bar, duration
from vpframe.text import plain, plain_lines

if TYPE_CHECKING:
    from collision.numeric.kernel import Compilation

DELAY = 2.0
"""time before the line appears, s"""
INTERVAL = 0.1
"""time between two updates, s"""
WIPE = "\r\x1b[K"
TAIL = 24
"""number of characters kept at the end of a shortened line"""


class _Screen:
    """The terminal: a thread draws the line of the innermost of the running lines.

    Meanwhile standard streams pass through `_Guarded`, and drawing waits for `input`.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.unfinished = False
        """whether a line of other text has not ended; nothing is drawn meanwhile"""
        self._lines: list[_Line] = []
        self._drawn: dict[int, TextIO] = {}
        self._waiting = 0
        self._input = builtins.input
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self, line: _Line) -> None:
        """Draw a line from now on."""
        with self.lock:
            self._lines.append(line)
            if self._thread is None:
                self._input, builtins.input = builtins.input, self._read
                self._ended.clear()
                self._thread = threading.Thread(target=self._draw_on, name="vpframe progress", daemon=True)
                self._thread.start()
            for name in ("stdout", "stderr"):
                stream = getattr(sys, name)
                if stream is not None and not isinstance(stream, _Guarded) and stream.isatty():
                    setattr(sys, name, _Guarded(stream))

    def close(self, line: _Line) -> None:
        """Erase a line; after the last one, undo what `open` changed."""
        with self.lock:
            self._lines.remove(line)
            self.wipe(line.stream)
            if self._lines:
                return
            thread, self._thread = self._thread, None
            self._ended.set()
            self.unfinished = False
            if builtins.input == self._read:
                builtins.input = self._input
            sys.stdout, sys.stderr = _bare(sys.stdout), _bare(sys.stderr)
        if thread is not None:
            thread.join()

    def wipe(self, stream: TextIO | None = None) -> None:
        """Erase the line of a stream, by default of all."""
        with self.lock:
            for drawn in list(self._drawn.values()) if stream is None else [stream]:
                if self._drawn.pop(id(drawn), None) is not None:
                    with contextlib.suppress(OSError, ValueError):  # the terminal is gone
                        drawn.write(WIPE)
                        drawn.flush()

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

    def _read(self, prompt: object = "", /) -> str:
        with self.waiting():
            return self._input(prompt)

    def _draw_on(self) -> None:
        ended = self._ended
        while not ended.wait(INTERVAL):
            with self.lock:
                if self._thread is not threading.current_thread():
                    return
                shown: dict[int, tuple[_Line, str]] = {}
                for line in sorted(self._lines, key=lambda line: line.rank):  # the innermost progress is the last
                    if text := line.text(time.monotonic()):
                        shown[id(line.stream)] = line, text
                for line, text in shown.values():
                    self._draw(line, text)

    def _draw(self, line: _Line, text: str) -> None:
        """Put text, shortened to the terminal, in place of the line; nothing more if the terminal is gone."""
        if self.unfinished or self._waiting or line.quiet:
            return
        try:
            line.stream.write(WIPE + fitted(plain(text), width(line.stream) - 1))
            line.stream.flush()
            self._drawn[id(line.stream)] = line.stream
        except (OSError, ValueError):
            line.quiet = True


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


_screen = _Screen()
_current: list[Progress] = []


class Terminal(console.Console):
    """The console of the command line: progress and status lines, and nothing drawn while a person answers."""

    def progress(self, title: str) -> Progress:
        """Return a progress line."""
        return Progress(title)

    def watch(self, text: Callable[[], str]) -> Watch:
        """Return a status line that is shown as long as the whole work takes."""
        return Watch(text)

    def say(self, text: str) -> None:
        """Print lines on standard output, escaped by `plain`, after erasing the progress line."""
        with _screen.lock:
            _screen.wipe()
            super().say(text)

    def warn(self, text: str) -> None:
        """Print lines on standard error, escaped by `plain`, from the start of a terminal line (after an echoed
        `^C`)."""
        with _screen.lock:
            _screen.wipe()
            print((WIPE if sys.stderr.isatty() else "") + plain_lines(text), file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        """Ask a question; no progress line is drawn until the answer is there."""
        with _screen.waiting():
            return super().ask(text)


def report(fraction: float | None, text: str = "") -> None:
    """Report progress to the innermost running `Progress`, if there is one."""
    if _current:
        _current[-1](fraction, text)


class _Line(ABC):
    """A line of the terminal, drawn between `_open` and `_close`."""

    rank = 0
    """the line of the highest rank is drawn, the last opened of equals"""

    def __init__(self, stream: TextIO | None, delay: float, quiet: bool = False) -> None:
        self.stream: TextIO = _bare(stream if stream is not None else sys.stderr)
        self.quiet = quiet or not self.stream.isatty() or os.environ.get("TERM") == "dumb"
        self.delay = delay
        self.compilation: Compilation | None = None
        self._opened = False
        self._before = 0, 0
        """numbers of kernels when the line was opened: on disk, where other processes put some, and compiled here"""

    @abstractmethod
    def text(self, now: float) -> str:
        """Return the text at a time of the monotonic clock, s; empty if nothing is to be drawn."""

    def _open(self) -> None:
        from collision.numeric.kernel import compilation
        from collision.numeric.kernel_cache import kept

        self.compilation = compilation
        if not self.quiet:
            self._before = kept(), compilation.kernels
            compilation.announced = True  # this line shows it
            self._opened = True
            _screen.open(self)

    def _close(self) -> None:
        if self._opened:
            self._opened = False
            _screen.close(self)

    def compiling(self) -> str:
        """Return `compiling kernels, once: 34 so far`; empty while kernels are only loaded, or none is needed."""
        if self.compilation is None or not self.compilation.active:
            return ""
        from collision.numeric.kernel_cache import kept

        made = max(kept() - self._before[0], self.compilation.kernels - self._before[1])
        return f"compiling kernels, once: {made} so far" if made > 0 else ""

    @property
    def compiled(self) -> float:
        """Total compile time of this process, s."""
        return 0.0 if self.compilation is None else self.compilation.seconds


class Progress(_Line):
    """A progress bar; call it with the fraction done (0 … 1, None if unknown) and the present task.

    Parameters
    ----------
    title: name of the work.
    stream: output stream, by default standard error.
    delay: time before the line appears, s.
    quiet: draw nothing.
    """

    rank = 1

    def __init__(self, title: str, stream: TextIO | None = None, delay: float = DELAY, quiet: bool = False) -> None:
        super().__init__(stream, delay, quiet)
        self.title = title
        self._fraction: float | None = None
        self._text = ""
        self._remaining = Remaining()
        self._began = self._compiled = 0.0

    def __enter__(self) -> Progress:
        self._began = time.monotonic()
        _current.append(self)
        self._open()
        self._compiled = self.compiled
        return self

    def __exit__(self, *exc: object) -> None:
        _current.remove(self)
        self._close()

    def __call__(self, fraction: float | None, text: str = "") -> None:
        """Report progress; cheap enough for every update."""
        self._fraction = None if fraction is None else min(max(float(fraction), 0.0), 1.0)
        self._text = text

    def line(self, elapsed: float) -> str:
        """Return the line `elapsed` seconds after the start."""
        if compiling := self.compiling():
            return f"{self.title}  {compiling}"
        fraction, worked = self._fraction, elapsed - (self.compiled - self._compiled)
        left = None if fraction is None else self._remaining.seconds(worked, fraction)
        return f"{self.title}  {bar(fraction, elapsed, left)}" + (f"  {self._text}" if self._text else "")

    def text(self, now: float) -> str:
        elapsed = now - self._began
        line = self.line(elapsed)  # also before the delay, so that the rate is known after it
        return line if elapsed >= self.delay else ""


class Watch(_Line, console.StatusLine):
    """A status line of many short tasks, such as the steps of a session, from `delay` seconds after the first one on.

    Use it as a context manager around each task; its cost is two assignments. `status()` returns the status of the
    whole work when the line is drawn.
    """

    def __init__(self, status: Callable[[], str], stream: TextIO | None = None, delay: float = DELAY) -> None:
        super().__init__(stream, delay)
        self._status = status
        self._first: float | None = None
        self._began: float | None = None

    def __enter__(self) -> Watch:
        self._began = time.monotonic()
        if self._first is None:
            self._first = self._began
            self._open()
        return self

    def __exit__(self, *exc: object) -> None:
        self._began = None

    def close(self) -> None:
        """Erase the line."""
        self._close()

    def text(self, now: float) -> str:
        if self._first is None or now - self._first < self.delay:
            return ""
        spent = now - (self._began or now)
        slow = f"  (this step: {duration(spent)})" if spent > self.delay else ""
        return self.compiling() or self._status() + slow


def fitted(text: str, columns: int) -> str:
    """Shorten text to `columns` columns of a terminal: first the bar is dropped, then the middle is cut."""
    if sum(map(_column, text)) > columns:
        text = re.sub(r"\[#*\.*\] +", "", text)
    if sum(map(_column, text)) <= columns:
        return text
    end = _prefix(text[::-1], min(TAIL, columns // 2))[::-1]
    return _prefix(text, columns - 1 - sum(map(_column, end))) + "…" + end if columns > 0 else ""


def _column(character: str) -> int:
    """Return the number of columns that a terminal takes for a character; those of East Asia take two."""
    if unicodedata.category(character) in ("Mn", "Me"):  # marks on the character before
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def _prefix(text: str, columns: int) -> str:
    """Return the longest beginning of a text that fits."""
    return text[: sum(end <= columns for end in accumulate(map(_column, text)))]


def width(stream: TextIO) -> int:
    """Return the number of columns of the terminal that a stream is; of standard output, or 80, if it tells none."""
    try:
        columns = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    return columns or shutil.get_terminal_size().columns
