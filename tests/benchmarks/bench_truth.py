"""The truth suite: verdict and number of `clash` for generated pairs of solids whose gap is known in closed form.

The pairs of a kind are written to one STEP file, a metre apart, and loaded with the default deflection. A pair is wrong
where a depth above 1 µm is not reported as an overlap, or a clearance above 1 µm is not reported as one, by the row of
its two parts. `error` is the greatest difference of depth or clearance from the closed form; `overstated` counts
clearances above the true ones. Peers in the same run: coal on the same facets, and OpenCascade on the B-reps, least
distance (BRepExtrema_DistShapeShape) and, where that is 0, volume of the common solid; neither has a depth.
"""

from __future__ import annotations

import platform
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import collision_peers
import numpy as np
import pinocchio as pin
from bench_run import chosen
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from truth_pairs import KINDS, THREAD, Pair, pair

import vpframe as vp
from collision import Tolerance
from vpframe.analysis.clash import clash, document
from vpframe.app.progress import report
from vpframe.scene import modelling as m

EACH, QUICK = 8, 2
"""pairs of a kind"""
LIMIT = 1e-6
"""m: verdicts count where gap or depth is above"""
WANTED = 1e-3
"""m: the clearance that is asked for"""
FAR = 1.0
"""m between pairs"""
OURS, COAL, OCC = "clash", "coal, facets", "OpenCascade, B-rep"
OVERLAPS = ("clash", "press fit", "containment")
APART = ("clearance",)
FORGIVEN = 1e-9
"""m: rounding of coordinates in STEP"""

Verdict = tuple[str, float, float]
"""kind; gap, m, nan if the method has no number; seconds"""


def run(quick: bool = False, only: Sequence[str] = (), pairs: int = 0, seed: int = 0) -> dict[str, Any]:
    """Rows, one a kind and method, and ratios of time; `pairs` of each kind, with seeds from `seed`."""
    each = pairs or (QUICK if quick else EACH)
    kinds = chosen(KINDS, only)
    rows, ratios, wrong = [], {}, []
    total = dict.fromkeys((OURS, COAL, OCC), 0.0)
    _ours([pair(kind, 0) for kind in ("planes", "countersink", THREAD)])  # kernels are loaded outside the clock
    for number, kind in enumerate(kinds):
        report(number / len(kinds), kind)
        made = [pair(kind, seed + k) for k in range(each)]
        scene, ours = _ours(made)
        peers: dict[str, Callable[[Pair, vp.Scene, int], Verdict]] = {COAL: _coal, OCC: _occ}
        found = {OURS: ours} | {name: [peer(p, scene, k) for k, p in enumerate(made)] for name, peer in peers.items()}
        for method, verdicts in found.items():
            row = _row(kind, method, made, verdicts)
            wrong += [f"{kind}, seed {p.seed}: {v[0]}, gap {p.gap * 1e6:.2f} µm" for p, v in row.pop("failed")]
            rows.append(row)
            total[method] += row["seconds"] * row["n"]
    for method in (COAL, OCC):
        ratios[f"{method} / {OURS}"] = total[method] / total[OURS]
    return {
        "suite": "truth",
        "machine": platform.platform(),
        "seeds": [seed, seed + each - 1],
        "rows": rows,
        "ratios": ratios,
        "wrong": wrong,
    }


def _row(kind: str, method: str, made: Sequence[Pair], verdicts: Sequence[Verdict]) -> dict[str, Any]:
    failed, errors, overstated = [], [0.0], 0
    for p, verdict in zip(made, verdicts, strict=True):
        name, value, _ = verdict
        if kind == THREAD:
            right = name == "thread" or (method != OURS and name in OVERLAPS)
        else:
            right = name in (OVERLAPS if p.gap < 0.0 else APART)
            if np.isfinite(value) and right:
                errors.append(abs(value - (p.gap if p.gap > 0.0 else -p.depth)))
            overstated += name in APART and value > p.gap + FORGIVEN
        if not right and (kind == THREAD or abs(p.gap) > LIMIT):
            failed.append((p, verdict))
    return {
        "case": kind,
        "method": method,
        "seconds": float(np.mean([v[2] for v in verdicts])),
        "error": max(errors),
        "unit": "m",
        "n": len(made),
        "wrong": len(failed),
        "overstated": int(overstated),
        "failed": failed if method == OURS else [],
    }


def _ours(made: Sequence[Pair]) -> tuple[vp.Scene, list[Verdict]]:
    """The verdicts of `clash`, from a STEP file; seconds of loading are not counted."""
    parts = {}
    for k, p in enumerate(made):
        aside = pin.SE3(np.eye(3), np.array([FAR * k, 0.0, 0.0]))
        for name, solid, pose in zip("ab", p.solids, p.poses, strict=True):
            parts[f"{name}{k}"] = (solid, aside * pose)
    with tempfile.TemporaryDirectory() as folder:
        scene = vp.load(m.write_step(Path(folder) / "pairs.step", parts))
    began = time.process_time()
    pairs = document(clash(scene, WANTED, Tolerance(linear=LIMIT)))["pairs"]
    seconds = (time.process_time() - began) / len(made)
    rows = {tuple(sorted(row["parts"])): row for row in pairs}
    out: list[Verdict] = []
    for k in range(len(made)):
        row = rows.get((f"a{k}", f"b{k}"))
        if row is None:
            out.append(("none", np.nan, seconds))
        else:
            out.append((row["kind"], row["distance"] if row["kind"] in APART else -row["depth"], seconds))
    return scene, out


def _coal(p: Pair, scene: vp.Scene, k: int) -> Verdict:
    a, b = scene[f"a{k}"], scene[f"b{k}"]
    ask = collision_peers.distance(a.mesh, b.mesh)
    pose = a.pose.actInv(b.pose)
    began = time.process_time()
    distance = ask(pose)
    seconds = time.process_time() - began
    return ("clearance", distance, seconds) if distance > 0.0 else ("clash", np.nan, seconds)


def _occ(p: Pair, scene: vp.Scene, k: int) -> Verdict:
    a, b = (solid.moved(pose).occ for solid, pose in zip(p.solids, p.poses, strict=True))
    began = time.process_time()
    distance = BRepExtrema_DistShapeShape(a, b)
    value = distance.Value() * m.MM if distance.IsDone() else np.nan
    if value > LIMIT:
        return "clearance", value, time.process_time() - began
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(BRepAlgoAPI_Common(a, b).Shape(), properties)
    kind = "clash" if properties.Mass() > 0.0 else "contact"
    return kind, np.nan, time.process_time() - began


def table(result: dict[str, Any]) -> str:
    """One line a kind, with the methods side by side, and the wrong verdicts of ours by seed."""
    low, high = result["seeds"]
    methods = (OURS, COAL, OCC)
    lines = [
        f"truth: clash or clearance at 1 µm of generated pairs, seeds {low} to {high}; wrong verdicts, overstated "
        "clearances, worst error, ms a pair",
        f"  {'':20} {'n':>4}" + "".join(f"  {method:>32}" for method in methods),
    ]
    by_case: dict[str, dict[str, dict[str, Any]]] = {}
    for row in result["rows"]:
        by_case.setdefault(row["case"], {})[row["method"]] = row
    for case, of in by_case.items():
        lines.append(f"  {case:20} {of[OURS]['n']:4}" + "".join(_cell(of[method]) for method in methods))
    sums = {}
    for method in methods:
        rows = [of[method] for of in by_case.values()]
        n = sum(row["n"] for row in rows)
        sums[method] = {
            "wrong": sum(row["wrong"] for row in rows),
            "overstated": sum(row["overstated"] for row in rows),
            "error": max(row["error"] for row in rows),
            "seconds": sum(row["seconds"] * row["n"] for row in rows) / n,
        }
    lines.append(f"  {'all':20} {n:4}" + "".join(_cell(sums[method]) for method in methods))
    lines += [f"  {name}: {value:.3g} times as long" for name, value in result["ratios"].items()]
    return "\n".join(lines + [f"  WRONG {text}" for text in result["wrong"]])


def _cell(row: dict[str, Any]) -> str:
    return (
        f"  {row['wrong']:3} wrong {row['overstated']:3} over {row['error'] * 1e6:7.3f} µm {row['seconds'] * 1e3:5.1f}"
    )


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """Worst error by kind and method."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(10, 7))
    cases = list(dict.fromkeys(row["case"] for row in result["rows"]))
    for method, mark in ((OURS, "o"), (COAL, "s"), (OCC, "x")):
        of = {row["case"]: row for row in result["rows"] if row["method"] == method}
        axis.plot([max(of[case]["error"] * 1e6, 1e-4) for case in cases], range(len(cases)), mark, label=method)
    axis.set_yticks(range(len(cases)), cases)
    axis.set_xscale("log")
    axis.set_xlabel("worst error, µm (below 0.0001 drawn there)")
    axis.legend()
    figure.tight_layout()
    figure.savefig(Path(directory) / "truth.png", dpi=150)
    plt.close(figure)
