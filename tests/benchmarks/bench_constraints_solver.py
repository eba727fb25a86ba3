"""Solver and mobility: time against residual, and the same hinges through CadQuery and SolveSpace in the same run.

Peers run in a process of their own, in the interpreter that VPFRAME_PEERS names (this one otherwise); their seconds are
those of the solving call alone, ours of the whole `solve` call from poses to poses, with the arrays of the call before.
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
from constraints.mobility import mobility
from constraints.solver import solve

HERE = Path(__file__).parent
STARTS = {"1 % and 3° off": (0.01, np.deg2rad(3.0)), "10 % and 30° off": (0.1, np.deg2rad(30.0))}
PLOTTED = {"chain of 100": "1 % and 3° off", "four-bar": "10 % and 30° off"}
"""problems drawn as residual against time, and the start they are drawn from"""
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


def _peers(given: dict[str, Any], repeats: int) -> dict[str, Any]:
    interpreter = os.environ.get("VPFRAME_PEERS", sys.executable)
    command = [interpreter, str(HERE / "constraint_peers.py"), str(repeats)]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, check=True)
    # CadQuery's optimiser prints a banner of its own; the answer is the last line
    return json.loads(done.stdout.strip().splitlines()[-1])


def run(quick: bool = False) -> dict[str, Any]:
    """All rows of the solver's part; `quick` spares the peers the long chain and repeats less."""
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
    given, own = {}, {}
    for start_name, (linear, angular) in STARTS.items():
        for name, problem in shared.items():
            case = f"{name}, {start_name}"
            start = problem.shaken(linear * problem.size, angular)
            own[case] = ours(case, problem, start)
            if not name.startswith("chain") or (linear < 0.05 and not quick):  # it takes the peers many seconds
                given[case] = _hinges(problem, start)
    peers = _peers(given, 1 if quick else 3)
    for case in own:
        fastest: dict[bool, float] = {}
        for solver, answers in peers.items():
            if not isinstance(answers, dict):
                row(case, solver, None, None, 0, str(answers))
            elif case in answers:
                a = answers[case]
                row(case, solver, a["seconds"], a["residual"], len(given[case]["joints"]), f"said {a['said']}")
                solved = a["residual"] < SOLVED
                fastest[solved] = min(fastest.get(solved, np.inf), a["seconds"])
        if True in fastest:
            ratios[f"{case}: fastest peer that solves it / vpframe"] = fastest[True] / own[case]
        if False in fastest:
            ratios[f"{case}: fastest peer that gives up / vpframe"] = fastest[False] / own[case]
    pair = problems.bolted_plate(1)
    ours("one bolt in its hole, 10 % and 30° off", pair, pair.shaken(0.1 * pair.size, np.deg2rad(30.0)))
    ours("one bolt in its hole, already there", pair, list(pair.poses))
    large = {
        "machine of 251 parts, 1,000 constraints": problems.machine(),
        "chain of 500 parts, 1,000 constraints": problems.chain(500),
        "net of 66 bars, 2,160 constraints in loops": problems.lattice(36, 30),
    }
    for name, problem in large.items():
        ours(f"{name}, warm (1 mm and 0.1° off)", problem, problem.shaken(1e-3, np.deg2rad(0.1)))
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
