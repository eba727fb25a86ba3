"""Signed distances of points from a solid, and of two surfaces from each other.

The side of a point is that of the pseudonormal of the nearest feature, which is right for any closed mesh without
self-intersections (Bærentzen & Aanæs, "Signed Distance Computation Using the Angle Weighted Pseudonormal", 2005). Where
that normal is unreliable, in slivers and folds and at the rim of an open mesh, the winding number decides.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.bvh.layout import LANES, NODE, PACKET, Bvh
from collision.bvh.packets import box_middle, moved_triangle, near_triangles, nearest_of, triangle_of
from collision.bvh.single import ALONE, place_box
from collision.bvh.traverse import TRIANGLES, corner_of, float_limit, fresh_node, start, walk_nearest, workspace_for
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inline_kernel, inner_kernel, kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.simd import near_lane, point_lane, signed_lane
from collision.numeric.vectors import dot, sub
from collision.query.containment import query_about, winds
from collision.query.distance import rounding_of
from collision.triangle.motion import STILL, pair_step

FAR: Final = 1e12
"""1: float32 bounds are not computed for points farther from a packet than this many of its sizes"""


class Nearest(NamedTuple):
    """Task: find the triangle nearest to a point, within the distance in `value`."""

    point: Any
    value: Any
    """(4,) float64: squared distance, m², and nearest point"""
    place: Any
    """(2,) int64: triangle and feature"""

    def is_open(self, ws, bound):
        """Whether a box at this squared distance (m²) may hold a nearer triangle."""
        return bound < self.value[0]

    def children_of_a(self, a, b, ws, node, lane_b):
        """Bits: which boxes of a node may hold a nearer triangle."""
        return near_lane(a.boxes, NODE * node, ws.moved, 0, float_limit(self.value[0]), ws.bounds)

    def visit(self, a, b, ws, lane_a, lane_b):
        """Update `self` with the triangles of a packet, those of the least bounds first."""
        packet = ~np.int64(a.child[lane_a])
        triangle_bounds(a, ws, lane_a, self.point)
        first, bounds = np.int64(a.first[packet]), ws.bounds
        while True:
            k = 0
            for i in range(1, np.int64(a.first[packet + 1]) - first):
                if bounds[i] < bounds[k]:
                    k = i
            bound = np.float64(bounds[k])
            if bound * bound >= self.value[0]:
                return False
            bounds[k] = np.inf
            t = first + k
            q, feature = nearest_on(a, t, self.point)
            w = sub(self.point, q)
            square = dot(w, w)
            if square < self.value[0]:
                self.value[0], self.value[1], self.value[2], self.value[3] = square, q[0], q[1], q[2]
                self.place[0], self.place[1] = t, feature


@inline_kernel
def triangle_bounds(bvh, ws, lane, point):
    """Write lower bounds of the distances (m) of a point from the triangles of a packet to `ws.bounds`, NaN in an empty
    lane."""
    middle, _ = box_middle(bvh, lane)
    x, size = sub(point, middle), np.float64(bvh.size[lane])
    reach = abs(x[0]) + abs(x[1]) + abs(x[2])
    if size == 0.0 or reach > FAR * size:
        for k in range(LANES):
            ws.bounds[k] = 0.0
        return
    scale = 1.0 / size
    noise = 2.0**-50 * (abs(point[0]) + abs(point[1]) + abs(point[2]) + bvh.frame[6])
    slack = 2.0**-18 * (1.0 + scale * reach) + scale * noise
    point_lane(
        bvh.packets, PACKET * ~np.int64(bvh.child[lane]), np.float32(scale),
        np.float32(scale * x[0]), np.float32(scale * x[1]), np.float32(scale * x[2]), np.float32(slack), ws.bounds,
    )  # fmt: skip
    for k in range(LANES):
        ws.bounds[k] *= np.float32(size)


@inline_kernel
def nearest_on(bvh, t, p):
    """(point of triangle t nearest to p, feature), see `closest_on_triangle`; t in leaf order."""
    return closest_on_triangle(p, corner_of(bvh, 3 * t), corner_of(bvh, 3 * t + 1), corner_of(bvh, 3 * t + 2))


@inline_kernel
def nearest(query, lane, p, bound):
    """Return the triangle below a lane that is nearest to p, -1 if none is within `bound` (squared, m²).

    `query.value` and `query.place` get its squared distance, nearest point and feature.
    """
    query.value[0], query.place[0] = bound, -1
    bvh = query.solid.bvh
    place_box(bvh, query.ws, p, p)
    walk_nearest(Nearest(p, query.value, query.place), bvh, bvh, query.ws, lane, ALONE, np.float32(0.0))
    return query.place[0]


@inner_kernel
def depth_at(query, p, guess):
    """(depth of p behind the solid's boundary, m, negative in front of it; nearest triangle).

    guess: a triangle whose distance is the first upper bound.
    """
    solid, t = query.solid, guess
    q, feature = nearest_on(solid.bvh, guess, p)
    w = sub(p, q)
    square = dot(w, w)
    if nearest(query, 0, p, square) >= 0:
        square, t, feature = query.value[0], query.place[0], query.place[1]
        q = query.value[1], query.value[2], query.value[3]
    if solid.sure[7 * t + feature]:
        at = 21 * t + 3 * feature
        behind = dot((solid.normal[at], solid.normal[at + 1], solid.normal[at + 2]), sub(p, q)) < 0.0
    else:
        behind = winds(query, p)
    return (np.sqrt(square) if behind else -np.sqrt(square)), t


# --- two surfaces -----------------------------------------------------------------------------------------------------


class SignedDistance(NamedTuple):
    """Task: find the least signed distance of two surfaces' triangles: their distance, or where they meet minus the
    shortest translation that separates the two triangles."""

    least: Any
    """(2,) float64, m: the least signed distance so far; error bound of a float64 distance"""

    def children(self, ws, boxes, at, others, at_other):
        """Bits: which boxes of a node may be at a lesser signed distance from a box of the other hierarchy."""
        return signed_lane(boxes, at, others, at_other, float_limit(self.least[0] + self.least[1]), ws.bounds)

    def is_open(self, ws, bound):
        """Whether a pair of boxes of this signed distance (m) may hold a lesser one."""
        return bound <= self.least[0] + self.least[1]

    def visit(self, a, b, ws, lane_a, lane_b):
        """Lower `self.least` by the triangles of two packets, those of the least bounds first."""
        least, m, rounding, still = self.least, ws.pose.matrix, self.least[1], np.float32(0.0)
        limit = float_limit(least[0] + rounding)
        bits = near_triangles(a, b, ws, lane_a, lane_b, limit, (still, still, still), True)
        first_a, first_b = np.int64(a.first[~a.child[lane_a]]), np.int64(b.first[~b.child[lane_b]])
        while bits != 0:
            i = nearest_of(ws, bits)
            bits &= ~(np.int64(1) << i)
            if ws.bounds[LANES + i] > float_limit(least[0] + rounding):
                break
            one, other = triangle_of(a, first_a + (i & 7)), moved_triangle(b, first_b + (i >> 3), m)
            if boxes_apart(one, other) >= least[0]:
                continue
            ws.counts[TRIANGLES] += 1
            d, _ = pair_step(one, other, STILL, least[0] - rounding, 0.0, rounding, ws.exact)
            least[0] = min(least[0], d)
        return False


@inner_kernel
def boxes_apart(one, other):
    """Greatest gap of the boxes of two triangles along an axis, m; negative if they overlap."""
    (a, b, c), (p, q, r) = one, other
    gap = -np.inf
    for d in range(3):
        gap = max(gap, min(p[d], q[d], r[d]) - max(a[d], b[d], c[d]), min(a[d], b[d], c[d]) - max(p[d], q[d], r[d]))
    return gap


@inner_kernel
def least_signed_distance(a, b, ws, pair, within, least):
    """The signed distance (m) of a pair of surfaces, at most `within`; `start` must have been called.

    pair: surface of a · surfaces of b + surface of b. least: see `SignedDistance`.
    """
    lane_a, lane_b = np.int64(a.root[pair // len(b.root)]), np.int64(b.root[pair % len(b.root)])
    least[0] = within
    fresh_node(b, ws, lane_b >> 3)
    walk_nearest(SignedDistance(least), a, b, ws, lane_a, lane_b, np.float32(-np.inf))
    return least[0]


@kernel
def signed_distances_of_pairs(a, b, ws, pairs, within, out, least):
    """Fill `out` (n,) with the signed distances (m), at most `within`, of pairs (n, 2) of surfaces; b is at the pose in
    `ws.pose.matrix[:12]`. least: see `SignedDistance`."""
    start(a, b, ws)
    least[1] = rounding_of(a, b, ws.pose.matrix)
    for k in range(len(pairs)):
        out[k] = least_signed_distance(a, b, ws, pairs[k, 0] * len(b.root) + pairs[k, 1], within, least)


@kernel
def depths_at(query, points, out):
    """Fill `out` (n,) with `depth_at` of points (n, 3), m."""
    t = np.int64(0)
    for i in range(len(points)):
        out[i], t = depth_at(query, (points[i, 0], points[i, 1], points[i, 2]), t)


_depths_at = EntryPoint(depths_at)
_signed_distances = EntryPoint(signed_distances_of_pairs)


def signed_distances_of(
    a: Bvh, b: Bvh, pose: NDArray[np.float64], pairs: NDArray[np.integer], within: float
) -> NDArray[np.float64]:
    """Return (n,) signed distances, m, at most `within` (>= 0), of pairs (n, 2) of surfaces; b at a (12,) pose in a's
    frame. Negative where they meet: minus the shortest translation that separates two triangles."""
    ws, out = workspace_for(a, b), np.empty(len(pairs))
    ws.pose.matrix[:12] = pose
    pairs = np.ascontiguousarray(pairs, np.int64)
    _signed_distances.call(a, b, ws, pairs, within, out, np.empty(2))
    return out


def signed_distances(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.float64]:
    """Return (n,) distances, m, of points (n, 3), in the mesh's frame, from the mesh: negative behind it.

    For a closed mesh without self-intersections, behind is inside; where the nearest point lies in a sliver or a fold,
    or at the rim of an open mesh, the winding number decides.
    """
    p = np.array(points, np.float64).reshape(-1, 3)
    out = np.empty(len(p))
    _depths_at.call(query_about(mesh), p, out)
    return -out
