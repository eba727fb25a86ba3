"""The fast query along a motion: what was known at the last question is checked, and mended where it fails. Kernels.

As long as pairs of surfaces that met still meet in the same two triangles, and the certificates of all others hold, the
answer is known. What fails is searched again from where it stood; if nothing meets there, some of it is split a level
down, each piece with a certificate of its own, so that the front follows the motion at a bounded cost a question. A
question far from the one before is answered as if it were the first. The answer never depends on what is remembered.
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.best import (
    add_found,
    answer,
    below,
    best_pairs,
    filled,
    key_of,
    move_node,
    nodes_of,
    root_of,
    search,
    start,
    task_of,
)
from collision.boxes import take_pose
from collision.certificates import ROW, drop, hopeless, record, record_boxes, record_leaves
from collision.lanes import failing, overlapping_lane
from collision.leaves import lane_of, meeting_leaves, middle, pair_meets
from collision.memory import doubles, f32, f64, i64, lowest, put_f64, put_i64
from collision.predicates import INNER, KERNEL
from collision.tables import (
    BEFORE,
    COOLING,
    COUNTS_AT,
    FAILED,
    FRONT,
    LAST,
    MET,
    MOTION_AT,
    MOVED,
    N_FREE,
    N_MET,
    OVERFLOW,
    PIECES,
    PLANES,
    POSE,
    PREPARED,
    QUESTION,
    REST,
    SEEN,
    SIZE,
    STATE,
    TURNED,
)
from collision.wide import BOXES, COUNT, FRAME, INFO, NODES, ROWS, STARTS, SURFACES, TOP

NONE: Final = 0
KEPT: Final = 1
"""states of a front"""
STEP: Final = 0.003
"""of b's size, a motion between two questions beyond which none is kept"""
PATIENCE: Final = 4
"""questions near each other, after one that was not, before one is kept"""
TOLERATED: Final = 3
"""one in so many may fail, and `SPLITS`"""
LONGEST: Final = 256
"""questions in which none is kept after many have failed, at most"""
SPLITS: Final = 128
"""certificates replaced by finer ones a question, at most"""
OVER: Final = 1 << 30
"""in place of a surface of a: the nodes over its surfaces are meant"""


@njit(**KERNEL)
def ask_along(a, b, matrix, rigid, scratch, front):
    """`best.ask` with a front."""
    pose = i64(scratch, POSE)
    if not take_pose(matrix, rigid, doubles(pose, 15)):
        return -1
    if not _near_the_last(pose, i64(front, BEFORE), i64(b, FRAME)):
        put_i64(front, STATE, NONE)
        put_i64(front, COOLING, PATIENCE)
        put_i64(front, REST, PATIENCE)
    elif i64(front, STATE) == KEPT:
        return _mend(a, b, scratch, front)
    elif i64(front, COOLING) > 0:
        put_i64(front, COOLING, i64(front, COOLING) - 1)
    else:
        return _begin(a, b, scratch, front)
    return best_pairs(a, b, scratch)


@njit(**INNER)
def _near_the_last(pose, before, frame_b):
    """Whether no point of b has moved far since the last question; notes the pose."""
    size = f64(frame_b, 3) + f64(frame_b, 4) + f64(frame_b, 5)
    moved = 0.0
    for d in range(3):
        shift = f64(pose, 9 + d) - f64(before, 9 + d)
        for e in range(3):
            turn = f64(pose, 3 * d + e) - f64(before, 3 * d + e)
            shift += turn * f64(frame_b, e)
            moved += abs(turn) * f64(frame_b, 3 + e)
        moved += abs(shift)
    for i in range(12):
        put_f64(before, i, f64(pose, i))
    return moved < STEP * size


@njit(**INNER)
def _unknown(front, pose, pair, task):
    """Note that nothing is known of two nodes: they are searched at every question until they are split."""
    record(front, pose, 0.0, 0.0, 0.0, -np.inf, 0.0, 0.0, 0.0, 0.0, pair, task)


@njit(**INNER)
def _begin(a, b, scratch, front):
    """Answer as `best_pairs` does, with a front of which nothing is known."""
    put_i64(front, SIZE, 0)
    put_i64(front, N_FREE, 0)
    put_i64(front, OVERFLOW, 0)
    top = task_of(i64(i64(a, ROWS), INFO * i64(a, SURFACES) + TOP), 0, 0, 0)
    for place_b in range(i64(b, SURFACES)):
        _unknown(front, i64(scratch, POSE), (OVER << 32) | place_b, top)
    put_i64(front, STATE, NONE if i64(front, OVERFLOW) else KEPT)
    put_i64(scratch, FRONT, front)
    found = best_pairs(a, b, scratch)
    put_i64(scratch, FRONT, 0)
    put_i64(front, N_MET, found)
    return found


@njit(**INNER)
def _mend(a, b, scratch, front):
    """Answer from the front, and mend it."""
    counts, size, met = i64(scratch, COUNTS_AT), i64(front, SIZE), i64(front, MET)
    start(a, b, scratch)
    put_i64(scratch, FRONT, front)
    failed, n = i64(front, FAILED), 0
    for at in range(0, size, 8):
        bits = failing(i64(front, PLANES), ROW * (at >> 3), i64(scratch, MOTION_AT))
        while bits != 0:
            if at + lowest(bits) < size:
                put_i64(failed, n, at + lowest(bits))
                n += 1
            bits &= bits - 1
    put_i64(counts, 2, i64(counts, 2) + size)
    if n > size // TOLERATED + SPLITS:  # to search them all one by one takes longer than to begin at the top
        put_i64(scratch, FRONT, 0)
        put_i64(front, STATE, NONE)
        put_i64(front, COOLING, i64(front, REST))
        put_i64(front, REST, min(2 * i64(front, REST), LONGEST))
        put_i64(counts, 0, i64(counts, 0) - 1)
        return best_pairs(a, b, scratch)
    if n == 0:
        put_i64(front, REST, PATIENCE)
    found = np.int64(0)  # see `best.best_pairs`
    for i in range(i64(front, N_MET)):
        pair = i64(met, i)
        place_a, place_b = pair >> 32, pair & 0xFFFFFFFF
        root = root_of(a, place_a, b, place_b)
        before = found
        found = _again(a, place_a, b, place_b, root, scratch, front, found)
        if found == before:
            _unknown(front, i64(scratch, POSE), pair, root)
    splits = SPLITS
    turn = i64(counts, QUESTION) * 31 % max(n, 1)  # whoever is split, it is not always the first
    for i in range(n):
        slot = i64(failed, (i + turn) % n)
        pair, task = i64(i64(front, PIECES), 2 * slot), i64(i64(front, PIECES), 2 * slot + 1)
        place_a, place_b = pair >> 32, pair & 0xFFFFFFFF
        before = found
        if place_a == OVER:
            found = below(a, b, scratch, place_b, task, found)
            if splits > 0:
                splits -= 1
                drop(front, slot)
                _split_over(a, b, scratch, front, place_b, task)
        else:
            if i64(i64(front, SEEN), key_of(a, place_a, b, place_b)) != i64(counts, QUESTION):
                found = _again(a, place_a, b, place_b, task, scratch, front, found)
                if found == before and splits > 0 and not hopeless(front, slot):
                    splits -= 1
                    drop(front, slot)
                    _split(a, place_a, b, place_b, scratch, front, task)
                    continue
            if i64(i64(front, SEEN), key_of(a, place_a, b, place_b)) == i64(counts, QUESTION):
                drop(front, slot)
    put_i64(scratch, FRONT, 0)
    put_i64(front, N_MET, found)
    if i64(front, OVERFLOW):
        put_i64(front, STATE, NONE)
    answer(found, i64(b, SURFACES), scratch)
    return found


@njit(**INNER)
def _again(a, place_a, b, place_b, task, scratch, front, found):
    """Add a pair of surfaces if it meets where it met last, or below the nodes of a task; how many are found."""
    key, last = key_of(a, place_a, b, place_b), i64(scratch, LAST)
    met = i64(last, key)
    if met < 0 or not pair_meets(a, met >> 32, b, met & 0xFFFFFFFF, scratch):
        # the box of the node of b lies in a node that may not be moved yet
        _, lb, _, qb, _ = nodes_of(task)
        row_b = i64(b, ROWS) + 8 * INFO * place_b
        if lb < i64(row_b, TOP):
            move_node(b, i64(row_b, STARTS + lb) + BOXES * (qb >> 3), scratch)
        met = search(a, place_a, b, place_b, task, scratch, 0)
        put_i64(last, key, met)
    return add_found(key, (place_a << 32) | place_b, scratch, found) if met >= 0 else found


@njit(**INNER)
def _split_over(a, b, scratch, front, place_b, task):
    """Certificates for a surface of b and the children of a node over the surfaces of a; pairs that meet need none."""
    level, _, q, _, mask = nodes_of(task)
    pose, nodes_a, moved = i64(scratch, POSE), i64(a, NODES), i64(scratch, MOVED)
    over_a = i64(a, ROWS) + 8 * INFO * i64(a, SURFACES)
    at_a, lane_b = i64(over_a, STARTS + level - 1) + BOXES * q, BOXES * (place_b >> 3) + (place_b & 7)
    mask &= filled(over_a, level, q)
    bits = overlapping_lane(nodes_a, at_a, moved, lane_b) & mask
    record_boxes(
        front, pose, nodes_a, at_a, 1, moved, i64(b, NODES), lane_b, 0, mask & ~bits,
        (OVER << 32) | place_b, task_of(level, q, 0, 0) - 255,
    )  # fmt: skip
    while bits != 0:
        i = lowest(bits)
        bits &= bits - 1
        if level > 1:
            _unknown(front, pose, (OVER << 32) | place_b, task_of(level - 1, 8 * q + i, 0, 0))
        elif i64(i64(front, SEEN), key_of(a, 8 * q + i, b, place_b)) != i64(i64(scratch, COUNTS_AT), QUESTION):
            _unknown(front, pose, ((8 * q + i) << 32) | place_b, root_of(a, 8 * q + i, b, place_b))


@njit(**INNER)
def _split(a, place_a, b, place_b, scratch, front, task):
    """Certificates for the children of two nodes below which nothing meets."""
    la, lb, qa, qb, mask = nodes_of(task)
    pose, pair, bare = i64(scratch, POSE), (place_a << 32) | place_b, task_of(la, qa, lb, qb) - 255
    nodes_a, nodes_b, moved = i64(a, NODES), i64(b, NODES), i64(scratch, MOVED)
    row_a, row_b = i64(a, ROWS) + 8 * INFO * place_a, i64(b, ROWS) + 8 * INFO * place_b
    lane_a, lane_b = lane_of(row_a + 8 * (STARTS - 1), la + 1, qa), lane_of(row_b + 8 * (STARTS - 1), lb + 1, qb)
    if la == 1 and lb == 1:
        at_a, at_b, sx, sy, sz, off, _, _, _, _, _ = meeting_leaves(a, row_a, qa, b, row_b, qb, scratch)
        x = f32(nodes_b, lane_b + 24) - f32(nodes_b, lane_b)
        y = f32(nodes_b, lane_b + 32) - f32(nodes_b, lane_b + 8)
        z = f32(nodes_b, lane_b + 40) - f32(nodes_b, lane_b + 16)
        record_leaves(
            front, pose, i64(scratch, PREPARED), at_a, min(8, i64(row_a, COUNT) - 8 * qa),
            i64(scratch, TURNED), at_b, min(8, i64(row_b, COUNT) - 8 * qb), sx, sy, sz, off,
            middle(nodes_b, lane_b), middle(nodes_b, lane_b + 8), middle(nodes_b, lane_b + 16),
            0.5000001 * np.sqrt(np.float64(x * x + y * y + z * z)), mask & filled(row_b, 1, qb), pair, bare,
        )  # fmt: skip
        return
    if la > lb:
        mask &= filled(row_a, la, qa)
        at_a = i64(row_a, STARTS + la - 1) + BOXES * qa
        bits = overlapping_lane(nodes_a, at_a, moved, lane_b) & mask
        record_boxes(front, pose, nodes_a, at_a, 1, moved, nodes_b, lane_b, 0, mask & ~bits, pair, bare)
        child, step = task_of(la - 1, 8 * qa, lb, qb), 1 << 8
    else:
        mask &= filled(row_b, lb, qb)
        at_b = i64(row_b, STARTS + lb - 1) + BOXES * qb
        move_node(b, at_b, scratch)
        bits = overlapping_lane(moved, at_b, nodes_a, lane_a) & mask
        record_boxes(front, pose, nodes_a, lane_a, 0, moved, nodes_b, at_b, 1, mask & ~bits, pair, bare)
        child, step = task_of(la, qa, lb - 1, 8 * qb), 1 << 32
    while bits != 0:
        _unknown(front, pose, pair, child + step * lowest(bits))
        bits &= bits - 1
