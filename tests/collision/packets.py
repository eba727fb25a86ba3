"""Two packets of triangles in every position, and their distances."""

import numpy as np
import pinocchio as pin
from numba import njit

from collision import SurfaceMesh
from collision.bvh.build import bvh_of
from collision.bvh.packets import near_triangles
from collision.bvh.traverse import start, workspace_for
from collision.triangle.distance import closest_features


def relative(rng: np.random.Generator, reach: float) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * reach)


def in_leaf_order(mesh: SurfaceMesh) -> np.ndarray:
    return mesh.vertices[mesh.triangles[bvh_of(mesh).order]]


def packet(rng: np.random.Generator, scale: float, place: float, slivers: bool = False) -> SurfaceMesh:
    """Eight triangles, some of them slivers or of no area."""
    corners = rng.normal(size=(8, 3, 3)) * scale * 10.0 ** rng.uniform(-3.0, 0.0, (8, 1, 1)) + rng.normal(
        size=(8, 1, 3)
    ) * scale * rng.uniform(0.0, 2.0)
    if slivers:
        corners[::3, 2] = corners[::3, 0] + (corners[::3, 1] - corners[::3, 0]) * rng.uniform(-0.5, 1.5, (3, 1))
        corners[::3, 2] += rng.normal(size=(3, 3)) * scale * 10.0 ** rng.uniform(-12.0, -3.0, (3, 1))
    return SurfaceMesh((corners + place * rng.normal(size=3)).reshape(-1, 3), np.arange(24).reshape(8, 3))


@njit
def distances_between(corners, others, out):
    for i in range(len(corners)):
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        for j in range(len(others)):
            p, q, r = others[j, 0], others[j, 1], others[j, 2]
            square, _, _ = closest_features(
                (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]),
                (p[0], p[1], p[2]), (q[0], q[1], q[2]), (r[0], r[1], r[2]),
            )  # fmt: skip
            out[i, j] = np.sqrt(square)


@njit
def near_pairs_of_packets(a, b, ws, distance, along, meeting):
    start(a, b, ws)
    direction = np.float32(along[0]), np.float32(along[1]), np.float32(along[2])
    ws.bounds[8:72] = np.inf
    return near_triangles(a, b, ws, 0, 0, np.float32(distance), direction, meeting)


def kept_and_bounds(
    one: SurfaceMesh, other: SurfaceMesh, pose: pin.SE3, distance: float, along: np.ndarray, meeting: bool
) -> tuple[np.ndarray, np.ndarray]:
    """(8, 8) which pairs may be within the distance, and the lower bounds."""
    a, b = bvh_of(one), bvh_of(other)
    ws = workspace_for(a, b)
    ws.pose.matrix[:12] = [*pose.rotation.ravel(), *pose.translation]
    bits = near_pairs_of_packets(a, b, ws, distance, along, meeting) & (2**64 - 1)
    kept = np.array([[bits >> (8 * j + i) & 1 == 1 for j in range(8)] for i in range(8)])
    return kept, ws.bounds[8:72].reshape(8, 8).T.astype(float)
