"""Stage 2, filter surfaces, and stage 3 within each pair: the plain algorithm, with and without OAABB. Kernels.

With OAABB, at both levels: of each object only the surfaces that reach into the overlap of the two objects' boxes are
paired, and of each pair of surfaces only the triangles that reach into the overlap of the two surfaces' boxes. Without,
all surfaces are paired, and all triangles of pairs whose boxes overlap. Either way a pair of surfaces is done at its
first pair of triangles that meet.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.boxes import group_boxes, oaabb, overlap, transform, triangle_boxes
from collision.polygons import triangles_meet
from collision.predicates import FALLBACKS


@njit(cache=True, nogil=True)
def plain_pairs(
    vertices_a, corner_a, start_a, box_a, group_a, vertices_b, corner_b, start_b, pose, clip, w, counts
):  # fmt: skip
    """The colliding surfaces of a and of b moved by `pose`, as rows of (surface of a, surface of b), sorted.

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


@njit(cache=True, nogil=True)
def _clip(boxes, begin, end, common, clip, inside, counts, counter):
    """The boxes begin … end - 1 that reach into the OAABB `common` (all of them unless `clip`); how many."""
    n = 0
    for i in range(begin, end):
        if not clip or overlap(boxes, i, common, 0):
            inside[n] = i
            n += 1
    if clip:
        counts[counter] += end - begin
    return n


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _point(vertices, i):
    return vertices[i, 0], vertices[i, 1], vertices[i, 2]
