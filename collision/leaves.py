"""The bottom of the fast query: two leaves of eight triangles, told apart in float32 beyond doubt. Kernels."""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

import numpy as np
from numba import njit

from collision.lanes import perhaps_meeting, prepare_triangles, reaching, turn_triangles
from collision.memory import doubles, f32, f64, i32, i64, lowest, put_i64
from collision.polygons import triangles_meet
from collision.predicates import INNER, WORKSPACE
from collision.tables import (
    COUNTS_AT,
    MOTION_AT,
    POSE,
    PREPARED,
    PREPARED_FOR,
    QUESTION,
    SPREAD,
    STAMP,
    STAMP_A,
    TURNED,
    WORK,
)
from collision.wide import BOXES, CORNERS, FIRST, NODES, STARTS, TRIANGLES, VERTICES

_INLINE = INNER | {"forceinline": True}


@njit(**_INLINE)
def add(counts, i, n):
    """Add n to the i-th count."""
    put_i64(counts, i, i64(counts, i) + n)


@njit(**_INLINE)
def lane_of(starts, level, q):
    """Where the box of node q of a level is: lane q % 8 of node q // 8 of the level above; that of a top is noted."""
    return i64(starts, level) + BOXES * (q >> 3) + (q & 7)


@njit(**_INLINE)
def meeting_leaves(a, row_a, qa, b, row_b, qb, scratch):
    """Prepare two leaves: where that is, the shift s of b's, `off`, half the box of a's, and the sizes of both.

    Both are about the centre of a's. Coordinates there are off by at most 10 roundings of float32 of the leaves' size
    (those of b turned and shifted) and by what the float64 vertices are off; differences by `off`.
    """
    nodes_a, nodes_b, counts = i64(a, NODES), i64(b, NODES), i64(scratch, COUNTS_AT)
    leaf_a, leaf_b = i64(row_a, STARTS) + TRIANGLES * qa, i64(row_b, STARTS) + TRIANGLES * qb
    lane_a, lane_b = lane_of(row_a + 8 * (STARTS - 1), 2, qa), lane_of(row_b + 8 * (STARTS - 1), 2, qb)
    stamp, stamp_a, question = i64(scratch, STAMP), i64(scratch, STAMP_A), i64(counts, QUESTION)
    pose, motion = i64(scratch, POSE), i64(scratch, MOTION_AT)
    question_a = i64(counts, PREPARED_FOR)
    if question_a == 0:
        question_a = question
    if i64(stamp_a, leaf_a >> 3) != question_a:
        put_i64(stamp_a, leaf_a >> 3, question_a)
        prepare_triangles(nodes_a, leaf_a, i64(scratch, PREPARED), SPREAD * leaf_a)
    if i64(stamp, leaf_b >> 3) != question:
        put_i64(stamp, leaf_b >> 3, question)
        turn_triangles(nodes_b, leaf_b, motion, i64(scratch, TURNED), SPREAD * leaf_b)
    half = np.float32(0.5)
    bx, by, bz = middle(nodes_b, lane_b), middle(nodes_b, lane_b + 8), middle(nodes_b, lane_b + 16)
    ax, ay, az = middle(nodes_a, lane_a), middle(nodes_a, lane_a + 8), middle(nodes_a, lane_a + 16)
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
    return SPREAD * leaf_a, SPREAD * leaf_b, sx, sy, sz, off, hx, hy, hz, size_a, size_b


@njit(**_INLINE)
def leaves_meet(a, row_a, qa, b, row_b, qb, mask, scratch):
    """Two triangles in which two leaves meet (as `best.search` has them), of b's those in the mask, or -1.

    With e, f, w off by `off` an entry, their determinant is off by no more than off·(|e||f| + |f||w| + |w||e|) in sum
    norms, each enlarged by 2·off; its rounding adds less than 2·off·|e||f|, and 1% is for the rounding of the bound.
    """
    at_a, at_b, sx, sy, sz, off, hx, hy, hz, size_a, size_b = meeting_leaves(a, row_a, qa, b, row_b, qb, scratch)
    turned, prepared, counts = i64(scratch, TURNED), i64(scratch, PREPARED), i64(scratch, COUNTS_AT)
    first_a, first_b = i64(row_a, FIRST) + 8 * qa, i64(row_b, FIRST) + 8 * qb
    add(counts, 2, 8)
    bits_b = mask & reaching(
        turned, at_b, -hx - sx - off, -hy - sy - off, -hz - sz - off, hx - sx + off, hy - sy + off, hz - sz + off
    )
    reach = size_a + np.float32(1.8) * size_b + np.float32(2.0) * off  # of any difference, where boxes overlap
    kf = np.float32(1.01) * off * (reach + np.float32(6.0) * off)
    kp = np.float32(3.03) * off
    k = np.float32(1.01) * off * off * (np.float32(4.0) * reach + np.float32(12.0) * off)
    while bits_b != 0:
        j = lowest(bits_b)
        bits_b &= bits_b - 1
        add(counts, 2, 8)
        bits = perhaps_meeting(prepared, at_a, turned, at_b + j, sx, sy, sz, off, kf, kp, k)
        while bits != 0:
            t = first_a + lowest(bits)
            bits &= bits - 1
            if pair_meets(a, t, b, first_b + j, scratch):
                return (t << 32) + first_b + j
    return -1


@njit(**INNER)
def pair_meets(a, ta, b, tb, scratch):
    """Whether triangle `ta` of a meets triangle `tb` of b, moved; both in leaf order."""
    add(i64(scratch, COUNTS_AT), 3, 1)
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
def middle(nodes, lane):
    """Middle of the box in a lane along one axis, m."""
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
