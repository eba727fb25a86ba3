"""A process of its own that reads a file or runs the CAD kernel, with limits of processor time and resident memory.

The process is isolated: it imports nothing from the folders of file, script or user, and ends with its parent. Results
come back as archives of `vpframe.importers.archive`; messages are lines of JSON (see `_reader`).
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vpframe.importers import limits
from vpframe.importers.limits import ReadingLimits
from vpframe.importers.raw import Progress
from vpframe.processes import kill, sleeps, usage

READER = Path(__file__).with_name("_reader.py")
SAMPLING = 0.02
"""s between two samples of the time and memory of a process that uses more than half its memory"""
SELDOM = 0.1
"""s between two samples of other processes"""
_THRIFTY = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "8"}
"""keeps idle threads on machines with many cores from taking memory"""
_BUSY = 10.0
"""s of the clock that count as one of processor time where the system does not report it (no /proc)"""


class Reading:
    """Last message of the process, and how it ended."""

    def __init__(self, given: ReadingLimits, who: str = "the CAD kernel") -> None:
        self.who = who
        self.text = f"starting {who}"
        self.limits = self._given = given
        self.shape: int | None = None
        self.error: str | None = None
        self.done = self.late = self.memory = False
        self.code = self.peak = self.ready = 0
        self.words = ""
        self.found: dict[str, int] = {}

    def hear(self, message: dict[str, Any], progress: Progress | None, ready: Callable[[int], None]) -> None:
        """Process one message of the process."""
        if "ready" in message:
            self.ready += 1
            ready(message["ready"])
            return
        if "found" in message:
            self.found = message["found"]
            self.limits = self._given.grown(self.found)
            return
        if message.get("memory"):
            self.memory = True
            return
        self.error = message.get("error")
        self.done = message.get("done", False)
        self.shape = message.get("shape")
        if "text" in message:
            self.text = message["text"]
            if progress is not None:
                progress(message["fraction"], message["text"])

    def where_it_ended(self) -> str:
        """Describe what the process was doing, and what it had understood of the file."""
        counts = [f"{self.found[unit]} {unit}" for unit in ("shapes", "faces", "triangles") if unit in self.found]
        made = f", {self.ready} shapes made" if "shapes" in self.found else ""
        return f"while {self.text} (understood until then: {', '.join(counts) or 'nothing'}{made})"

    def how_it_ended(self) -> str:
        """Describe how the process ended: the limit reached, the crash, or its last words."""
        if self.late:
            return f"no answer within {self.limits.seconds:g} s of processor time"
        if self.memory:
            return f"more than {self.limits.memory / 1e9:.1f} GB of memory are needed"
        if self.code < 0:
            return f"{self.who} crashed ({signal.Signals(-self.code).name})"
        last = self.words.strip().splitlines()[-1:]
        return f"{self.who} gave up ({last[0] if last else f'exit code {self.code}'})"


def run(
    request: dict[str, Any],
    folder: str,
    outcome: Reading,
    progress: Progress | None = None,
    ready: Callable[[int], None] = lambda number: None,
    begun: Callable[[subprocess.Popen[str]], None] = lambda process: None,
) -> Reading:
    """Run `READER` with a request until it ends or reaches the limits of `outcome`; return `outcome`.

    folder: temporary folder. ready: receives the number of each finished shape archive. begun: receives the process.
    """
    whole = {**request, "memory": outcome.limits.ceiling, "parent": os.getpid()}
    command = [sys.executable, "-I", str(READER), json.dumps(whole)]
    empty = os.path.join(folder, "empty")
    os.mkdir(empty)
    with open(os.path.join(folder, "words"), "w+", encoding="utf-8", errors="replace") as words:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=words,
            cwd=empty,
            env={**os.environ, **_THRIFTY},
            encoding="utf-8",
        )
        over = threading.Event()
        # a daemon, so that an interrupt at any point cannot keep this process alive
        watch = threading.Thread(target=_watch, args=(process, outcome, over), daemon=True)
        try:
            watch.start()
            begun(process)
            assert process.stdout is not None
            for line in process.stdout:
                before = outcome.limits
                outcome.hear(json.loads(line), progress, ready)
                if outcome.limits != before:
                    _allow(process.pid, outcome.limits)
            if hasattr(os, "waitid"):  # /proc reports the process until it is reaped: the last sample takes all of it
                os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
                over.set()
                watch.join()
            process.wait()
            outcome.code = process.returncode
        finally:
            over.set()
            kill(process)
            process.communicate()
        words.seek(0)
        outcome.words = words.read()
    outcome.done &= not outcome.late
    outcome.memory |= "bad_alloc" in outcome.words
    outcome.memory |= outcome.code < 0 and not outcome.late and outcome.peak > limits.CROWDED * outcome.limits.memory
    return outcome


def _allow(pid: int, given: ReadingLimits) -> None:
    """Raise the ceiling of a running process; on Linux."""
    if sys.platform == "linux":
        import resource

        with contextlib.suppress(OSError, ValueError):  # it has ended
            hard = resource.prlimit(pid, resource.RLIMIT_DATA)[1]
            resource.prlimit(pid, resource.RLIMIT_DATA, (given.ceiling, hard))


def package_folders(beside: Path, packages: Sequence[str]) -> list[str]:
    """Return the folders of packages, for a Python that does not find them by itself; never the folder `beside`."""
    folders = []
    for name in packages:
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            folder = Path(spec.origin).resolve().parent
            folder = folder.parent if spec.submodule_search_locations else folder
            if folder != beside and str(folder) not in folders:
                folders.append(str(folder))
    return folders


def _watch(process: subprocess.Popen[str], outcome: Reading, over: threading.Event) -> None:
    """Kill a process at the limits of `outcome`, in which the peak of its memory is kept.

    The last sample is taken when it is `over`: on a busy machine a process can end before any other.
    """
    began = last = time.monotonic()
    before = slept = 0.0
    ended = False
    while not ended:
        ended = over.is_set()
        now = time.monotonic()
        used_by = usage(process.pid)
        if used_by is None:
            used = (now - began) / _BUSY
        else:
            if used_by.seconds <= before and not ended and sleeps(process.pid):
                slept += min(now - last, SELDOM)  # longer: this process was suspended
            before, used = max(before, used_by.seconds), used_by.seconds + slept
            outcome.peak = max(outcome.peak, used_by.memory)
            outcome.memory |= used_by.memory > outcome.limits.memory
        last = now
        outcome.late = used > outcome.limits.seconds and not outcome.memory
        if outcome.late or outcome.memory:
            kill(process)
            return
        over.wait(SAMPLING if used_by is None or used_by.memory > 0.5 * outcome.limits.memory else SELDOM)
