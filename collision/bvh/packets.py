"""Two packets of triangles: which pairs may be within a distance of each other, eight a time in float32."""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

import numpy as np

from collision.bvh.layout import LANES, PREPARED
from collision.bvh.traverse import (
    TRIANGLE_BOXES,
    box_at,
    corner_of,
    fresh_packets,
    moved_corner,
    packet_errors,
    reached,
)
from collision.numeric.kernel import inline_kernel
from collision.numeric.simd import edges_cross, edges_near, lowest, triangles_near


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
def triangle_of(a, t):
    """The corners of triangle t of a, in leaf order."""
    return corner_of(a, 3 * t), corner_of(a, 3 * t + 1), corner_of(a, 3 * t + 2)


@inline_kernel
def moved_triangle(b, t, matrix):
    """The same of b in a's frame."""
    return moved_corner(b, 3 * t, matrix), moved_corner(b, 3 * t + 1, matrix), moved_corner(b, 3 * t + 2, matrix)


@inline_kernel
def near_triangles(a, b, ws, lane_a, lane_b, limit, direction, meeting):
    """Bit 8·j + i: whether the signed distance of triangle i of a packet of a from triangle j of one of b may be at
    most `limit` (float32, m); `ws.bounds[8 + 8·j + i]` is how little it can be.

    direction: (x, y, z) float32, one along which they may be apart, or 0. meeting: whether triangles that meet are of
    interest; for those that are apart the bounds are better without.
    """
    p, q = ~np.int64(a.child[lane_a]), ~np.int64(b.child[lane_b])
    fresh_packets(a, b, ws, p, q)
    shift, half, errors = packet_errors(a, b, ws, lane_a, lane_b)
    off = errors[0]
    bits, bits_b = np.int64(0), reached(ws, q, shift, half, max(limit, np.float32(0.0)) + off)
    while bits_b != 0:
        j = lowest(bits_b)
        bits_b &= bits_b - 1
        at, to, out = PREPARED * p, PREPARED * q + j, ws.bounds[LANES + LANES * j :]
        ws.counts[TRIANGLE_BOXES] += LANES
        near = triangles_near(ws.prepared, at, ws.turned, to, shift, off, direction, limit, out)
        if near != 0:
            if meeting:
                near = edges_cross(ws.prepared, at, ws.turned, to, shift, off, limit, out)
            else:
                near = edges_near(ws.prepared, at, ws.turned, to, shift, off, limit, out)
        bits |= near << (LANES * j)
    return bits


@inline_kernel
def nearest_of(ws, bits):
    """The bit of the pair of triangles of least bound."""
    i, rest, bounds = lowest(bits), bits & (bits - 1), ws.bounds[LANES:]
    while rest != 0:
        if bounds[lowest(rest)] < bounds[i]:
            i = lowest(rest)
        rest &= rest - 1
    return i
