"""The fast query: two wide trees, eight boxes a step, and at the bottom the same exact triangle test. Kernels.

Boxes and triangles of b are moved into a's frame in float32; boxes are inflated by more than all rounding, of the boxes
and of the float64 vertices that decide in the end, and triangles are told apart only beyond that doubt. So no pair of
triangles that meet is ever passed over. A surface pair is done at its first pair of triangles that meet.
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.boxes import take_pose
from collision.lanes import (
    lowest,
    move_boxes,
    overlapping,
    perhaps_meeting,
    prepare_triangles,
    reaching,
    turn_triangles,
)
from collision.polygons import triangles_meet
from collision.predicates import FALLBACKS, KERNEL
from collision.wide import BOXES, INFO, TRIANGLES

LEVELS: Final = 12
"""of either kind; 8^12 is more triangles than there can be"""
STACK: Final = 4 * 64 * 2 * LEVELS
"""numbers on the stack of pairs of nodes: up to 64 pairs at each step down either tree"""
QUESTION: Final = 5
"""where, after the counts of `Statistics`, the questions are numbered"""
PREPARED_FOR: Final = 6
"""not 0: leaves of a stay prepared for good, since always the same mesh is a"""
COUNTS: Final = 7
SLOT: Final = 24
"""where a node begins is a multiple of this"""
SPREAD: Final = 3
"""a prepared leaf takes up to three times what the leaf takes, and lies at three times its place"""


@njit(**KERNEL)
def set_motion(pose, frame_a, frame_b, motion):
    """Fill `motion` (see `lanes.MOTION`) for boxes about b's centre into boxes about a's centre.

    pose: (15,), of which the last three become that motion's translation in float64.
    """
    size = 0.0
    for d in range(3):
        shift = pose[9 + d] - frame_a[d]
        for e in range(3):
            shift += pose[3 * d + e] * frame_b[e]
            motion[3 * d + e] = pose[3 * d + e]
            motion[9 + 3 * d + e] = abs(pose[3 * d + e])
        motion[18 + d] = pose[12 + d] = shift
        size += abs(shift) + frame_a[3 + d] + 2.0 * frame_b[3 + d]
    # at most 16 roundings of float32 in a box, and 32 of float64 in a vertex
    place = 32.0 * 2.0**-53 * (abs(pose[9]) + abs(pose[10]) + abs(pose[11]) + 2.0 * frame_a[6] + 4.0 * frame_b[6])
    motion[21] = 16.0 * 2.0**-24 * size + place + 1e-30
    motion[22] = 4.0 * place + 1e-30


@njit(**KERNEL)
def _set_levels(at, above, boxes, start):
    """Place in `start[1:]` where the levels over `boxes` leaves at `at` begin, those from 2 on at `above`; how many."""
    level = 1
    start[1] = at
    while boxes > 1:
        level += 1
        start[level] = above
        boxes = (boxes + 7) >> 3
        above += BOXES * boxes
    return level


@njit(**KERNEL)
def best_pairs(
    nodes_a, info_a, corner_a, vertices_a, frame_a, nodes_b, info_b, corner_b, vertices_b, frame_b,
    last, pose, motion, moved, stamp, turned, prepared, stamp_a, stack, levels, keys, pairs, counts, w,
):  # fmt: skip
    """Place the colliding pairs of surfaces, sorted, in `pairs` (n, 2); how many.

    The first two rows are the fields of the `WideTree` of a and of b. `last`: empty, or for each pair of surfaces the
    two triangles that met when last asked, -1 if none did; they are tried first. Then the (15,) pose, and scratch:
    `stamp` and `stamp_a` tell which nodes of b are moved, and which leaves of a prepared, since which question.
    """
    counts[QUESTION] += 1
    query = counts[QUESTION]
    query_a = counts[PREPARED_FOR] if counts[PREPARED_FOR] != 0 else query
    ka, kb = len(info_a) // INFO, len(info_b) // INFO
    set_motion(pose, frame_a, frame_b, motion)
    start_a, surface_a, surface_b = levels[0], levels[1], levels[2]
    top_a = _set_levels(0, BOXES * ((ka + 7) >> 3), (ka + 7) >> 3, start_a)
    counts[0] += 1
    found = 0
    for node_b in range((kb + 7) >> 3):
        at_b = BOXES * node_b
        move_boxes(nodes_b, at_b, motion, moved, at_b)
        for j in range(min(8, kb - 8 * node_b)):
            b = at_b + j
            x0, y0, z0, x1, y1, z1 = moved[b], moved[b + 8], moved[b + 16], moved[b + 24], moved[b + 32], moved[b + 40]
            # the surfaces of a whose boxes overlap that of this one of b
            depth = 2
            stack[0], stack[1] = top_a, 0
            while depth > 0:
                depth -= 2
                level, q = stack[depth], stack[depth + 1]
                counts[1] += 8
                at_a = start_a[level] + BOXES * q
                bits = overlapping(nodes_a, at_a, x0, y0, z0, x1, y1, z1)
                while bits != 0:
                    i = lowest(bits)
                    bits &= bits - 1
                    if level > 1:
                        stack[depth], stack[depth + 1] = level - 1, 8 * q + i
                        depth += 2
                        continue
                    a = INFO * (8 * q + i)
                    o = INFO * (8 * node_b + j)
                    key = info_a[a] * kb + info_b[o]
                    if len(last) > 0 and last[key] >= 0:
                        counts[3] += 1
                        ta, tb = last[key] >> 32, last[key] & 0xFFFFFFFF
                        if _pair_meets(corner_a, vertices_a, ta, corner_b, vertices_b, tb, pose, w):
                            keys[found] = key
                            found += 1
                            continue
                    levels_a = _set_levels(info_a[a + 1], info_a[a + 2], (info_a[a + 4] + 7) >> 3, surface_a)
                    levels_b = _set_levels(info_b[o + 1], info_b[o + 2], (info_b[o + 4] + 7) >> 3, surface_b)
                    met = _surfaces_meet(
                        nodes_a, corner_a, vertices_a, surface_a, levels_a, at_a + i, info_a[a + 3],
                        nodes_b, corner_b, vertices_b, surface_b, levels_b, b, info_b[o + 3],
                        pose, motion, moved, stamp, turned, prepared, stamp_a, query, query_a, stack, depth, counts, w,
                    )  # fmt: skip
                    if len(last) > 0:
                        last[key] = met
                    if met >= 0:
                        keys[found] = key
                        found += 1
    counts[4] += int(w[FALLBACKS])
    w[FALLBACKS] = 0.0
    _sort(keys, found)
    for i in range(found):
        pairs[i, 0] = keys[i] // kb
        pairs[i, 1] = keys[i] % kb
    return found


@njit(**KERNEL)
def _sort(keys, n):
    """Shell's sort of the first n: numba's own takes seconds to compile."""
    gap = n // 2
    while gap > 0:
        for i in range(gap, n):
            key = keys[i]
            j = i
            while j >= gap and keys[j - gap] > key:
                keys[j] = keys[j - gap]
                j -= gap
            keys[j] = key
        gap //= 2


@njit(**KERNEL)
def ask(
    nodes_a, info_a, corner_a, vertices_a, frame_a, nodes_b, info_b, corner_b, vertices_b, frame_b,
    matrix, rigid, last, pose, motion, moved, stamp, turned, prepared, stamp_a, stack, levels, keys, pairs, counts, w,
):  # fmt: skip
    """`best_pairs` for a (4, 4) pose as it comes; -1 if that is not a rigid motion."""
    if not take_pose(matrix, rigid, pose):
        return -1
    return best_pairs(
        nodes_a, info_a, corner_a, vertices_a, frame_a, nodes_b, info_b, corner_b, vertices_b, frame_b,
        last, pose, motion, moved, stamp, turned, prepared, stamp_a, stack, levels, keys, pairs, counts, w,
    )  # fmt: skip


@njit(forceinline=True, **KERNEL)
def _surfaces_meet(
    nodes_a, corner_a, vertices_a, start_a, levels_a, top_a, first_a,
    nodes_b, corner_b, vertices_b, start_b, levels_b, top_b, first_b,
    pose, motion, moved, stamp, turned, prepared, stamp_a, query, query_a, stack, bottom, counts, w,
):  # fmt: skip
    """Two triangles in which a surface of a and one of b meet (2^32·(that of a) + that of b, in leaf order), or -1.

    The box of node q of level l is lane q % 8 of node q // 8 of level l + 1; that of a surface's top is at `top`.
    """
    depth = bottom
    stack[depth], stack[depth + 1], stack[depth + 2], stack[depth + 3] = levels_a, 0, levels_b, 0
    depth += 4
    while depth > bottom:
        depth -= 4
        la, qa, lb, qb = stack[depth], stack[depth + 1], stack[depth + 2], stack[depth + 3]
        a = top_a if la == levels_a else start_a[la + 1] + BOXES * (qa >> 3) + (qa & 7)
        b = top_b if lb == levels_b else start_b[lb + 1] + BOXES * (qb >> 3) + (qb & 7)
        if la == 1 and lb == 1:
            met = _leaves_meet(
                nodes_a, corner_a, vertices_a, start_a[1] + TRIANGLES * qa, a, first_a + 8 * qa,
                nodes_b, corner_b, vertices_b, start_b[1] + TRIANGLES * qb, b, first_b + 8 * qb,
                pose, motion, moved, stamp, turned, prepared, stamp_a, query, query_a, counts, w,
            )  # fmt: skip
            if met >= 0:
                return met
            continue
        if la > lb:
            counts[2] += 8
            at_a = start_a[la] + BOXES * qa
            bits = overlapping(
                nodes_a, at_a, moved[b], moved[b + 8], moved[b + 16], moved[b + 24], moved[b + 32], moved[b + 40]
            )
            while bits != 0:
                stack[depth], stack[depth + 1] = la - 1, 8 * qa + lowest(bits)
                stack[depth + 2], stack[depth + 3] = lb, qb
                depth += 4
                bits &= bits - 1
            continue
        at_b = start_b[lb] + BOXES * qb
        if stamp[at_b // SLOT] != query:
            stamp[at_b // SLOT] = query
            move_boxes(nodes_b, at_b, motion, moved, at_b)
        counts[2] += 8
        bits_b = overlapping(
            moved, at_b, nodes_a[a], nodes_a[a + 8], nodes_a[a + 16], nodes_a[a + 24], nodes_a[a + 32], nodes_a[a + 40]
        )
        if lb > la:
            while bits_b != 0:
                stack[depth], stack[depth + 1] = la, qa
                stack[depth + 2], stack[depth + 3] = lb - 1, 8 * qb + lowest(bits_b)
                depth += 4
                bits_b &= bits_b - 1
            continue
        at_a = start_a[la] + BOXES * qa
        while bits_b != 0:
            j = lowest(bits_b)
            bits_b &= bits_b - 1
            b = at_b + j
            counts[2] += 8
            bits = overlapping(
                nodes_a, at_a, moved[b], moved[b + 8], moved[b + 16], moved[b + 24], moved[b + 32], moved[b + 40]
            )
            while bits != 0:
                stack[depth], stack[depth + 1] = la - 1, 8 * qa + lowest(bits)
                stack[depth + 2], stack[depth + 3] = lb - 1, 8 * qb + j
                depth += 4
                bits &= bits - 1
    return -1


@njit(forceinline=True, **KERNEL)
def _leaves_meet(
    nodes_a, corner_a, vertices_a, leaf_a, a, first_a, nodes_b, corner_b, vertices_b, leaf_b, b, first_b,
    pose, motion, moved, stamp, turned, prepared, stamp_a, query, query_a, counts, w,
):  # fmt: skip
    """The same for two leaves, whose boxes are at `a` and `b`.

    Both leaves are about the centre of a's leaf. Coordinates there are off by at most 10 roundings of float32 of the
    leaves' size (those of b turned and shifted) and by what the float64 vertices are off; differences by `off`.

    With e, f, w off by `off` an entry, their determinant is off by no more than off·(|e||f| + |f||w| + |w||e|) in sum
    norms, each enlarged by 2·off; its rounding adds less than 2·off·|e||f|, and 1% is for the rounding of the bound.
    """
    if stamp_a[leaf_a // SLOT] != query_a:
        stamp_a[leaf_a // SLOT] = query_a
        prepare_triangles(nodes_a, leaf_a, prepared, SPREAD * leaf_a)
    if stamp[leaf_b // SLOT] != query:
        stamp[leaf_b // SLOT] = query
        turn_triangles(nodes_b, leaf_b, motion, turned, SPREAD * leaf_b)
    bx, by, bz = (
        _middle(nodes_b[b], nodes_b[b + 24]),
        _middle(nodes_b[b + 8], nodes_b[b + 32]),
        _middle(nodes_b[b + 16], nodes_b[b + 40]),
    )
    ax, ay, az = (
        _middle(nodes_a[a], nodes_a[a + 24]),
        _middle(nodes_a[a + 8], nodes_a[a + 32]),
        _middle(nodes_a[a + 16], nodes_a[a + 40]),
    )
    sx = np.float32(pose[0] * bx + pose[1] * by + pose[2] * bz + (pose[12] - ax))
    sy = np.float32(pose[3] * bx + pose[4] * by + pose[5] * bz + (pose[13] - ay))
    sz = np.float32(pose[6] * bx + pose[7] * by + pose[8] * bz + (pose[14] - az))
    half = np.float32(0.5)
    hx = half * (nodes_a[a + 24] - nodes_a[a])
    hy = half * (nodes_a[a + 32] - nodes_a[a + 8])
    hz = half * (nodes_a[a + 40] - nodes_a[a + 16])
    size_a = np.float32(2.0) * (hx + hy + hz)
    size_b = nodes_b[b + 24] - nodes_b[b] + (nodes_b[b + 32] - nodes_b[b + 8]) + (nodes_b[b + 40] - nodes_b[b + 16])
    off = np.float32(20.0 * 2.0**-24) * (size_a + size_b) + motion[22]
    counts[2] += 8
    bits_b = reaching(
        turned, SPREAD * leaf_b,
        -hx - sx - off, -hy - sy - off, -hz - sz - off, hx - sx + off, hy - sy + off, hz - sz + off,
    )  # fmt: skip
    if bits_b == 0:
        return -1
    reach = size_a + np.float32(1.8) * size_b + np.float32(2.0) * off  # of any difference, where boxes overlap
    kf = np.float32(1.01) * off * (reach + np.float32(6.0) * off)
    kp = np.float32(3.03) * off
    k = np.float32(1.01) * off * off * (np.float32(4.0) * reach + np.float32(12.0) * off)
    while bits_b != 0:
        j = lowest(bits_b)
        bits_b &= bits_b - 1
        counts[2] += 8
        bits = perhaps_meeting(prepared, SPREAD * leaf_a, turned, SPREAD * leaf_b + j, sx, sy, sz, off, kf, kp, k)
        if bits == 0:
            continue
        while bits != 0:
            t = first_a + lowest(bits)
            bits &= bits - 1
            counts[3] += 1
            if _pair_meets(corner_a, vertices_a, t, corner_b, vertices_b, first_b + j, pose, w):
                return (t << 32) + first_b + j
    return -1


@njit(**KERNEL)
def _pair_meets(corner_a, vertices_a, ta, corner_b, vertices_b, tb, pose, w):
    """Whether triangle `ta` of a meets triangle `tb` of b, moved; both in leaf order."""
    return triangles_meet(
        _corner(vertices_a, corner_a[3 * ta]),
        _corner(vertices_a, corner_a[3 * ta + 1]),
        _corner(vertices_a, corner_a[3 * ta + 2]),
        _moved(vertices_b, corner_b[3 * tb], pose),
        _moved(vertices_b, corner_b[3 * tb + 1], pose),
        _moved(vertices_b, corner_b[3 * tb + 2], pose),
        w,
    )


@njit(forceinline=True, **KERNEL)
def _middle(low, high):
    return 0.5 * (np.float64(low) + np.float64(high))


@njit(forceinline=True, **KERNEL)
def _corner(vertices, i):
    return vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]


@njit(forceinline=True, **KERNEL)
def _moved(vertices, i, pose):
    """The same arithmetic as `boxes.transform`."""
    x, y, z = vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]
    return (
        pose[0] * x + pose[1] * y + pose[2] * z + pose[9],
        pose[3] * x + pose[4] * y + pose[5] * z + pose[10],
        pose[6] * x + pose[7] * y + pose[8] * z + pose[11],
    )
