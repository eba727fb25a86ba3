"""Exact intersection of surfaces: boxes eight at a time, then triangles.

A floating-point filter in float32 rejects triangles that are apart by more than its error bound; the exact test decides
the others. The test of a pair of surfaces ends at the first two triangles that intersect; these are kept, and tested
first in the next query.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bvh_of
from collision.bvh.layout import LANES, PREPARED
from collision.bvh.packets import moved_triangle, triangle_of
from collision.bvh.traverse import (
    MET,
    TRIANGLE_BOXES,
    TRIANGLES,
    QueryWorkspace,
    fresh_node,
    fresh_packets,
    near_surfaces,
    packet_errors,
    reached,
    sort,
    start,
    walk,
    workspace,
    workspace_for,
)
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inline_kernel, kernel
from collision.numeric.rigid_transforms import relative_pose, take_poses
from collision.numeric.simd import lowest, overlapping_lane, perhaps_meeting
from collision.objects import Objects
from collision.poses import frames, pack
from collision.triangle.intersection import triangles_meet

NO_TRIANGLES: Final = np.empty(0, np.int64)
"""passed instead of a table of triangles if none is kept"""
ALL_ENABLED: Final = np.empty(0, np.uint8)
"""passed instead of a table of enabled pairs of surfaces if all are enabled; read-only like those of `Objects`, since
numba would compile kernels once more for a writable array"""
ALL_ENABLED.setflags(write=False)


class Intersect(NamedTuple):
    """Task: find two triangles that intersect; write 2³²·(triangle of a) + triangle of b, in leaf order, to `met`."""

    met: Any
    """(1,) int64"""

    def children(self, ws, boxes, at, others, at_other):
        """Bits: which boxes of a node overlap a box of the other hierarchy."""
        ws.counts[TRIANGLE_BOXES] += LANES
        return overlapping_lane(boxes, at, others, at_other)

    def visit(self, a, b, ws, lane_a, lane_b):
        """Whether any triangles of two packets intersect."""
        p, q = ~np.int64(a.child[lane_a]), ~np.int64(b.child[lane_b])
        fresh_packets(a, b, ws, p, q)
        shift, half, errors = packet_errors(a, b, ws, lane_a, lane_b)
        first_a, first_b = np.int64(a.first[p]), np.int64(b.first[q])
        tests = LANES
        bits_b = reached(ws, q, shift, half, errors[0])
        while bits_b != 0:
            j = lowest(bits_b)
            bits_b &= bits_b - 1
            tests += LANES
            bits = perhaps_meeting(ws.prepared, PREPARED * p, ws.turned, PREPARED * q + j, shift, errors)
            while bits != 0:
                t = first_a + lowest(bits)
                bits &= bits - 1
                if triangle_pair_meets(a, b, ws, t, first_b + j):
                    self.met[0] = (t << 32) + first_b + j
                    ws.counts[TRIANGLE_BOXES] += tests
                    return True
        ws.counts[TRIANGLE_BOXES] += tests
        return False


@inline_kernel
def triangle_pair_meets(a, b, ws, ta, tb):
    """Whether triangle ta of a intersects the moved triangle tb of b, both in leaf order. Exact."""
    ws.counts[TRIANGLES] += 1
    (u, v, w), (p, q, r) = triangle_of(a, ta), moved_triangle(b, tb, ws.pose.matrix)
    return triangles_meet(u, v, w, p, q, r, ws.exact)


@inline_kernel
def intersecting_surfaces(a, b, ws, met, enabled):
    """Fill `ws.pairs` with the pairs of surfaces that intersect, sorted; return their number, or ~n if `ws.pairs` must
    be able to hold n pairs.

    b is at the pose in `ws.pose.matrix[:12]`. met: (ka·kb,) int64, for each pair of surfaces the triangles that
    intersected in the last query (see `Intersect`), -1 for none; tested first, and updated; or `NO_TRIANGLES`. enabled:
    (ka·kb,) uint8, 0 for pairs of surfaces to leave out; or `ALL_ENABLED`.
    """
    start(a, b, ws)
    near = near_surfaces(a, b, ws, 0.0)
    if near > len(ws.pairs):
        return ~near
    kb, found, task = len(b.root), 0, Intersect(ws.counts[MET:])
    for i in range(near):
        pair = ws.pairs[i]
        if len(enabled) > 0 and enabled[pair] == 0:
            continue
        last = met[pair] if len(met) > 0 else np.int64(-1)
        meet = last >= 0 and triangle_pair_meets(a, b, ws, last >> 32, last & 0xFFFFFFFF)
        if not meet:
            lane_b = np.int64(b.root[pair % kb])
            fresh_node(b, ws, lane_b >> 3)
            meet = walk(task, a, b, ws, np.int64(a.root[pair // kb]), lane_b)
            if len(met) > 0:
                met[pair] = task.met[0] if meet else -1
        if meet:
            ws.pairs[found] = pair
            found += 1
    sort(ws.pairs, found)
    for i in range(found):
        ws.rows[i, 1], ws.rows[i, 3] = ws.pairs[i] // kb, ws.pairs[i] % kb
    return found


@kernel
def intersect(a, b, ws, poses, i, j, met, enabled):
    """Fill `ws.rows` with object, surface, object, surface of the surfaces of objects i and j that intersect.

    poses: (n, 12), world frame, m. Returns as `intersecting_surfaces`.
    """
    relative_pose(poses[i], poses[j], ws.pose.matrix)
    found = intersecting_surfaces(a, b, ws, met, enabled)
    for k in range(found):
        ws.rows[k, 0], ws.rows[k, 2] = i, j
    return found


# --- from Python -----------------------------------------------------------------------------------------------------

intersect_entry, _take_poses = EntryPoint(intersect), EntryPoint(take_poses)


def enabled_pairs(objects: Objects, i: int, j: int) -> NDArray[np.int32]:
    """Return (k, 2) int32, sorted: the enabled pairs of surfaces of two objects that intersect."""
    pairs = intersecting(objects.mesh(i), objects.mesh(j), objects.relative_pose(i, j), objects.checked.rigid)[0]
    enabled = objects.enabled_surfaces(i, j)
    return pairs if enabled is None else pairs[enabled[pairs[:, 0], pairs[:, 1]] != 0]


def intersecting(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, rigid: float
) -> tuple[NDArray[np.int32], QueryWorkspace]:
    """Return (k, 2) int32, sorted: the pairs of surfaces that intersect; and the workspace with its counts.

    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4), m. rigid: see `poses.pack`, which raises PoseError.
    """
    a, b = bvh_of(mesh_a), bvh_of(mesh_b)
    poses, matrix = frames(), getattr(pose_ab, "homogeneous", None)
    if matrix is None or _take_poses.call(matrix[None], rigid, poses[1:]) >= 0:
        poses[1] = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}", rigid=rigid)
    while True:
        ws = workspace_for(a, b)
        found = intersect_entry.call(a, b, ws, poses, 0, 1, NO_TRIANGLES, ALL_ENABLED)
        if found >= 0:
            return ws.rows[:found, 1::2].copy(), ws
        workspace(pairs=~found)
