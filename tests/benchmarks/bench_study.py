"""What a study costs over a plain loop: child processes, records, Dask.

The task is the first half of `vpframe demo`: the shaft goes into its housing until it sits, from a hand that is off by
a little. The model is a STEP file, read once a process. 5,000 variants take about ten minutes on two free cores.

    vpframe bench study [--quick]           python tests/benchmarks/bench_study.py [VARIANTS]
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # a dependency of distributed

from vpframe.app import demo
from vpframe.app.progress import report
from vpframe.outputs import STUDY_FILES, OutputFolder
from vpframe.studies.child import Done, Work, in_turn
from vpframe.studies.cluster import connected, on_client
from vpframe.studies.job import Job, Machines, read_job
from vpframe.studies.results import ANSWER, Results, record
from vpframe.studies.variants import Variant, random_sample

FULL, QUICK = 5000, 80
BLOCK, PAIRS = 80, 10
"""variants that two jobs run in turn with the plain loop and one job, and variants of them that those run"""
TASKS, QUICK_TASKS = 5000, 300
"""empty tasks that the scheduler's cost is measured with"""
CLUSTERS = (10, 100, 1000)
"""workers of the clusters on paper"""
OVERHEAD, SPEED_UP = 0.10, 1.8
"""goals"""

SCRIPT = """
import numpy as np
import pinocchio as pin
from vpframe.hands import constraint
from vpframe.session.rules import accept_kinds
from vpframe.studies import Normal, load

FILE = "shaft_and_housing.step"
OPTIONS = {"rule": accept_kinds("concentric", "against")}
VARIANTS = {"offset": Normal(0.0, 1e-4), "tilt": Normal(0.0, 0.002), "turn": Normal(0.0, 0.1)}


def scene(v):
    made = load(__file__.replace("insertion.py", FILE))
    made["housing"].fixed = True
    return made


def task(session, v):
    seat = np.array([0.0, 0.0, 0.045])
    hand = session.hand(at=(0.10, 0.0, 0.12))
    hand.grab("shaft")
    hand.move_by((0.0, 0.0, 0.060))
    rotation = pin.exp3(np.array([v["tilt"], 0.0, 0.0])) @ pin.exp3(np.array([0.0, 0.0, v["turn"]]))
    hand.move_to(pin.SE3(rotation, seat + [v["offset"], 0.0, 0.060]), duration=1.5)
    hand.slide("down", until=constraint("concentric", other="housing"))
    hand.slide("down", until=constraint("against", other="housing"))
    session.expect_freedom("shaft", 1)
    session.expect_no_clash()
"""
PLAIN = """
import json, sys, time
from pathlib import Path
from vpframe.studies.runner import Runner
from vpframe.studies.variants import Variant

runner = Runner(Path(sys.argv[1]))
for line in sys.stdin:
    began = time.perf_counter()
    outcome = runner.run(Variant(0, 0, json.loads(line)))
    print(json.dumps({"wall": time.perf_counter() - began, **outcome}), flush=True)
"""


def run(quick: bool = False, variants: int | None = None) -> dict[str, Any]:
    """Rows and ratios of `variants` (5,000; 80 if quick) by two jobs, an eighth of them by one job and a plain loop.

    The three take turns, in blocks of seconds, and ratios are of one block: what else the machine does cancels. Ratios
    of processor time count the study's own process, its workers and their children; other programs do not change them.
    The first block is left out, in which processes start and kernels are read.
    """
    count = variants or (QUICK if quick else FULL)
    tasks = QUICK_TASKS if quick else TASKS
    with tempfile.TemporaryDirectory(prefix="vpframe-bench-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        demo.build(folder / demo.MODEL)
        script = folder / "insertion.py"
        script.write_text(SCRIPT)
        job = read_job(script, 600.0, 2)
        sample = random_sample(job.variables, count + BLOCK, 0)
        client = stack.enter_context(connected(Machines(2), 2, 2))
        plain = stack.enter_context(_plain(script))
        works: tuple[Work, Work] = deque(), deque()
        one = stack.enter_context(_Study(job, in_turn(job, works[0]), works[0], folder / "one"))
        two = stack.enter_context(_Study(job, on_client(job, works[1], client, True), works[1], folder / "two"))
        blocks = []
        for start in range(0, count + BLOCK, BLOCK):
            report(start / (count + BLOCK), f"{start} of {count + BLOCK} variants")
            blocks.append(_block(sample[start : start + BLOCK], plain, one, two))
        memory = [plain(sample[0])["memory"], one.memory(), two.memory()]
        report(1.0, "empty tasks")
        scheduler = _scheduler(client, tasks)
    pairs = np.concatenate([block["pairs"] for block in blocks[1:]])
    bare, alone, waiting = np.median(pairs, axis=0)
    together = np.median([block["together"] for block in blocks[1:]])
    cpu_plain, cpu_one, cpu_two = np.sum([block["cpu"] for block in blocks[1:]], axis=0)
    rows = [
        _row("insertion", "plain loop", bare, len(pairs), memory[0], cpu=cpu_plain / len(pairs)),
        _row("insertion", "study, 1 job", alone, len(pairs), memory[1], cpu=cpu_one / len(pairs), waiting=waiting),
        _row("insertion", "study, 2 jobs", together, count, memory[2], cpu=cpu_two / count),
        _row("empty task", "scheduler", scheduler, tasks, None),
    ]
    rows += [on_paper(workers, bare, scheduler) for workers in CLUSTERS]
    speed_ups = [block["pairs"][:, 1].mean() / block["together"] for block in blocks[1:]]
    return {
        "suite": "study",
        "machine": f"{platform.platform()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        "rows": rows,
        "ratios": {
            "study with 1 job over plain loop, median of pairs": float(np.median(pairs[:, 1] / pairs[:, 0])),
            "the same of processor time": cpu_one / cpu_plain,
            "1 job, waiting over all, median": float(np.median(pairs[:, 2] / pairs[:, 1])),
            "speed-up of 2 jobs, median of blocks": float(np.median(speed_ups)),
            "2 over processor time of 2 jobs and 1": 2.0 * (cpu_one / len(pairs)) / (cpu_two / count),
            "blocks with answers that are equal to the last bit": float(np.mean([block["same"] for block in blocks])),
        },
    }


def _block(
    sample: Sequence[Variant], plain: Callable[[Variant], dict[str, Any]], one: _Study, two: _Study
) -> dict[str, Any]:
    """Run a block: some variants by the plain loop and by one job, in turn, then all by two jobs.

    pairs: (n, 3) seconds by the plain loop, by one job, and of these without the variant itself.
    together: seconds a variant by two jobs.
    cpu: (3,) processor seconds of the plain loop, of one job, of two jobs.
    same: whether all answers are equal to the last bit.
    """
    pairs, cpu, same = [], np.zeros(3), True
    for i, variant in enumerate(sample[:PAIRS]):
        for method in (0, 1) if i % 2 else (1, 0):
            before = _processor_time()
            if method == 0:
                bare = plain(variant)
            else:
                wall = one.run([variant])
            cpu[method] += _processor_time() - before
        outcome = one.outcomes[-1]
        pairs.append((bare["wall"], wall, wall - outcome["seconds"]))
        same = same and _same(bare, outcome)
    before = _processor_time()
    together = two.run(sample) / len(sample)
    cpu[2] = _processor_time() - before
    found = {outcome["index"]: outcome for outcome in two.outcomes[-len(sample) :]}
    same = same and all(_same(each, found[each["index"]]) for each in one.outcomes[-len(pairs) :])
    return {"pairs": np.array(pairs), "together": together, "cpu": cpu, "same": same}


def _processor_time() -> float:
    """s, of this process and of all that it has started."""
    own = psutil.Process()
    times = [process.cpu_times() for process in (own, *own.children(recursive=True))]
    return sum(each.user + each.system for each in times)


class _Study:
    """A study that is given its variants bit by bit."""

    def __init__(self, job: Job, done: Done, work: Work, folder: Path) -> None:
        self._job, self._done, self._work = job, done, work
        self._folder = OutputFolder(folder, STUDY_FILES)
        self._results = Results(self._folder, {}, job.timeout, False)
        self.outcomes: list[dict[str, Any]] = []

    def run(self, sample: Sequence[Variant]) -> float:
        """Seconds until all have run and are recorded."""
        began = time.perf_counter()
        self._work.extend((variant, "") for variant in sample)
        for _ in sample:
            variant, avoid, outcome = next(self._done)
            assert outcome["status"] == "ok", outcome
            self._results.add(record(self._job.key(variant), variant, outcome, self._job.timeout, bool(avoid)))
            self.outcomes.append({"index": variant.index, **outcome})
        return time.perf_counter() - began

    def memory(self) -> float:
        """Most that a child has held, and its Dask worker if it has one, bytes."""
        child = max(self.outcomes, key=lambda outcome: outcome["memory"])
        worker = psutil.Process(int(child["worker"].rpartition(":")[2])).parent()
        own = worker is None or worker.pid == os.getpid()
        return child["memory"] + (0 if own else worker.memory_info().rss)

    def __enter__(self) -> _Study:
        return self

    def __exit__(self, *exc: object) -> None:
        self._done.close()  # type: ignore[attr-defined]
        self._folder.close()


@contextlib.contextmanager
def _plain(script: Path) -> Iterator[Callable[[Variant], dict[str, Any]]]:
    """A process that runs variants in a loop, without a time limit or anybody who would notice its crash."""
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    root = str(Path(demo.__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    process = subprocess.Popen(
        [sys.executable, "-c", PLAIN, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, **threads, "PYTHONPATH": path, "PYTHONHASHSEED": "0"},
    )  # fmt: skip
    assert process.stdin is not None and process.stdout is not None
    stdin, stdout = process.stdin, process.stdout

    def run(variant: Variant) -> dict[str, Any]:
        stdin.write(json.dumps(dict(variant)) + "\n")
        stdin.flush()
        outcome: dict[str, Any] = json.loads(next(line for line in stdout if line.startswith('{"wall"')))
        assert outcome["status"] == "ok", outcome
        return outcome

    try:
        yield run
    finally:
        process.kill()
        process.communicate()


def _row(case: str, method: str, seconds: float, n: int, memory: float | None, **more: float) -> dict[str, Any]:
    return {
        "case": case, "method": method, "seconds": float(seconds), "error": None, "unit": "s a variant", "n": n,
        "memory": memory, **more,
    }  # fmt: skip


def _same(a: dict[str, Any], b: dict[str, Any]) -> bool:
    return all(json.dumps(a[name]) == json.dumps(b[name]) for name in ANSWER)


def _scheduler(client: Any, count: int) -> float:
    """Seconds that an empty task takes: given out one by one, fetched at once, as variants are."""
    from distributed import as_completed

    futures = as_completed([], loop=client.loop, with_results=True)
    given, ahead = 0, 8
    began = time.perf_counter()
    while given < count or not futures.is_empty():
        while given < count and futures.count() < ahead:
            futures.add(client.submit(abs, given, pure=False))
            given += 1
        next(futures)
    return (time.perf_counter() - began) / count


def on_paper(workers: int, seconds: float, scheduler: float) -> dict[str, Any]:
    """Seconds a variant of a cluster: of its workers together, or of its scheduler if that is busier."""
    each = max(seconds / workers, scheduler)
    return _row("insertion, on paper", f"{workers} workers", each, workers, None, efficiency=seconds / workers / each)


def table(result: dict[str, Any]) -> str:
    """The rows as text, and the goals."""
    head = f"{'case':<22}{'method':<16}{'n':>6}{'ms a variant':>14}{'processor':>11}{'waiting':>9}"
    lines = [f"{head}{'MiB':>7}{'efficiency':>12}"]
    for row in result["rows"]:
        cpu = f"{1e3 * row['cpu']:.1f}" if "cpu" in row else ""
        waiting = f"{1e3 * row['waiting']:.2f}" if "waiting" in row else ""
        memory = f"{row['memory'] / 2**20:.0f}" if row["memory"] else ""
        efficiency = f"{row['efficiency']:.2f}" if "efficiency" in row else ""
        names = f"{row['case']:<22}{row['method']:<16}{row['n']:>6}"
        lines.append(f"{names}{1e3 * row['seconds']:>14.2f}{cpu:>11}{waiting:>9}{memory:>7}{efficiency:>12}")
    lines += [f"{name}: {value:.3f}" for name, value in result["ratios"].items()]
    lines.append(f"goals: overhead under {OVERHEAD:.0%}, speed-up at least {SPEED_UP}; {result['machine']}")
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """Efficiency over workers, as a picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = [row for row in result["rows"] if "efficiency" in row]
    figure, axes = plt.subplots(figsize=(5, 3))
    axes.semilogx([row["n"] for row in rows], [row["efficiency"] for row in rows], "o-")
    axes.set(xlabel="workers (on paper)", ylabel="efficiency", ylim=(0.0, 1.05))
    Path(directory).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(directory) / "study.png", bbox_inches="tight", dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    print(table(run(variants=int(sys.argv[1]) if len(sys.argv) > 1 else None)))
