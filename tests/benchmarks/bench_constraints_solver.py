"""Solver and mobility: time against residual, and the same hinges through CadQuery and SolveSpace in the same run.

Peers run in a process of their own, in the interpreter that VPFRAME_PEERS names (this one otherwise); their seconds are
those of the solving call alone, ours of the whole `solve` call from poses to poses, with the arrays of the call before.
All solvers take turns, round by round, so that what else the machine does meets them alike; the least time counts for
each, since on a busy machine a long call is interrupted more often than a short one, and a median would favour ours.
In each turn ours is called several times: the first call, after the others have had the caches, is told apart.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from collision import Tolerance
from constraints.freedom.mobility import mobility
from constraints.solve.solver import solve

HERE = Path(__file__).parent
FAR = "10 % and 30° off"
STARTS = {"1 % and 3° off": (0.01, np.deg2rad(3.0)), FAR: (0.1, np.deg2rad(30.0))}
PLOTTED = {"chain of 100": "1 % and 3° off", "four-bar": FAR}
"""problems drawn as residual against time, and the start they are drawn from"""
PEERS = ("cadquery", "py_slvs", "python-solvespace", "slvs")
CALLS = 6
"""of ours, a turn"""
PATIENCE = 2.0
"""s: a peer slower than this gets no second turn"""
SOLVED = 1e-6
"""m, rad: a peer whose residual is above this did not solve the problem"""


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


problems = _module(HERE.parent / "constraints" / "problems.py")


def median_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median over `repeats` calls after one that compiles and fills caches."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds))


def _hinges(problem: Any, start: list[Any]) -> dict[str, Any]:
    """A problem whose constraints come in hinges (concentric, then planes), as the peers read it."""
    joints = []
    for concentric, planes in zip(problem.constraints[::2], problem.constraints[1::2], strict=True):
        (ca, cb), (pa, pb) = concentric.features, planes.features
        joints.append([*concentric.bodies, pa.origin.tolist(), ca.axis.tolist(), pb.origin.tolist(), cb.axis.tolist()])
    return {"poses": [p.homogeneous.ravel().tolist() for p in start], "joints": joints}


class Peers:
    """The other solvers, in a process of their own that answers line by line; also a context that ends it."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Peers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.communicate()

    def ask(self, solver: str, given: dict[str, Any]) -> dict[str, Any]:
        """{"seconds", "residual", "said"} of one attempt, or {"missing": why}."""
        if self._process is None:
            command = [os.environ.get("VPFRAME_PEERS", sys.executable), str(HERE / "constraint_peers.py")]
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps({"solver": solver, **given}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if line:
            return json.loads(line)
        self._process.wait()
        self._process = None  # the next question gets a new one
        return {"missing": "its process died"}


def compete(peers: Peers, problem: Any, start: list[Any], rounds: int) -> dict[str, dict[str, Any]]:
    """Every solver's least seconds, residual and words on one problem, each round one turn of each."""
    given = _hinges(problem, start)
    found = solve(problem.constraints, start, problem.movable)
    seconds: dict[str, list[float]] = {solver: [] for solver in ("vpframe", *PEERS)}
    first: list[float] = []
    answer: dict[str, dict[str, Any]] = {
        "vpframe": {
            "residual": problem.residual({0: start[0], **found.poses}),
            "said": f"{found.iterations} iterations",
        }
    }
    for turn in range(1 + rounds):  # the first warms caches up
        for call in range(CALLS):
            begin = time.perf_counter()
            solve(problem.constraints, start, problem.movable)
            (first if call == 0 else seconds["vpframe"]).append(time.perf_counter() - begin)
        for solver in PEERS:
            if "missing" in answer.get(solver, {}) or (turn and max(seconds[solver]) > PATIENCE):
                continue
            answer[solver] = peers.ask(solver, given)
            if "seconds" in answer[solver]:
                seconds[solver].append(answer[solver]["seconds"])
    answer["vpframe"]["said"] += f", {1e3 * float(np.median(first[1:])):.2f} ms after a pause"
    for solver, each in seconds.items():
        answer[solver]["seconds"] = min(each[1:] or each) if each else None
    return answer


def run(quick: bool = False) -> dict[str, Any]:
    """All rows of the solver's part; `quick` spares the peers the long chains and repeats less."""
    repeats = 7 if quick else 31
    rows: list[dict[str, Any]] = []
    ratios: dict[str, float] = {}

    def row(case: str, method: str, seconds: float | None, error: float | None, n: int, note: str = "") -> None:
        unit = "m, rad"
        rows.append(
            {"case": case, "method": method, "seconds": seconds, "error": error, "unit": unit, "n": n, "note": note}
        )

    def ours(case: str, problem: Any, start: list[Any], tolerance: Tolerance | None = None) -> float:
        found = solve(problem.constraints, start, problem.movable, tolerance)
        residual = problem.residual({0: start[0], **found.poses})
        seconds = median_seconds(lambda: solve(problem.constraints, start, problem.movable, tolerance), repeats)
        row(case, "vpframe", seconds, residual, len(problem.constraints), f"{found.iterations} iterations")
        return seconds

    shared = {
        "bolted plate of 20": problems.bolted_plate(20),
        "chain of 100": problems.chain(100),
        "four-bar": problems.four_bar(),
    }
    with Peers() as peers:
        for start_name, (linear, angular) in STARTS.items():
            for name, problem in shared.items():
                case = f"{name}, {start_name}"
                start = problem.shaken(linear * problem.size, angular)
                if quick and name.startswith("chain"):  # it takes the peers many seconds
                    ours(case, problem, start)
                    continue
                answers = compete(peers, problem, start, 3 if quick else 15)
                fastest: dict[bool, float] = {}
                for solver, a in answers.items():
                    if "missing" in a:
                        row(case, solver, None, None, 0, a["missing"])
                        continue
                    solved = a["residual"] < SOLVED
                    note = a["said"] if solver == "vpframe" else f"said {a['said']}"
                    row(case, solver, a["seconds"], a["residual"], len(problem.constraints), note)
                    if solver != "vpframe":
                        fastest[solved] = min(fastest.get(solved, np.inf), a["seconds"])
                for solved, words in ((True, "solves it"), (False, "gives up")):
                    if solved in fastest:
                        name_of = f"{case}: fastest peer that {words} / vpframe"
                        ratios[name_of] = fastest[solved] / answers["vpframe"]["seconds"]
    pair = problems.bolted_plate(1)
    ours(f"one bolt in its hole, {FAR}", pair, pair.shaken(0.1 * pair.size, np.deg2rad(30.0)))
    ours("one bolt in its hole, already there", pair, list(pair.poses))
    large = {
        "machine of 251 parts, 1,000 constraints": problems.machine(),
        "chain of 500 parts, 1,000 constraints": problems.chain(500),
        "net of 66 bars, 2,160 constraints in loops": problems.lattice(36, 30),
    }
    for name, problem in large.items():
        ours(f"{name}, warm (1 mm and 0.1° off)", problem, problem.shaken(1e-3, np.deg2rad(0.1)))
    loops = {
        "Bennett's loop": problems.bennett(),
        "slider crank": problems.slider_crank(),
        "parallelogram, flat": problems.parallelogram(0.0),
        "Sarrus' linkage": problems.sarrus(),
    }
    for name, problem in {**loops, **large}.items():
        ours(f"{name}, {FAR}", problem, problem.shaken(0.1 * problem.size, np.deg2rad(30.0)))
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        for name, start_name in PLOTTED.items():
            problem = shared[name]
            linear, angular = STARTS[start_name]
            start = problem.shaken(linear * problem.size, angular)
            ours(f"{name}, {start_name}, asked {tolerance:.0e}", problem, start, Tolerance(solver=tolerance))
    for name, problem in {**shared, **large}.items():
        if quick and len(problem.constraints) > 1000:
            continue
        seconds = median_seconds(lambda p=problem: mobility(p.constraints, p.poses, [0]), 3 if quick else 5)
        row(f"mobility of {name}", "vpframe", seconds, None, len(problem.constraints))
    return {"suite": "constraints/solver", "machine": platform.platform(), "rows": rows, "ratios": ratios}


def table(result: dict[str, Any]) -> str:
    """The rows as text, then the ratios."""
    lines = [f"{'case':<66} {'method':<18} {'ms':>10} {'residual':>10}  note"]
    for r in result["rows"]:
        ms = "-" if r["seconds"] is None else f"{1e3 * r['seconds']:.3f}"
        error = "-" if r["error"] is None else f"{r['error']:.1e}"
        lines.append(f"{r['case']:<66} {r['method']:<18} {ms:>10} {error:>10}  {r.get('note', '')}")
    lines += [f"{name}: {ratio:.3g}" for name, ratio in result["ratios"].items()]
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """solver.svg: residual against time, ours at several tolerances and the peers."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True)
    for axis, (name, start) in zip(axes, PLOTTED.items(), strict=True):
        for method in sorted({r["method"] for r in result["rows"]}):
            wanted = [
                r
                for r in result["rows"]
                if r["method"] == method and r["seconds"] and r["case"].startswith(f"{name}, {start}")
            ]
            wanted.sort(key=lambda r: r["error"], reverse=True)
            if wanted:
                x, y = [1e3 * r["seconds"] for r in wanted], [max(r["error"], 1e-17) for r in wanted]
                axis.loglog(x, y, "o-" if len(wanted) > 1 else "s", label=method)
        axis.set_title(f"{name}, {start}")
        axis.set_xlabel("ms")
        axis.grid(True, which="both", alpha=0.3)
        axis.legend()
    axes[0].set_ylabel("residual, m or rad")
    figure.tight_layout()
    Path(directory).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(directory) / "constraints_solver.svg")
    plt.close(figure)


if __name__ == "__main__":
    print(table(run(quick="--quick" in sys.argv)))
