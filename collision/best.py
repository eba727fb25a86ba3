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
    move_boxes,
    overlapping_lane,
    perhaps_meeting,
    prepare_triangles,
    reaching,
    turn_triangles,
)
from collision.memory import doubles, f32, f64, i32, i64, lowest, put_f32, put_f64, put_i32, put_i64
from collision.polygons import triangles_meet
from collision.predicates import KERNEL, WORKSPACE
from collision.wide import (
    BOXES,
    CORNERS,
    FIRST,
    FRAME,
    INFO,
    NODES,
    NUMBER,
    ROWS,
    STARTS,
    SURFACES,
    TOP,
    TRIANGLES,
    VERTICES,
)

STACK: Final = 64 * 24
"""pairs of nodes on the stack: up to eight at each step down either tree"""
QUESTION: Final = 4
"""where, after the first four of `Statistics`, the questions are numbered"""
PREPARED_FOR: Final = 5
"""not 0: leaves of a stay prepared for good, since always the same mesh is a"""
COUNTS: Final = 6
SPREAD: Final = 3
"""a prepared leaf takes up to three times what the leaf takes, and lies at three times its place"""

POSE, MOTION_AT, MOVED, STAMP, TURNED, PREPARED, STAMP_A, STACK_AT, KEYS, PAIRS, COUNTS_AT, WORK, LAST = range(13)
"""places in the table of scratch; LAST is 0 if nothing is remembered"""
TABLE: Final = 13
"""its length"""

_NODE: Final = (1 << 28) - 1
_INLINE: Final = KERNEL | {"forceinline": True}


@njit(**KERNEL)
def set_motion(pose, frame_a, frame_b, motion):
    """Fill `motion` (see `lanes.MOTION`) for boxes about b's centre into boxes about a's centre.

    pose: (15,), of which the last three become that motion's translation in float64.
    """
    size = 0.0
    for d in range(3):
        shift = f64(pose, 9 + d) - f64(frame_a, d)
        for e in range(3):
            r = f64(pose, 3 * d + e)
            shift += r * f64(frame_b, e)
            put_f32(motion, 3 * d + e, r)
            put_f32(motion, 9 + 3 * d + e, abs(r))
        put_f64(pose, 12 + d, shift)
        put_f32(motion, 18 + d, shift)
        size += abs(shift) + f64(frame_a, 3 + d) + 2.0 * f64(frame_b, 3 + d)
    # at most 16 roundings of float32 in a box, and 32 of float64 in a vertex
    reach = abs(f64(pose, 9)) + abs(f64(pose, 10)) + abs(f64(pose, 11))
    place = 32.0 * 2.0**-53 * (reach + 2.0 * f64(frame_a, 6) + 4.0 * f64(frame_b, 6))
    put_f32(motion, 21, 16.0 * 2.0**-24 * size + place + 1e-30)
    put_f32(motion, 22, 4.0 * place + 1e-30)


@njit(**_INLINE)
def _add(counts, i, n):
    put_i64(counts, i, i64(counts, i) + n)


@njit(**_INLINE)
def _task(la, qa, lb, qb):
    """A pair of nodes, of levels la and lb, in one number."""
    return (lb << 60) | (la << 56) | (qb << 28) | qa


@njit(**_INLINE)
def _lane(starts, level, q):
    """Where the box of node q of a level is: lane q % 8 of node q // 8 of the level above; that of a top is noted."""
    return i64(starts, level) + BOXES * (q >> 3) + (q & 7)


@njit(**KERNEL)
def best_pairs(a, b, scratch):
    """Place the colliding pairs of surfaces, sorted, in the pairs of scratch; how many.

    a, b, scratch: addresses of the tables of two `WideTree`s and of the scratch, whose pose is set. LAST has for each
    pair of surfaces the two triangles that met when last asked, -1 if none did; they are tried first. STAMP and STAMP_A
    tell which nodes of b are moved, and which leaves of a prepared, since which question.
    """
    counts, stack, last, keys = i64(scratch, COUNTS_AT), i64(scratch, STACK_AT), i64(scratch, LAST), i64(scratch, KEYS)
    motion, moved = i64(scratch, MOTION_AT), i64(scratch, MOVED)
    _add(counts, QUESTION, 1)
    _add(counts, 0, 1)
    nodes_a, nodes_b, rows_a, rows_b = i64(a, NODES), i64(b, NODES), i64(a, ROWS), i64(b, ROWS)
    ka, kb = i64(a, SURFACES), i64(b, SURFACES)
    set_motion(i64(scratch, POSE), i64(a, FRAME), i64(b, FRAME), motion)
    starts_a = rows_a + 8 * (INFO * ka + STARTS - 1)
    top_a = i64(rows_a, INFO * ka + TOP)
    found = 0
    for node_b in range((kb + 7) >> 3):
        move_boxes(nodes_b, BOXES * node_b, motion, moved, BOXES * node_b)
        for place_b in range(8 * node_b, min(8 * node_b + 8, kb)):
            lane_b = BOXES * node_b + (place_b & 7)
            # the surfaces of a whose boxes overlap that of this one of b
            depth = 1
            put_i64(stack, 0, _task(top_a, 0, 0, 0))
            while depth > 0:
                depth -= 1
                task = i64(stack, depth)
                level, q = task >> 56, task & _NODE
                _add(counts, 1, 8)
                bits = overlapping_lane(nodes_a, i64(starts_a, level) + BOXES * q, moved, lane_b)
                while bits != 0:
                    i = lowest(bits)
                    bits &= bits - 1
                    if level > 1:
                        put_i64(stack, depth, _task(level - 1, 8 * q + i, 0, 0))
                        depth += 1
                        continue
                    row_a, row_b = rows_a + 8 * INFO * (8 * q + i), rows_b + 8 * INFO * place_b
                    key = i64(row_a, NUMBER) * kb + i64(row_b, NUMBER)
                    if last != 0:
                        met = i64(last, key)
                        if met >= 0 and _pair_meets(a, met >> 32, b, met & 0xFFFFFFFF, scratch):
                            put_i64(keys, found, key)
                            found += 1
                            continue
                    met = _surfaces_meet(a, row_a, b, row_b, scratch, depth)
                    if last != 0:
                        put_i64(last, key, met)
                    if met >= 0:
                        put_i64(keys, found, key)
                        found += 1
    _answer(found, kb, scratch)
    return found


@njit(**KERNEL)
def _answer(found, kb, scratch):
    """Sort the keys (Shell's sort: numba's own takes seconds to compile) and write them out as pairs."""
    keys, pairs = i64(scratch, KEYS), i64(scratch, PAIRS)
    gap = found // 2
    while gap > 0:
        for i in range(gap, found):
            key = i64(keys, i)
            j = i
            while j >= gap and i64(keys, j - gap) > key:
                put_i64(keys, j, i64(keys, j - gap))
                j -= gap
            put_i64(keys, j, key)
        gap //= 2
    for i in range(found):
        key = i64(keys, i)
        put_i32(pairs, 2 * i, key // kb)
        put_i32(pairs, 2 * i + 1, key % kb)


@njit(**KERNEL)
def ask(a, b, matrix, rigid, scratch):
    """`best_pairs` for a (4, 4) pose as it comes; -1 if that is not a rigid motion."""
    if not take_pose(matrix, rigid, doubles(i64(scratch, POSE), 15)):
        return -1
    return best_pairs(a, b, scratch)


@njit(**KERNEL)
def _surfaces_meet(a, row_a, b, row_b, scratch, bottom):
    """Two triangles in which a surface of a and one of b meet (2^32·(that of a) + that of b, in leaf order), or -1.

    bottom: where on the stack there is room.
    """
    stack, counts, moved = i64(scratch, STACK_AT), i64(scratch, COUNTS_AT), i64(scratch, MOVED)
    motion, stamp, question = i64(scratch, MOTION_AT), i64(scratch, STAMP), i64(counts, QUESTION)
    nodes_a, nodes_b = i64(a, NODES), i64(b, NODES)
    starts_a, starts_b = row_a + 8 * (STARTS - 1), row_b + 8 * (STARTS - 1)
    put_i64(stack, bottom, _task(i64(row_a, TOP), 0, i64(row_b, TOP), 0))
    depth = bottom + 1
    boxes = 0
    met = -1
    while depth > bottom:
        depth -= 1
        task = i64(stack, depth)
        la, lb, qa, qb = (task >> 56) & 15, task >> 60, task & _NODE, (task >> 28) & _NODE
        lane_a, lane_b = _lane(starts_a, la + 1, qa), _lane(starts_b, lb + 1, qb)
        at_a, at_b = i64(starts_a, la), i64(starts_b, lb)
        if la == 1 and lb == 1:
            met = _leaves_meet(
                a, at_a + TRIANGLES * qa, lane_a, i64(row_a, FIRST) + 8 * qa,
                b, at_b + TRIANGLES * qb, lane_b, i64(row_b, FIRST) + 8 * qb, scratch,
            )  # fmt: skip
            if met >= 0:
                break
            continue
        boxes += 8
        if la > lb:
            bits = overlapping_lane(nodes_a, at_a + BOXES * qa, moved, lane_b)
            child, step = _task(la - 1, 8 * qa, lb, qb), 1
        else:
            at_b += BOXES * qb
            if i64(stamp, at_b >> 3) != question:
                put_i64(stamp, at_b >> 3, question)
                move_boxes(nodes_b, at_b, motion, moved, at_b)
            bits = overlapping_lane(moved, at_b, nodes_a, lane_a)
            child, step = _task(la, qa, lb - 1, 8 * qb), 1 << 28
        while bits != 0:
            put_i64(stack, depth, child + step * lowest(bits))
            depth += 1
            bits &= bits - 1
    _add(counts, 2, boxes)
    return met


@njit(**_INLINE)
def _leaves_meet(a, leaf_a, lane_a, first_a, b, leaf_b, lane_b, first_b, scratch):
    """The same for two leaves, whose boxes are at `lane_a` and `lane_b`.

    Both leaves are about the centre of a's leaf. Coordinates there are off by at most 10 roundings of float32 of the
    leaves' size (those of b turned and shifted) and by what the float64 vertices are off; differences by `off`.

    With e, f, w off by `off` an entry, their determinant is off by no more than off·(|e||f| + |f||w| + |w||e|) in sum
    norms, each enlarged by 2·off; its rounding adds less than 2·off·|e||f|, and 1% is for the rounding of the bound.
    """
    nodes_a, nodes_b, counts = i64(a, NODES), i64(b, NODES), i64(scratch, COUNTS_AT)
    stamp, stamp_a, question = i64(scratch, STAMP), i64(scratch, STAMP_A), i64(counts, QUESTION)
    turned, prepared, pose, motion = (
        i64(scratch, TURNED),
        i64(scratch, PREPARED),
        i64(scratch, POSE),
        i64(scratch, MOTION_AT),
    )
    question_a = i64(counts, PREPARED_FOR)
    if question_a == 0:
        question_a = question
    if i64(stamp_a, leaf_a >> 3) != question_a:
        put_i64(stamp_a, leaf_a >> 3, question_a)
        prepare_triangles(nodes_a, leaf_a, prepared, SPREAD * leaf_a)
    if i64(stamp, leaf_b >> 3) != question:
        put_i64(stamp, leaf_b >> 3, question)
        turn_triangles(nodes_b, leaf_b, motion, turned, SPREAD * leaf_b)
    half = np.float32(0.5)
    bx, by, bz = _middle(nodes_b, lane_b), _middle(nodes_b, lane_b + 8), _middle(nodes_b, lane_b + 16)
    ax, ay, az = _middle(nodes_a, lane_a), _middle(nodes_a, lane_a + 8), _middle(nodes_a, lane_a + 16)
    sx = np.float32(f64(pose, 0) * bx + f64(pose, 1) * by + f64(pose, 2) * bz + (f64(pose, 12) - ax))
    sy = np.float32(f64(pose, 3) * bx + f64(pose, 4) * by + f64(pose, 5) * bz + (f64(pose, 13) - ay))
    sz = np.float32(f64(pose, 6) * bx + f64(pose, 7) * by + f64(pose, 8) * bz + (f64(pose, 14) - az))
    hx = half * (f32(nodes_a, lane_a + 24) - f32(nodes_a, lane_a))
    hy = half * (f32(nodes_a, lane_a + 32) - f32(nodes_a, lane_a + 8))
    hz = half * (f32(nodes_a, lane_a + 40) - f32(nodes_a, lane_a + 16))
    size_a = np.float32(2.0) * (hx + hy + hz)
    size_b = (
        f32(nodes_b, lane_b + 24) - f32(nodes_b, lane_b)
        + (f32(nodes_b, lane_b + 32) - f32(nodes_b, lane_b + 8))
        + (f32(nodes_b, lane_b + 40) - f32(nodes_b, lane_b + 16))
    )  # fmt: skip
    off = np.float32(20.0 * 2.0**-24) * (size_a + size_b) + f32(motion, 22)
    _add(counts, 2, 8)
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
        _add(counts, 2, 8)
        bits = perhaps_meeting(prepared, SPREAD * leaf_a, turned, SPREAD * leaf_b + j, sx, sy, sz, off, kf, kp, k)
        while bits != 0:
            t = first_a + lowest(bits)
            bits &= bits - 1
            if _pair_meets(a, t, b, first_b + j, scratch):
                return (t << 32) + first_b + j
    return -1


@njit(**KERNEL)
def _pair_meets(a, ta, b, tb, scratch):
    """Whether triangle `ta` of a meets triangle `tb` of b, moved; both in leaf order."""
    _add(i64(scratch, COUNTS_AT), 3, 1)
    pose = i64(scratch, POSE)
    corner_a, corner_b = i64(a, CORNERS) + 12 * ta, i64(b, CORNERS) + 12 * tb
    w = doubles(i64(scratch, WORK), WORKSPACE)
    return triangles_meet(
        _corner(a, i32(corner_a, 0)),
        _corner(a, i32(corner_a, 1)),
        _corner(a, i32(corner_a, 2)),
        _moved(b, i32(corner_b, 0), pose),
        _moved(b, i32(corner_b, 1), pose),
        _moved(b, i32(corner_b, 2), pose),
        w,
    )


@njit(**_INLINE)
def _middle(nodes, lane):
    return 0.5 * (np.float64(f32(nodes, lane)) + np.float64(f32(nodes, lane + 24)))


@njit(**_INLINE)
def _corner(tree, i):
    at = i64(tree, VERTICES) + 24 * i
    return f64(at, 0), f64(at, 1), f64(at, 2)


@njit(**_INLINE)
def _moved(tree, i, pose):
    """The same arithmetic as `boxes.transform`."""
    x, y, z = _corner(tree, i)
    return (
        f64(pose, 0) * x + f64(pose, 1) * y + f64(pose, 2) * z + f64(pose, 9),
        f64(pose, 3) * x + f64(pose, 4) * y + f64(pose, 5) * z + f64(pose, 10),
        f64(pose, 6) * x + f64(pose, 7) * y + f64(pose, 8) * z + f64(pose, 11),
    )
