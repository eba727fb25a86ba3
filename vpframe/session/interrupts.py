"""Ctrl-C, so that it ends what is under way cleanly: between two steps of a session, at once elsewhere."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Protocol

AGAIN = 0.02
"""s until a Ctrl-C that came where it would be lost is tried again"""


def at_once(signum: int, frame: FrameType | None) -> None:
    """Handler: raise KeyboardInterrupt, a moment later where LLVM calls back, because there it would be swallowed."""
    here = frame
    while here is not None:
        if "llvmlite" in here.f_code.co_filename:
            threading.Timer(AGAIN, os.kill, (os.getpid(), signum)).start()
            return
        here = here.f_back
    raise KeyboardInterrupt


@contextlib.contextmanager
def handled() -> Iterator[None]:
    """Ctrl-C is `at_once` inside, unless somebody else handles or ignores it."""
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
    """Ctrl-C inside is handled at the end."""
    ours = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT) if ours else None
    if before is None:  # not ours to handle
        yield
        return
    came: list[tuple[int, FrameType | None]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came and callable(before):
            before(*came[0])


class Interruptible(Protocol):
    """A run of steps."""

    @property
    def compiling(self) -> bool: ...
    def interrupt(self) -> None: ...


@contextlib.contextmanager
def between_steps(session: Interruptible) -> Iterator[None]:
    """The first Ctrl-C ends the run between two steps, or at once while a kernel is compiled; a second one at once."""
    if threading.current_thread() is not threading.main_thread():  # whoever runs it handles signals
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def stop(signum: int, frame: FrameType | None) -> None:
        session.interrupt()
        signal.signal(signal.SIGINT, at_once)
        if session.compiling:
            at_once(signum, frame)

    signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
