"""How deep two surfaces that meet reach into one another's material, and which way out.

The depth of a point x behind the boundary of a solid A is its distance to that boundary: the length of the shortest
translation that takes x out of A. The depth of surface t of B in surface s of A is that of the deepest point of t whose
nearest boundary point lies on s; the depth of the pair is the greater of t in A and s in B. For indentations that are
shallow against the parts this is the translation that parts the two surfaces: the overlap d of two boxes face to face,
the height of a sphere's cap below a plane, the interference of a peg and a bore's wall. It grows with every
translation into the material as long as the nearest surface stays the same; it is never more than half the wall's
thickness, for beyond the middle the other side is nearer. Surfaces that only touch have depth 0. Behind means inside
for closed meshes; an open mesh counts as the boundary of what lies behind it, and where it ends the winding number
decides (see `collision.query.signed_distance`).

Depths are found by branch and bound, from below: none is deeper than what is returned by more than `Tolerance.depth`
(1 %) of it and of `Tolerance.linear`, unless `BUDGET` ended the search, or `SETTLED` pieces settled what the caller
wants to know, see `penetration`; an upper bound is returned as well. What is searched are the hierarchies of s and of
t, and below their packets triangles that are cut in two. Each piece has an upper bound of the depth of its points;
the piece of the greatest bound is opened next, until no bound is above the deepest point seen by more than the
precision. Both directions are one search: the deepest point of either rules out pieces of both. A point of s in B
counts only if it is deeper than those of t in A by more than the precision.

Of a piece with middle c and radius r, no point is deeper than the depth of c plus r, for the distance to a boundary is
1-Lipschitz. Of a triangle there are up to six convex functions of its points that are never below their depth: the
distance to a triangle of the boundary, the nearest to one of its corners, and the depth of a corner plus the
distance from it. A convex function is at most the linear one through its values in the corners, so the depth is at most
the greatest value over the triangle of the lesser of two such linear functions (which lies in a corner or on an edge).
With one that belongs to each side of a wall, that is tight even where the depth has its ridge, half way through. No
point is deeper than a step by which the whole triangle comes out of the solid. And a triangle is left out if no point
of it has its nearest boundary point on s: the distance to a triangle of s is never below its tangent at c, that to
another triangle of the boundary never above the linear function through its values in the corners.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.bvh.build import bvh_of
from collision.bvh.layout import LANES, NODE, PACKET, PREPARED, Bvh
from collision.bvh.packets import box_middle, triangle_of
from collision.bvh.single import ALONE, place_box
from collision.bvh.traverse import QUESTION, box_at, corner_of, float_limit, moved_corner, walk
from collision.contact import PENETRATION_DTYPE
from collision.mesh import SurfaceMesh
from collision.numeric.kernel import EntryPoint, inline_kernel, inner_kernel, kernel
from collision.numeric.rigid_transforms import transform
from collision.numeric.simd import lowest, near_lane, overlapping_lane, prepare_triangles, reaching
from collision.numeric.vectors import along, dot, norm, sub
from collision.objects import Objects
from collision.poses import pack_rigid
from collision.query.containment import SolidQuery, query_about, winds
from collision.query.distance import clearance_at
from collision.query.intersection import enabled_pairs
from collision.query.signed_distance import depth_at, nearest, nearest_on, triangle_bounds
from collision.triangle.distance import planes_part
from collision.triangle.intersection import triangles_meet

if TYPE_CHECKING:
    import pinocchio as pin


BUDGET: Final = 20000
"""pieces opened for a pair of surfaces; beyond it the deepest point seen counts"""
SETTLED: Final = 512
"""pieces opened for a pair of surfaces from which on the search may end before its precision is reached"""
TURN: Final = 32
"""pieces opened in one direction before the other is considered again"""
BEYOND: Final = 2.0**-46
"""1: a triangle that is farther than another by this part of the coordinates is surely not the nearest …"""
TIE: Final = 2.0**-44
"""1: … and one that is farther by no more than this part is as near, but for rounding; above `BEYOND`, so that small
pieces are either left out or seen"""
STEEP: Final = 0.7
"""1: cosine of the angle between two sides from which on they count as almost parallel when a triangle is cut"""
NEAR_END: Final = 0.05
"""1: share of an edge that a cut leaves at least"""
SHORT: Final = 0.8
"""1: share of the longest edge below which another is not cut, so that no slivers come of it"""


# --- pieces, and a heap of those that are not yet opened -------------------------------------------------------------

BOUND, CORNERS, DEPTHS, PIECE = 0, 1, 10, 13
"""places of a piece in `Pieces.value`: no point is deeper; nine coordinates; the three corners' depths; numbers"""
LANE: Final = 3
"""place in `Pieces.index` of the lane, -1 of a triangle; before it the nearest triangles of the three corners"""


class Pieces(NamedTuple):
    """The pieces of a search, and the heap of those that are not yet opened, greatest bound first."""

    value: Any
    """(n, 13) float64, see above"""
    index: Any
    """(n, 4) int64: triangles of the solid nearest to each corner (the first, to the middle of a box); lane or -1"""
    heap: Any
    """(n,) int64"""
    size: Any
    """(2,) int64: length of the heap, pieces made"""


@inline_kernel
def _new_piece(pieces, bound, lane):
    place = pieces.size[1]
    pieces.size[1] += 1
    pieces.value[place, BOUND], pieces.index[place, LANE] = bound, lane
    return place


@inner_kernel
def _push(pieces, place):
    """Insert a piece into the heap."""
    value, heap = pieces.value, pieces.heap
    i = pieces.size[0]
    pieces.size[0] += 1
    while i > 0:
        up = (i - 1) // 2
        if value[heap[up], BOUND] >= value[place, BOUND]:
            break
        heap[i] = heap[up]
        i = up
    heap[i] = place


@inner_kernel
def _pop(pieces):
    """Remove the piece of greatest bound from the heap and return it."""
    value, heap = pieces.value, pieces.heap
    pieces.size[0] -= 1
    n = pieces.size[0]
    top, last = heap[0], heap[n]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= n:
            break
        if child + 1 < n and value[heap[child + 1], BOUND] > value[heap[child], BOUND]:
            child += 1
        if value[heap[child], BOUND] <= value[last, BOUND]:
            break
        heap[i] = heap[child]
        i = child
    heap[i] = last
    return top


# --- a search --------------------------------------------------------------------------------------------------------


class Direction(NamedTuple):
    """One of two meshes as the solid, the other as the body that penetrates it, with the depths known so far."""

    query: SolidQuery
    other: Bvh
    matrix: Any
    """(12,) float64: pose of the other mesh in the solid's frame, rotation by rows, translation"""
    depth: Any
    """(n,) float64: depths in the solid of the vertices of `other`, m, filled on demand"""
    nearest: Any
    """(n,) int64: nearest triangles of the solid to these vertices; -1 if not computed"""
    pieces: Pieces
    side: Any
    """0 if the solid is the first of the two meshes, else 1"""


class Search(NamedTuple):
    """A search for the deepest point of a surface of another mesh behind one surface of a solid."""

    way: Direction
    best: Any
    """(9,) float64: greatest depth known, its point, the nearest point of the solid's surface; m, in the frame of the
    solid; `Direction.side` of that solid; at the end a depth that none exceeds by more than the precision"""
    surface: Any
    """of the solid"""
    relative: Any
    precision: Any
    """1, m: precision of the depth, relative and absolute"""
    guess: Any
    """m: estimate of the depth, tested before the exact search"""


@inline_kernel
def _enough(search):
    """The least depth that is still searched for, m."""
    return search.best[0] * (1.0 + search.relative) + search.precision


@inline_kernel
def _least_better(search):
    """The depth above which a point replaces the best, m; larger if the best is of the first direction and the point is
    not, so that the direction of a penetration does not depend on rounding."""
    return _enough(search) if search.best[7] < search.way.side and search.best[0] > 0.0 else search.best[0]


@inner_kernel
def _nearest_below(query, lane, p, bound):
    """`nearest`, not made part of its callers."""
    return nearest(query, lane, p, bound)


@inline_kernel
def _coordinates(bvh, p):
    """m: the size of the coordinates of p and a mesh, to which the rounding of distances is in proportion."""
    return abs(p[0]) + abs(p[1]) + abs(p[2]) + bvh.frame[6]


@inner_kernel
def _see(search, p, depth, t):
    """Record p if it is the deepest point so far and its nearest triangle t, or one as near, is on the surface.

    A closed mesh must also wind about p: where it intersects itself, points behind the nearest triangle may be outside.
    """
    best, query = search.best, search.way.query
    bvh = query.solid.bvh
    if query.solid.surface[t] == search.surface:
        q, _ = nearest_on(bvh, t, p)
    elif _nearest_below(query, np.int64(bvh.root[search.surface]), p, (depth + TIE * _coordinates(bvh, p)) ** 2) >= 0:
        q = query.value[1], query.value[2], query.value[3]
    else:
        return
    if query.solid.closed and not winds(query, p):
        return
    best[0], best[7] = depth, search.way.side
    for d in range(3):
        best[1 + d], best[4 + d] = p[d], q[d]


@inner_kernel
def _most(f):
    return max(f[0], f[1], f[2])


@inner_kernel
def _peak(f, g):
    """The greatest value, over a triangle, of the lesser of two linear functions given by their values in its corners.

    The lesser is concave, and linear on either side of the line f = g: it is greatest in a corner, or where that line
    crosses an edge.
    """
    top = max(min(f[0], g[0]), min(f[1], g[1]), min(f[2], g[2]))
    for k in range(3):
        i = (k + 1) % 3
        u, v = f[k] - g[k], f[i] - g[i]
        if (u > 0.0 and v < 0.0) or (u < 0.0 and v > 0.0):
            top = max(top, f[k] + u / (u - v) * (f[i] - f[k]))
    return top


@inline_kernel
def _to_triangle(bvh, t, p, known, distance):
    """The distance of p from triangle t; `distance` if that is the triangle known to be nearest to p."""
    if t == known:
        return abs(distance)
    q, _ = nearest_on(bvh, t, p)
    return norm(sub(p, q))


@inline_kernel
def _cones(closed, p, q, r, depth):
    """Three linear functions that no point of the triangle p q r is deeper than: the depth of a corner and the distance
    from it, by their values in the corners.

    About the rim of an open mesh the depth leaps from one side to the other; there it is the distance that is bounded.
    """
    dp, dq, dr = depth
    if not closed:
        dp, dq, dr = abs(dp), abs(dq), abs(dr)
    pq, qr, rp = norm(sub(p, q)), norm(sub(q, r)), norm(sub(r, p))
    return (dp, dp + pq, dp + rp), (dq + pq, dq, dq + qr), (dr + rp, dr + qr, dr)


@inner_kernel
def _bound(bound, cone, far, enough):
    """Upper bound of the depth over a triangle, from `bound`, its cones and `far`; stops early at `enough`."""
    for i in range(3):
        bound = min(bound, _peak(far[i], far[(i + 1) % 3]))
        if bound <= enough:
            return bound
    for i in range(3):
        for j in range(3):
            bound = min(bound, _peak(far[i], cone[j]))
            if bound <= enough:
                return bound
    return bound


class MayBeNearest(NamedTuple):
    """Task: a triangle, below a lane, that may be the nearest of the boundary to a point of the triangle p q r."""

    middle: Any
    """of p, q, r"""
    reach: Any
    """m: from this distance of the middle on, no triangle is"""
    corners: Any
    """p, q, r less the middle"""
    far: Any
    """distances of p, q, r from each of three triangles of the boundary that are not below the lane"""
    margin: Any
    """m: by which a distance is surely greater than another"""

    def children_of_a(self, a, b, ws, node, lane_b):
        """Bits: which boxes of a node come within the reach of the middle, and may hold the nearest triangle."""
        bits = near_lane(a.boxes, NODE * node, ws.moved, 0, float_limit(self.reach * self.reach), ws.bounds)
        rest, (x, y, z) = bits, self.middle
        while rest != 0:
            (u, v, w), half = box_middle(a, LANES * node + lowest(rest))
            q = (
                max(u - half[0], min(x, u + half[0])),
                max(v - half[1], min(y, v + half[1])),
                max(w - half[2], min(z, w + half[2])),
            )
            if _never_nearest(self.middle, self.corners, self.far, norm(sub(self.middle, q)), q, self.margin):
                bits &= ~(rest & -rest)
            rest &= rest - 1
        return bits

    def visit(self, a, b, ws, lane_a, lane_b):
        """Whether a triangle of a packet may be nearest to a point of p q r; that ends the walk."""
        packet = ~np.int64(a.child[lane_a])
        triangle_bounds(a, ws, lane_a, self.middle)
        first = np.int64(a.first[packet])
        for k in range(np.int64(a.first[packet + 1]) - first):
            if ws.bounds[k] < self.reach:
                q, _ = nearest_on(a, first + k, self.middle)
                apart = norm(sub(self.middle, q))
                if apart < self.reach and not _never_nearest(
                    self.middle, self.corners, self.far, apart, q, self.margin
                ):
                    return True
        return False


@inner_kernel
def _never_nearest(middle, corners, far, apart, q, margin):
    """Whether a triangle or box of which q, `apart` away, is nearest to the middle is nowhere as near as one of three
    triangles.

    Its distance, a convex function, is nowhere below its tangent in the middle.
    """
    if apart == 0.0:
        return False
    g = sub(middle, q)
    g = g[0] / apart, g[1] / apart, g[2] / apart
    tangent = apart + dot(g, corners[0]), apart + dot(g, corners[1]), apart + dot(g, corners[2])
    for i in range(3):
        f = far[i]
        if min(tangent[0] - f[0], tangent[1] - f[1], tangent[2] - f[2]) > margin:
            return True
    return False


@inline_kernel
def _may_be_nearest(query, surface, p, q, r, far, bound):
    """Whether the surface may have the nearest point of the boundary to one of p q r, no deeper than `bound`."""
    c = ((p[0] + q[0] + r[0]) / 3.0, (p[1] + q[1] + r[1]) / 3.0, (p[2] + q[2] + r[2]) / 3.0)
    corners = sub(p, c), sub(q, c), sub(r, c)
    radius = max(norm(corners[0]), norm(corners[1]), norm(corners[2]))
    bvh = query.solid.bvh
    place_box(bvh, query.ws, c, c)
    task = MayBeNearest(c, radius + bound, corners, far, BEYOND * _coordinates(bvh, c))
    return walk(task, bvh, bvh, query.ws, np.int64(bvh.root[surface]), ALONE)


@inner_kernel
def _add_box(search, lane, guess):
    """Add a box of `other` to the pieces, if it may contain a point deeper than `_enough`."""
    query, other = search.way.query, search.way.other
    solid = query.solid
    center, half = box_middle(other, lane)
    radius, middle = norm(half) * (1.0 + 2.0**-40), transform(search.way.matrix, center)
    depth, t = depth_at(query, middle, guess)
    bound = radius + (depth if solid.closed else abs(depth))
    if bound <= _enough(search):
        return
    if solid.surface[t] != search.surface:
        reach = radius + bound
        if _nearest_below(query, np.int64(solid.bvh.root[search.surface]), middle, reach * reach) < 0:
            return
    place = _new_piece(search.way.pieces, bound, lane)
    search.way.pieces.index[place, 0] = t


@inner_kernel
def _add_triangle(search, p, q, r, depth, near):
    """Add a triangle to the pieces, if it may contain a point deeper than `_enough`."""
    solid, enough = search.way.query.solid, _enough(search)
    bvh, (dp, dq, dr), (a, b, c) = solid.bvh, depth, near
    cone = _cones(solid.closed, p, q, r, depth)
    bound = min(_most(cone[0]), _most(cone[1]), _most(cone[2]))
    if bound <= enough:
        return
    of_a = abs(dp), _to_triangle(bvh, a, q, b, dq), _to_triangle(bvh, a, r, c, dr)
    bound = min(bound, _most(of_a))
    if bound <= enough:
        return
    of_b = _to_triangle(bvh, b, p, a, dp), abs(dq), _to_triangle(bvh, b, r, c, dr)
    of_c = _to_triangle(bvh, c, p, a, dp), _to_triangle(bvh, c, q, b, dq), abs(dr)
    far = of_a, of_b, of_c
    bound = _bound(min(bound, _most(of_b), _most(of_c)), cone, far, enough)
    if bound <= enough:
        return
    on, surface = solid.surface, search.surface
    elsewhere = on[a] != surface and on[b] != surface and on[c] != surface
    if elsewhere and not _may_be_nearest(search.way.query, surface, p, q, r, far, bound):
        return
    pieces = search.way.pieces
    place = _new_piece(pieces, bound, -1)
    for d in range(3):
        pieces.value[place, CORNERS + d] = p[d]
        pieces.value[place, CORNERS + 3 + d] = q[d]
        pieces.value[place, CORNERS + 6 + d] = r[d]
        pieces.value[place, DEPTHS + d], pieces.index[place, d] = depth[d], near[d]


@inline_kernel
def _open_box(search, lane, guess):
    """Add the child boxes, or the triangles, of a box of `other` to the pieces."""
    other, m = search.way.other, search.way.matrix
    child = np.int64(other.child[lane])
    if child >= 0:
        for k in range(LANES * child, LANES * child + LANES):
            if other.boxes[box_at(k)] < np.inf:
                _add_box(search, k, guess)
        return
    for i in range(3 * np.int64(other.first[~child]), 3 * np.int64(other.first[~child + 1]), 3):
        for c in range(i, i + 3):
            v = other.corner[c]
            p = moved_corner(other, c, m)
            if search.way.nearest[v] < 0:
                search.way.depth[v], search.way.nearest[v] = depth_at(search.way.query, p, guess)
            guess = search.way.nearest[v]
            if search.way.depth[v] > _least_better(search):
                _see(search, p, search.way.depth[v], guess)
        a, b, c = other.corner[i], other.corner[i + 1], other.corner[i + 2]
        _add_triangle(
            search, moved_corner(other, i, m), moved_corner(other, i + 1, m), moved_corner(other, i + 2, m),
            (search.way.depth[a], search.way.depth[b], search.way.depth[c]),
            (search.way.nearest[a], search.way.nearest[b], search.way.nearest[c]),
        )  # fmt: skip


# --- whether a triangle comes out of the solid -----------------------------------------------------------------------


class Meets(NamedTuple):
    """Task: a triangle of the mesh that meets the triangle p q r."""

    corners: Any
    box: Any
    """least x, y, z and greatest x, y, z of p, q, r"""

    def children_of_a(self, a, b, ws, node, lane_b):
        """Bits: which boxes of a node overlap that of p q r."""
        return overlapping_lane(a.boxes, NODE * node, ws.moved, 0)

    def visit(self, a, b, ws, lane_a, lane_b):
        """Whether a triangle of a packet meets p q r, exactly; that ends the walk."""
        packet = ~np.int64(a.child[lane_a])
        if ws.fresh_a[packet] != ws.counts[QUESTION]:
            ws.fresh_a[packet] = ws.counts[QUESTION]
            prepare_triangles(a.packets, PACKET * packet, ws.prepared, PREPARED * packet)
        (x, y, z), half = box_middle(a, lane_a)
        low, high = self.box
        p, q, r = self.corners
        off = 2.0**-20 * (half[0] + half[1] + half[2]) + 2.0**-48 * a.frame[6]  # beyond all rounding where they overlap
        bits = reaching(
            ws.prepared, PREPARED * packet,
            np.float32(max(low[0] - x, -2.0 * half[0]) - off), np.float32(max(low[1] - y, -2.0 * half[1]) - off),
            np.float32(max(low[2] - z, -2.0 * half[2]) - off), np.float32(min(high[0] - x, 2.0 * half[0]) + off),
            np.float32(min(high[1] - y, 2.0 * half[1]) + off), np.float32(min(high[2] - z, 2.0 * half[2]) + off),
        )  # fmt: skip
        first = np.int64(a.first[packet])
        while bits != 0:
            u, v, w = triangle_of(a, first + lowest(bits))
            bits &= bits - 1
            if not planes_part((u, v, w), self.corners, 0.0) and triangles_meet(u, v, w, p, q, r, ws.exact):
                return True
        return False


@inline_kernel
def _comes_out(query, p, q, r, least, t, step):
    """Whether a step along the normal of the solid's triangle t takes all of p q r, of which a corner is `least` deep,
    out of it."""
    normal, at = query.solid.normal, 21 * t + 18
    n = normal[at], normal[at + 1], normal[at + 2]
    p, q, r = along(p, step, n), along(q, step, n), along(r, step, n)
    low = min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2])
    high = max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2])
    bvh = query.solid.bvh
    place_box(bvh, query.ws, low, high)
    if walk(Meets((p, q, r), (low, high)), bvh, bvh, query.ws, 0, ALONE):
        return False
    if query.solid.closed and least < -1.01 * step:
        return True  # that corner cannot have come in
    depth, _ = depth_at(query, p, t)
    return depth < 0.0


# --- cutting triangles in two ----------------------------------------------------------------------------------------


@inline_kernel
def _bisector(solid, p, q, tp, tq):
    """Where between p (0) and q (1) the planes of the triangles nearest to them are as far, if these are at an angle.

    There the nearest side changes, so that one step is enough for what lies on either side. -1 where that is of no
    use: near an end, or for sides that are almost parallel, where the middle takes fewer cuts (measured).
    """
    if tp == tq:
        return -1.0
    n, i, j = solid.normal, 21 * tp + 18, 21 * tq + 18
    np_, nq = (n[i], n[i + 1], n[i + 2]), (n[j], n[j + 1], n[j + 2])
    if abs(dot(np_, nq)) >= STEEP:
        return -1.0
    on_p, on_q = corner_of(solid.bvh, 3 * tp), corner_of(solid.bvh, 3 * tq)
    u = dot(np_, sub(p, on_p)) - dot(nq, sub(p, on_q))
    v = dot(np_, sub(q, on_p)) - dot(nq, sub(q, on_q))
    if not (u < 0.0 < v or v < 0.0 < u):
        return -1.0
    s = u / (u - v)
    return s if NEAR_END < s < 1.0 - NEAR_END else -1.0


@inline_kernel
def _cut(solid, p, q, r, tp, tq, tr):
    """(edge 0 … 2 of p q r to cut, where on it): the longest that has a bisector and is not short, else the longest."""
    length = (norm(sub(p, q)), norm(sub(q, r)), norm(sub(r, p)))
    edge = 0 if length[0] >= length[1] and length[0] >= length[2] else (1 if length[1] >= length[2] else 2)
    at, least = 0.5, SHORT * length[edge]
    for k in range(3):
        if length[k] >= least:
            e, f, te, tf = (p, q, tp, tq) if k == 0 else ((q, r, tq, tr) if k == 1 else (r, p, tr, tp))
            s = _bisector(solid, e, f, te, tf)
            if s >= 0.0:
                edge, at, least = k, s, length[k]
    return edge, at


@inline_kernel
def _open_triangle(search, place):
    """Cut a triangle in two, unless a step that is no longer than what counts takes it out of the solid; put it back
    with a lower bound if a step as long as the guess does."""
    query, v, index = search.way.query, search.way.pieces.value[place], search.way.pieces.index[place]
    p, q, r = (v[1], v[2], v[3]), (v[4], v[5], v[6]), (v[7], v[8], v[9])
    dp, dq, dr = v[DEPTHS], v[DEPTHS + 1], v[DEPTHS + 2]
    tp, tq, tr = index[0], index[1], index[2]
    enough = _enough(search)
    step = search.guess if enough < search.guess < v[BOUND] else enough
    for k in range(3 if max(dp, dq, dr) <= step else 0):  # a corner deeper than the step stays inside
        t = tp if k == 0 else (tq if k == 1 else tr)
        if (k == 0 or t != tp) and (k != 2 or t != tq) and _comes_out(query, p, q, r, min(dp, dq, dr), t, step):
            if step > enough:
                v[BOUND] = step
                _push(search.way.pieces, place)
            return
    edge, at = _cut(query.solid, p, q, r, tp, tq, tr)
    if edge == 1:
        p, q, r, dp, dq, dr, tp, tq, tr = q, r, p, dq, dr, dp, tq, tr, tp
    elif edge == 2:
        p, q, r, dp, dq, dr, tp, tq, tr = r, p, q, dr, dp, dq, tr, tp, tq
    m = along(p, at, sub(q, p))
    bvh = query.solid.bvh
    nearer = tq
    if tp == tq or _to_triangle(bvh, tp, m, -1, 0.0) <= _to_triangle(bvh, tq, m, -1, 0.0):
        nearer = tp
    dm, tm = depth_at(query, m, nearer)
    if dm > _least_better(search):
        _see(search, m, dm, tm)
    for k in range(2):
        if k == 0:
            _add_triangle(search, p, m, r, (dp, dm, dr), (tp, tm, tr))
        else:
            _add_triangle(search, m, q, r, (dm, dq, dr), (tm, tq, tr))


@inline_kernel
def _begin(search, surface):
    """Make a surface of the other the only piece of a search."""
    pieces = search.way.pieces
    pieces.size[0], pieces.size[1] = 0, 0
    search.way.query.ws.counts[QUESTION] += 1
    _add_box(search, np.int64(search.way.other.root[surface]), np.int64(0))
    if pieces.size[1] > 0:
        _push(pieces, 0)


@inner_kernel
def _advance(search, most):
    """Open up to `most` pieces that may hold something deeper than is known, those of greatest bound first.

    Returns their number.
    """
    pieces = search.way.pieces
    search.way.query.ws.counts[QUESTION] += 1
    opened, at_hand = 0, -1
    while opened < most and pieces.size[1] + LANES <= len(pieces.value):
        if at_hand < 0 or pieces.value[at_hand, BOUND] <= _enough(search):
            if pieces.size[0] == 0:
                break
            at_hand = _pop(pieces)
            if pieces.value[at_hand, BOUND] <= _enough(search):
                pieces.size[0], at_hand = 0, -1
                break
        opened += 1
        fresh, lane = pieces.size[1], pieces.index[at_hand, LANE]
        if lane < 0:
            _open_triangle(search, at_hand)
        else:
            _open_box(search, lane, pieces.index[at_hand, 0])
        at_hand = -1
        for place in range(fresh, pieces.size[1]):
            if at_hand < 0 or pieces.value[place, BOUND] > pieces.value[at_hand, BOUND]:
                at_hand, place = place, at_hand
            if place >= 0:
                _push(pieces, place)
    if at_hand >= 0:
        _push(pieces, at_hand)
    return opened


@inline_kernel
def _greatest_bound(pieces):
    """m: no point of the pieces that are not yet opened is deeper."""
    return pieces.value[pieces.heap[0], BOUND] if pieces.size[0] > 0 else -np.inf


@kernel
def deepest(one, other, pairs, limit, limits, out):
    """Fill `out` (n, 9), see `Search.best`, with the deepest points of pairs of surfaces behind one another.

    one, other: the two `Direction`s; `one.query` has the first mesh. pairs: (n, 2) int32 surface of the first mesh, of
    the second. limit: (n,) m, as `penetration` takes it. limits: (4,) float64, relative
    (1), precision (m), `BUDGET` and `SETTLED`. Returns the pieces opened.
    """
    total, guess = 0, 0.0
    for k in range(len(pairs)):
        out[k] = 0.0
        opened = 0
        b_in_a = Search(one, out[k], np.int64(pairs[k, 0]), limits[0], limits[1], guess)
        a_in_b = Search(other, out[k], np.int64(pairs[k, 1]), limits[0], limits[1], guess)
        _begin(b_in_a, pairs[k, 1])
        _begin(a_in_b, pairs[k, 0])
        while opened < limits[2]:
            if opened == 0 or _greatest_bound(one.pieces) >= _greatest_bound(other.pieces):
                now = _advance(b_in_a, TURN)
            else:
                now = _advance(a_in_b, TURN)
            if now == 0 and opened > 0:
                break
            opened += max(now, 1)
            bound = max(_greatest_bound(one.pieces), _greatest_bound(other.pieces))
            within = limit[k] + (out[k, 0] if out[k, 0] > limit[k] else 0.0)
            if opened >= limits[3] and bound <= within:
                break
        out[k, 8] = max(_greatest_bound(one.pieces), _greatest_bound(other.pieces), out[k, 0])
        total += opened
        guess = out[k, 0]  # neighbours are often as deep: what is not as deep is not cut before the deepest is known
    return total


# --- from Python -----------------------------------------------------------------------------------------------------

_deepest_points = EntryPoint(deepest)


def penetration(
    objects: Objects,
    i: int,
    j: int,
    limit: ArrayLike = 0.0,
    known: dict[tuple[int, int], NDArray[np.float64]] | None = None,
) -> NDArray[Any]:
    """Depth and direction of every pair of surfaces of two objects that meet: PENETRATION_DTYPE rows.

    Ignored pairs of surfaces are left out. limit: m, by surface of i (the lower id) and surface of j, or one for all: a
    search of more than `SETTLED` pieces ends when no point can be deeper than this, or when one is and none can be
    deeper by more than this; nothing is searched where it is infinite. known: what was found, by pair of surfaces, of
    instances of the same meshes that are placed so relative to one another; what is found is added.
    """
    objects.ignored(i, j)  # raises, unless there are both, and two
    i, j = min(i, j), max(i, j)
    meshes = objects.mesh(i), objects.mesh(j)
    world, pose, surfaces = objects.pose(i), objects.relative_pose(i, j), enabled_pairs(objects, i, j)
    limits = np.broadcast_to(limit, (meshes[0].n_surfaces, meshes[1].n_surfaces))
    surfaces = surfaces[np.isfinite(limits[surfaces[:, 0], surfaces[:, 1]])]
    rows = np.zeros(len(surfaces), PENETRATION_DTYPE)
    rows["object_a"], rows["surface_a"], rows["object_b"], rows["surface_b"] = i, surfaces[:, 0], j, surfaces[:, 1]
    known, keys = {} if known is None else known, list(map(tuple, surfaces.tolist()))
    new = surfaces[[key not in known for key in keys]]
    known.update(
        zip(map(tuple, new.tolist()), _found(objects, meshes, pose, new, limits[new[:, 0], new[:, 1]]), strict=True)
    )
    if keys:
        found = np.stack([known[key] for key in keys])
        rows["depth"], rows["bound"] = found[:, 0], found[:, 1]
        rows["direction"] = found[:, 2:5] @ world.rotation.T
        rows["point"] = found[:, 5:] @ world.rotation.T + world.translation
    return rows


def _found(
    objects: Objects, meshes: tuple[SurfaceMesh, SurfaceMesh], pose: pin.SE3, surfaces: NDArray[np.int32],
    limits: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """(n, 8) depth and bound (m), unit direction and deepest point (m) in the first mesh's frame, of pairs (n, 2)."""
    if not len(surfaces):
        return np.empty((0, 8))
    found = deepest_points(objects, meshes, pose, surfaces, limits)
    swapped = found[:, 7] == 1.0
    ends = found[:, 1:7].reshape(-1, 2, 3)
    if swapped.any():
        ends[swapped] = ends[swapped] @ pose.rotation.T + pose.translation
    out = (ends[:, 1] - ends[:, 0]) * np.where(swapped, -1.0, 1.0)[:, None]
    length = np.sqrt(np.einsum("kd,kd->k", out, out))
    for k in np.flatnonzero(length <= objects.tolerance.solver).tolist():
        contact = clearance_at(*meshes, pose, *surfaces[k].tolist())
        out[k], length[k], ends[k, 0] = _normal(meshes[0], int(contact["triangle_a"][0])), 1.0, contact["point_a"][0]
    return np.column_stack([found[:, 0], found[:, 8], out / length[:, None], ends[:, 0]])


def _normal(mesh: SurfaceMesh, triangle: int) -> NDArray[np.float64]:
    a, b, c = mesh.vertices[mesh.triangles[triangle]]
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n)
    return n / length if length > 0.0 else np.array([0.0, 0.0, 1.0])


def deepest_points(
    objects: Objects,
    meshes: tuple[SurfaceMesh, SurfaceMesh],
    pose: pin.SE3,
    pairs: NDArray[np.int32],
    limit: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return (n, 9) rows of `Search.best` of pairs of surfaces (n, 2), whether or not they meet.

    pose: of the second mesh in the frame of the first. objects: their tolerance is the precision. limit: (n,) m, as
    for `penetration`.
    """
    a, b = meshes
    ways = _direction(a, b, pose, 0), _direction(b, a, pose.inverse(), 1)
    relative = objects.tolerance.depth
    limits = np.array([relative, relative * objects.tolerance.linear, BUDGET, SETTLED])
    out, settled = np.empty((len(pairs), 9)), np.zeros(len(pairs)) if limit is None else limit
    _deepest_points.call(*ways, np.ascontiguousarray(pairs, np.int32), settled, limits, out)
    return out


class _Local(threading.local):
    pieces: tuple[Pieces, Pieces] | None = None


_local = _Local()


def _pieces() -> tuple[Pieces, Pieces]:
    """This thread's room for the pieces of both directions of a search."""
    if _local.pieces is None:
        _local.pieces = _new_pieces(4 * BUDGET), _new_pieces(4 * BUDGET)
    return _local.pieces


def _new_pieces(n: int) -> Pieces:
    index = np.empty((n, LANE + 1), np.int64)
    return Pieces(np.empty((n, PIECE)), index, np.empty(n, np.int64), np.zeros(2, np.int64))


def _direction(solid: SurfaceMesh, other: SurfaceMesh, pose: pin.SE3, side: int) -> Direction:
    n = len(other.vertices)
    known, nearest = np.empty(n), np.full(n, -1, np.int64)
    return Direction(query_about(solid), bvh_of(other), pack_rigid(pose), known, nearest, _pieces()[side], side)
