"""Axis-aligned boxes of triangles and surfaces, and the overlap of two (OAABB). Kernels.

A box is a row (least x, y, z, greatest x, y, z), closed: boxes that touch overlap. Boxes of the very coordinates that
are tested lose nothing, so no inflation is needed here.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.predicates import KERNEL


@njit(**KERNEL)
def take_pose(matrix, rigid, pose):
    """Pack the (4, 4) `matrix` into `pose` (see `collision.poses`); whether it is a finite rigid motion."""
    for d in range(3):
        for e in range(3):
            pose[3 * d + e] = matrix[d, e]
        pose[9 + d] = matrix[d, 3]
    off = 0.0
    for d in range(3):
        for e in range(d, 3):
            product = pose[d] * pose[e] + pose[3 + d] * pose[3 + e] + pose[6 + d] * pose[6 + e]
            off = max(off, abs(product - (1.0 if d == e else 0.0)))
        if not np.isfinite(pose[9 + d]) or matrix[3, d] != 0.0:
            return False
    det = (
        pose[0] * (pose[4] * pose[8] - pose[5] * pose[7])
        + pose[1] * (pose[5] * pose[6] - pose[3] * pose[8])
        + pose[2] * (pose[3] * pose[7] - pose[4] * pose[6])
    )
    return off <= rigid and det > 0.0 and matrix[3, 3] == 1.0  # NaN: det > 0 is false


@njit(cache=True, nogil=True)
def transform(vertices, pose, out):
    """Place `vertices` (n, 3), moved by the (12,) pose, in `out`: the arithmetic by which all methods move points."""
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        out[i, 0] = pose[0] * x + pose[1] * y + pose[2] * z + pose[9]
        out[i, 1] = pose[3] * x + pose[4] * y + pose[5] * z + pose[10]
        out[i, 2] = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]


@njit(cache=True, nogil=True)
def triangle_boxes(vertices, corner, out):
    """Place the boxes of the triangles `corner` (m, 3) in `out` (m, 6)."""
    for i in range(len(corner)):
        a, b, c = corner[i, 0], corner[i, 1], corner[i, 2]
        for d in range(3):
            x, y, z = vertices[a, d], vertices[b, d], vertices[c, d]
            out[i, d] = min(x, y, z)
            out[i, d + 3] = max(x, y, z)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def oaabb(a, i, b, j, out):
    """Place the overlap of the boxes `a[i]` and `b[j]`, itself a box, in `out` (1, 6)."""
    for d in range(3):
        out[0, d] = max(a[i, d], b[j, d])
        out[0, d + 3] = min(a[i, d + 3], b[j, d + 3])
