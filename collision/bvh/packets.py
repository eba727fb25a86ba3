"""Pairs of triangles of two packets that may be within a distance of each other, eight at a time in float32."""

from __future__ import annotations

import numpy as np

from collision.bvh.layout import LANES, PREPARED
from collision.bvh.traverse import (
    TRIANGLE_BOXES,
    box_at,
    corner_of,
    fresh_packets,
    middle_and_half,
    moved_corner,
    packet_errors,
    reached,
)
from collision.numeric.kernel import inline_kernel
from collision.numeric.simd import edges_cross, edges_near, lowest, triangles_near
from collision.numeric.vectors import along


@inline_kernel
def box_middle(bvh, lane):
    """(middle, half edges), each (x, y, z), of the box in a lane, in the mesh's frame, m."""
    middle, half = middle_and_half(bvh.boxes, box_at(lane))
    return along(bvh.frame, 1.0, middle), half


@inline_kernel
def triangle_of(a, t):
    """The corners of triangle t of a, in leaf order, m."""
    return corner_of(a, 3 * t), corner_of(a, 3 * t + 1), corner_of(a, 3 * t + 2)


@inline_kernel
def moved_triangle(b, t, matrix):
    """The corners of triangle t of b, in leaf order, moved into a's frame by `matrix`, m."""
    return moved_corner(b, 3 * t, matrix), moved_corner(b, 3 * t + 1, matrix), moved_corner(b, 3 * t + 2, matrix)


@inline_kernel
def near_triangles(a, b, ws, lane_a, lane_b, limit, direction, meeting):
    """Bits of the pairs of triangles of two packets whose signed distance may be at most `limit` (float32, m).

    Bit 8·j + i is for triangle i of a's packet and j of b's; `ws.bounds[8 + 8·j + i]` is a lower bound of their signed
    distance. direction: (x, y, z) float32, a candidate for a separating direction, or 0. meeting: also bound the depth
    of triangles that meet, at the price of weaker bounds for those that are apart.
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
    """The bit, of those set, whose pair of triangles has the least bound."""
    i, rest, bounds = lowest(bits), bits & (bits - 1), ws.bounds[LANES:]
    while rest != 0:
        if bounds[lowest(rest)] < bounds[i]:
            i = lowest(rest)
        rest &= rest - 1
    return i
