"""The algorithm of Figueiredo and Fernando for two objects, with overlap boxes (OAABB) and without, and its counts.

Stage 2 pairs surfaces, stage 3 the triangles of each pair of surfaces. With OAABBs, stage 2 pairs only surfaces that
reach into the overlap of the two objects' boxes, and stage 3 only triangles that reach into the overlap of the two
surfaces' boxes. Without, all surfaces are paired, and all triangles of surfaces whose boxes overlap. Both end a pair of
surfaces at its first two triangles that intersect.

A box is a row (least x, y, z, greatest x, y, z), closed: boxes that touch overlap. Boxes are made of the coordinates
that are tested, so they need no inflation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.mesh import SurfaceMesh
from collision.numeric.kernel import kernel
from collision.numeric.predicates import FALLBACKS, workspace
from collision.poses import pack
from collision.reference.shape import triangles_needed
from collision.statistics import Statistics
from collision.triangle.intersection import triangles_meet


def plain_pairs_of(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, rigid: float, clip: bool
) -> tuple[NDArray[np.int32], Statistics]:
    """Return the pairs of surfaces that intersect, (k, 2) int32, sorted, and the counts; clip: use OAABBs.

    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4). rigid: see `poses.pack`, which raises.
    """
    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}", rigid=rigid)
    corner_a, box_a, group_a = _boxes(mesh_a)
    corner_b, _, _ = _boxes(mesh_b)
    counts = np.zeros(5, np.int64)
    pairs = plain_pairs(
        mesh_a.vertices, corner_a, mesh_a.surface_start, box_a, group_a,
        mesh_b.vertices, corner_b, mesh_b.surface_start, pose, clip, workspace(), counts,
    )  # fmt: skip
    return pairs.copy(), Statistics(*counts.tolist())


def _boxes(mesh: SurfaceMesh) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Vertices (m, 3) and boxes (m, 6) of the triangles by surface, boxes (k, 6) of the surfaces; kept on the mesh."""
    cached = mesh._cache.get("plain")
    if cached is None:
        triangles_needed(mesh)
        corner = mesh.triangles[mesh.order]
        box, group = np.empty((mesh.n_triangles, 6)), np.empty((mesh.n_surfaces, 6))
        triangle_boxes(mesh.vertices, corner, box)
        group_boxes(box, mesh.surface_start, group)
        cached = mesh._cache["plain"] = (corner, box, group)
    return cached


# --- kernels ---------------------------------------------------------------------------------------------------------


@kernel(allocates=True)
def plain_pairs(
    vertices_a, corner_a, start_a, box_a, group_a, vertices_b, corner_b, start_b, pose, clip, w, counts
):  # fmt: skip
    """Return the colliding surfaces of a and of b moved by `pose`, as rows of (surface of a, surface of b), sorted.

    `corner_*`: (m, 3) vertices of the triangles by surface, those of surface s at `start[s]` … `start[s + 1]`;
    `box_a`, `group_a`: boxes of the triangles and of the surfaces of a; `clip`: use OAABBs; `counts`: see `Statistics`.
    """
    moved = np.empty_like(vertices_b)
    transform(vertices_b, pose, moved)
    box_b = np.empty((len(corner_b), 6))
    triangle_boxes(moved, corner_b, box_b)
    ka, kb = len(start_a) - 1, len(start_b) - 1
    group_b = np.empty((kb, 6))
    group_boxes(box_b, start_b, group_b)
    whole = np.empty((3, 6))
    group_boxes(group_a, np.array([0, ka]), whole[0:1])
    group_boxes(group_b, np.array([0, kb]), whole[1:2])
    pairs = np.empty((ka * kb, 2), np.int32)
    n = 0
    if not overlap(whole, 0, whole, 1):
        return pairs[:0]
    counts[0] += 1
    oaabb(whole, 0, whole, 1, whole[2:3])
    near_a, near_b = np.empty(ka, np.int64), np.empty(kb, np.int64)
    na = _clip(group_a, 0, ka, whole[2:3], clip, near_a, counts, 1)
    nb = _clip(group_b, 0, kb, whole[2:3], clip, near_b, counts, 1)
    inside_a, inside_b = np.empty(len(corner_a), np.int64), np.empty(len(corner_b), np.int64)
    common = np.empty((1, 6))
    for i in range(na):
        for j in range(nb):
            sa, sb = near_a[i], near_b[j]
            counts[1] += 1
            if not overlap(group_a, sa, group_b, sb):
                continue
            oaabb(group_a, sa, group_b, sb, common)
            ma = _clip(box_a, start_a[sa], start_a[sa + 1], common, clip, inside_a, counts, 2)
            mb = _clip(box_b, start_b[sb], start_b[sb + 1], common, clip, inside_b, counts, 2)
            if _any_meet(vertices_a, corner_a, box_a, inside_a, ma, moved, corner_b, box_b, inside_b, mb, w, counts):
                pairs[n, 0] = sa
                pairs[n, 1] = sb
                n += 1
    counts[4] = int(w[FALLBACKS])
    return pairs[:n]


@kernel(allocates=True)
def _clip(boxes, begin, end, common, clip, inside, counts, counter):
    """Fill `inside` with the boxes begin … end - 1 that overlap the OAABB `common`, all unless `clip`; how many."""
    n = 0
    for i in range(begin, end):
        if not clip or overlap(boxes, i, common, 0):
            inside[n] = i
            n += 1
    if clip:
        counts[counter] += end - begin
    return n


@kernel(allocates=True)
def _any_meet(vertices_a, corner_a, box_a, inside_a, ma, vertices_b, corner_b, box_b, inside_b, mb, w, counts):
    for i in range(ma):
        ta = inside_a[i]
        p1 = _point(vertices_a, corner_a[ta, 0])
        q1 = _point(vertices_a, corner_a[ta, 1])
        r1 = _point(vertices_a, corner_a[ta, 2])
        for j in range(mb):
            tb = inside_b[j]
            counts[2] += 1
            if not overlap(box_a, ta, box_b, tb):
                continue
            counts[3] += 1
            p2 = _point(vertices_b, corner_b[tb, 0])
            q2 = _point(vertices_b, corner_b[tb, 1])
            r2 = _point(vertices_b, corner_b[tb, 2])
            if triangles_meet(p1, q1, r1, p2, q2, r2, w):
                return True
    return False


@kernel(allocates=True)
def _point(vertices, i):
    return vertices[i, 0], vertices[i, 1], vertices[i, 2]


@kernel(allocates=True)
def transform(vertices, pose, out):
    """Fill `out` with `vertices` (n, 3) moved by the (12,) pose, in the order of operations of all methods."""
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        out[i, 0] = pose[0] * x + pose[1] * y + pose[2] * z + pose[9]
        out[i, 1] = pose[3] * x + pose[4] * y + pose[5] * z + pose[10]
        out[i, 2] = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]


@kernel(allocates=True)
def triangle_boxes(vertices, corner, out):
    """Place the boxes of the triangles `corner` (m, 3) in `out` (m, 6)."""
    for i in range(len(corner)):
        a, b, c = corner[i, 0], corner[i, 1], corner[i, 2]
        for d in range(3):
            x, y, z = vertices[a, d], vertices[b, d], vertices[c, d]
            out[i, d] = min(x, y, z)
            out[i, d + 3] = max(x, y, z)


@kernel(allocates=True)
def group_boxes(boxes, start, out):
    """Place the boxes of consecutive groups `boxes[start[s]:start[s + 1]]` in `out` (k, 6)."""
    for s in range(len(start) - 1):
        for d in range(3):
            low, high = np.inf, -np.inf
            for i in range(start[s], start[s + 1]):
                low = min(low, boxes[i, d])
                high = max(high, boxes[i, d + 3])
            out[s, d] = low
            out[s, d + 3] = high


@kernel(allocates=True)
def overlap(a, i, b, j):
    """Whether the boxes `a[i]` and `b[j]` have a point in common."""
    return (
        a[i, 0] <= b[j, 3]
        and b[j, 0] <= a[i, 3]
        and a[i, 1] <= b[j, 4]
        and b[j, 1] <= a[i, 4]
        and a[i, 2] <= b[j, 5]
        and b[j, 2] <= a[i, 5]
    )


@kernel(allocates=True)
def oaabb(a, i, b, j, out):
    """Place the overlap of the boxes `a[i]` and `b[j]`, itself a box, in `out` (1, 6)."""
    for d in range(3):
        out[0, d] = max(a[i, d], b[j, d])
        out[0, d + 3] = min(a[i, d + 3], b[j, d + 3])
