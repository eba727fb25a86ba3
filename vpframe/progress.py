"""Progress bars on standard error for whatever takes over two seconds, with the time that is left.

    with Progress("loading gearbox.step") as progress:
        scene = vp.load(path, progress=progress)        # calls progress(fraction, "meshing shaft")

Nothing is written when standard error is not a terminal, or when the work is done before the delay is over.
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from typing import TextIO, TypeVar

Item = TypeVar("Item")

DELAY = 2.0
"""s before a bar appears"""
INTERVAL = 0.1
"""s between two drawings"""


class Progress:
    """A bar while work runs; call it with the fraction done (0 … 1, None if unknown) and what is being done.

    Parameters
    ----------
    title: what the work is.
    stream: where to draw, standard error by default.
    delay: s before anything is drawn.
    quiet: never draw.
    """

    def __init__(self, title: str, stream: TextIO | None = None, delay: float = DELAY, quiet: bool = False) -> None:
        self.title = title
        self._stream = stream if stream is not None else sys.stderr
        self._delay = delay
        self._quiet = quiet or not self._stream.isatty()
        self._fraction: float | None = None
        self._text = ""
        self._began = 0.0
        self._drawn = False
        self._done = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Progress:
        self._began = time.monotonic()
        if not self._quiet:
            self._thread = threading.Thread(target=self._draw_on, name="vpframe progress", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        if self._drawn:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

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

    def line(self, elapsed: float, columns: int) -> str:
        """What is drawn `elapsed` seconds after the start, at most `columns` characters."""
        fraction = self._fraction
        if fraction is None:
            shown = f"{self.title}  {duration(elapsed)}"
        else:
            filled = round(24 * fraction)
            left = f"  {duration(elapsed * (1.0 - fraction) / fraction)} left" if 0.02 <= fraction < 1.0 else ""
            shown = f"{self.title}  [{'#' * filled}{'.' * (24 - filled)}] {100 * fraction:3.0f} %{left}"
        if self._text:
            shown += f"  {self._text}"
        return shown if len(shown) <= columns else shown[: max(columns - 1, 0)] + "…"

    def _draw_on(self) -> None:
        if self._done.wait(self._delay):
            return
        while True:
            columns = shutil.get_terminal_size().columns - 1
            self._stream.write("\r\x1b[K" + self.line(time.monotonic() - self._began, columns))
            self._stream.flush()
            self._drawn = True
            if self._done.wait(INTERVAL):
                return


class Watch:
    """A line on standard error while one of many short pieces of work takes long, such as a step that compiles kernels.

    Use it as a context manager around each piece; a piece costs two assignments. `text` is shown with the seconds.
    """

    def __init__(self, text: str, stream: TextIO | None = None, delay: float = DELAY) -> None:
        self.text = text
        self._stream = stream if stream is not None else sys.stderr
        self._delay = delay
        self._began: float | None = None
        self._thread: threading.Thread | None = None
        self._drawing = threading.Lock()
        self._drawn = False
        self._closed = threading.Event()

    def __enter__(self) -> Watch:
        self._began = time.monotonic()
        if self._thread is None and self._stream.isatty():
            self._thread = threading.Thread(target=self._look, name="vpframe watch", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._began = None
        if self._drawn:
            with self._drawing:
                self._stream.write("\r\x1b[K")
                self._stream.flush()
                self._drawn = False

    def close(self) -> None:
        """Stop to look."""
        self._closed.set()

    def _look(self) -> None:
        while not self._closed.wait(min(self._delay, 0.5)):
            with self._drawing:
                began = self._began
                if began is None or time.monotonic() - began < self._delay:
                    continue
                line = f"{self.text}  {duration(time.monotonic() - began)}"
                self._stream.write("\r\x1b[K" + line[: shutil.get_terminal_size().columns - 1])
                self._stream.flush()
                self._drawn = True


def duration(seconds: float) -> str:
    """`12 s`, `3 min 05 s`, `1 h 20 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
