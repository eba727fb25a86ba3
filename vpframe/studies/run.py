"""`vpframe study`: sample the variants, run what is missing, keep every result, report."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vpframe import console, warm_up
from vpframe.console import FEW, WINDOW, warn
from vpframe.errors import VpframeError
from vpframe.outputs import STUDY_FILES, OutputFolder
from vpframe.studies import report, variants
from vpframe.studies.child import Done, Work, in_turn
from vpframe.studies.job import Job, Machines, read_job
from vpframe.studies.results import UNANSWERED, Record, Results, record
from vpframe.studies.summary import SOBOL, summary
from vpframe.studies.variants import Variant

REPEAT = 100
"""every 100th variant is run again by another process and compared"""
TIMEOUT = 600.0
"""s"""
RETRIES = 2
SAMPLES = 100


@dataclass(frozen=True)
class Sampling:
    """The choice of a study's variants."""

    samples: int = SAMPLES
    sobol: bool = False
    """whether samples come from Sobol' sequences instead of random numbers"""
    levels: int | None = None
    """number of values of each continuous variable in a grid, which replaces samples"""
    seed: int = 0

    def variants(self, job: Job) -> list[Variant]:
        """Return all variants, by index. Raises VpframeError for none or too many."""
        if self.seed < 0:
            raise VpframeError(f"--seed {self.seed}: give none below 0")
        if self.levels is not None:
            return variants.grid(job.variables, self.levels, self.seed)
        sample = variants.sobol_sample if self.sobol else variants.random_sample
        return sample(job.variables, self.samples, self.seed)

    def document(self) -> dict[str, Any]:
        """Return the choice as `study.json` states it."""
        if self.levels is not None:
            return {"method": "grid", "levels": self.levels, "seed": self.seed}
        method = {"method": SOBOL, "sequences": variants.SEQUENCES} if self.sobol else {"method": "random"}
        return {**method, "samples": self.samples, "seed": self.seed}


def run_study(
    script: str | Path,
    out: str | Path,
    sampling: Sampling,
    machines: Machines,
    timeout: float = TIMEOUT,
    retries: int = RETRIES,
    resume: bool = False,
    force: bool = False,
) -> tuple[dict[str, Any], bool]:
    """Run a study and write its report into the folder `out`; returns its document, and whether Ctrl-C ended it.

    Parameters
    ----------
    timeout: s that one variant may take.
    retries: how often a variant that crashed is run again.
    resume: go on from the results that are in `out`.
    force: write the report also over what vpframe did not write; results are never replaced.

    Raises
    ------
    VpframeError: bad input in one line; what was finished is kept in `out`, and `resume` continues from it.
    """
    if not timeout > 0.0 or retries < 0 or machines.jobs < 1:
        raise VpframeError("--timeout and --jobs must be positive, --retries not negative")
    job = read_job(script, timeout, retries)
    by_key = {job.key(variant): variant for variant in sampling.variants(job)}
    with OutputFolder(out, STUDY_FILES, force, [*job.code, *job.models]) as folder:
        with Results(folder, by_key, timeout, resume) as results:
            if results.unreadable:
                warn(f"{results.path}: {results.unreadable} lines are no results and are passed over")
            interrupted = _interrupted(job, by_key, results, machines)
        records = sorted(results.records.values(), key=lambda one: one["index"])
        repeats = list(results.repeats.values())
        found = summary(job.variables, sampling.document(), records, repeats, len(by_key))
        head = {"generator": "vpframe", "study": job.script.stem, "script": str(script), "interrupted": interrupted}
        document = {**head, **found}
        report.write(folder, job.script, job.variables, document, records)
    return document, interrupted


def _interrupted(job: Job, by_key: dict[str, Variant], results: Results, machines: Machines) -> bool:
    """Run the variants missing in `results`; return whether Ctrl-C ended the run."""
    finished = results.records.items()
    work: Work = deque((variant, "") for key, variant in by_key.items() if key not in results.records)
    work += [(by_key[key], one["worker"]) for key, one in finished if _is_repeated(one) and key not in results.repeats]
    if not work:
        return False
    rate = _Rate(len(by_key), len(finished), sum(one["status"] != "ok" for _, one in finished))
    try:
        with (
            console.progress(f"study {job.script.stem}") as progress,
            contextlib.closing(_done(job, work, machines)) as done,  # type: ignore[type-var]
        ):
            if machines.cluster is None:
                progress(None, "kernels, compiled once a machine")
                warm_up.start("session")
                warm_up.wait()
            progress(None, "the first variants")
            for variant, avoid, outcome in done:
                one = record(job.key(variant), variant, outcome, job.timeout, bool(avoid))
                results.add(one)
                if not avoid:
                    if _is_repeated(one):
                        work.append((variant, one["worker"]))
                    progress(*rate.after(one["status"] != "ok", time.monotonic()))
    except KeyboardInterrupt:
        return True
    return False


def _done(job: Job, work: Work, machines: Machines) -> Done:
    if machines.cluster is None and machines.jobs == 1:
        return in_turn(job, work)
    try:
        from vpframe.studies.cluster import on_machines
    except ModuleNotFoundError as error:
        raise VpframeError(f"{error}: several jobs need Dask (pip install distributed); or give --jobs 1") from None
    return on_machines(job, work, machines)


def _is_repeated(one: Record) -> bool:
    """Whether a variant is run twice: every `REPEAT`th, unless its process was ended from outside."""
    return one["index"] % REPEAT == 0 and one["status"] not in UNANSWERED


class _Rate:
    """Counts finished variants for the progress line."""

    def __init__(self, total: int, finished: int, failed: int) -> None:
        self._total, self._finished, self._failed = total, finished, failed
        self._ends: deque[float] = deque()
        """when the variants of the last seconds ended, and one before them (s)"""

    def after(self, failed: bool, now: float) -> tuple[float, str]:
        """Count one more variant, at time `now` (s); return the finished fraction and the text of the progress line."""
        self._finished += 1
        self._failed += failed
        text = f"{self._finished} of {self._total}, {self._failed} without success"
        ends = self._ends
        ends.append(now)  # the first one only begins the count: kernels were compiled and workers started before it
        while len(ends) > FEW + 1 and ends[1] <= now - WINDOW:
            ends.popleft()
        if len(ends) > FEW:
            text += f", {(len(ends) - 1) / max(now - ends[0], 1e-9):.3g} a second"
        return self._finished / self._total, text
