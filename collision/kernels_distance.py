"""Numba kernels of `collision.proximity`: closest points of surfaces, and surfaces that are near, over two trees.

Triangles of b are moved into a's frame as `move` does it, by one rotation and one translation. Whether two triangles
meet is decided by the exact predicate alone; a box or a plane may only rule a pair out when it does so beyond the
rounding of its own arithmetic.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.kernels_triangles import ROUNDING, closest_features, common_point, planes_part
from collision.polygons import triangles_meet
from collision.predicates import KERNEL

STACK: Final = 512
"""Places on a traversal's stack: more than the depths of two trees together."""


@njit(error_model="numpy", **KERNEL)
def move(rotation, translation, vertices, i):
    """Vertex i moved by a pose: the one formula by which a vertex of b comes into a's frame."""
    x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0],
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1],
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2],
    )


@njit(error_model="numpy", **KERNEL)
def box_gap(box_a, i, box_b, j, rotation, translation):
    """Lower bound of the squared distance of node i of a and node j of b: the gap along a's axes or along b's."""
    ax, ay, az = 0.5 * (box_a[i, 0] + box_a[i, 3]), 0.5 * (box_a[i, 1] + box_a[i, 4]), 0.5 * (box_a[i, 2] + box_a[i, 5])
    bx, by, bz = 0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5])
    hx, hy, hz = box_a[i, 3] - ax, box_a[i, 4] - ay, box_a[i, 5] - az
    kx, ky, kz = box_b[j, 3] - bx, box_b[j, 4] - by, box_b[j, 5] - bz
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    dx = r00 * bx + r01 * by + r02 * bz + translation[0] - ax
    dy = r10 * bx + r11 * by + r12 * bz + translation[1] - ay
    dz = r20 * bx + r21 * by + r22 * bz + translation[2] - az
    gx = max(0.0, abs(dx) - hx - (abs(r00) * kx + abs(r01) * ky + abs(r02) * kz))
    gy = max(0.0, abs(dy) - hy - (abs(r10) * kx + abs(r11) * ky + abs(r12) * kz))
    gz = max(0.0, abs(dz) - hz - (abs(r20) * kx + abs(r21) * ky + abs(r22) * kz))
    along_a = gx * gx + gy * gy + gz * gz
    gx = max(0.0, abs(r00 * dx + r10 * dy + r20 * dz) - kx - (abs(r00) * hx + abs(r10) * hy + abs(r20) * hz))
    gy = max(0.0, abs(r01 * dx + r11 * dy + r21 * dz) - ky - (abs(r01) * hx + abs(r11) * hy + abs(r21) * hz))
    gz = max(0.0, abs(r02 * dx + r12 * dy + r22 * dz) - kz - (abs(r02) * hx + abs(r12) * hy + abs(r22) * hz))
    return max(along_a, gx * gx + gy * gy + gz * gz)


@njit(error_model="numpy", **KERNEL)
def rounding_of(box_a, box_b, rotation, translation):
    """m: how far a distance of boxes or points may be off, by its coordinates and the rotation's own error."""
    reach = 0.0
    for k in range(6):
        reach = max(reach, abs(box_a[0, k]), abs(box_b[0, k]))
    off = 0.0
    for i in range(3):
        reach = max(reach, abs(translation[i]))
        for j in range(3):
            d = -1.0 if i == j else 0.0
            for k in range(3):
                d += rotation[k, i] * rotation[k, j]
            off = max(off, abs(d))
    return (ROUNDING + 4.0 * off) * 2.0 * reach


@njit(error_model="numpy", **KERNEL)
def size_of(box, i):
    """Sum of the edges of box `i`: the larger is opened first."""
    return box[i, 3] - box[i, 0] + box[i, 4] - box[i, 1] + box[i, 5] - box[i, 2]


@njit(error_model="numpy", **KERNEL)
def opened(i, j, box_a, second_a, box_b, second_b):
    """(i, j, i, j): the two pairs of nodes that a pair opens into, by the larger node, or the one that is no leaf."""
    if second_b[j] < 0 or (second_a[i] >= 0 and size_of(box_a, i) >= size_of(box_b, j)):
        return i + 1, j, second_a[i], j
    return i, j + 1, i, second_b[j]


@njit(error_model="numpy", **KERNEL)
def _leaves(
    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
    rotation, translation, bound, rounding, best, hit, work,
):  # fmt: skip
    """Better `best` and `hit` by the triangles of two leaves; the new bound."""
    for tb in range(first_b[j], first_b[j] + count_b[j]):
        p = move(rotation, translation, vertices_b, corner_b[tb, 0])
        q = move(rotation, translation, vertices_b, corner_b[tb, 1])
        r = move(rotation, translation, vertices_b, corner_b[tb, 2])
        low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
        high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
        for ta in range(first_a[i], first_a[i] + count_a[i]):
            ia, ib, ic = corner_a[ta, 0], corner_a[ta, 1], corner_a[ta, 2]
            a = (vertices_a[ia, 0], vertices_a[ia, 1], vertices_a[ia, 2])
            b = (vertices_a[ib, 0], vertices_a[ib, 1], vertices_a[ib, 2])
            c = (vertices_a[ic, 0], vertices_a[ic, 1], vertices_a[ic, 2])
            reach = bound + rounding
            square = 0.0
            for d in range(3):
                between = max(min(a[d], b[d], c[d]) - high[d], low[d] - max(a[d], b[d], c[d]))
                if between > 0.0:
                    square += between * between
            if square > reach * reach or planes_part(a, b, c, p, q, r, bound):
                continue
            # boxes that rounding cannot bring together hold no triangles that meet
            if square <= rounding * rounding and triangles_meet(a, b, c, p, q, r, work):
                x = common_point(a, b, c, p, q, r)
                best[0] = 0.0
                for d in range(3):
                    best[1 + d] = x[d]
                    best[4 + d] = x[d]
                hit[0], hit[1] = ta, tb
                return 0.0
            if bound == 0.0:
                continue
            d2, x, y = closest_features(a, b, c, p, q, r)
            distance = max(np.sqrt(d2), np.finfo(np.float64).tiny)  # they do not meet: never 0
            if distance < bound or (distance == bound and hit[0] < 0):
                bound = distance
                best[0] = distance
                for d in range(3):
                    best[1 + d] = x[d]
                    best[4 + d] = y[d]
                hit[0], hit[1] = ta, tb
    return bound


@njit(error_model="numpy", **KERNEL)
def closest(
    root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, bound, rounding, best, hit, work, stack, gap,
):  # fmt: skip
    """The nearest triangles below two nodes, if they are within `bound` (m): branch and bound, the nearer boxes first.

    best: (7,) distance, point on a, point on b, both in a's frame. hit: (2,) their places in leaf order, -1 if none is
    within the bound. Stops at the first triangles that meet.
    """
    hit[0] = -1
    hit[1] = -1
    stack[0, 0], stack[0, 1] = root_a, root_b
    gap[0] = box_gap(box_a, root_a, box_b, root_b, rotation, translation)
    top = 1
    while top > 0:
        top -= 1
        # beyond a gap that rounding explains nothing meets, and to rounding nothing there is nearer than what is known:
        # faces flat on one another would otherwise be searched to the last triangle
        reach = bound - rounding if hit[0] >= 0 and bound > 4.0 * rounding else bound + rounding
        if gap[top] > reach * reach:
            continue
        i, j = stack[top, 0], stack[top, 1]
        if second_a[i] < 0 and second_b[j] < 0:
            bound = _leaves(
                i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
                rotation, translation, bound, rounding, best, hit, work,
            )  # fmt: skip
            if hit[0] >= 0 and bound == 0.0:
                return
            continue
        i0, j0, i1, j1 = opened(i, j, box_a, second_a, box_b, second_b)
        g0 = box_gap(box_a, i0, box_b, j0, rotation, translation)
        g1 = box_gap(box_a, i1, box_b, j1, rotation, translation)
        if g0 < g1:
            i0, j0, g0, i1, j1, g1 = i1, j1, g1, i0, j0, g0
        stack[top, 0], stack[top, 1], gap[top] = i0, j0, g0
        stack[top + 1, 0], stack[top + 1, 1], gap[top + 1] = i1, j1, g1
        top += 2


@njit(error_model="numpy", **KERNEL)
def near_surfaces(
    box_a, second_a, surface_a, box_b, second_b, surface_b, rotation, translation, reach, heeded, pairs, stack,
):  # fmt: skip
    """Surface pairs whose boxes come within `reach` (m): their number; as many as fit are written to `pairs`.

    heeded: (ka, kb) uint8, 0 where a surface pair is left out; (0, 0) where none is.
    """
    n = 0
    stack[0, 0], stack[0, 1] = 0, 0
    top = 1
    while top > 0:
        top -= 1
        i, j = stack[top, 0], stack[top, 1]
        if box_gap(box_a, i, box_b, j, rotation, translation) > reach * reach:
            continue
        s, t = surface_a[i], surface_b[j]
        if s >= 0 and t >= 0:
            if heeded.shape[0] > 0 and heeded[s, t] == 0:
                continue
            if n < len(pairs):
                pairs[n, 0], pairs[n, 1] = s, t
            n += 1
            continue
        if t >= 0 or (s < 0 and size_of(box_a, i) >= size_of(box_b, j)):
            stack[top, 0], stack[top, 1] = i + 1, j
            stack[top + 1, 0], stack[top + 1, 1] = second_a[i], j
        else:
            stack[top, 0], stack[top, 1] = i, j + 1
            stack[top + 1, 0], stack[top + 1, 1] = i, second_b[j]
        top += 2
    return n


@njit(error_model="numpy", **KERNEL)
def surface_contacts(
    pairs, root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, best, hit, work, stack, gap,
):  # fmt: skip
    """`closest` for each surface pair of `pairs`: rows of `best` (n, 7) and `hit` (n, 2)."""
    for k in range(len(pairs)):
        closest(
            root_a[pairs[k, 0]], root_b[pairs[k, 1]],
            vertices_a, box_a, second_a, first_a, count_a, corner_a,
            vertices_b, box_b, second_b, first_b, count_b, corner_b,
            rotation, translation, within, rounding, best[k], hit[k], work, stack, gap,
        )  # fmt: skip
