"""Handling of Ctrl-C: it ends a session between two steps, and other work at once."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from _signal import signal as set_handler  # `signal.signal` without enumerations, in a tenth of the time
from collections.abc import Iterator
from types import FrameType
from typing import Protocol

SOON = 0.8
"""time after a Ctrl-C in which the present step may end by itself, s"""
AGAIN = 0.02
"""delay before a Ctrl-C that would be lost is sent again, s"""


def at_once(signum: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt; where an LLVM callback would swallow it, send the signal again a little later."""
    here = frame
    while here is not None:
        if "llvmlite" in here.f_code.co_filename:
            threading.Timer(AGAIN, os.kill, (os.getpid(), signum)).start()
            return
        here = here.f_back
    raise KeyboardInterrupt


@contextlib.contextmanager
def handled() -> Iterator[None]:
    """Install `at_once` for Ctrl-C inside the block, unless another handler is installed or the signal is ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, at_once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def deferred() -> Iterator[None]:
    """Defer a Ctrl-C inside the block to its end."""
    ours = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT) if ours else None
    if before is None:  # another thread, or a handler set outside Python
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    set_handler(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        set_handler(signal.SIGINT, before)
        if came and callable(before):
            before(*came[0])


class Interruptible(Protocol):
    """A run of steps that can be interrupted."""

    @property
    def compiling(self) -> bool: ...
    def interrupt(self) -> None: ...


@contextlib.contextmanager
def between_steps(session: Interruptible) -> Iterator[None]:
    """Let a first Ctrl-C end the run between two steps, or at once during compilation and in a step that does not end
    within `SOON`; a second one ends it at once."""
    if threading.current_thread() is not threading.main_thread():  # signals can be handled in the main thread only
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    late = threading.Timer(SOON, os.kill, (os.getpid(), signal.SIGINT))
    late.daemon = True

    def stop(signum: int, frame: FrameType | None) -> None:
        session.interrupt()
        signal.signal(signal.SIGINT, at_once)
        if session.compiling:
            at_once(signum, frame)
        late.start()

    signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        late.cancel()
        if late.ident is not None:
            late.join()  # a signal that it sends is handled here, not after the block
        signal.signal(signal.SIGINT, before)
