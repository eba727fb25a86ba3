"""The algorithm of Figueiredo and Fernando for two objects, with overlap boxes (OAABB) and without, and its counts.

Stage 2 pairs surfaces, stage 3 the triangles of each pair of surfaces. With OAABBs, stage 2 pairs only surfaces whose
boxes overlap the intersection of the two objects' boxes, and stage 3 only triangles whose boxes overlap the
intersection of the two surfaces' boxes. Without, all surfaces are paired, and all triangles of surfaces whose boxes
overlap. Both end the test of a pair of surfaces at the first two triangles that intersect.

A box is a row (least x, y, z, greatest x, y, z), closed: boxes that touch overlap. Boxes are computed from the
coordinates that are tested, so they need no inflation.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.mesh import SurfaceMesh
from collision.numeric.kernel import kernel
from collision.numeric.predicates import FALLBACKS, workspace
from collision.numeric.rigid_transforms import transform
from collision.numeric.vectors import row
from collision.poses import pack
from collision.reference.shape import triangles_needed
from collision.statistics import Statistics
from collision.triangle.intersection import triangles_meet


class Soup(NamedTuple):
    """Input of the algorithm: m triangles sorted by surface, those of surface s at `start[s]` … `start[s + 1]` - 1."""

    vertices: Any
    """(n, 3) float64, m"""
    corner: Any
    """(m, 3) int32: the triangles' vertices"""
    start: Any
    """(k + 1,) int64"""
    box: Any
    """(m, 6) float64, m: of the triangles"""
    group: Any
    """(k, 6) float64, m: of the surfaces"""


def plain_pairs_of(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, rigid: float, clip: bool
) -> tuple[NDArray[np.int32], Statistics]:
    """Return the pairs of surfaces that intersect, (k, 2) int32, sorted, and the counts; clip: use OAABBs.

    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4). rigid: see `poses.pack`, which raises.
    """
    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}", rigid=rigid)
    counts = np.zeros(5, np.int64)
    pairs = plain_pairs(_soup(mesh_a), _soup(mesh_b), pose, clip, workspace(), counts)
    return pairs.copy(), Statistics(*counts.tolist())


def _soup(mesh: SurfaceMesh) -> Soup:
    """The `Soup` of a mesh in its own frame; kept on the mesh."""
    cached = mesh._cache.get("plain")
    if cached is None:
        triangles_needed(mesh)
        corner = mesh.triangles[mesh.order]
        box, group = np.empty((mesh.n_triangles, 6)), np.empty((mesh.n_surfaces, 6))
        triangle_boxes(mesh.vertices, corner, box)
        group_boxes(box, mesh.surface_start, group)
        cached = mesh._cache["plain"] = Soup(mesh.vertices, corner, mesh.surface_start, box, group)
    return cached


# --- kernels ---------------------------------------------------------------------------------------------------------


@kernel(allocates=True)
def plain_pairs(a, given, pose, clip, w, counts):
    """Return the colliding surfaces of a and of b, given and moved by `pose`, as rows of their numbers, sorted.

    a, given: each a `Soup` in its own frame. clip: use OAABBs. counts: see `Statistics`.
    """
    vertices, box, group = np.empty(given.vertices.shape), np.empty(given.box.shape), np.empty(given.group.shape)
    b = Soup(vertices, given.corner, given.start, box, group)
    for i in range(len(vertices)):
        vertices[i, 0], vertices[i, 1], vertices[i, 2] = transform(pose, row(given.vertices, i))
    triangle_boxes(b.vertices, b.corner, b.box)
    group_boxes(b.box, b.start, b.group)
    ka, kb, whole = len(a.group), len(b.group), np.empty((3, 6))
    group_boxes(a.group, np.array([0, ka]), whole[0:1])
    group_boxes(b.group, np.array([0, kb]), whole[1:2])
    pairs = np.empty((ka * kb, 2), np.int32)
    n = 0
    if not overlap(whole, 0, whole, 1):
        return pairs[:0]
    counts[0] += 1
    oaabb(whole, 0, whole, 1, whole[2:3])
    near_a, near_b = np.empty(ka, np.int64), np.empty(kb, np.int64)
    na = _clip(a.group, 0, ka, whole[2:3], clip, near_a, counts, 1)
    nb = _clip(b.group, 0, kb, whole[2:3], clip, near_b, counts, 1)
    inside_a, inside_b = np.empty(len(a.box), np.int64), np.empty(len(b.box), np.int64)
    common = np.empty((1, 6))
    for i in range(na):
        for j in range(nb):
            sa, sb = near_a[i], near_b[j]
            counts[1] += 1
            if not overlap(a.group, sa, b.group, sb):
                continue
            oaabb(a.group, sa, b.group, sb, common)
            ma = _clip(a.box, a.start[sa], a.start[sa + 1], common, clip, inside_a, counts, 2)
            mb = _clip(b.box, b.start[sb], b.start[sb + 1], common, clip, inside_b, counts, 2)
            if _any_meet(a, inside_a[:ma], b, inside_b[:mb], w, counts):
                pairs[n, 0] = sa
                pairs[n, 1] = sb
                n += 1
    counts[4] = int(w[FALLBACKS])
    return pairs[:n]


@kernel(allocates=True)
def _clip(boxes, begin, end, common, clip, inside, counts, counter):
    """Fill `inside` with the boxes begin … end - 1 that overlap the OAABB `common`, or all unless `clip`; return their
    number."""
    n = 0
    for i in range(begin, end):
        if not clip or overlap(boxes, i, common, 0):
            inside[n] = i
            n += 1
    if clip:
        counts[counter] += end - begin
    return n


@kernel(allocates=True)
def _any_meet(a, inside_a, b, inside_b, w, counts):
    for ta in inside_a:
        p1, q1, r1 = _triangle(a, ta)
        for tb in inside_b:
            counts[2] += 1
            if not overlap(a.box, ta, b.box, tb):
                continue
            counts[3] += 1
            p2, q2, r2 = _triangle(b, tb)
            if triangles_meet(p1, q1, r1, p2, q2, r2, w):
                return True
    return False


@kernel(allocates=True)
def _triangle(soup, t):
    x, corner = soup.vertices, soup.corner
    return row(x, corner[t, 0]), row(x, corner[t, 1]), row(x, corner[t, 2])


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
    meet = True
    for d in range(3):
        meet = meet and a[i, d] <= b[j, d + 3] and b[j, d] <= a[i, d + 3]
    return meet


@kernel(allocates=True)
def oaabb(a, i, b, j, out):
    """Place the overlap of the boxes `a[i]` and `b[j]`, itself a box, in `out` (1, 6)."""
    for d in range(3):
        out[0, d] = max(a[i, d], b[j, d])
        out[0, d + 3] = min(a[i, d + 3], b[j, d + 3])
