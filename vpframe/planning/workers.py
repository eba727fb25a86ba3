"""Worker processes of a plan: they ask questions before the plan does.

A plan with workers asks the same questions in the same order as one without, and finds many answered. Budgets count a
question that was answered ahead as any other. So the same seed gives the same plan whatever the number of workers, and
whether or not they live.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from vpframe.errors import VpframeError
from vpframe.planning import certify
from vpframe.planning.assembly import Assembly, Budget, BudgetError, working
from vpframe.planning.certify import PathClearance
from vpframe.planning.order import Unit, Ways
from vpframe.processes import kill, start

Task = tuple[str, Unit, tuple[Any, ...]]
"""method of `Asker`, the unit it is about, further arguments"""
_BROKEN = (OSError, EOFError, pickle.UnpicklingError)


class Workers:
    """`jobs` processes that know an assembly; none for one job."""

    def __init__(self, ways: Ways, jobs: int) -> None:
        if jobs < 1:
            raise VpframeError(f"jobs is {jobs}; give a number of processes of at least 1")
        self._ways, self._told = ways, False
        self._processes = [
            start(__name__, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
            for _ in range(jobs if jobs > 1 else 0)
        ]

    def close(self) -> None:
        """End all workers."""
        while self._processes:
            self._end(self._processes[0])

    def ask(self, tasks: Sequence[Task], budget: Budget) -> dict[int, PathClearance]:
        """Let the workers do tasks, each unit's by the same one; answers are kept by the assembly.

        Returns the clearances by the place of their task. The workers end within what is left of the budget and take
        their processor time from it. If one dies, the plan asks for itself.
        """
        try:
            return self._ask(tasks, budget) if self._processes and tasks else {}
        except BaseException:
            self.close()  # an answer may still be under way
            raise

    def _ask(self, tasks: Sequence[Task], budget: Budget) -> dict[int, PathClearance]:
        assembly, out = self._ways.assembly, dict[int, PathClearance]()
        if not self._told:
            self._told = True
            assembly.prepare()
            for process in tuple(self._processes):
                self._send(process, (assembly, self._ways.motion, self._ways.clearance))
        shares: dict[int, list[int]] = {}
        for k, (_, unit, _) in enumerate(tasks):
            shares.setdefault(unit[0] % max(1, len(self._processes)), []).append(k)
        busy = [(self._processes[w], share) for w, share in sorted(shares.items()) if w < len(self._processes)]
        each = budget.left / max(1, len(busy))
        sent = [(p, s) for p, s in busy if self._send(p, (self._ways.larger, each, [tasks[k] for k in s]))]
        for process, share in sent:
            assert process.stdout is not None
            try:
                ahead, patches, clearances, seconds = pickle.load(process.stdout)
            except _BROKEN:
                self._end(process)
                continue
            budget.take(seconds)
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
        kill(process)
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
        self.ways, self.ignored = Ways(assembly, Budget(1e-3), motion, 0.0), clearance

    def do(
        self, larger: bool, seconds: float, tasks: Sequence[Task]
    ) -> tuple[Any, Any, dict[int, PathClearance], float]:
        """Do tasks for so many seconds of processor time; return new answers, new patches, clearances by the place of
        the task, and the seconds taken."""
        began, clearances = working(), {}
        self.ways.larger, self.ways.budget = larger, Budget(max(seconds, 1e-3))
        self.ways.budget.questions = sys.maxsize
        try:
            for k, (method, unit, arguments) in enumerate(tasks):
                self.ways.budget.ask(0)
                found = getattr(self, method)(unit, *arguments)
                if found is not None:
                    clearances[k] = found
        except BudgetError:
            pass  # the plan's own budget ends it soon
        return *self.assembly.new_answers(), clearances, working() - began

    def free(self, unit: Unit, present: Any) -> None:
        """What `Ways.free` asks."""
        self.ways.free(unit, present)

    def every(self, unit: Unit, units: Any, larger: bool) -> None:
        """What `Ways.of` asks."""
        self.ways.of(unit, units, larger)

    def blocked(self, unit: Unit, others: Any, directions: Any) -> None:
        """What the blocking graphs of directions ask."""
        for direction in directions:
            for other in others:
                any(self.ways.blocked(unit, j, direction) for j in other)

    def clearance(self, unit: Unit, static: Any, knots: Any) -> PathClearance:
        """What `Ways.clearance_of` measures."""
        return certify.least_clearance(self.assembly, unit, sorted(static), knots, self.ignored)


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
