"""Speed against error of `physics`, side by side with MuJoCo and Drake: nine cases, eighteen rows (see physics_cases).

The peers run in the interpreter that the environment variable VPFRAME_PEERS names, else in this one; an engine that
does not import there is a row that says so. Times are processor time of stepping alone, which a busy machine
changes less than wall time; all runs are made one after the other.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import physics_cases as pc
import physics_linkages
import pinocchio as pin
from physics_meshes import at, ball_mesh, box_mesh, cylinder_mesh, plate_with_hole, room

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Sphere
from physics import Body, Buoyancy, Drag, Elastic, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY
from vpframe.app.progress import report

assert STANDARD_GRAVITY == pc.G

STEPS: dict[str, tuple[list[float], list[float]]] = {  # run -> our steps, peers' steps (they get one more), s
    "bounce e=1": ([1e-2, 2e-3], [1e-3, 1e-4]),
    "bounce e=0.8": ([1e-2, 2e-3], [1e-3, 1e-4]),
    "slope slide": ([1e-1, 1e-2], [1e-2, 1e-3]),
    "slope stick": ([1e-1, 1e-2], [1e-2, 1e-3]),
    "spin": ([5e-2, 1e-2], [1e-2, 1e-3, 5e-4]),
    "pendulum": ([5e-2, 1.8e-2, 1e-2], [1e-2, 1e-3, 3e-4, 1e-4]),
    "four-bar": ([2e-2, 1e-2, 5e-3], [1e-3, 3e-4, 1e-4]),
    "stack": ([2e-2, 1e-2], [1e-2, 2e-3]),
    "roll": ([5e-2, 1e-2], [1e-2, 1e-3]),
    "coin roll": ([1e-2, 1e-3, 2e-4], [1e-3, 1e-4]),
    "coin spin": ([1e-2, 1e-3, 2e-4], [1e-3, 1e-4]),
    "balloon rise": ([5e-2, 2e-2, 1e-2], [1e-2, 1e-3, 3e-4]),
    "balloon rest": ([5e-2, 1e-2], [1e-2, 1e-3]),
    "peg 0.1 mm": ([1e-2, 1e-3], [1e-3, 2e-4]),
    "peg 10 um": ([1e-2, 1e-3], [1e-3, 2e-4]),
}
ROUNDING = 1e-14
"""errors below this count as this in ratios: what rounding leaves of lengths of up to 10 m"""
QUICK_STACK = 2.0
"""s, instead of a minute"""
Outcome = tuple[float, int, float | dict[str, float]]
"""s of stepping, steps, error (of several rows where one run gives them)"""


def _run(world: World, dt: float, end: float) -> tuple[float, int]:
    """Steps to `end`; seconds of processor time and the number of steps."""
    n = math.ceil(end / dt - 1e-9)
    h = end / n
    begin = time.process_time()
    for _ in range(n):
        world.step(h)
    return time.process_time() - begin, n


def _ball(friction: float | None = None, restitution: float | None = None, tilt: float = 0.0, **more: Any):
    behaviours: list[Any] = [Gravity([pc.G * np.sin(tilt), 0, -pc.G * np.cos(tilt)]), Sleeping(False)]
    if friction is not None:
        behaviours.append(Friction(friction))
    if restitution is not None:
        behaviours.append(Elastic(restitution))
    radius, height = more["radius"], more["height"]
    manager, _ = room(60.0)
    ball = manager.add(ball_mesh(radius, 8), at(z=height))
    world = World(manager)
    world.add(ball, Body.sphere(radius, more["mass"]), behaviours, {0: Sphere(np.zeros(3), radius)})
    return world, ball


def bounce(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    e = float(row.split("=")[1])
    b = pc.BALL
    world, ball = _ball(restitution=e, radius=b["radius"], mass=b["mass"], height=b["drop"] + b["radius"])
    seconds, n = _run(world, dt, pc.apex_time(e, b["bounces"]))
    v = world.velocity(ball)[2]
    apex = world.pose(ball).translation[2] - b["radius"] + v * v / (2 * pc.G)
    return seconds, n, abs(apex - e ** (2 * b["bounces"]))


def slope(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.SLOPE
    mu, a, s = c[row.split()[1]], c["tilt"], c["side"]
    manager, _ = room(60.0)
    box = manager.add(box_mesh(s, s, s), at(z=s / 2))
    world = World(manager)
    gravity = Gravity([pc.G * np.sin(a), 0, -pc.G * np.cos(a)])
    world.add(box, Body.box([s] * 3, c["mass"]), [gravity, Friction(mu), Sleeping(False)])
    seconds, n = _run(world, dt, c["time"])
    want = 0.5 * pc.G * (np.sin(a) - mu * np.cos(a)) if mu < np.tan(a) else 0.0
    return seconds, n, abs(world.pose(box).translation[0] - want)


def spin(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.SPIN
    manager = CollisionManager()
    body = manager.add(box_mesh(0.1, 0.2, 0.3), at())
    world = World(manager)
    world.add(body, Body(1.0, np.zeros(3), np.diag(c["inertia"])), velocity=[0, 0, 0, *c["omega"]])
    errors, seconds, n = pc.SpinErrors(truth), 0.0, 0
    for _ in range(errors.LOOKS):
        s, k = _run(world, dt, c["time"] / errors.LOOKS)
        seconds, n = seconds + s, n + k
        rotation = world.pose(body).rotation
        errors.look(rotation, rotation.T @ world.velocity(body)[3:])
    return seconds, n, errors.rows()


def mechanism(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    if row == "pendulum":
        world, ids, _ = physics_linkages.pendulum()
        seconds, n = _run(world, dt, pc.PENDULUM["time"])
        x = world.pose(ids["bar"]).rotation[:, 0]
        return seconds, n, abs(np.pi / 2 - np.arctan2(-x[2], x[0]) - truth["pendulum"])
    world, ids, _ = physics_linkages.fourbar()
    seconds, n = _run(world, dt, pc.FOURBAR["time"])
    middle = world.pose(ids["coupler"]).translation[[0, 2]]
    return seconds, n, float(np.linalg.norm(middle - np.array(truth["four-bar"])))


def stack(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.STACK
    s = c["side"]
    manager, _ = room()
    world = World(manager)
    mesh = box_mesh(s, s, s)
    ids = [manager.add(mesh, at(z=s * (k + 0.5))) for k in range(c["n"])]
    for i in ids:
        world.add(i, Body.box([s] * 3, c["mass"]), [Gravity(), Friction(c["friction"]), Sleeping(False)])
    seconds, n = _run(world, dt, c["time"])
    here = np.array([world.pose(i).translation for i in ids])
    return seconds, n, float(np.abs(here - [[0, 0, s * (k + 0.5)] for k in range(c["n"])]).max())


def roll(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.ROLL
    world, ball = _ball(c["friction"], tilt=c["tilt"], radius=c["radius"], mass=c["mass"], height=c["radius"])
    seconds, n = _run(world, dt, c["time"])
    return seconds, n, abs(world.pose(ball).translation[0] - 5 / 14 * pc.G * np.sin(c["tilt"]) * c["time"] ** 2)


def coin(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.COINS[row]
    rotation, center, omega = pc.coin_start(c)
    manager, _ = room()
    disc = manager.add(cylinder_mesh(c["radius"], c["thickness"], 64), pin.SE3(rotation, center))
    r, t, m = c["radius"], c["thickness"], c["mass"]
    body = Body(m, np.zeros(3), m * np.diag([r * r / 4 + t * t / 12] * 2 + [r * r / 2]))
    world = World(manager)
    world.add(
        disc,
        body,
        [Gravity(), Friction(c["friction"]), Sleeping(False)],
        {0: Cylinder(np.zeros(3), [0, 0, 1], r)},
        velocity=[0, 0, 0, *omega],
    )
    seconds, n = _run(world, dt, c["time"])
    return seconds, n, float(np.linalg.norm(world.pose(disc).translation - center))


def balloon(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    c = pc.BALLOON
    r = c["radius"]
    manager, _ = room()
    manager.add(box_mesh(4, 4, 0.2, "ceiling"), at(z=c["ceiling"] + 0.1), movable=False)
    ball = manager.add(ball_mesh(r, 8), at(z=c["start"]))
    world = World(manager)
    _, _, area = pc.balloon_constants()
    behaviours = [Gravity(), Buoyancy(c["air"]), Drag(area, c["drag"], c["air"]), Sleeping(False)]
    world.add(ball, Body.sphere(r, c["mass"]), behaviours, {0: Sphere(np.zeros(3), r)})
    end = c["time"] if row.endswith("rise") else c["rest"]
    seconds, n = _run(world, dt, end)
    want = pc.balloon_rise(end) if row.endswith("rise") else c["ceiling"] - r
    return seconds, n, abs(world.pose(ball).translation[2] - want)


def _peg(row: str) -> tuple[World, int]:
    """The peg above its hole, a little off its middle."""
    c, gap = pc.PEG, pc.CLEARANCE[row]
    r, length, plate = c["radius"], c["length"], c["plate"]
    manager, _ = room(0.2)
    hole = manager.add(plate_with_hole(0.04, plate, r + gap), at(z=plate / 2), movable=False)
    mesh = cylinder_mesh(r, length)
    body = manager.add(mesh, at(x=c["offset"] * gap, z=plate + c["gap"] + length / 2))
    world = World(manager)
    world.add(hole, None, [], {0: Cylinder(np.zeros(3), [0, 0, 1], r + gap)})
    steel = Body.from_mesh(mesh, 7850.0)
    world.add(body, steel, [Gravity(), Friction(0.1), Sleeping(False)], {0: Cylinder(np.zeros(3), [0, 0, 1], r)})
    return world, body


def peg(row: str, dt: float, truth: dict[str, Any]) -> Outcome:
    world, body = _peg(row)
    seconds, n = _run(world, dt, pc.PEG["time"])
    return seconds, n, abs(world.pose(body).translation[2] - pc.PEG["length"] / 2)


def peg_in_wall(row: str, dt: float) -> tuple[float, float]:
    """How far (m) the peg stood in the bore's wall at its worst, after any step; s of processor of the median step."""
    c = pc.PEG
    world, body = _peg(row)
    worst, seconds = -np.inf, []
    for _ in range(round(c["time"] / dt)):
        seconds.append(_run(world, dt, dt)[0])
        pose = world.pose(body)
        axis, half = pose.rotation[:, 2], c["length"] / 2
        low, high = sorted(pose.translation[2] + s * half * axis[2] for s in (-1, 1))
        for z in (max(low, 0.0), min(high, c["plate"])):  # where the axis enters and leaves the plate
            if low <= z <= high:
                middle = pose.translation + (z - pose.translation[2]) / axis[2] * axis
                out = np.linalg.norm(middle[:2]) + c["radius"] / abs(axis[2])  # of an ellipse, its long half axis
                worst = max(worst, float(out) - c["radius"] - pc.CLEARANCE[row])
    return worst, float(np.median(seconds))


def ours_of(run: str, dt: float, truth: dict[str, Any]) -> Iterator[dict[str, Any]]:
    case = next(case for row, (case, _) in pc.ROWS.items() if row.startswith(run))
    seconds, n, error = globals()[case](run, dt, truth)
    for row, value in (error if isinstance(error, dict) else {run: error}).items():
        yield {"row": row, "method": "vpframe", "dt": dt, "seconds": seconds, "steps": n, "error": float(value)}


def peers_of(engine: str, runs: list[list[Any]], truth: dict[str, Any], begin: float, end: float) -> dict[str, Any]:
    """The answer of `physics_peers.py`; tells how far it is, from `begin` to `end` of all."""
    interpreter = os.environ.get("VPFRAME_PEERS", sys.executable)
    script = Path(__file__).with_name("physics_peers.py")
    request = json.dumps({"truth": truth, "stack": pc.STACK["time"], "runs": runs})
    with tempfile.TemporaryFile("w+") as answer, tempfile.TemporaryFile("w+") as asked:
        asked.write(request)
        asked.seek(0)
        command = [interpreter, str(script), engine]
        with subprocess.Popen(command, stdin=asked, stdout=answer, stderr=subprocess.PIPE, text=True) as process:
            said = ""
            for done, line in enumerate(process.stderr or ()):
                said = line.strip() or said
                report(begin + (end - begin) * min(1.0, done / len(runs)), f"{engine}: {said}")
        answer.seek(0)
        try:
            return json.loads(answer.read())
        except json.JSONDecodeError:
            return {"missing": f"ended with code {process.returncode}: {said}"}


def run(quick: bool = False) -> dict[str, Any]:
    """Run all rows. `quick` leaves out the finest steps, and all but two seconds of the stack's minute."""
    truth = pc.truths()
    minute = pc.STACK["time"]
    if quick:
        pc.STACK["time"] = QUICK_STACK
    try:
        return _result(truth, quick)
    finally:
        pc.STACK["time"] = minute


def _result(truth: dict[str, Any], quick: bool) -> dict[str, Any]:
    found, asked = [], []
    for number, (name, (own, theirs)) in enumerate(STEPS.items()):
        report(0.5 * number / len(STEPS), name)
        own = own[:2] if quick else own
        list(ours_of(name, own[0], truth))  # kernels compiled and caches filled outside the timing
        mine = [row for dt in own for row in ours_of(name, dt, truth)]
        found += mine
        asked.append([name, theirs, max(row["seconds"] for row in mine)])
    report(0.5, "peg")
    in_wall, peg_step = peg_in_wall("peg 10 um", 1e-2)
    missing, versions = {}, {}
    for engine, begin in (("mujoco", 0.5), ("drake", 0.75)):
        answer = peers_of(engine, asked, truth, begin, begin + 0.25)
        if "missing" in answer:
            missing[engine] = answer["missing"]
        versions[engine] = answer.get("version", "")
        for r in answer.get("rows", []):
            r["method"] = " ".join(x for x in (engine, r["method"]) if x)
            found.append(r)
    rows = [
        {
            "case": row,
            "method": r["method"],
            "seconds": r["seconds"] / r["steps"] if "seconds" in r else None,
            "error": r.get("error"),
            "unit": pc.ROWS[row][1].replace("60 s", f"{pc.STACK['time']:.0f} s"),
            "n": r.get("steps", 0),
            "dt": r["dt"],
            "total": r.get("seconds"),
            "note": r.get("failed", ""),
        }
        for r in found
        for row in pc.ROWS
        if row == r["row"] or row.startswith(r["row"] + " ")
    ]
    fronts = {engine: fronts_of(rows, engine) for engine in ("mujoco", "drake")}
    return {
        "suite": "physics",
        "machine": {"processor": platform.processor() or platform.machine(), "python": platform.python_version()},
        "versions": versions,
        "missing": missing,
        "rows": rows,
        "ratios": {
            f"{row}: error vpframe / {engine}": found[-1]["ratio"]
            for engine, rows_of in fronts.items()
            for row, found in rows_of.items()
        },
        "fronts": fronts,
        "goals": goals_of(rows, fronts["mujoco"], in_wall, peg_step),
    }


def fronts_of(rows: list[dict[str, Any]], engine: str) -> dict[str, list[dict[str, float]]]:
    """By row, for each of our runs that is more exact than all our quicker ones: its processor time (s), our error, the
    least that the peer reached in no more processor time (10 % are allowed), and the ratio of the two.

    Errors below `ROUNDING` count as that. A peer that was never as quick is judged by its quickest run.
    """
    out: dict[str, list[dict[str, float]]] = {}
    for case in pc.ROWS:
        ran = [r for r in rows if r["case"] == case and r["total"] is not None]
        mine = sorted((r for r in ran if r["method"] == "vpframe"), key=lambda r: r["total"])
        theirs = [r for r in ran if r["method"].split()[0] == engine]
        front: list[dict[str, float]] = []
        for r in mine if theirs else []:
            if front and max(r["error"], ROUNDING) >= max(front[-1]["error"], ROUNDING):
                continue
            within = [p for p in theirs if p["total"] <= 1.1 * r["total"]] or [min(theirs, key=lambda p: p["total"])]
            error = min(np.inf if p["error"] is None else p["error"] for p in within)
            ratio = max(r["error"], ROUNDING) / max(error, ROUNDING)
            front.append({"total": r["total"], "error": r["error"], "peer": error, "ratio": float(ratio)})
        if front:
            out[case] = front
    return out


def goals_of(
    rows: list[dict[str, Any]], fronts: dict[str, list[dict[str, float]]], in_wall: float, peg_step: float
) -> list[dict[str, Any]]:
    """What was aimed at, what was measured, and whether it is met; ours at its worst over all steps that were run."""

    def worst(case: str, dt: float | None = None) -> float:
        errors = [r["error"] for r in rows if r["case"] == case and r["method"] == "vpframe" and dt in (None, r["dt"])]
        return max(errors, default=np.inf)

    goals: list[tuple[str, float, str, float]] = []
    if fronts:
        by_case = {
            case: max(
                (fronts[r][-1]["ratio"] for r in pc.ROWS if pc.ROWS[r][0] == case and r in fronts), default=np.inf
            )
            for case in pc.CASES
        }
        all_runs = max(point["ratio"] for front in fronts.values() for point in front)
        goals = [
            (
                "cases of nine with the smaller error, MuJoCo given our processor time",
                sum(x < 1 for x in by_case.values()),
                ">=",
                7,
            ),
            (
                "worst ratio to MuJoCo's error in the time of our most exact run",
                max(by_case.values()),
                "<=",
                2,
            ),
            ("worst ratio to MuJoCo's error in the time of any of our runs", all_runs, "<=", 2),
        ]
    seconds = f"{pc.STACK['time']:.0f} s"
    goals += [
        ("apex after 20 bounces at e = 1 (m)", worst("bounce e=1"), "<=", 1e-9),
        ("sticking creep in 1 s (m)", worst("slope stick"), "<=", 1e-12),
        (f"sag of the stack of 10 in {seconds} (m)", worst("stack"), "<=", 1e-8),
        ("energy of the free spin, 100 s at 10 ms", worst("spin energy", 1e-2), "<=", 1e-8),
        ("peg at 10 um clearance: height at rest (m)", worst("peg 10 um"), "<=", 1e-9),
        ("peg at 10 um clearance: most that stood in the wall (m)", max(in_wall, 0.0), "<=", 1e-9),
        ("peg at 10 um clearance: median step (s)", peg_step, "<=", 2e-3),
    ]
    return [
        {"name": name, "value": float(v), "sign": s, "limit": float(x), "met": bool(v >= x if s == ">=" else v <= x)}
        for name, v, s, x in goals
    ]


def table(result: dict[str, Any]) -> str:
    """The rows by case, then the ratios."""
    lines = [f"{'case':<13} {'method':<15} {'step':>8} {'total':>9} {'us/step':>9} {'error':>10}  unit of error"]
    for case in pc.ROWS:
        for r in result["rows"]:
            if r["case"] != case:
                continue
            if r["total"] is None:
                lines.append(
                    f"{case:<13} {r['method']:<15} {r['dt']:>8.0e} {'':>9} {'':>9} {'failed':>10}  {r['note']}"
                )
                continue
            error = "diverged" if r["error"] is None else f"{r['error']:.1e}"
            lines.append(
                f"{case:<13} {r['method']:<15} {r['dt']:>8.0e} {r['total']:>7.3f} s {r['seconds'] * 1e6:>9.1f} "
                f"{error:>10}  {r['unit']}"
            )
    lines += [f"{engine}: {why}" for engine, why in result["missing"].items()]
    for engine, fronts in result["fronts"].items():
        if fronts:
            lines.append(
                f"our error over {engine}'s least in no more processor time (in brackets; below 1: ours is smaller):"
            )
        for case, front in fronts.items():
            lines.append(f"  {case:<13} " + ", ".join(f"{p['ratio']:.1e} ({p['total']:.2f} s)" for p in front))
    lines.append("goals:")
    for g in result["goals"]:
        met = "met" if g["met"] else "MISSED"
        lines.append(f"  {g['name']:<70} {g['value']:>8.2g} {g['sign']} {g['limit']:<6.2g} {met}")
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> Path:
    """Error against processor time, a panel a row; physics.png in `directory`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullFormatter

    figure, axes = plt.subplots(3, 6, figsize=(26, 12))
    for axis, case in zip(axes.ravel(), pc.ROWS, strict=True):
        rows = [r for r in result["rows"] if r["case"] == case and r["error"] is not None]
        for method in sorted({r["method"] for r in rows}, key=lambda m: (m != "vpframe", m)):
            mine = sorted((r for r in rows if r["method"] == method), key=lambda r: r["total"])
            engine = method.split()[0]
            same = sorted({r["method"] for r in rows if r["method"].split()[0] == engine}).index(method)
            axis.loglog(
                [r["total"] for r in mine],
                [max(r["error"], 1e-17) for r in mine],
                marker="o^s"[same % 3],
                linestyle=("-", "--", ":")[same % 3],
                color={"vpframe": "black", "mujoco": "tab:blue", "drake": "tab:orange"}[engine],
                label=method,
                linewidth=2 if engine == "vpframe" else 1,
            )
        axis.set_title(
            f"{case} ({result['fronts']['mujoco'][case][-1]['ratio']:.0e})"
            if case in result["fronts"]["mujoco"]
            else case
        )
        axis.set_ylabel(pc.ROWS[case][1], fontsize=8)
        axis.set_ylim(5e-18, 10.0)
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.grid(alpha=0.3)
        if rows:
            axis.legend(fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("processor time, s")
    figure.suptitle(
        "physics: error against processor time of the whole run; errors below 1e-17 are drawn there;"
        " in brackets our least error over MuJoCo's at that processor time"
    )
    figure.tight_layout()
    path = Path(directory) / "physics.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)
    return path
