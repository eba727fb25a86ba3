"""Child processes that run variants: a crash or an endless loop costs one variant and no more."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import select
import signal
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError
from vpframe.processes import ctrl_c_blocked, environment, how_it_ended, kill, start
from vpframe.studies.job import Job
from vpframe.studies.variants import Variant

Work = deque[tuple[Variant, str]]
"""variants to run, each with the child ("host:pid") that must not run it, or "" """
Done = Iterator[tuple[Variant, str, dict[str, Any]]]
"""variant and child to avoid, as in `Work`, and the outcome"""

IDLE = 600.0
"""s without a variant after which a child ends: a killed study cannot end the children of a cluster's workers"""
READING = 600.0
"""s that a child may take to read the script"""
LOOK = 1.0
"""s between two checks that a silent child is alive: processes it has forked may hold its pipe open"""
OUTPUT = 4000
"""characters kept of the output of a child that crashed or was ended"""
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_turn(job: Job, work: Work) -> Done:
    """Run the variants of `work`, and those appended meanwhile, one by one on this machine."""
    children = Children(job.script.resolve(), job.timeout, job.retries)
    try:
        while work:
            variant, avoid = work.popleft()
            yield variant, avoid, children.run(variant, avoid)
    finally:
        children.close()


def unanswered(status: str, reason: str, **more: Any) -> dict[str, Any]:
    """Return the outcome of a variant whose process did not answer."""
    nothing = dict.fromkeys(("clearance", "time", "steps", "seconds", "memory"))
    return {"status": status, "reason": reason, **nothing, "measures": {}, **more}


class Child:
    """One process of `vpframe.studies.runner` that has read the script."""

    def __init__(self, script: Path) -> None:
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `close`)
        fcntl.fcntl(self._output, fcntl.F_SETFL, os.O_APPEND)  # writers continue at the end, also when truncated
        alone = {**environment(), **dict.fromkeys(_THREADS, "1"), "PYTHONHASHSEED": "0"}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._output, "bufsize": 0}
        with ctrl_c_blocked():
            self.process = start("vpframe.studies.runner", str(script), env=alone, **pipes)
        self.name = f"{os.uname().nodename}:{self.process.pid}"
        self._script = script
        self._buffer = b""
        self._ready = False
        self._used = time.monotonic()

    def run(self, variant: Variant, timeout: float) -> dict[str, Any]:
        """Run one variant; returns its outcome, with status "crashed" or "timeout" if the child has ended by it.

        Raises
        ------
        VpframeError: the script cannot be read.
        """
        began, limit = time.monotonic(), READING
        try:
            if not self._ready:
                self._receive("ready", limit)
                self._ready = True
            began, limit = time.monotonic(), timeout
            os.ftruncate(self._output.fileno(), 0)
            request = {"index": variant.index, "seed": variant.seed, "parameters": dict(variant.parameters)}
            with contextlib.suppress(BrokenPipeError):  # the child has ended; `_receive` notices
                assert self.process.stdin is not None
                self.process.stdin.write(json.dumps(request).encode() + b"\n")
            outcome: dict[str, Any] = self._receive("done", limit)
            if outcome["status"] == "error":
                outcome["output"] = self._last_output()
        except EOFError:
            outcome = self._ended("crashed", how_it_ended(self.process.wait()), began)
        except TimeoutError:
            self.process.send_signal(signal.SIGUSR1)  # the child prints its traceback if it can
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(0.2)
            outcome = self._ended("timeout", f"no answer within {limit:g} s", began)
        self._used = time.monotonic()
        return outcome

    @property
    def alive(self) -> bool:
        """Whether the child runs and is not about to end for lack of variants."""
        return self.process.poll() is None and time.monotonic() - self._used < 0.5 * IDLE

    def close(self) -> None:
        """End the process."""
        kill(self.process)
        self.process.communicate()
        self._output.close()

    def _ended(self, status: str, reason: str, began: float) -> dict[str, Any]:
        kill(self.process)
        self.process.wait()
        output = self._last_output().partition("\n\nExtension modules:")[0]
        if not self._ready:
            reason += " while it read the script"
        reason = self._place(output) + reason
        return unanswered(status, reason, seconds=time.monotonic() - began, output=output)

    def _last_output(self) -> str:
        file = self._output.fileno()
        size = os.fstat(file).st_size
        return os.pread(file, OUTPUT, max(size - OUTPUT, 0)).decode(errors="replace")

    def _place(self, output: str) -> str:
        """`task.py:12: `, the innermost line of the script in a traceback of `faulthandler`."""
        lines = re.findall(r'File "([^"\n]*)", line (\d+)', output)
        own = [number for file, number in lines if Path(file).name == self._script.name]
        return f"{self._script.name}:{own[0]}: " if own else ""

    def _receive(self, name: str, timeout: float) -> Any:
        """Return the next message of this name; the clock stands while kernels are compiled."""
        deadline = time.monotonic() + timeout
        compiling: float | None = None
        while True:
            message = self._message(deadline if compiling is None else None)
            if "error" in message:
                raise VpframeError(message["error"])
            if message.get("compiling") is True:
                compiling = time.monotonic()
            elif compiling is not None:
                deadline += time.monotonic() - compiling
                compiling = None
            if name in message:
                return message[name]

    def _message(self, deadline: float | None) -> dict[str, Any]:
        assert self.process.stdout is not None
        out = self.process.stdout.fileno()
        poll = select.poll()
        poll.register(out, select.POLLIN)
        while b"\n" not in self._buffer:
            left = LOOK if deadline is None else min(max(deadline - time.monotonic(), 0.0), LOOK)
            ready = poll.poll(1e3 * left)
            data = os.read(out, 65536) if ready else b""
            if not data and (ready or self.process.poll() is not None):
                raise EOFError  # it has ended
            if not ready and deadline is not None and time.monotonic() >= deadline:
                raise TimeoutError
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        message: dict[str, Any] = json.loads(line)
        return message


class Children:
    """The children of one process: one for each variant that runs at the same time, replaced when they end."""

    def __init__(self, script: Path, timeout: float, retries: int) -> None:
        self._script, self._timeout, self._retries = script, timeout, retries
        self._lock = threading.Lock()
        self._all: set[Child] = set()
        self._idle: list[Child] = []
        self._closed = False

    def run(self, variant: Variant, avoid: str = "") -> dict[str, Any]:
        """Run a variant in a child other than `avoid`, again after a crash; return its outcome.

        Raises
        ------
        VpframeError: the script cannot be read here.
        """
        attempts = 0
        while True:
            attempts += 1
            child = self._take(avoid)
            outcome = child.run(variant, self._timeout)
            self._give_back(child)
            if outcome["status"] != "crashed" or attempts > self._retries or self._closed:
                return outcome | {"attempts": attempts, "worker": child.name}

    def close(self) -> None:
        """End all of them; a variant under way ends as crashed."""
        self._closed = True
        with self._lock:
            everyone, self._all = list(self._all), set()
            self._idle.clear()
        for child in everyone:
            kill(child.process)

    def _take(self, avoid: str) -> Child:
        with self._lock:
            while self._idle:
                child = self._idle.pop()
                if child.alive and child.name != avoid:
                    return child
                self._all.discard(child)
                child.close()
            child = Child(self._script)
            self._all.add(child)
            return child

    def _give_back(self, child: Child) -> None:
        with self._lock:
            if child.alive and not self._closed:
                self._idle.append(child)
            else:
                self._all.discard(child)
                child.close()
