"""A heap of cubes that forms in a tray: time, residual, overlap and energy of each step; MuJoCo beside it.

`python tests/benchmarks/physics_heap.py [BOXES] [--seconds S] [--peer PYTHON] [--json]` from the repository's root.
Overlaps are measured apart from what moves the cubes: by separating axes of all pairs of cubes, and against the tray.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

SIDE, DENSITY, FRICTION, G, DT = 0.03, 1000.0, 0.4, 9.80665, 0.01
"""m, kg/m³, 1, m/s², s"""
APART, COLUMNS, WALL = 0.054, 7, 0.05
"""m between cubes at the start (each turned at random), cubes along a side of the tray, m of its walls"""


def starts(n: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) m and rotation vectors (n, 3) of n cubes over the tray."""
    rng = np.random.default_rng(seed)
    k = np.arange(n)
    middle = 0.5 * (COLUMNS - 1)
    at = np.stack([k % COLUMNS - middle, k // COLUMNS % COLUMNS - middle, k // COLUMNS**2 + 0.6], axis=1) * APART
    return at, rng.normal(size=(n, 3))


def tray(n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Extents and middles of the blocks that make a tray for n cubes, its floor's top at z = 0."""
    inside, high = COLUMNS * APART, (n // COLUMNS**2 + 2) * APART
    outside = inside + 2 * WALL
    blocks = [([outside, outside, WALL], [0.0, 0.0, -0.5 * WALL])]
    for side in (-1.0, 1.0):
        blocks.append(([WALL, outside, high], [side * 0.5 * (inside + WALL), 0.0, 0.5 * high]))
        blocks.append(([inside, WALL, high], [0.0, side * 0.5 * (inside + WALL), 0.5 * high]))
    return [(np.array(extent), np.array(middle)) for extent, middle in blocks]


def overlap(center: np.ndarray, rotation: np.ndarray) -> float:
    """m: the deepest that two cubes, or a cube and the tray, stand in one another; centres (n, 3), rotations (n, 3, 3).

    Of two boxes the least overlap along the fifteen axes that can part them (Gottschalk, Lin & Manocha, 1996).
    """
    corners = 0.5 * SIDE * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    points = center[:, None] + np.einsum("nij,kj->nki", rotation, corners)
    half = 0.5 * COLUMNS * APART
    worst = max(0.0, -points[:, :, 2].min(), np.abs(points[:, :, :2]).max() - half)
    i, j = np.triu_indices(len(center), 1)
    near = ((center[i] - center[j]) ** 2).sum(axis=1) < 3.0 * SIDE**2
    i, j = i[near], j[near]
    a, b = rotation[i].transpose(0, 2, 1), rotation[j].transpose(0, 2, 1)
    edges = np.cross(a[:, :, None], b[:, None]).reshape(-1, 9, 3)
    size = np.linalg.norm(edges, axis=2, keepdims=True)
    parallel = size[:, :, 0] < 1e-6
    edges = np.divide(edges, size, out=np.zeros_like(edges), where=size > 0.0)
    axes = np.concatenate([a, b, edges], axis=1)
    reach = sum(np.abs(np.einsum("pxk,pmk->pxm", axes, side)).sum(axis=2) for side in (a, b))
    deep = 0.5 * SIDE * reach - np.abs(np.einsum("pxk,pk->px", axes, center[j] - center[i]))
    deep[:, 6:][parallel] = np.inf
    return float(max(worst, deep.min(axis=1).max(initial=0.0)))


def heap(n: int):
    """A world with n cubes that are about to fall into a tray, and their ids."""
    import pinocchio as pin
    from physics_meshes import box_mesh

    from collision import CollisionManager
    from physics import Body, Friction, Gravity, World

    manager = CollisionManager()
    for extent, middle in tray(n):
        manager.add(box_mesh(*extent, "tray"), pin.SE3(np.eye(3), middle), movable=False)
    world = World(manager)
    mesh = box_mesh(SIDE, SIDE, SIDE)
    body = Body.from_mesh(mesh, DENSITY)
    ids = []
    for at, turn in zip(*starts(n), strict=True):
        i = manager.add(mesh, pin.SE3(pin.exp3(turn), at))
        world.add(i, body, [Gravity(), Friction(FRICTION)])
        ids.append(i)
    return world, ids


def memory() -> float:
    """MB: the most that this process has held (`ru_maxrss` would count what its parent held, too)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return int(line.split()[1]) / 1024
    return float("nan")


def energy(world, ids) -> float:
    """J: of motion and of height."""
    return sum(world.energy(i) + SIDE**3 * DENSITY * G * world.pose(i).translation[2] for i in ids)


def run(n: int, seconds: float) -> list[dict[str, float]]:
    """One row a step: s of CPU, m/s of residual, m of overlap, J of energy, contacts that carry, bodies awake."""
    world, ids = heap(n)
    rows = []
    for _ in range(round(seconds / DT)):
        begin = time.process_time()
        world.step(DT)
        taken = time.process_time() - begin
        poses = [world.pose(i) for i in ids]
        deep = overlap(np.array([p.translation for p in poses]), np.array([p.rotation for p in poses]))
        speed = max(float(np.abs(world.velocity(i)[:3]).max()) for i in ids)
        rows.append(
            {
                "seconds": taken, "residual": world.residual, "overlap": deep, "energy": energy(world, ids),
                "speed": speed, "awake": len(world.awake),
            }
        )  # fmt: skip
    return rows


def peer(n: int, seconds: float, dt: float) -> dict[str, Any]:
    """The same heap in MuJoCo, boxes as boxes, stepped in C; runs in an interpreter that has it."""
    import mujoco

    def text(values) -> str:
        return " ".join(repr(float(x)) for x in values)

    geoms = "".join(f'<geom type="box" size="{text(e / 2)}" pos="{text(m)}"/>' for e, m in tray(n))
    bodies = ""
    for at, turn in zip(*starts(n), strict=True):
        angle = float(np.linalg.norm(turn))
        quaternion = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
        bodies += (
            f'<body pos="{text(at)}" quat="{text(quaternion)}"><freejoint/>'
            f'<geom type="box" size="{text([SIDE / 2] * 3)}" density="{DENSITY}"/></body>'
        )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{dt}" gravity="0 0 {-G}" integrator="implicitfast" cone="elliptic"
        solver="Newton"/><size memory="512M"/><default><geom friction="{FRICTION} 0 0" solref="{2 * dt} 1"
        solimp="0.99 0.9999 1e-6"/></default><worldbody>{geoms}{bodies}</worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    each = max(1, round(DT / dt))
    times, deepest = [], 0.0
    for _ in range(round(seconds / DT)):
        begin = time.process_time()
        mujoco.mj_step(model, data, each)
        times.append(time.process_time() - begin)
        mujoco.mj_kinematics(model, data)
        deepest = max(deepest, overlap(data.xpos[1:], data.xmat[1:].reshape(-1, 3, 3)))
    return {
        "version": mujoco.__version__, "dt": dt, "mean": float(np.mean(times)), "worst": max(times), "overlap": deepest,
        "memory": memory(),
    }  # fmt: skip


def summary(rows: list[dict[str, float]]) -> dict[str, float]:
    """Mean, median and worst of a run's columns."""
    column = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return {
        "steps": len(rows),
        "mean": float(column["seconds"].mean()),
        "median": float(np.median(column["seconds"])),
        "worst": float(column["seconds"].max()),
        "residual": float(column["residual"].max()),
        "overlap": float(column["overlap"].max()),
        "gain": float(np.diff(column["energy"]).max(initial=0.0)),
        "speed": float(column["speed"][-1]),
        "awake": float(column["awake"][-1]),
        "memory": memory(),
    }


def main() -> None:
    """Print one line a simulator, or one JSON document."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("boxes", nargs="?", type=int, default=500)
    arguments.add_argument("--seconds", type=float, default=1.5)
    arguments.add_argument("--peer", help="an interpreter that has mujoco")
    arguments.add_argument("--mujoco", type=float, help=argparse.SUPPRESS)
    arguments.add_argument("--json", action="store_true")
    given = arguments.parse_args()
    if given.mujoco:
        print(json.dumps(peer(given.boxes, given.seconds, given.mujoco)))
        return
    run(8, 0.2)  # kernels are made before anything is measured
    rows = run(given.boxes, given.seconds)
    out: dict[str, Any] = {"boxes": given.boxes, "vpframe": summary(rows), "rows": rows, "mujoco": []}
    for dt in (0.01, 0.001) if given.peer else ():
        command = [given.peer, __file__, str(given.boxes), "--seconds", str(given.seconds), "--mujoco", str(dt)]
        out["mujoco"].append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    if given.json:
        print(json.dumps(out))
        return
    print(", ".join(f"{name} {value:.3g}" for name, value in out["vpframe"].items()))
    for answer in out["mujoco"]:
        print("MuJoCo", ", ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in answer.items()))


if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]
    main()
