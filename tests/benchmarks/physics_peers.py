"""The physics cases in other people's engines: runs in an interpreter that has them.

`python physics_peers.py ENGINE < request.json > answer.json`; request {"truth", "stack", "runs":
[[run, [dt, …], total], …]}, answer {"version", "rows": [{"row", "method", "dt", "seconds", "steps", "error"}]} or
{"missing": reason}. Every set of settings an engine has for a run is tried at each step, and once more at the step with
which it would take 0.9 `total` seconds, so that errors can be compared at equal processor time. `seconds` is stepping
only. Names of runs go to standard error as they begin.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import physics_drake
import physics_mujoco
from physics_cases import STACK

ENGINES: dict[str, Any] = {"mujoco": physics_mujoco, "drake": physics_drake}


def _once(engine: Any, run: str, dt: float, option: str) -> Iterator[dict[str, Any]]:
    """The rows of one run; one row that says why where it failed."""
    try:
        seconds, steps, error = engine.run(run, dt, option)
    except Exception as failure:
        yield {"row": run, "method": option, "dt": dt, "failed": (str(failure) or repr(failure)).splitlines()[0][:120]}
        return
    for row, value in (error if isinstance(error, dict) else {run: error}).items():
        value = float(value) if np.isfinite(value) else None
        yield {"row": row, "method": option, "dt": dt, "seconds": seconds, "steps": steps, "error": value}


def all_runs_of(
    engine: Any, run: str, steps: list[float], total: float, options: list[str]
) -> Iterator[dict[str, Any]]:
    for option in options:
        found = []
        for dt in sorted(steps, reverse=True):
            if found and "failed" not in found[0] and found[0]["seconds"] * found[0]["dt"] / dt > 3.0 * total:
                continue  # far beyond the processor time that is compared
            found = list(_once(engine, run, dt, option))
            yield from found
        if not found or "failed" in found[0]:
            continue
        dt = found[0]["dt"] * found[0]["seconds"] / (0.9 * total)
        if dt < max(steps) and all(abs(np.log(dt / known)) > 0.1 for known in steps):
            yield from _once(engine, run, dt, option)


def main(name: str) -> None:
    request = json.load(sys.stdin)
    STACK["time"] = request["stack"]
    module = ENGINES[name]
    try:
        engine = module.Engine(request["truth"])
    except ImportError as error:
        json.dump({"missing": f"not installed: {error}"}, sys.stdout)
        return
    rows = []
    for run, steps, total in request["runs"]:
        print(run, file=sys.stderr, flush=True)
        rows += list(all_runs_of(engine, run, steps, total, list(module.options(run))))
    json.dump({"version": engine.version, "rows": rows}, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1])
