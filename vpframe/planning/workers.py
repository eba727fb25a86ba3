"""Worker processes of a plan: they ask questions before the plan does.

A plan with workers asks the same questions in the same order as one without, and finds many answered. Budgets count a
question that was answered ahead as any other. So the same seed gives the same plan whatever the number of workers, and
whether or not they live.
"""

from __future__ import annotations

import os
import pickle
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vpframe.errors import VpframeError
from vpframe.planning import certify
from vpframe.planning.assembly import Assembly, Budget
from vpframe.planning.certify import Clearance
from vpframe.planning.order import Unit, Ways

Task = tuple[str, Unit, tuple[Any, ...]]
"""method of `Asker`, the unit it is about, further arguments"""
_BROKEN = (OSError, EOFError, pickle.UnpicklingError)


class Workers:
    """`jobs` processes that know an assembly; none for one job."""

    def __init__(self, ways: Ways, jobs: int) -> None:
        if jobs < 1:
            raise VpframeError(f"jobs is {jobs}; give a number of processes of at least 1")
        self._ways, self._told = ways, False
        root = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
        self._processes = [
            subprocess.Popen(
                [sys.executable, "-P", "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": path}, start_new_session=True,
            )
            for _ in range(jobs if jobs > 1 else 0)
        ]  # fmt: skip

    def close(self) -> None:
        """End all workers."""
        while self._processes:
            self._end(self._processes[0])

    def ask(self, tasks: Sequence[Task], seconds: float | None = None) -> dict[int, Clearance]:
        """Let the workers do tasks, each unit's by the same one; answers are kept by the assembly.

        Returns the clearances by the place of their task. A worker that dies, or takes longer than `seconds`, is ended,
        and the plan asks for itself.
        """
        try:
            return self._ask(tasks, seconds) if self._processes and tasks else {}
        except BaseException:
            self.close()  # an answer may still be under way
            raise

    def _ask(self, tasks: Sequence[Task], seconds: float | None) -> dict[int, Clearance]:
        assembly, out = self._ways.assembly, dict[int, Clearance]()
        end = None if seconds is None else time.monotonic() + seconds
        if not self._told:
            self._told = True
            assembly.prepare()
            for process in tuple(self._processes):
                self._send(process, (assembly, self._ways.motion, self._ways.clearance))
        shares: dict[int, list[int]] = {}
        for k, (_, unit, _) in enumerate(tasks):
            shares.setdefault(unit[0] % max(1, len(self._processes)), []).append(k)
        busy = [(self._processes[w], share) for w, share in sorted(shares.items()) if w < len(self._processes)]
        sent = [(p, s) for p, s in busy if self._send(p, (self._ways.larger, [tasks[k] for k in s]))]
        for process, share in sent:
            assert process.stdout is not None
            try:
                left = None if end is None else max(0.0, end - time.monotonic())
                if not select.select([process.stdout], [], [], left)[0]:
                    raise EOFError
                ahead, patches, clearances = pickle.load(process.stdout)
            except _BROKEN:
                self._end(process)
                continue
            assembly.answer(ahead, patches)
            out |= {share[k]: clearance for k, clearance in clearances.items()}
        return out

    def _send(self, process: subprocess.Popen[bytes], message: Any) -> bool:
        assert process.stdin is not None
        try:
            pickle.dump(message, process.stdin)
            process.stdin.flush()
        except _BROKEN:
            self._end(process)
            return False
        return True

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        self._processes.remove(process)
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            try:
                assert pipe is not None
                pipe.close()
            except OSError:
                pass  # what was not written yet


class Asker:
    """What a worker does."""

    def __init__(self, assembly: Assembly, motion: str, clearance: float) -> None:
        self.assembly = assembly
        self.ways, self.ignored = Ways(assembly, Budget(1e9), motion, 0.0), clearance

    def do(self, larger: bool, tasks: Sequence[Task]) -> tuple[Any, Any, dict[int, Clearance]]:
        """Do tasks: (answers, patches, clearances by place) that are new."""
        self.ways.larger = larger
        clearances = {}
        for k, (method, unit, arguments) in enumerate(tasks):
            found = getattr(self, method)(unit, *arguments)
            if found is not None:
                clearances[k] = found
        return *self.assembly.new_answers(), clearances

    def free(self, unit: Unit, present: Any) -> None:
        """What `Ways.free` asks."""
        self.ways.free(unit, present)

    def every(self, unit: Unit) -> None:
        """What `Ways.of` asks."""
        self.ways.of(unit)

    def blocked(self, unit: Unit, others: Any, directions: Any) -> None:
        """What the blocking graphs of directions ask."""
        for direction in directions:
            for other in others:
                any(self.ways.blocked(unit, j, direction) for j in other)

    def clearance(self, unit: Unit, standing: Any, knots: Any) -> Clearance:
        """What `Ways.clearance_of` measures."""
        return certify.least_clearance(self.assembly, unit, sorted(standing), knots, self.ignored)


def main() -> None:
    """Read an assembly and tasks from the standard input until it ends; write what is found to the output."""
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    try:
        asker = Asker(*pickle.load(questions))
        while True:
            pickle.dump(asker.do(*pickle.load(questions)), answers)
            answers.flush()
    except (EOFError, BrokenPipeError):
        pass


if __name__ == "__main__":
    main()
