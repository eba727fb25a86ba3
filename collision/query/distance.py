"""Distances of surfaces and parts with their witness points: nearest boxes first, then triangles.

Distances are those of the triangles. Two surfaces are at distance 0 if and only if they intersect by the exact test; a
positive distance has the rounding error of float64 arithmetic in a's frame (about 1e-15 of the coordinates). Boxes and
float32 bounds of triangles only exclude what is farther than the nearest triangles so far; the nearest triangles of
the last query are tested first.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.bvh.build import bvh_of
from collision.bvh.layout import LANES, Bvh
from collision.bvh.packets import moved_triangle, near_triangles, nearest_of, triangle_of
from collision.bvh.traverse import (
    MET,
    SURFACE_BOXES,
    TRIANGLE_BOXES,
    TRIANGLES,
    float_limit,
    fresh_node,
    near_surfaces,
    sort,
    start,
    walk,
    walk_nearest,
    workspace,
    workspace_for,
)
from collision.contact import CONTACT_DTYPE
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inline_kernel, kernel
from collision.numeric.rigid_transforms import relative_pose
from collision.numeric.simd import near_lane
from collision.poses import frames
from collision.query.intersection import ALL_ENABLED, NO_TRIANGLES, Intersect
from collision.triangle.distance import ROUNDING, closest_features, common_point, planes_part
from collision.triangle.intersection import triangles_meet

TINIEST: Final = float(np.finfo(np.float64).tiny)
"""m: least distance returned for triangles that do not intersect"""


class NearestTriangles(NamedTuple):
    """Task: find the nearest two triangles."""

    best: Any
    """(11,) float64, m: least distance so far, or its upper limit; point of a, point of b, both in a's frame; rounding
    error of distances; unit vector from the point of a to that of b, or 0"""
    limit: Any
    """(2,) float32: greatest squared distance (m²), and distance (m), still to be searched, rounded up"""
    hit: Any
    """(1,) int64: 2^32·(triangle of a) + triangle of b, in leaf order; -1 while none is within `best[0]`"""

    def children(self, ws, boxes, at, others, at_other):
        """Bits: which boxes of a node come within the limit of a box of the other hierarchy."""
        ws.counts[TRIANGLE_BOXES] += LANES
        return near_lane(boxes, at, others, at_other, self.limit[0], ws.bounds)

    def is_open(self, ws, bound):
        """Whether a pair of boxes of this squared distance (m²) may hold nearer triangles."""
        return bound <= self.limit[0]

    def visit(self, a, b, ws, lane_a, lane_b):
        """Update `self` with the triangles of two packets, in the order of their bounds; return whether any meet."""
        best = self.best
        along = np.float32(best[8]), np.float32(best[9]), np.float32(best[10])
        bits = near_triangles(a, b, ws, lane_a, lane_b, self.limit[1], along, False)
        first_a, first_b = np.int64(a.first[~a.child[lane_a]]), np.int64(b.first[~b.child[lane_b]])
        while bits != 0:
            i = nearest_of(ws, bits)
            bits &= ~(np.int64(1) << i)
            if ws.bounds[LANES + i] > self.limit[1]:
                break
            if look_at_triangles(self, a, b, ws, first_a + (i & 7), first_b + (i >> 3)):
                return True
        return False


@inline_kernel
def set_limit(task):
    """Set `task.limit` from `task.best[0]`.

    Triangles farther apart than rounding do not intersect, and one nearer by less than rounding is no improvement.
    """
    bound, rounding = task.best[0], task.best[7]
    reach = bound - rounding if task.hit[0] >= 0 and bound > 4.0 * rounding else bound + rounding
    task.limit[0], task.limit[1] = float_limit(reach * reach), float_limit(reach)


@inline_kernel
def look_at_triangles(task, a, b, ws, ta, tb):
    """Update `task` with triangles ta of a and tb of b, in leaf order; return whether they intersect."""
    best = task.best
    bound, rounding = best[0], best[7]
    (u, v, w), (p, q, r) = triangle_of(a, ta), moved_triangle(b, tb, ws.pose.matrix)
    square = 0.0
    for d in range(3):
        gap = max(min(u[d], v[d], w[d]) - max(p[d], q[d], r[d]), min(p[d], q[d], r[d]) - max(u[d], v[d], w[d]))
        if gap > 0.0:
            square += gap * gap
    if square > (bound + rounding) * (bound + rounding):
        return False
    ws.counts[TRIANGLES] += 1
    # triangles intersect only if their boxes are within rounding of each other
    if square <= rounding * rounding and triangles_meet(u, v, w, p, q, r, ws.exact):
        x = common_point(u, v, w, p, q, r)
        best[0], task.hit[0] = 0.0, (ta << 32) | tb
        for d in range(3):
            best[1 + d], best[4 + d] = x[d], x[d]
        return True
    if bound == 0.0:
        return False
    if task.hit[0] >= 0 and bound > 4.0 * rounding and planes_part((u, v, w), (p, q, r), bound - rounding):
        return False  # no nearer by more than rounding: the case of all pairs of triangles of two parallel faces
    d2, x, y = closest_features(u, v, w, p, q, r)
    distance = max(np.sqrt(d2), TINIEST)
    better = distance < bound or (distance == bound and task.hit[0] < 0)
    if better or task.hit[0] < 0:  # the neighbours of a distant triangle are often distant along the same direction
        for d in range(3):
            best[8 + d] = (y[d] - x[d]) / distance if distance > 1e-140 else 0.0  # else squares may have underflowed
    if better:
        best[0], task.hit[0] = distance, (ta << 32) | tb
        for d in range(3):
            best[1 + d], best[4 + d] = x[d], y[d]
        set_limit(task)
    return False


@inline_kernel
def rounding_of(a, b, matrix):
    """Error bound of a distance of points, m, from the size of their coordinates and the error of the rotation."""
    reach, off = max(a.frame[6], b.frame[6]), 0.0
    for i in range(3):
        reach = max(reach, abs(matrix[9 + i]))
        for j in range(3):
            d = -1.0 if i == j else 0.0
            for k in range(3):
                d += matrix[3 * k + i] * matrix[3 * k + j]
            off = max(off, abs(d))
    return (ROUNDING + 4.0 * off) * 2.0 * reach


@inline_kernel
def nearest_triangles(task, a, b, ws, lane_a, lane_b, last):
    """Find the nearest triangles below two boxes within `task.best[0]`; return whether there are any.

    last: (1,) int64, the nearest triangles of the last query, -1 for none; updated. (0,) if they are not kept.
    """
    task.hit[0] = -1
    task.best[8] = task.best[9] = task.best[10] = 0.0
    set_limit(task)
    meet = False
    if len(last) > 0 and last[0] >= 0:
        meet = look_at_triangles(task, a, b, ws, last[0] >> 32, last[0] & 0xFFFFFFFF)
    if not meet:
        fresh_node(b, ws, lane_b >> 3)
        if walk(Intersect(task.hit), a, b, ws, lane_a, lane_b):  # intersections are found sooner without distances
            look_at_triangles(task, a, b, ws, task.hit[0] >> 32, task.hit[0] & 0xFFFFFFFF)
        else:
            walk_nearest(task, a, b, ws, lane_a, lane_b, np.float32(0.0))
    if len(last) > 0:
        last[0] = task.hit[0]
    return task.hit[0] >= 0


@inline_kernel
def set_row(task, a, b, world, i, j, row):
    """Write the result of `task` to a row of CONTACT_DTYPE, its points moved by the pose `world` of a."""
    best, ta, tb = task.best, task.hit[0] >> 32, task.hit[0] & 0xFFFFFFFF
    row.object_a, row.object_b, row.distance = i, j, best[0]
    row.triangle_a, row.triangle_b = a.order[ta], b.order[tb]
    for d in range(3):
        row.point_a[d] = world[3 * d] * best[1] + world[3 * d + 1] * best[2] + world[3 * d + 2] * best[3] + world[9 + d]
        row.point_b[d] = world[3 * d] * best[4] + world[3 * d + 1] * best[5] + world[3 * d + 2] * best[6] + world[9 + d]


@kernel
def contacts(a, b, ws, poses, i, j, within, enabled, near, rows):
    """Fill `rows` (CONTACT_DTYPE, world frame) with the pairs of surfaces of objects i and j at most `within` (m)
    apart.

    Sorted by surface of i, surface of j. poses: (n, 12), of the objects in the world. enabled: (ka·kb,) uint8, 0 for
    pairs of surfaces to leave out; (0,) enables all. near: (ka·kb,) int64, the nearest triangles of the last query, -1
    for none; (0,) if they are not kept. Returns the number of rows, or ~n if `ws.pairs` and `rows` must be able to hold
    n pairs of surfaces.
    """
    relative_pose(poses[i], poses[j], ws.pose.matrix)
    start(a, b, ws)
    task = NearestTriangles(ws.floats, ws.bounds[9 * LANES :], ws.counts[MET:])
    rounding = rounding_of(a, b, ws.pose.matrix)
    n = near_surfaces(a, b, ws, (within + rounding) * (within + rounding))
    if n > len(ws.pairs) or n > len(rows):
        return ~n
    sort(ws.pairs, n)
    kb, found = len(b.root), 0
    for k in range(n):
        pair = ws.pairs[k]
        if len(enabled) > 0 and enabled[pair] == 0:
            continue
        s, t = pair // kb, pair % kb
        task.best[0], task.best[7] = within, rounding
        last = near[pair : pair + 1] if len(near) > 0 else near[0:0]
        if nearest_triangles(task, a, b, ws, np.int64(a.root[s]), np.int64(b.root[t]), last):
            row = rows[found]
            set_row(task, a, b, poses[i], i, j, row)
            row.surface_a, row.surface_b = s, t
            found += 1
    return found


@kernel
def clearance(a, b, ws, poses, i, j, bound, last, rows):
    """Fill `rows[0]` (CONTACT_DTYPE, world frame) with the nearest triangles of objects i and j; return 1, or 0 for
    none within `bound` (m).

    last: (3,) int64, the lane of each object (0, or that of a surface) and the nearest triangles of the last query, or
    -1. The surfaces of the row are not filled in.
    """
    relative_pose(poses[i], poses[j], ws.pose.matrix)
    start(a, b, ws)
    task = NearestTriangles(ws.floats, ws.bounds[9 * LANES :], ws.counts[MET:])
    task.best[0], task.best[7] = bound, rounding_of(a, b, ws.pose.matrix)
    ws.counts[SURFACE_BOXES] += 1
    if not nearest_triangles(task, a, b, ws, last[0], last[1], last[2:]):
        return 0
    set_row(task, a, b, poses[i], i, j, rows[0])
    return 1


contacts_entry, clearance_entry = EntryPoint(contacts), EntryPoint(clearance)


def contacts_at(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, within: float, enabled: NDArray[np.uint8] | None = None
) -> NDArray[Any]:
    """Return CONTACT_DTYPE rows, in a's frame, of the pairs of surfaces at most `within` (m) apart.

    pose_ab: `pinocchio.SE3`, of b in a's frame. enabled: (ka, kb), 0 for pairs of surfaces to leave out. `object_a` is
    0 and `object_b` is 1.
    """
    mask = ALL_ENABLED if enabled is None else enabled
    return contacts_between(bvh_of(mesh_a), bvh_of(mesh_b), frames(pose_ab), float(within), mask)


def contacts_between(
    a: Bvh, b: Bvh, poses: NDArray[np.float64], within: float, enabled: NDArray[np.uint8]
) -> NDArray[Any]:
    """Return CONTACT_DTYPE rows, in the world frame, of the pairs of surfaces at most `within` (m) apart.

    poses: (2, 12), of both in the world. enabled: (ka, kb), 0 for pairs of surfaces to leave out, or `ALL_ENABLED`.
    `object_a` is 0 and `object_b` is 1.
    """
    mask = enabled.ravel()
    mask.setflags(write=False)  # as `ALL_ENABLED`
    while True:
        ws = workspace_for(a, b)
        rows = np.zeros(len(ws.pairs), CONTACT_DTYPE)
        found = contacts_entry.call(a, b, ws, poses, 0, 1, within, mask, NO_TRIANGLES, rows)
        if found >= 0:
            return rows[:found]
        workspace(pairs=~found)


def clearance_at(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, surface_a: int | None = None, surface_b: int | None = None,
    bound: float = np.inf,
) -> NDArray[Any]:  # fmt: skip
    """Return one CONTACT_DTYPE row, in a's frame, of the nearest triangles within `bound` (m), or no row.

    pose_ab: `pinocchio.SE3`, of b in a's frame. For a mesh wholly inside another it is the distance of their surfaces.
    """
    a, b, rows = bvh_of(mesh_a), bvh_of(mesh_b), np.zeros(1, CONTACT_DTYPE)
    last = lanes_of(a, b, surface_a, surface_b)
    found = clearance_entry.call(a, b, workspace_for(a, b), frames(pose_ab), 0, 1, float(bound), last, rows)
    return with_surfaces(rows[:found], mesh_a, mesh_b)


def lanes_of(a: Bvh, b: Bvh, surface_a: int | None, surface_b: int | None) -> NDArray[np.int64]:
    """Return the `last` of `clearance` for the first query of two meshes, or of a surface of either."""
    lane_a = 0 if surface_a is None else int(a.root[surface_a])
    lane_b = 0 if surface_b is None else int(b.root[surface_b])
    return np.array([lane_a, lane_b, -1], np.int64)


def with_surfaces(rows: NDArray[Any], mesh_a: SurfaceMesh, mesh_b: SurfaceMesh) -> NDArray[Any]:
    """Set the surfaces of rows to those of their triangles."""
    rows["surface_a"] = mesh_a.surface_of_triangle[rows["triangle_a"]]
    rows["surface_b"] = mesh_b.surface_of_triangle[rows["triangle_b"]]
    return rows
