"""Numba kernels: the signed distance of surfaces at one pose, over two trees, as `kernels_hold.pair_step` has it.

It is what `collision.sweep` asks of pairs that are in contact at the start. Least first, the same branch and bound as
for the distance, with boxes that overlap counted by how far they do.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from collision.kernels_distance import box_gap, move, opened
from collision.kernels_hold import pair_step
from collision.kernels_triangles import planes_part
from collision.predicates import KERNEL


@njit(error_model="numpy", **KERNEL)
def _signed_gap(box_a, i, box_b, j, rotation, translation):
    """Lower bound of the signed distance of triangles in two nodes: the boxes' distance, or minus what parts them."""
    gap = box_gap(box_a, i, box_b, j, rotation, translation)
    if gap > 0.0:
        return np.sqrt(gap)
    most = -np.inf
    bx, by, bz = 0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5])
    hx, hy, hz = box_b[j, 3] - bx, box_b[j, 4] - by, box_b[j, 5] - bz
    for d in range(3):
        half = abs(rotation[d, 0]) * hx + abs(rotation[d, 1]) * hy + abs(rotation[d, 2]) * hz
        offset = rotation[d, 0] * bx + rotation[d, 1] * by + rotation[d, 2] * bz + translation[d]
        middle = 0.5 * (box_a[i, d] + box_a[i, d + 3])
        most = max(most, abs(offset - middle) - half - (box_a[i, d + 3] - middle))
    return most


@njit(error_model="numpy", **KERNEL)
def _leaf_depth(
    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
    rotation, translation, least, rounding, work,
):  # fmt: skip
    """`least`, or the least signed distance of two leaves' triangles if that is less."""
    still = (0.0, 0.0, 0.0)
    for tb in range(first_b[j], first_b[j] + count_b[j]):
        p = move(rotation, translation, vertices_b, corner_b[tb, 0])
        q = move(rotation, translation, vertices_b, corner_b[tb, 1])
        r = move(rotation, translation, vertices_b, corner_b[tb, 2])
        for ta in range(first_a[i], first_a[i] + count_a[i]):
            ia, ib, ic = corner_a[ta, 0], corner_a[ta, 1], corner_a[ta, 2]
            a = (vertices_a[ia, 0], vertices_a[ia, 1], vertices_a[ia, 2])
            b = (vertices_a[ib, 0], vertices_a[ib, 1], vertices_a[ib, 2])
            c = (vertices_a[ic, 0], vertices_a[ic, 1], vertices_a[ic, 2])
            beyond = -np.inf  # what parts their boxes parts the triangles: a lower bound of their signed distance
            for k in range(3):
                low_a, high_a = min(a[k], b[k], c[k]), max(a[k], b[k], c[k])
                low_b, high_b = min(p[k], q[k], r[k]), max(p[k], q[k], r[k])
                beyond = max(beyond, low_b - high_a, low_a - high_b)
            if beyond < least and not planes_part(a, b, c, p, q, r, max(0.0, least)):
                d, _ = pair_step(a, b, c, p, q, r, still, still, still, 0.0, 0.0, least, least, 0.0, rounding, work)
                least = min(least, d)
    return least


@njit(error_model="numpy", **KERNEL)
def _depth(
    root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, work, stack, safe,
):  # fmt: skip
    least = within
    stack[0, 0], stack[0, 1] = root_a, root_b
    safe[0] = -np.inf
    top = 1
    while top > 0:
        top -= 1
        if safe[top] > least + rounding:
            continue
        i, j = stack[top, 0], stack[top, 1]
        if second_a[i] < 0 and second_b[j] < 0:
            least = _leaf_depth(
                i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
                rotation, translation, least, rounding, work,
            )  # fmt: skip
            continue
        i0, j0, i1, j1 = opened(i, j, box_a, second_a, box_b, second_b)
        g0 = _signed_gap(box_a, i0, box_b, j0, rotation, translation)
        g1 = _signed_gap(box_a, i1, box_b, j1, rotation, translation)
        if g0 < g1:
            i0, j0, g0, i1, j1, g1 = i1, j1, g1, i0, j0, g0
        stack[top, 0], stack[top, 1], safe[top] = i0, j0, g0
        stack[top + 1, 0], stack[top + 1, 1], safe[top + 1] = i1, j1, g1
        top += 2
    return least


@njit(error_model="numpy", **KERNEL)
def depths_of(
    pairs, root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, depths, work, stack, safe,
):  # fmt: skip
    """The least signed distance (m) of each pair of surfaces, or `within` (>= 0) if it is more, into `depths`."""
    for k in range(len(pairs)):
        depths[k] = _depth(
            root_a[pairs[k, 0]], root_b[pairs[k, 1]],
            vertices_a, box_a, second_a, first_a, count_a, corner_a,
            vertices_b, box_b, second_b, first_b, count_b, corner_b,
            rotation, translation, within, rounding, work, stack, safe,
        )  # fmt: skip
