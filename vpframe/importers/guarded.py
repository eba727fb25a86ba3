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
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vpframe.importers import limits
from vpframe.importers.limits import Limits
from vpframe.importers.raw import Progress

READER = Path(__file__).with_name("_reader.py")
SAMPLING = 0.02
"""s between two samples of the time and memory of a process that uses more than half its memory"""
SELDOM = 0.1
"""s between two samples of other processes"""
_THRIFTY = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "8"}
"""keeps idle threads on machines with many cores from taking memory"""
_BUSY = 10.0
"""s of the clock that count as one of processor time where the system does not report it (no /proc)"""


class Outcome:
    """Last message of the process, and how it ended."""

    def __init__(self, given: Limits, who: str = "the CAD kernel") -> None:
        self.who = who
        self.text = f"starting {who}"
        self.limits = self._given = given
        self.shape: int | None = None
        self.error: str | None = None
        self.done = self.late = self.memory = False
        self.code = self.peak = 0
        self.words = ""

    def hear(self, message: dict[str, Any], progress: Progress | None, ready: Callable[[int], None]) -> None:
        """Process one message of the process."""
        if "ready" in message:
            ready(message["ready"])
            return
        if "found" in message:
            self.limits = self._given.grown(message["found"])
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
    outcome: Outcome,
    progress: Progress | None = None,
    ready: Callable[[int], None] = lambda number: None,
    begun: Callable[[subprocess.Popen[str]], None] = lambda process: None,
) -> Outcome:
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
            process.kill()
            process.communicate()
        words.seek(0)
        outcome.words = words.read()
    outcome.done &= not outcome.late
    outcome.memory |= "bad_alloc" in outcome.words
    outcome.memory |= outcome.code < 0 and not outcome.late and outcome.peak > limits.CROWDED * outcome.limits.memory
    return outcome


def _allow(pid: int, given: Limits) -> None:
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


class _Usage(NamedTuple):
    seconds: float
    """of processor time"""
    memory: int
    """resident bytes"""


def _watch(process: subprocess.Popen[str], outcome: Outcome, over: threading.Event) -> None:
    """Kill a process at the limits of `outcome`, in which the peak of its memory is kept.

    The last sample is taken when it is `over`: on a busy machine a process can end before any other.
    """
    began = last = time.monotonic()
    before = slept = 0.0
    ended = False
    while not ended:
        ended = over.is_set()
        now = time.monotonic()
        usage = _usage(process.pid)
        if usage is None:
            used = (now - began) / _BUSY
        else:
            if usage.seconds <= before and not ended and _sleeps(process.pid):
                slept += min(now - last, SELDOM)  # longer: this process was suspended
            before, used = max(before, usage.seconds), usage.seconds + slept
            outcome.peak = max(outcome.peak, usage.memory)
            outcome.memory |= usage.memory > outcome.limits.memory
        last = now
        outcome.late = used > outcome.limits.seconds and not outcome.memory
        if outcome.late or outcome.memory:
            process.kill()
            return
        over.wait(SAMPLING if usage is None or usage.memory > 0.5 * outcome.limits.memory else SELDOM)


def _usage(pid: int) -> _Usage | None:
    """Return what a process and its descendants use; None where the system does not report it."""
    seconds, memory = 0.0, 0
    for member in _family(pid):
        with contextlib.suppress(OSError, IndexError):  # it has ended
            fields = _stat(f"/proc/{member}/stat")
            seconds += sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # its own, and of ended children
            memory += int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    return _Usage(seconds, memory) if os.path.exists("/proc/self/stat") else None


def _sleeps(pid: int) -> bool:
    """Whether no thread of a process and its descendants is running or ready to run."""
    for member in _family(pid):
        with contextlib.suppress(OSError, IndexError):  # it has ended
            for task in os.listdir(f"/proc/{member}/task"):
                if _stat(f"/proc/{member}/task/{task}/stat")[0] not in "SZ":
                    return False
    return True


def _stat(path: str) -> list[str]:
    """Return the fields of a process or thread from its state on (proc_pid_stat(5))."""
    return Path(path).read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()


def _family(pid: int) -> Iterator[int]:
    """Yield a process and its descendants."""
    yield pid
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            for child in Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split():
                yield from _family(int(child))
