"""Speed against error of `physics`, side by side with MuJoCo and Drake: nine cases, fifteen rows (see physics_cases).

The peers run in the interpreter that the environment variable VPFRAME_PEERS names, else in this one; an engine that
does not import there is a row that says so. Wall times are of stepping alone; all runs are made one after the other.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import physics_cases as pc
import pinocchio as pin
from physics_meshes import at, ball_mesh, box_mesh, cylinder_mesh, plate_with_hole, room

from collision import CollisionManager
from constraints.geometry import Cylinder, Plane, Sphere
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Body, Buoyancy, Drag, Elastic, Friction, Gravity, Sleeping, World
from physics.behaviours import STANDARD_GRAVITY
from vpframe.progress import report

assert STANDARD_GRAVITY == pc.G

STEPS: dict[str, tuple[list[float], list[float]]] = {  # row -> our steps, peers' steps, s
    "bounce e=1": ([1e-2, 2e-3], [1e-3, 1e-4, 2e-5]),
    "bounce e=0.8": ([1e-2, 2e-3], [1e-3, 1e-4, 2e-5]),
    "slope slide": ([1e-1, 1e-2], [1e-2, 1e-3, 1e-4]),
    "slope stick": ([1e-1, 1e-2], [1e-2, 1e-3, 1e-4]),
    "spin energy": ([5e-2, 1e-2], [1e-2, 1e-3, 1e-4]),
    "spin attitude": ([5e-2, 1e-2], [1e-2, 1e-3, 1e-4]),
    "pendulum": ([5e-2, 2e-2, 1e-2], [1e-2, 1e-3, 1e-4]),
    "four-bar": ([2e-2, 1e-2, 5e-3], [1e-3, 1e-4, 2e-5]),
    "stack": ([2e-2, 1e-2], [1e-2, 2e-3, 1e-3]),
    "roll": ([5e-2, 1e-2], [1e-2, 1e-3, 1e-4]),
    "coin": ([1e-2, 1e-3, 2e-4], [1e-3, 1e-4, 2e-5]),
    "balloon rise": ([1e-1, 5e-2, 1e-2], [1e-2, 1e-3, 1e-4]),
    "balloon rest": ([5e-2, 1e-2], [1e-2, 1e-3, 2e-4]),
    "peg 0.1 mm": ([1e-2, 1e-3], [1e-3, 2e-4]),
    "peg 10 um": ([1e-2, 1e-3], [1e-3, 2e-4]),
}
DRAKE = ("slope slide", "slope stick", "pendulum")
"""the rows that Drake runs (discrete SAP with point contact, RK3 for the pendulum)"""


def _run(world: World, dt: float, end: float) -> tuple[float, int]:
    """Steps to `end`; seconds of wall time and the number of steps."""
    n = math.ceil(end / dt - 1e-9)
    h = end / n
    begin = time.perf_counter()
    for _ in range(n):
        world.step(h)
    return time.perf_counter() - begin, n


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


def bounce(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    e = float(row.split("=")[1])
    b = pc.BALL
    world, ball = _ball(restitution=e, radius=b["radius"], mass=b["mass"], height=b["drop"] + b["radius"])
    seconds, n = _run(world, dt, pc.apex_time(e, b["bounces"]))
    v = world.velocity(ball)[2]
    apex = world.pose(ball).translation[2] - b["radius"] + v * v / (2 * pc.G)
    return seconds, n, abs(apex - e ** (2 * b["bounces"]))


def slope(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
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


def spin(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    c = pc.SPIN
    manager = CollisionManager()
    body = manager.add(box_mesh(0.1, 0.2, 0.3), at())
    world = World(manager)
    world.add(body, Body(1.0, np.zeros(3), np.diag(c["inertia"])), velocity=[0, 0, 0, *c["omega"]])
    first = world.energy(body)
    worst, seconds, n = 0.0, 0.0, 0
    for _ in range(100):
        s, k = _run(world, dt, c["time"] / 100)
        seconds, n = seconds + s, n + k
        worst = max(worst, abs(world.energy(body) / first - 1))
    if row.endswith("energy"):
        return seconds, n, worst
    return seconds, n, pc.angle_between(world.pose(body).rotation, np.array(truth["spin"]))


def hinge(a: int, b: int, at_a: Any, at_b: Any) -> list[Any]:
    """The two constraints of a hinge about y, as recognition gives them: a pin in a bore and two flush sides."""
    y = np.array([0.0, 1.0, 0.0])
    return [
        Concentric((a, b), (Cylinder(at_a, y, 0.005), Cylinder(at_b, y, 0.005))),
        Coplanar((a, b), (Plane(at_a, y), Plane(at_b, y))),
    ]


def mechanism(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    return (_pendulum if row == "pendulum" else _fourbar)(dt, truth)


def _pendulum(dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    p = pc.PENDULUM
    manager = CollisionManager()
    ground = manager.add(box_mesh(0.1, 0.1, 0.1), at(), movable=False)
    mesh = box_mesh(p["length"], p["width"], p["height"])
    turn = pin.exp3(np.array([0.0, p["angle"], 0.0]))
    bar = manager.add(mesh, pin.SE3(turn, turn @ [p["length"] / 2, 0, 0]))
    manager.ignore(ground, bar)
    world = World(manager)
    world.add(bar, Body.from_mesh(mesh, p["density"]), [Gravity(), Sleeping(False)])
    world.set_joints(hinge(ground, bar, np.zeros(3), np.array([-p["length"] / 2, 0, 0])))
    seconds, n = _run(world, dt, p["time"])
    x = world.pose(bar).rotation[:, 0]
    return seconds, n, abs(np.pi / 2 - np.arctan2(-x[2], x[0]) - truth["pendulum"])


def _fourbar(dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    f = pc.FOURBAR
    manager = CollisionManager()
    ids = [manager.add(box_mesh(0.02, 0.02, 0.02), at(), movable=False)]
    flat_b, flat_c = pc.fourbar_points(f["crank"])
    a, d = np.zeros(3), np.array([f["ground"], 0, 0])
    b, c = (np.array([p[0], 0, p[1]]) for p in (flat_b, flat_c))
    world = World(manager)
    for (start, end), length in zip(((a, b), (b, c), (d, c)), f["bars"], strict=True):
        mesh = box_mesh(length, f["width"], f["width"])
        x = (end - start) / length
        y = np.array([0.0, 1.0, 0.0])
        ids.append(manager.add(mesh, pin.SE3(np.column_stack([x, y, np.cross(x, y)]), (start + end) / 2)))
        world.add(ids[-1], Body.from_mesh(mesh, f["density"]), [Gravity(), Sleeping(False)])
    for i in ids:
        for j in ids[:i]:
            manager.ignore(i, j)
    left, right = ([np.array([s * length / 2, 0, 0]) for length in f["bars"]] for s in (-1, 1))
    joints = hinge(0, 1, a, left[0]) + hinge(1, 2, right[0], left[1])
    joints += hinge(2, 3, right[1], right[2]) + hinge(0, 3, d, left[2])
    world.set_joints(joints)
    seconds, n = _run(world, dt, f["time"])
    return seconds, n, float(np.linalg.norm(world.pose(2).translation[[0, 2]] - np.array(truth["four-bar"])))


def stack(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
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


def roll(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    c = pc.ROLL
    world, ball = _ball(c["friction"], tilt=c["tilt"], radius=c["radius"], mass=c["mass"], height=c["radius"])
    seconds, n = _run(world, dt, c["time"])
    return seconds, n, abs(world.pose(ball).translation[0] - 5 / 14 * pc.G * np.sin(c["tilt"]) * c["time"] ** 2)


def coin(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    c = pc.COIN
    rotation, center, omega = pc.coin_start()
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


def balloon(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
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


def peg(row: str, dt: float, truth: dict[str, Any]) -> tuple[float, int, float]:
    c, gap = pc.PEG, pc.CLEARANCE[row]
    r, length, plate = c["radius"], c["length"], c["plate"]
    manager, _ = room(0.2)
    hole = manager.add(plate_with_hole(0.04, plate, r + gap), at(z=plate / 2), movable=False)
    mesh = cylinder_mesh(r, length)
    body = manager.add(mesh, at(x=c["offset"] * gap, z=plate + c["gap"] + length / 2))
    world = World(manager)
    world.add(hole, None, [], {0: Cylinder(np.zeros(3), [0, 0, 1], r + gap)})
    world.add(
        body,
        Body.from_mesh(mesh, 7850.0),
        [Gravity(), Friction(0.1), Sleeping(False)],
        {0: Cylinder(np.zeros(3), [0, 0, 1], r)},
    )
    seconds, n = _run(world, dt, c["time"])
    return seconds, n, abs(world.pose(body).translation[2] - length / 2)


def _ours(row: str, dt: float, truth: dict[str, Any]) -> dict[str, Any]:
    seconds, n, error = globals()[pc.ROWS[row][0]](row, dt, truth)
    return {"row": row, "method": "vpframe", "dt": dt, "seconds": seconds, "steps": n, "error": float(error)}


def _peers(engine: str, runs: list[list[Any]], truth: dict[str, Any]) -> dict[str, Any]:
    interpreter = os.environ.get("VPFRAME_PEERS", sys.executable)
    script = Path(__file__).with_name("physics_peers.py")
    done = subprocess.run(
        [interpreter, str(script), engine],
        input=json.dumps({"truth": truth, "runs": runs}),
        capture_output=True,
        text=True,
        check=False,
    )
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        said = (done.stderr or done.stdout).strip().splitlines()
        return {"missing": f"ended with code {done.returncode}: {said[-1] if said else ''}"}


def run(quick: bool = False) -> dict[str, Any]:
    """Run all rows. `quick` leaves out the finest steps, the stack's minute and the spin at fine steps."""
    truth = pc.truths()
    pc_time = pc.STACK["time"]
    if quick:
        pc.STACK["time"] = 2.0
    ours, mujoco, drake = [], [], []
    for number, (row, (own, theirs)) in enumerate(STEPS.items()):
        report(0.7 * number / len(STEPS), row)
        if quick:
            own, theirs = own[:2], theirs[:2]
        globals()[pc.ROWS[row][0]](row, own[0], truth)  # kernels compiled and caches filled outside the timing
        ours += [_ours(row, dt, truth) for dt in own]
        options = {"slope stick": ["", "noslip"], "bounce e=1": ["", "RK4"]}.get(row, [""])
        options = ["hull", "wedges"] if row.startswith("peg") else options
        mujoco += [[row, dt, option] for dt in theirs for option in options]
        if row in DRAKE:
            drake += [[row, dt, ""] for dt in theirs[:2]]
    if quick:
        mujoco = [[r, dt, o] for r, dt, o in mujoco if r != "stack"]
        drake = [[r, dt, o] for r, dt, o in drake if r != "stack"]
        pc.STACK["time"] = pc_time
    found = list(ours)
    missing = {}
    for engine, runs in (("mujoco", mujoco), ("drake", drake)):
        report(0.7 if engine == "mujoco" else 0.85, engine)
        answer = _peers(engine, runs, truth)
        if "missing" in answer:
            missing[engine] = answer["missing"]
        for r in answer.get("rows", []):
            r["method"] = " ".join(x for x in (engine, r["method"]) if x)
            found.append(r)
    rows = [
        {
            "case": r["row"],
            "method": r["method"],
            "seconds": r["seconds"] / r["steps"] if "seconds" in r else None,
            "error": r.get("error"),
            "unit": pc.ROWS[r["row"]][1],
            "n": r.get("steps", 0),
            "dt": r["dt"],
            "wall": r.get("seconds"),
            "note": r.get("failed", ""),
        }
        for r in found
    ]
    return {
        "suite": "physics",
        "machine": {"processor": platform.processor() or platform.machine(), "python": platform.python_version()},
        "missing": missing,
        "rows": rows,
        "ratios": _ratios(rows),
    }


def _ratios(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Our error over MuJoCo's best at no more wall time than ours took, by row; errors below 1e-15 count as 1e-15."""
    out = {}
    for case in pc.ROWS:
        mine = [r for r in rows if r["case"] == case and r["method"] == "vpframe"]
        theirs = [r for r in rows if r["case"] == case and r["method"].startswith("mujoco") and r["wall"] is not None]
        if not mine or not theirs:
            continue
        best = min(mine, key=lambda r: r["error"])
        within = [r for r in theirs if r["wall"] <= best["wall"]] or [min(theirs, key=lambda r: r["wall"])]
        error = min(r["error"] if r["error"] is not None else np.inf for r in within)
        out[f"{case}: error vpframe / mujoco"] = float(max(best["error"], 1e-15) / max(error, 1e-15))
    return out


def table(result: dict[str, Any]) -> str:
    """The rows by case, then the ratios."""
    lines = [f"{'case':<13} {'method':<15} {'step':>8} {'wall':>9} {'us/step':>9} {'error':>10}  unit of error"]
    for case in pc.ROWS:
        for r in result["rows"]:
            if r["case"] != case:
                continue
            if r["wall"] is None:
                lines.append(
                    f"{case:<13} {r['method']:<15} {r['dt']:>8.0e} {'':>9} {'':>9} {'failed':>10}  {r['note']}"
                )
                continue
            error = "diverged" if r["error"] is None else f"{r['error']:.1e}"
            lines.append(
                f"{case:<13} {r['method']:<15} {r['dt']:>8.0e} {r['wall']:>7.3f} s {r['seconds'] * 1e6:>9.1f} "
                f"{error:>10}  {r['unit']}"
            )
    lines += [f"{engine}: {why}" for engine, why in result["missing"].items()]
    if result["ratios"]:
        lines.append("at no more wall time than ours (below 1: ours is the smaller error):")
        lines += [f"  {name}: {value:.1e}" for name, value in result["ratios"].items()]
    return "\n".join(lines)


def plot(result: dict[str, Any], directory: str | Path) -> Path:
    """Error against wall time, a panel a row; physics.png in `directory`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(3, 5, figsize=(20, 11))
    for axis, case in zip(axes.ravel(), pc.ROWS, strict=True):
        rows = [r for r in result["rows"] if r["case"] == case and r["error"] is not None]
        for k, method in enumerate(sorted({r["method"] for r in rows}, key=lambda m: (m != "vpframe", m))):
            mine = sorted((r for r in rows if r["method"] == method), key=lambda r: r["wall"])
            axis.loglog(
                [r["wall"] for r in mine],
                [max(r["error"], 1e-17) for r in mine],
                "os^Dv"[k % 5] + "-",
                label=method,
                linewidth=2 if method == "vpframe" else 1,
            )
        axis.set_title(case)
        axis.set_ylabel(pc.ROWS[case][1].split(",")[0].split(" after")[0])
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("wall time, s")
    figure.suptitle("physics: error against wall time of the whole run")
    figure.tight_layout()
    path = Path(directory) / "physics.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)
    return path
