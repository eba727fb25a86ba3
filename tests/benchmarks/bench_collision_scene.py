"""A large scene: thousands of bodies of 6,400 triangles, all moving, a tenth of them overlapping another.

Run as a script, or through `rows()` from the collision suite.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from collision.tree import build_trees, tree_of
from collision.wide import wide_tree_of

FRAMES = 60


def bumpy_ball(seed: int, size: float = 0.05) -> SurfaceMesh:
    """A closed body of 6,400 triangles in 32 surfaces, its radius varied a little."""
    rng = np.random.default_rng(seed)
    rows, columns = 41, 80
    u = np.linspace(0, np.pi, rows + 2)[1:-1]
    v = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    u, v = np.meshgrid(u, v, indexing="ij")
    radius = size * (1 + 0.1 * np.sin(3 * u + rng.random()) * np.cos(4 * v + rng.random()))
    ring = radius[..., None] * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], -1)
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, 0, size], [0, 0, -size]]])
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1], i[1:], np.roll(i, -1, 1)[1:], np.roll(i, -1, 1)[:-1]
    faces = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    top = np.stack([np.full(columns, rows * columns), i[0], np.roll(i[0], -1)], -1)
    bottom = np.stack([np.full(columns, rows * columns + 1), np.roll(i[-1], -1), i[-1]], -1)
    faces = np.concatenate([*faces, top, bottom])
    faces = faces[:6400]
    centre = vertices[faces].mean(1)
    turn = ((np.arctan2(centre[:, 1], centre[:, 0]) + np.pi) / (2 * np.pi) * 8).astype(int) % 8
    band = np.clip(((centre[:, 2] / size + 1) * 2).astype(int), 0, 3)
    surface = np.unique(8 * band + turn, return_inverse=True)[1]
    return SurfaceMesh(vertices, faces, surface, f"ball {seed}")


def paths(n: int, seed: int, tenth: float = 0.1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 3) centres on a grid wide enough to be apart, but for a tenth that are put beside a neighbour, and (n, 6)
    speeds of 0.5 mm and 0.5° a frame."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(n ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)[:n] * 0.25
    centres = grid + rng.uniform(-0.04, 0.04, (n, 3))
    for i in rng.choice(n // 2, int(tenth * n / 2), replace=False):
        direction = rng.normal(size=3)
        centres[2 * i + 1] = centres[2 * i] + 0.085 * direction / np.linalg.norm(direction)
    speed = rng.normal(size=(n, 6)) * ([0.0005 / 3] * 3 + [np.pi / 360 / 3] * 3)
    return centres, speed


def scene(n: int, fixed: int = 0, kinds: int = 10) -> tuple[CollisionManager, NDArray[np.float64], NDArray[np.float64]]:
    """A manager with n moving bodies of `kinds` meshes, and `fixed` between them that do not move and touch none; the
    poses (n, 4, 4) of those that move, and their steps."""
    meshes = [bumpy_ball(k) for k in range(kinds)]
    centres, speed = paths(n, 1)
    manager = CollisionManager()
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = centres
    for i in range(n):
        manager.add(meshes[i % kinds], poses[i])
    between = paths(n, 3, 0.0)[0][:fixed] + 0.125
    between = between[[np.linalg.norm(centres - c, axis=1).min() > 0.13 for c in between]]
    for k, centre in enumerate(between):
        manager.add(meshes[k % kinds], pin.SE3(np.eye(3), centre), movable=False)
    return manager, poses, np.array([pin.exp6(v).homogeneous for v in speed])


def frames(manager: CollisionManager, poses: NDArray[np.float64], steps: NDArray[np.float64]) -> dict[str, Any]:
    """Move all, ask all, `FRAMES` times; the median time a frame, poses set included."""
    ids = np.arange(len(poses))
    times, rows, pairs = [], 0, 0
    for k in range(FRAMES + 5):
        poses = poses @ steps if k % 20 < 10 else poses @ np.linalg.inv(steps)
        begin = time.perf_counter()
        manager.set_poses(ids, poses)
        found = manager.colliding_surfaces()
        times.append(time.perf_counter() - begin)
        rows, pairs = len(found), len(np.unique(found[:, [0, 2]], axis=0))
    return {"seconds": float(np.median(times[5:])), "surface_pairs": rows, "object_pairs": pairs}


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """Frames with all bodies moving, the same with half as many fixed ones more, and what trees take."""
    n = 200 if quick else 2000
    moving = frames(*scene(n))
    both = frames(*scene(n, n // 2))
    out = [
        {"case": f"{n} bodies, {n * 6400} triangles, all moving", "method": "best", "unit": "s a frame", "n": n}
        | moving,
        {"case": f"the same and {n // 2} fixed", "method": "best", "unit": "s a frame", "n": n + n // 2} | both,
    ]
    meshes = [bumpy_ball(1000 + k) for k in range(20 if quick else 200)]
    triangles = sum(mesh.n_triangles for mesh in meshes)
    begin = time.perf_counter()
    build_trees(meshes)
    seconds = time.perf_counter() - begin
    one = meshes[0]
    own = sum(a.nbytes for a in (one.vertices, one.triangles, one.surface_of_triangle, one.order, one.surface_start))
    held = own + tree_of(one).nbytes + wide_tree_of(one).nbytes
    out.append({"case": "trees", "method": "best", "seconds": seconds, "unit": "s", "n": triangles,
                "triangles_a_second": triangles / seconds, "bytes_a_triangle": held / one.n_triangles})  # fmt: skip
    return out


if __name__ == "__main__":
    print(json.dumps(rows("--quick" in sys.argv), indent=1))
