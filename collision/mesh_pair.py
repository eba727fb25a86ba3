"""Intersection tests of one pair of meshes at many poses, also from kernels, as for sampling motion planners.

    pair = prepare_pair(mesh_a, mesh_b)
    intersecting = intersect_at(pair, poses)    # (n,) bool

A kernel takes the pair as an argument and calls `pair_intersects(pair, pose)` and `pair_contact(pair, pose)`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bvh_of
from collision.bvh.layout import LANES, Bvh
from collision.bvh.packets import moved_triangle, triangle_of
from collision.bvh.traverse import QueryWorkspace, fresh_node, near_surfaces, new_workspace, start, walk
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inline_kernel, kernel
from collision.numeric.vectors import cross, sub, unit
from collision.query.intersection import ALL_ENABLED, Intersect, triangle_pair_meets
from collision.triangle.distance import common_point


class MeshPair(NamedTuple):
    """Two meshes, prepared for intersection tests; for one thread at a time."""

    a: Bvh
    b: Bvh
    workspace: QueryWorkspace
    enabled: Any
    """(surfaces of a · surfaces of b,) uint8, 0 for pairs of surfaces that are not tested; empty if all are"""
    last: Any
    """(1,) int64: the triangles that intersected last (see `Intersect`), tested first; -1 for none"""


def prepare_pair(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, enabled: NDArray[np.uint8] | None = None) -> MeshPair:
    """Return a pair of meshes with a workspace of its own.

    enabled: (surfaces of a, surfaces of b), 0 for pairs of surfaces that may intersect; None tests all.

    Raises
    ------
    CollisionError: `enabled` has another shape.
    """
    a, b, mask = bvh_of(mesh_a), bvh_of(mesh_b), ALL_ENABLED
    shape = mesh_a.n_surfaces, mesh_b.n_surfaces
    if enabled is not None and enabled.shape != shape:
        raise CollisionError(f"enabled has shape {enabled.shape}; the meshes have {shape} surfaces")
    if enabled is not None and not enabled.all():
        mask = enabled.astype(np.uint8).ravel()
        mask.setflags(write=False)
    nodes, packets = max(len(a.child), len(b.child)) // LANES, max(len(a.first), len(b.first)) - 1
    return MeshPair(a, b, new_workspace(nodes, packets, max(64, len(mask))), mask, np.full(1, -1, np.int64))


@inline_kernel
def pair_intersects(pair, pose):
    """Whether b at `pose` (12,), rotation by rows and translation in m in a's frame, intersects a. Exact."""
    a, b, ws, last = pair.a, pair.b, pair.workspace, pair.last[0]
    for d in range(12):
        ws.pose.matrix[d] = pose[d]
    start(a, b, ws)
    if last >= 0 and triangle_pair_meets(a, b, ws, last >> 32, last & 0xFFFFFFFF):
        return True
    kb, n = len(b.root), 1
    if len(pair.enabled) > 0:
        n = near_surfaces(a, b, ws, 0.0)
    for k in range(n):
        lane_a = lane_b = np.int64(0)
        if len(pair.enabled) > 0:
            surfaces = ws.pairs[k]
            if pair.enabled[surfaces] == 0:
                continue
            lane_a, lane_b = np.int64(a.root[surfaces // kb]), np.int64(b.root[surfaces % kb])
        fresh_node(b, ws, lane_b >> 3)
        if walk(Intersect(pair.last), a, b, ws, lane_a, lane_b):
            return True
    return False


@inline_kernel
def pair_contact(pair, pose):
    """(point, unit normal of a's triangle, of b's), in a's frame, of the triangles that `pair_intersects` found."""
    one = triangle_of(pair.a, pair.last[0] >> 32)
    other = moved_triangle(pair.b, pair.last[0] & 0xFFFFFFFF, pose)
    point = common_point(one[0], one[1], one[2], other[0], other[1], other[2])
    return point, _normal(one), _normal(other)


@inline_kernel
def _normal(t):
    return unit(cross(sub(t[1], t[0]), sub(t[2], t[0])))


def last_surfaces(pair: MeshPair, mesh_a: SurfaceMesh, mesh_b: SurfaceMesh) -> tuple[int, int] | None:
    """Return the surfaces of a and of b whose triangles intersected last, None if none did."""
    last = int(pair.last[0])
    if last < 0:
        return None
    a, b = int(pair.a.order[last >> 32]), int(pair.b.order[last & 0xFFFFFFFF])
    return int(mesh_a.surface_of_triangle[a]), int(mesh_b.surface_of_triangle[b])


@kernel
def test_poses(pair, poses, out):
    """Fill `out` (n,) bool: whether the pair intersects at each of `poses` (n, 12)."""
    for k in range(len(poses)):
        out[k] = pair_intersects(pair, poses[k])


_test_poses = EntryPoint(test_poses)


def intersect_at(pair: MeshPair, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (n,) bool: whether the pair intersects at each pose; touching counts, enabled surfaces only.

    poses: (n, 12) of b in a's frame: rotation by rows, then translation, m. They are not checked.
    """
    poses, out = np.ascontiguousarray(poses, np.float64).reshape(-1, 12), np.empty(len(poses), np.bool_)
    _test_poses.call(pair, poses, out)
    return out
