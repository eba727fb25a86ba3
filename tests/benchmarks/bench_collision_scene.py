"""A large scene: thousands of bodies of 6,400 triangles, all moving, a tenth of them overlapping another.

Run as a script, or through `rows()` from the collision suite.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, SurfaceMesh
from collision.bvh.build import build, bvh_of
from collision.bvh.layout import nbytes

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


def scene(n: int, fixed: int = 0, apart: bool = False, kinds: int = 10) -> Scene:
    """n moving bodies of `kinds` meshes, and `fixed` that do not move and touch none: in the gaps between those that
    move, where boxes overlap, or `apart`, beside them."""
    meshes = [bumpy_ball(k) for k in range(kinds)]
    centres, speed = paths(n, 1)
    manager = CollisionManager()
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = centres
    for i in range(n):
        manager.add(meshes[i % kinds], poses[i])
    others = paths(n, 3, 0.0)[0]
    if apart:
        others[:, 0] += 0.5 + np.ptp(centres[:, 0])
    else:
        others += 0.125
        others = others[[np.linalg.norm(centres - c, axis=1).min() > 0.13 for c in others]]
    for k in range(fixed):
        manager.add(meshes[k % kinds], pin.SE3(np.eye(3), others[k]), movable=False)
    return Scene(manager, poses, np.array([pin.exp6(v).homogeneous for v in speed]))


@dataclass
class Scene:
    """A manager, the poses (n, 4, 4) of what moves, and its steps (n, 4, 4)."""

    manager: CollisionManager
    poses: NDArray[np.float64]
    steps: NDArray[np.float64]

    def frame(self, k: int) -> tuple[float, NDArray[np.int32]]:
        """Move all, ask all; the time, poses set included, and the answer."""
        self.poses = self.poses @ (self.steps if k % 20 < 10 else np.linalg.inv(self.steps))
        ids = np.arange(len(self.poses))
        begin = time.perf_counter()
        self.manager.set_poses(ids, self.poses)
        found = self.manager.colliding_surfaces()
        return time.perf_counter() - begin, found


def frames(scenes: list[Scene]) -> list[dict[str, Any]]:
    """`FRAMES` frames of each scene by turns, so that other work on the machine slows all alike; the median times."""
    times = np.empty((FRAMES + 5, len(scenes)))
    last = []
    for k in range(len(times)):
        last = []
        for s, each in enumerate(scenes):
            times[k, s], found = each.frame(k)
            last.append(found)
    return [
        {
            "seconds": seconds,
            "surface_pairs": len(found),
            "object_pairs": len(np.unique(found[:, [0, 2]], axis=0)),
            "boxes_near": len(each.manager.object_pairs()),
        }
        for seconds, found, each in zip(np.median(times[5:], axis=0).tolist(), last, scenes, strict=True)
    ]


def rows(quick: bool = False) -> list[dict[str, Any]]:
    """Frames with all bodies moving, the same with half as many fixed ones more, and what trees take."""
    n = 200 if quick else 2000
    cases = {
        f"{n} bodies, {n * 6400} triangles, all moving": scene(n),
        f"the same and {n // 2} fixed between them": scene(n, n // 2),
        f"the same and {n // 2} fixed beside them": scene(n, n // 2, apart=True),
    }
    out = [
        {"case": case, "method": "bvh", "unit": "s a frame", "n": len(each.manager.objects)} | measured
        for (case, each), measured in zip(cases.items(), frames(list(cases.values())), strict=True)
    ]
    return [*out, trees(4 if quick else 40)]


def trees(meshes: int, rounds: int = 5) -> dict[str, Any]:
    """Building the hierarchies of so many new meshes of 6,400 triangles; the median of some rounds."""
    balls = [[bumpy_ball(1000 * r + k) for k in range(meshes)] for r in range(1, rounds + 1)]
    wall, processor = [], []
    for some in balls:
        begin = time.perf_counter(), time.process_time()
        build(some)
        wall.append(time.perf_counter() - begin[0])
        processor.append(time.process_time() - begin[1])
    one = balls[0][0]
    own = sum(a.nbytes for a in (one.vertices, one.triangles, one.surface_of_triangle, one.order, one.surface_start))
    held = own + nbytes(bvh_of(one))
    n = meshes * one.n_triangles
    return {
        "case": "trees",
        "method": "bvh",
        "seconds": float(np.median(wall)),
        "unit": "s",
        "n": n,
        "triangles_a_second": n / float(np.median(wall)),
        "triangles_a_processor_second": n / float(np.median(processor)),
        "bytes_a_triangle": held / one.n_triangles,
    }


if __name__ == "__main__":
    print(json.dumps(rows("--quick" in sys.argv), indent=1))
