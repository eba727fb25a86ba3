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
from collision.lanes import move_boxes, overlapping_lane
from collision.leaves import add, lane_of, leaves_meet, pair_meets
from collision.memory import doubles, f64, i64, lowest, put_f32, put_f64, put_i32, put_i64
from collision.predicates import INNER, KERNEL
from collision.tables import (
    COUNTS_AT,
    FRONT,
    KEYS,
    LAST,
    MET,
    MOTION_AT,
    MOVED,
    PAIRS,
    POSE,
    QUESTION,
    SEEN,
    STACK_AT,
    STAMP,
)
from collision.wide import BOXES, COUNT, FRAME, INFO, NODES, NUMBER, ROWS, STARTS, SURFACES, TOP

_NODE: Final = (1 << 24) - 1
_INLINE: Final = INNER | {"forceinline": True}


@njit(**INNER)
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
def task_of(la, qa, lb, qb):
    """A pair of nodes, of levels la and lb, in one number, with a mask of eight lanes, all set.

    Of children of the node of the higher level, of those of b if both are as high, of b's triangles if both are leaves.
    """
    return (lb << 60) | (la << 56) | (qb << 32) | (qa << 8) | 255


@njit(**_INLINE)
def nodes_of(task):
    """la, lb, qa, qb and the mask of a task."""
    return (task >> 56) & 15, (task >> 60) & 15, (task >> 8) & _NODE, (task >> 32) & _NODE, task & 255


@njit(**_INLINE)
def filled(row, level, q):
    """The lanes of node q of a level that are not empty, as bits."""
    boxes = (i64(row, COUNT) + (1 << (3 * level - 3)) - 1) >> (3 * level - 3)
    return 255 >> (8 - min(8, boxes - 8 * q))


@njit(**INNER)
def start(a, b, scratch):
    """Begin a question: the motion, and the boxes of b's surfaces moved."""
    counts, motion = i64(scratch, COUNTS_AT), i64(scratch, MOTION_AT)
    add(counts, QUESTION, 1)
    add(counts, 0, 1)
    set_motion(i64(scratch, POSE), i64(a, FRAME), i64(b, FRAME), motion)
    for node_b in range((i64(b, SURFACES) + 7) >> 3):
        move_boxes(i64(b, NODES), BOXES * node_b, motion, i64(scratch, MOVED), BOXES * node_b)


@njit(**KERNEL)
def best_pairs(a, b, scratch):
    """Place the colliding pairs of surfaces, sorted, in the pairs of scratch; how many.

    a, b, scratch: addresses of the tables of two `WideTree`s and of the scratch, whose pose is set. LAST has for each
    pair of surfaces the two triangles that met when last asked, -1 if none did; they are tried first. STAMP and STAMP_A
    tell which nodes of b are moved, and which leaves of a prepared, since which question.
    """
    start(a, b, scratch)
    top = task_of(i64(i64(a, ROWS), INFO * i64(a, SURFACES) + TOP), 0, 0, 0)
    found = np.int64(0)  # of no literal type, for which numba compiles all below twice
    for place_b in range(i64(b, SURFACES)):
        found = below(a, b, scratch, place_b, top, found)
    answer(found, i64(b, SURFACES), scratch)
    return found


@njit(**INNER)
def below(a, b, scratch, place_b, task, found):
    """Add the surfaces below a node (and mask) over the surfaces of a that collide with one of b; how many are found.

    Only those whose boxes overlap are looked at.
    """
    counts, stack = i64(scratch, COUNTS_AT), i64(scratch, STACK_AT)
    nodes_a, moved, lane_b = i64(a, NODES), i64(scratch, MOVED), BOXES * (place_b >> 3) + (place_b & 7)
    starts_a = i64(a, ROWS) + 8 * (INFO * i64(a, SURFACES) + STARTS - 1)
    put_i64(stack, 0, task)
    depth = 1
    while depth > 0:
        depth -= 1
        level, _, q, _, mask = nodes_of(i64(stack, depth))
        add(counts, 1, 8)
        bits = overlapping_lane(nodes_a, i64(starts_a, level) + BOXES * q, moved, lane_b) & mask
        while bits != 0:
            i = lowest(bits)
            bits &= bits - 1
            if level > 1:
                put_i64(stack, depth, task_of(level - 1, 8 * q + i, 0, 0))
                depth += 1
            else:
                found = _add_pair(a, 8 * q + i, b, place_b, scratch, depth, found)
    return found


@njit(**INNER)
def _add_pair(a, place_a, b, place_b, scratch, bottom, found):
    """Add a pair of surfaces if it collides; what met last is tried first. How many are found."""
    last, front = i64(scratch, LAST), i64(scratch, FRONT)
    key = key_of(a, place_a, b, place_b)
    if front != 0 and i64(i64(front, SEEN), key) == i64(i64(scratch, COUNTS_AT), QUESTION):
        return found
    met = i64(last, key) if last != 0 else -1
    if met < 0 or not pair_meets(a, met >> 32, b, met & 0xFFFFFFFF, scratch):
        met = search(a, place_a, b, place_b, root_of(a, place_a, b, place_b), scratch, bottom)
        if last != 0:
            put_i64(last, key, met)
    return add_found(key, (place_a << 32) | place_b, scratch, found) if met >= 0 else found


@njit(**_INLINE)
def key_of(a, place_a, b, place_b):
    """A number for a pair of surfaces, in the order of the answer."""
    number_a, number_b = INFO * place_a + NUMBER, INFO * place_b + NUMBER
    return i64(i64(a, ROWS), number_a) * i64(b, SURFACES) + i64(i64(b, ROWS), number_b)


@njit(**_INLINE)
def root_of(a, place_a, b, place_b):
    """The pair of top nodes of two surfaces."""
    return task_of(i64(i64(a, ROWS), INFO * place_a + TOP), 0, i64(i64(b, ROWS), INFO * place_b + TOP), 0)


@njit(**INNER)
def add_found(key, pair, scratch, found):
    """Add a pair of surfaces that collides; how many are found."""
    put_i64(i64(scratch, KEYS), found, key)
    front = i64(scratch, FRONT)
    if front != 0:
        put_i64(i64(front, MET), found, pair)
        put_i64(i64(front, SEEN), key, i64(i64(scratch, COUNTS_AT), QUESTION))
    return found + 1


@njit(**INNER)
def answer(found, kb, scratch):
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


@njit(**INNER)
def search(a, place_a, b, place_b, task, scratch, bottom):
    """Two triangles in which a surface of a and one of b meet (2^32·(that of a) + that of b, in leaf order), or -1.

    task: the nodes below which is searched. bottom: where on the stack there is room.
    """
    stack, counts, moved = i64(scratch, STACK_AT), i64(scratch, COUNTS_AT), i64(scratch, MOVED)
    nodes_a = i64(a, NODES)
    row_a, row_b = i64(a, ROWS) + 8 * INFO * place_a, i64(b, ROWS) + 8 * INFO * place_b
    starts_a, starts_b = row_a + 8 * (STARTS - 1), row_b + 8 * (STARTS - 1)
    put_i64(stack, bottom, task)
    depth = bottom + 1
    boxes = 0
    met = -1
    while depth > bottom:
        depth -= 1
        la, lb, qa, qb, mask = nodes_of(i64(stack, depth))
        if la == 1 and lb == 1:
            met = leaves_meet(a, row_a, qa, b, row_b, qb, mask, scratch)
            if met >= 0:
                break
            continue
        boxes += 8
        if la > lb:
            at_a = i64(starts_a, la) + BOXES * qa
            bits = overlapping_lane(nodes_a, at_a, moved, lane_of(starts_b, lb + 1, qb)) & mask
            child, step = task_of(la - 1, 8 * qa, lb, qb), 1 << 8
        else:
            at_b = i64(starts_b, lb) + BOXES * qb
            move_node(b, at_b, scratch)
            bits = overlapping_lane(moved, at_b, nodes_a, lane_of(starts_a, la + 1, qa)) & mask
            child, step = task_of(la, qa, lb - 1, 8 * qb), 1 << 32
        while bits != 0:
            put_i64(stack, depth, child + step * lowest(bits))
            depth += 1
            bits &= bits - 1
    add(counts, 2, boxes)
    return met


@njit(**_INLINE)
def move_node(b, at_b, scratch):
    """Move the inner node at `at_b` of b, if this question has not done so."""
    stamp, question = i64(scratch, STAMP), i64(i64(scratch, COUNTS_AT), QUESTION)
    if i64(stamp, at_b >> 3) != question:
        put_i64(stamp, at_b >> 3, question)
        move_boxes(i64(b, NODES), at_b, i64(scratch, MOTION_AT), i64(scratch, MOVED), at_b)
