"""Managers of many objects anywhere, and their answers pair by pair."""

from itertools import combinations

import numpy as np
import pinocchio as pin

from collision import (
    CollisionManager,
    colliding_surfaces,
)
from tests.collision import shapes


def anywhere(rng: np.random.Generator, spread: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), spread * rng.random(3))


def crowd(n: int, seed: int, spread: float) -> CollisionManager:
    rng = np.random.default_rng(seed)
    meshes = [shapes.soup(40, 4, 1), shapes.box(cells=2), shapes.wave(6, 2, 3)]
    manager = CollisionManager()
    for i in range(n):
        manager.add(meshes[i % 3], anywhere(rng, spread), movable=bool(i % 4))
    return manager


def one_by_one(manager: CollisionManager) -> list[list[int]]:
    rows = []
    for i, j in combinations(manager.objects, 2):
        if manager.movable(i) or manager.movable(j):
            pairs = colliding_surfaces(manager.mesh(i), manager.mesh(j), manager.relative_pose(i, j), "brute")
            rows += [[i, a, j, b] for a, b in pairs.tolist()]
    return rows
