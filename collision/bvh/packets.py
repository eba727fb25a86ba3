"""Two packets of triangles: which pairs may be within a distance of each other, eight a time in float32."""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

import numpy as np

from collision.bvh.layout import LANES, PREPARED
from collision.bvh.traverse import TRIANGLE_BOXES, box_at, fresh_packets, inline_kernel
from collision.numeric.simd import lowest, perhaps_meeting, reaching


@inline_kernel
def box_middle(bvh, lane):
    """(middle, half the edges) of the box in a lane, in the mesh's frame, m."""
    at, boxes, frame = box_at(lane), bvh.boxes, bvh.frame
    x0, x1 = np.float64(boxes[at]), np.float64(boxes[at + 3 * LANES])
    y0, y1 = np.float64(boxes[at + LANES]), np.float64(boxes[at + 4 * LANES])
    z0, z1 = np.float64(boxes[at + 2 * LANES]), np.float64(boxes[at + 5 * LANES])
    return (
        (frame[0] + 0.5 * (x0 + x1), frame[1] + 0.5 * (y0 + y1), frame[2] + 0.5 * (z0 + z1)),
        (0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (z1 - z0)),
    )


@inline_kernel
def near_triangles(a, b, ws, lane_a, lane_b, distance, out):
    """Place in `out` (64,) the pairs of triangles of two packets that may be within a distance (m), as 2^32·(that of a)
    + that of b in leaf order; how many.

    Left out are pairs that are farther apart along an axis, or all corners of one on one side of the other's plane. The
    error bounds are those of `collision.query.intersection.packets_meet`. A determinant of edges e, f and a difference
    is the distance from the plane times |e × f|, which is at most |e||f|.
    """
    p, q = ~np.int64(a.child[lane_a]), ~np.int64(b.child[lane_b])
    fresh_packets(a, b, ws, p, q)
    m = ws.pose.matrix
    middle_a, half = box_middle(a, lane_a)
    (bx, by, bz), _ = box_middle(b, lane_b)
    sx = np.float32(m[0] * bx + m[1] * by + m[2] * bz + (m[9] - middle_a[0]))
    sy = np.float32(m[3] * bx + m[4] * by + m[5] * bz + (m[10] - middle_a[1]))
    sz = np.float32(m[6] * bx + m[7] * by + m[8] * bz + (m[11] - middle_a[2]))
    hx, hy, hz = np.float32(half[0]), np.float32(half[1]), np.float32(half[2])
    size_a, size_b = a.size[lane_a], b.size[lane_b]
    gap = np.float32(min(distance * (1.0 + 2.0**-20) + 1e-37, 3e38))
    off = np.float32(20.0 * 2.0**-24) * (size_a + size_b + gap) + ws.pose.motion[22]
    reach = size_a + np.float32(1.8) * size_b + np.float32(2.0) * off + np.float32(3.0) * gap  # of any difference
    kf = np.float32(1.01) * off * (reach + np.float32(6.0) * off + np.float32(2.0) * gap)
    kp = np.float32(3.03) * off + np.float32(1.01) * gap
    k = np.float32(1.01) * off * off * (np.float32(4.0) * (reach + gap) + np.float32(12.0) * off)
    wide = off + gap
    first_a, first_b = np.int64(a.first[p]), np.int64(b.first[q])
    found = 0
    bits_b = reaching(
        ws.turned, PREPARED * q,
        -hx - sx - wide, -hy - sy - wide, -hz - sz - wide, hx - sx + wide, hy - sy + wide, hz - sz + wide,
    )  # fmt: skip
    ws.counts[TRIANGLE_BOXES] += LANES
    while bits_b != 0:
        j = lowest(bits_b)
        bits_b &= bits_b - 1
        ws.counts[TRIANGLE_BOXES] += LANES
        bits = perhaps_meeting(ws.prepared, PREPARED * p, ws.turned, PREPARED * q + j, sx, sy, sz, wide, kf, kp, k)
        while bits != 0:
            out[found] = ((first_a + lowest(bits)) << 32) + first_b + j
            found += 1
            bits &= bits - 1
    return found
