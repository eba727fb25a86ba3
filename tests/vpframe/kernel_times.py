"""Measures `vpframe/kernels.json`: which kernels each use needs, and the seconds that each takes to compile by itself.

python tests/vpframe/kernel_times.py        writes the file anew
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numba.core import event

import vpframe as vp
import vpframe.report
from physics import Elastic, Friction, Gravity
from vpframe import clash, demo, mates
from vpframe.compiling import PACKAGES
from vpframe.session import Session

ROOT = Path(__file__).parents[2]
FILE = ROOT / "vpframe" / "kernels.json"
MEASURED = ("clash", "mates", "run", "physics")
SEAT = np.array([0.0, 0.0, 0.045])


def measured(use: str) -> dict[str, dict[str, float]]:
    """Seconds by kernel, by use, of one use in a process and a numba cache of its own."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, __file__, use], env=environment, cwd=folder, capture_output=True, text=True, check=True
        )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Measure all uses and write the file."""
    uses: dict[str, set[str]] = {}
    seconds: dict[str, float] = {}
    for use in MEASURED:
        for stage, kernels in measured(use).items():
            for name, spent in kernels.items():
                uses.setdefault(name, set()).add(stage)
                seconds[name] = min(spent, seconds.get(name, spent))
    for name in uses:  # a run with forces needs what a run needs
        if "run" in uses[name]:
            uses[name].discard("physics")
    rows = [f"  {json.dumps(name)}: [{seconds[name]:.2f}, {json.dumps(sorted(uses[name]))}]" for name in sorted(uses)]
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


class Stopwatch(event.Listener):
    """Seconds that each of our kernels takes to compile by itself, by the stage of the work."""

    def __init__(self) -> None:
        self.stage = "load"
        self.found: dict[str, dict[str, float]] = {}
        self._open: list[list[float]] = []

    def on_start(self, event: event.Event) -> None:
        self._open.append([time.perf_counter(), 0.0])

    def on_end(self, event: event.Event) -> None:
        began, inner = self._open.pop()
        spent = time.perf_counter() - began
        function = event.data["dispatcher"].py_func
        ours = function.__module__.partition(".")[0] in PACKAGES
        if self._open:
            self._open[-1][1] += spent if ours else inner  # what is not ours counts as its caller's own
        if ours:
            kernels = self.found.setdefault(self.stage, {})
            name = f"{function.__module__}.{function.__name__}"
            kernels[name] = kernels.get(name, 0.0) + spent - inner


def _measure(use: str) -> None:
    watch = Stopwatch()
    event.register("numba:compile", watch)
    model = demo.build(Path("model.step"))
    scene = vp.load(model)
    if use in ("clash", "mates"):
        scene["shaft"].pose = pin.SE3(np.eye(3), np.array([0.001, 0.0, 0.045]) if use == "clash" else SEAT)
        watch.stage = use
        (clash.clash if use == "clash" else mates.mates)(scene)
    else:
        written = vpframe.report.write

        def write(*arguments: Any, **options: Any) -> Path:
            watch.stage = "report"
            return written(*arguments, **options)

        vpframe.report.write = write
        watch.stage = use
        scene["housing"].fixed = True
        with Session(scene, clearance=True) as session:
            if use == "run":
                demo.task(session)
            else:
                session.behave("shaft", Gravity(), Elastic(0.3), Friction(0.3))
                session.run(1.0)
            session.report("report")
    print(json.dumps(watch.found))


if __name__ == "__main__":
    _measure(sys.argv[1]) if len(sys.argv) > 1 else main()
