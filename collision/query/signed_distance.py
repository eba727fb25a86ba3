"""Signed distances of points from a solid: how far its boundary is, and on which side of it they lie.

The side is told by the pseudonormal of the nearest feature, which is right for any closed mesh without
self-intersections (Bærentzen & Aanæs, "Signed Distance Computation Using the Angle Weighted Pseudonormal", 2005); by
the winding number where that normal is not sure: in slivers and folds, and where an open mesh ends.
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.bvh.layout import LANES, NODE, PACKET, Bvh
from collision.bvh.packets import box_middle, near_triangles
from collision.bvh.single import ALONE, below_packets_alone, no_children, place_box
from collision.bvh.traverse import (
    TRIANGLES,
    Door,
    below_packets,
    box_at,
    children_of_a,
    children_of_b,
    corner_of,
    fresh_node,
    implements,
    inline_kernel,
    is_bottom,
    is_open,
    moved_corner,
    near_surfaces,
    start,
    visit,
    walk_nearest,
    workspace,
    workspace_for,
)
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.simd import near_lane, point_lane, signed_lane
from collision.numeric.vectors import dot, sub
from collision.query.containment import query_about, winds
from collision.query.distance import rounding_of
from collision.triangle.distance import planes_part
from collision.triangle.motion import pair_step
from collision.triangle.point import closest_on_triangle

FAR: Final = 1e12
"""1: a packet is not looked at in float32 from a distance of this many of its sizes"""


class Nearest(NamedTuple):
    """Task: the triangle nearest to a point, of those nearer than is known."""

    point: Any
    value: Any
    """(4,) float64: squared distance, m², and nearest point"""
    place: Any
    """(2,) int64: triangle and feature"""


implements(is_bottom, Nearest)(below_packets_alone)
implements(children_of_b, Nearest)(no_children)


@inner_kernel
def float_limit(square):
    """A float32 not below a squared distance."""
    return np.float32(min(square * (1.0 + 2.0**-20) + 1e-37, 3e38))


@implements(is_open, Nearest)
def may_be_nearer(task, ws, bound):
    return bound < task.value[0]


@implements(children_of_a, Nearest)
def nearer_children(task, a, b, ws, node, lane_b):
    return near_lane(a.boxes, NODE * node, ws.moved, 0, float_limit(task.value[0]), ws.bounds)


@inline_kernel
def triangle_bounds(bvh, ws, lane, point):
    """Place in `ws.bounds` lower bounds of the distances (m) of a point from the triangles of a packet, NaN where there
    is none."""
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


@implements(visit, Nearest)
def nearest_in_packet(task, a, b, ws, lane_a, lane_b):
    packet = ~np.int64(a.child[lane_a])
    triangle_bounds(a, ws, lane_a, task.point)
    first = np.int64(a.first[packet])
    for k in range(np.int64(a.first[packet + 1]) - first):
        bound = np.float64(ws.bounds[k])
        if bound * bound < task.value[0]:
            t = first + k
            q, feature = closest_on_triangle(
                task.point, corner_of(a, 3 * t), corner_of(a, 3 * t + 1), corner_of(a, 3 * t + 2)
            )
            w = sub(task.point, q)
            square = dot(w, w)
            if square < task.value[0]:
                task.value[0], task.value[1], task.value[2], task.value[3] = square, q[0], q[1], q[2]
                task.place[0], task.place[1] = t, feature
    return False


@inner_kernel
def nearest(query, lane, p, bound):
    """Place in `query.value` and `query.place` the triangle below a lane that is nearest to p, if its squared distance
    is below `bound` (m²), else triangle -1. Returns the triangle."""
    query.value[0], query.place[0] = bound, -1
    bvh = query.solid.bvh
    place_box(bvh, query.ws, p, p)
    walk_nearest(Nearest(p, query.value, query.place), bvh, bvh, query.ws, lane, ALONE, np.float32(0.0))
    return query.place[0]


@inline_kernel
def nearest_on(bvh, t, p):
    """(point of triangle t nearest to p, the feature it lies on), see `closest_on_triangle`."""
    return closest_on_triangle(p, corner_of(bvh, 3 * t), corner_of(bvh, 3 * t + 1), corner_of(bvh, 3 * t + 2))


@inner_kernel
def depth_at(query, p, guess):
    """(depth of p behind the solid's boundary, m, negative before it; nearest triangle), by way of the triangle
    `guess`."""
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
    """Task: the least signed distance of two surfaces' triangles: their distance, or where they meet minus the shortest
    translation that parts the two triangles."""

    least: Any
    """(2,) float64, m: the least signed distance; how far a float64 distance may be off"""
    found: Any
    """(64,) int64: pairs of triangles"""


implements(is_bottom, SignedDistance)(below_packets)


@inner_kernel
def _signed_limit(least):
    """A float32 not below a signed distance and its error."""
    x = least[0] + least[1]
    return np.float32(min(x + 2.0**-22 * abs(x) + 1e-37, 3e38))


@implements(is_open, SignedDistance)
def may_be_less(task, ws, bound):
    return bound <= task.least[0] + task.least[1]


@implements(children_of_a, SignedDistance)
def less_children_of_a(task, a, b, ws, node, lane_b):
    return signed_lane(a.boxes, NODE * node, ws.moved, box_at(lane_b), _signed_limit(task.least), ws.bounds)


@implements(children_of_b, SignedDistance)
def less_children_of_b(task, a, b, ws, lane_a, node):
    return signed_lane(ws.moved, NODE * node, a.boxes, box_at(lane_a), _signed_limit(task.least), ws.bounds)


@implements(visit, SignedDistance)
def less_in_packets(task, a, b, ws, lane_a, lane_b):
    m, still, rounding = ws.pose.matrix, (0.0, 0.0, 0.0), task.least[1]
    reach = max(0.0, task.least[0]) + rounding
    for i in range(near_triangles(a, b, ws, lane_a, lane_b, reach, task.found)):
        ta, tb = 3 * (task.found[i] >> 32), 3 * (task.found[i] & 0xFFFFFFFF)
        x, y, z = corner_of(a, ta), corner_of(a, ta + 1), corner_of(a, ta + 2)
        p, q, r = moved_corner(b, tb, m), moved_corner(b, tb + 1, m), moved_corner(b, tb + 2, m)
        least = task.least[0]
        beyond = -np.inf  # what parts their boxes parts the triangles: a lower bound of their signed distance
        for d in range(3):
            low_a, high_a = min(x[d], y[d], z[d]), max(x[d], y[d], z[d])
            low_b, high_b = min(p[d], q[d], r[d]), max(p[d], q[d], r[d])
            beyond = max(beyond, low_b - high_a, low_a - high_b)
        if beyond < least and not planes_part(x, y, z, p, q, r, max(0.0, least)):
            ws.counts[TRIANGLES] += 1
            enough = least - rounding
            d, _ = pair_step(
                x, y, z, p, q, r, still, still, still, 0.0, 0.0, enough, enough, 0.0, rounding, ws.exact
            )  # fmt: skip
            task.least[0] = min(least, d)
    return False


@kernel
def near_pairs(a, b, ws, distance):
    """Fill `ws.pairs` with the pairs of surfaces whose boxes are within a distance (m), b at the pose in
    `ws.pose.matrix[:12]`; how many, which may be more than there is room for."""
    start(a, b, ws)
    reach = distance + rounding_of(a, b, ws.pose.matrix)
    return near_surfaces(a, b, ws, reach * reach)


@kernel
def signed_distances_of_pairs(a, b, ws, pairs, within, out, least, found):
    """Fill `out` (n,) with the signed distances (m) of pairs (n, 2) of surfaces, or `within` where they are more, b at
    the pose in `ws.pose.matrix[:12]`; least, found: see `SignedDistance`."""
    start(a, b, ws)
    least[1] = rounding_of(a, b, ws.pose.matrix)
    for k in range(len(pairs)):
        least[0] = within
        lane_a, lane_b = np.int64(a.root[pairs[k, 0]]), np.int64(b.root[pairs[k, 1]])
        fresh_node(b, ws, lane_b >> 3)
        walk_nearest(SignedDistance(least, found), a, b, ws, lane_a, lane_b, np.float32(-np.inf))
        out[k] = least[0]


@kernel
def depths_at(query, points, out):
    """`depth_at` of points (n, 3), into `out` (n,)."""
    t = np.int64(0)
    for i in range(len(points)):
        out[i], t = depth_at(query, (points[i, 0], points[i, 1], points[i, 2]), t)


_depths_at = Door(depths_at)


_near_pairs = Door(near_pairs)
_signed_distances = Door(signed_distances_of_pairs)


def near_surface_pairs(a: Bvh, b: Bvh, pose: NDArray[np.float64], distance: float) -> NDArray[np.int64]:
    """(n, 2) pairs of surfaces whose boxes are within a distance (m), b at a (12,) pose in a's frame; sorted."""
    ws, near = workspace_for(a, b), -1
    while near < 0 or near > len(ws.pairs):
        ws = workspace(pairs=near)
        ws.pose.matrix[:12] = pose
        near = _near_pairs.call(a, b, ws, distance)
    return np.stack(np.divmod(np.sort(ws.pairs[:near]), len(b.root)), axis=1)


def signed_distances_of(
    a: Bvh, b: Bvh, pose: NDArray[np.float64], pairs: NDArray[np.integer], within: float
) -> NDArray[np.float64]:
    """(n,) signed distances (m) of pairs (n, 2) of surfaces, b at a (12,) pose in a's frame; `within` (at least 0)
    where they are more. Negative where they meet: minus the shortest translation that parts two triangles."""
    ws, out = workspace_for(a, b), np.empty(len(pairs))
    ws.pose.matrix[:12] = pose
    pairs = np.ascontiguousarray(pairs, np.int64)
    _signed_distances.call(a, b, ws, pairs, within, out, np.empty(2), np.empty(64, np.int64))
    return out


def signed_distances(mesh: SurfaceMesh, points: ArrayLike) -> NDArray[np.float64]:
    """(n,) distances in m of points (n, 3), in the mesh's frame, to the mesh: negative behind the nearest surface.

    For a closed mesh without self-intersections, behind is inside; where the nearest point lies in a sliver or a fold,
    or where an open mesh ends, the winding number tells.
    """
    p = np.array(points, np.float64).reshape(-1, 3)
    out = np.empty(len(p))
    _depths_at.call(query_about(mesh), p, out)
    return -out
