"""How far the compiling of kernels is: numba compiles each at its first use, and keeps it for the next run.

What a command will need is known from earlier measurement (`kernels.json`: seconds each kernel took by itself, and
the uses that need it); what of that lies in numba's cache already is left out. Time left is in proportion to what the
kernels compiled so far took here.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config, event

USES = ("load", "clash", "mates", "run", "physics", "report")
TYPICAL = 0.3
"""s, of a kernel that was never measured"""
PACKAGES = ("collision", "constraints", "physics", "vpframe")


class Compiling(event.Listener):
    """Listens to numba: what is being compiled in this process, and how long it has taken in all."""

    def __init__(self, known: dict[str, tuple[float, frozenset[str]]] | None = None) -> None:
        self._known = kernel_times() if known is None else known
        self._open: list[tuple[str, float]] = []
        self._cached: frozenset[str] | None = None
        self._finished: dict[str, None] = {}
        self._spent = 0.0

    @property
    def active(self) -> bool:
        """Whether a kernel is being compiled."""
        return bool(self._open)

    @property
    def spent(self) -> float:
        """s of compiling so far."""
        stack = self._open
        return self._spent + (time.monotonic() - stack[0][1] if stack else 0.0)

    def on_start(self, event: event.Event) -> None:
        """A kernel is begun; kernels that it calls come inside."""
        function = event.data["dispatcher"].py_func
        if self._cached is None:
            self._cached = cached_kernels()
        self._open.append((f"{function.__module__}.{function.__name__}", time.monotonic()))

    def on_end(self, event: event.Event) -> None:
        """It is done, or was given up."""
        name, began = self._open.pop()
        if not self._open:
            self._spent += time.monotonic() - began
        if name.partition(".")[0] in PACKAGES:
            self._finished[name] = None

    def text(self, uses: Iterable[str]) -> str:
        """`compiling kernels, once: 34 of about 81, 12 s left`, for what `uses` (of USES) need."""
        from vpframe.progress import duration

        wanted = set(uses)
        done = list(self._finished)
        open_ = {name for name, _ in list(self._open)}
        left = [
            name
            for name, (_, groups) in self._known.items()
            if groups & wanted and name not in self._finished and name not in open_ and not self._is_cached(name)
        ]
        here = [name for name in open_ if name not in self._finished and name.partition(".")[0] in PACKAGES]
        worked = sum(self._seconds(name) for name in done)
        ahead = sum(self._seconds(name) for name in left) + 0.5 * sum(self._seconds(name) for name in here)
        pace = self.spent / worked if worked >= 1.0 else 1.0
        total = len(done) + len(left) + len(here)
        return f"compiling kernels, once: {len(done)} of about {total}, {duration(max(ahead * pace, 1.0))} left"

    def _is_cached(self, name: str) -> bool:
        return self._cached is not None and ".".join(name.split(".")[-2:]) in self._cached

    def _seconds(self, name: str) -> float:
        return self._known.get(name, (TYPICAL, frozenset()))[0]


@cache
def listening() -> Compiling:
    """The one listener of this process, from the first call on."""
    made = Compiling()
    event.register("numba:compile", made)
    return made


def kernel_times(path: Path | None = None) -> dict[str, tuple[float, frozenset[str]]]:
    """By kernel ("package.module.function"): seconds it took when measured, and which of USES need it."""
    file = path or Path(__file__).with_name("kernels.json")
    rows: dict[str, Any] = json.loads(file.read_text())
    return {name: (float(seconds), frozenset(uses)) for name, (seconds, uses) in rows.items()}


def cached_kernels() -> frozenset[str]:
    """Kernels in numba's cache, as "module.function"; some may be of older code, and are compiled again."""
    here = Path(__file__).resolve().parent.parent
    elsewhere: str = getattr(config, "CACHE_DIR", "")
    folders = [Path(elsewhere)] if elsewhere else [here / package for package in PACKAGES]
    return frozenset(file.name.partition("-")[0] for folder in folders for file in folder.rglob("*.nbi"))
