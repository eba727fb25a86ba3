"""Make the shapes of a file in forked processes, on all cores. Imports numpy only, because the reading process uses it.

A shape that crashes its process, or uses up its processor time or memory, ends no other: it is made again in a plainer
way, then left out. The kernel may be in a call that does not return, so the system ends the process (SIGPROF).
"""

from __future__ import annotations

import os
import resource
import signal
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any

from vpframe.importers import limits
from vpframe.importers.raw import RawScene, RawShape
from vpframe.processes import end_with

Make = Callable[[int, bool, Callable[[float], None]], RawShape]
"""makes shape `number`; second argument: False for the plainer way; third: receives the fraction done"""

EMPTY = "meshes to nothing"
SHOWN = 3
"""most parts that a note names"""


@dataclass
class _Worker:
    """A forked process, and what it still has to make: pairs of number and plainness."""

    pid: int
    messages: Connection
    left: list[tuple[int, bool]]
    now: tuple[int, bool] | None = None


class _Fraction:
    """Sends the fraction done of a shape."""

    def __init__(self, messages: Connection, number: int) -> None:
        self._messages, self._number = messages, number

    def __call__(self, fraction: float) -> None:
        self._messages.send(("fraction", self._number, fraction))


@dataclass
class Crew:
    """Processes that make shapes."""

    make: Make
    keep: Callable[[int, RawShape], None]
    """writes a finished shape, in the forked process"""
    tell: Callable[[int, float], None]
    """receives the number of a shape and the fraction done of it"""
    ready: Callable[[int], None]
    """receives the number of each shape that was kept"""
    memory: int
    """limit of this process, bytes"""
    lost: dict[int, str] = field(default_factory=dict)
    """why shapes are left out, by number"""

    def run(self, costs: Sequence[float]) -> None:
        """Make the shapes 0 … len(costs)-1; costs: expected effort for each, in faces."""
        self._costs = costs
        count = crew_size(costs)
        shares: list[list[tuple[int, bool]]] = [[] for _ in range(count)]
        loads = [0.0] * count
        for number in sorted(range(len(costs)), key=lambda i: (-costs[i], i)):
            least = loads.index(min(loads))
            shares[least].append((number, True))
            loads[least] += 1.0 + costs[number]
        workers = {worker.messages: worker for worker in map(self._fork, filter(None, shares))}
        while workers:
            for messages in wait(list(workers)):
                worker = workers[messages]  # type: ignore[index]
                try:
                    kind, number, value = worker.messages.recv()
                except EOFError:
                    del workers[worker.messages]
                    self._ended(worker)
                    if worker.left:
                        again = self._fork(worker.left)
                        workers[again.messages] = again
                else:
                    self._hear(worker, kind, number, value)

    def _hear(self, worker: _Worker, kind: str, number: int, value: Any) -> None:
        if kind == "begin":
            worker.now = worker.left.pop(0)
            self.tell(number, 0.0)
        elif kind == "fraction":
            self.tell(number, value)
        elif kind == "fault":
            raise RuntimeError(value)
        else:
            worker.now = None
            if kind == "kept":
                self.ready(number)
            else:
                self.lost[number] = value

    def _ended(self, worker: _Worker) -> None:
        """Have the shape that ended a process made in the plainer way, or leave it out."""
        _, status, usage = os.wait4(worker.pid, 0)
        worker.messages.close()
        if worker.now is None:
            return
        number, mesher = worker.now
        code = os.waitstatus_to_exitcode(status)
        late = code == -signal.SIGPROF
        if not late and 1024 * usage.ru_maxrss > limits.CROWDED * self.memory:
            self.lost[number] = self._too_large(number)
        elif mesher:
            worker.left.insert(0, (number, False))
        else:
            limit = f"is not meshed within {self._limits(number).seconds:g} s of processor time"
            self.lost[number] = limit if late else "crashes the CAD kernel"

    def _too_large(self, number: int) -> str:
        return f"takes more than {self._limits(number).memory / 1e9:.1f} GB to mesh"

    def _limits(self, number: int) -> limits.ReadingLimits:
        return limits.of_shape(self._costs[number], self.memory)

    def _fork(self, work: list[tuple[int, bool]]) -> _Worker:
        messages, own = Pipe(duplex=False)
        parent, pid = os.getpid(), os.fork()
        if pid:
            own.close()
            return _Worker(pid, messages, work)
        try:
            messages.close()
            end_with(parent)
            self._work(own, work)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)

    def _work(self, messages: Connection, work: list[tuple[int, bool]]) -> None:
        """Make all shapes of `work` in the forked process, which then ends."""
        most = resource.getrlimit(resource.RLIMIT_DATA)[1]
        resource.setrlimit(resource.RLIMIT_DATA, (int(limits.SHAPE_MEMORY * self.memory), most))
        for number, mesher in work:
            messages.send(("begin", number, None))
            signal.setitimer(signal.ITIMER_PROF, self._limits(number).seconds)
            try:
                raw = self.make(number, mesher, _Fraction(messages, number))
                if raw.faces:
                    self.keep(number, raw)
                messages.send(("kept", number, None) if raw.faces else ("lost", number, EMPTY))
            except Exception as error:
                if isinstance(error, MemoryError) or "OutOfMemory" in type(error).__name__:
                    messages.send(("lost", number, self._too_large(number)))
                elif type(error).__module__.startswith("OCP"):
                    os._exit(1)
                else:
                    messages.send(("fault", number, f"{type(error).__name__}: {error}"))
                    raise
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
        os._exit(0)


def crew_size(costs: Sequence[float]) -> int:
    """Number of processes for shapes of these costs."""
    return max(1, min(len(os.sched_getaffinity(0)), len(costs)))


def resident() -> int:
    """Bytes of memory in which this process resides: a forked one shares them, and the system counts them again."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def left_out(raw: RawScene, lost: dict[int, str]) -> None:
    """Remove and name the parts of lost shapes; number the others without gaps."""
    for why in dict.fromkeys(lost.values()):
        names = [part.name for part in raw.parts if lost.get(part.shape) == why]
        if len(names) == 1:
            raw.notes.append(f"part {names[0]} is lost: its geometry {why}")
        elif names:
            more = ", …" if len(names) > SHOWN else ""
            raw.notes.append(f"{len(names)} parts ({', '.join(names[:SHOWN])}{more}) are lost: their geometry {why}")
    raw.whole &= all(why == EMPTY for why in lost.values())
    raw.parts = [part for part in raw.parts if part.shape not in lost]
    for part in raw.parts:
        part.shape -= sum(number < part.shape for number in lost)
