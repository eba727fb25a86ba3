"""Numba kernels of `collision.penetration`: the deepest point of one surface behind another, best first.

What is searched is the tree of the surface, and below its leaves triangles that are halved. Each piece has an upper
bound of the depth of its points; the piece of the greatest is opened next, until no bound is above the deepest point
that has been seen by more than the precision asked for.

Of a piece that is known by its middle c and radius r, no point is deeper than the depth of c plus r, for the distance
to a boundary is 1-Lipschitz. Of a triangle there are up to six convex functions of its points that are never below
their depth: the distance to a triangle of the boundary, that which is nearest to one of its corners, and the depth of a
corner plus the distance from it. A convex function is at most the linear one through its values in the corners, so the
depth is at most the greatest value over the triangle of the lesser of two such linear functions (which lies in a corner
or on an edge). With one that belongs to each side of a wall, that is tight even where the depth has its ridge, half way
through. And no point is deeper than a step by which the whole triangle comes out of the solid.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from collision.kernels_distance import planes_part
from collision.kernels_solid import closest_on_triangle, distance
from collision.kernels_vector import along, dot, norm, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL
from collision.tree import LEAF

TIE: Final = 1.0 + 64.0 * 2.0**-52
"""squared distances that differ by no more than their rounding (some 30 operations each) are of one nearest point"""

STEEP: Final = 0.7
"""1: cosine of the angle between two sides from which on they count as almost parallel when a triangle is cut"""
NEAR_END: Final = 0.05
"""1: share of an edge that a cut leaves at least"""
SHORT: Final = 0.8
"""1: share of the longest edge below which another is not cut, so that no slivers come of it"""


class Boundary(NamedTuple):
    """The solid: as in `SurfaceMesh`, `MeshTree` and `Solid`; what is by triangle, in the tree's leaf order."""

    vertices: Any
    box: Any
    second: Any
    first: Any
    count: Any
    corner: Any
    root: Any
    surface: Any
    face: Any
    edge: Any
    vertex: Any
    closed: Any


class Other(NamedTuple):
    """The mesh whose points are looked for: its tree, and its vertices in the solid's frame.

    depth, nearest: (n,) of its vertices behind the solid and nearest triangles there; NaN, and -1, where not yet known.
    """

    vertices: Any
    box: Any
    second: Any
    first: Any
    count: Any
    corner: Any
    root: Any
    rotation: Any
    translation: Any
    depth: Any
    nearest: Any


class Pieces(NamedTuple):
    """Room for the pieces of a search, and the heap of those that are not yet opened, greatest bound first."""

    bound: Any
    """(n,) no point is deeper"""
    node: Any
    """(n,) the node of the tree, -1 for a triangle"""
    corner: Any
    """(n, 9) of a triangle"""
    depth: Any
    """(n, 3) of its corners"""
    nearest: Any
    """(n, 3) triangle of the solid nearest to each of its corners; the first, to the middle of a node"""
    heap: Any
    """(n,) places"""
    size: Any
    """(2,) length of the heap, places used"""


class Room(NamedTuple):
    """What traversals work in."""

    stack: Any
    gap: Any
    work: Any


def room_for(pieces: int) -> Pieces:
    """Room for so many pieces."""
    return Pieces(
        np.empty(pieces), np.empty(pieces, np.int64), np.empty((pieces, 9)), np.empty((pieces, 3)),
        np.empty((pieces, 3), np.int64), np.empty(pieces, np.int64), np.zeros(2, np.int64),
    )  # fmt: skip


@njit(error_model="numpy", **KERNEL)
def _place(pieces, bound):
    """A place for a piece."""
    place = pieces.size[1]
    pieces.size[1] += 1
    pieces.bound[place] = bound
    return place


@njit(error_model="numpy", **KERNEL)
def _push(pieces, place):
    """Put a piece in the heap, by its bound."""
    key, heap = pieces.bound, pieces.heap
    i = pieces.size[0]
    pieces.size[0] += 1
    while i > 0:
        up = (i - 1) // 2
        if key[heap[up]] >= key[place]:
            break
        heap[i] = heap[up]
        i = up
    heap[i] = place


@njit(error_model="numpy", **KERNEL)
def _pop(pieces):
    """The place of the piece of greatest bound, which is taken out of the heap."""
    key, heap = pieces.bound, pieces.heap
    pieces.size[0] -= 1
    n = pieces.size[0]
    top, last = heap[0], heap[n]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= n:
            break
        if child + 1 < n and key[heap[child + 1]] > key[heap[child]]:
            child += 1
        if key[heap[child]] <= key[last]:
            break
        heap[i] = heap[child]
        i = child
    heap[i] = last
    return top


@njit(error_model="numpy", **KERNEL)
def _at(vertices, i):
    return (vertices[i, 0], vertices[i, 1], vertices[i, 2])


@njit(error_model="numpy", **KERNEL)
def _nearest_on(solid, t, p):
    a, b, c = (_at(solid.vertices, solid.corner[t, 0]), _at(solid.vertices, solid.corner[t, 1]),
               _at(solid.vertices, solid.corner[t, 2]))  # fmt: skip
    return closest_on_triangle(p, a, b, c)


@njit(error_model="numpy", **KERNEL)
def _to_triangle(solid, t, p):
    q, _ = _nearest_on(solid, t, p)
    return norm(sub(p, q))


@njit(error_model="numpy", **KERNEL)
def _to_surface(solid, s, p, bound, room):
    """(nearest point, its triangle) of surface s, if nearer to p than the root of `bound`; else triangle -1."""
    _, q, t, _ = distance(
        solid.root[s], solid.vertices, solid.box, solid.second, solid.first, solid.count, solid.corner,
        p, bound, room.stack, room.gap,
    )  # fmt: skip
    return q, t


@njit(error_model="numpy", **KERNEL)
def _depth_at(solid, p, guess, room):
    """(depth of p behind the solid's boundary, negative before it; nearest triangle), by way of the triangle `guess`.

    The side is told by the pseudonormal of the nearest feature, see `kernels_solid.signed_distance`.
    """
    q, feature = _nearest_on(solid, guess, p)
    w = sub(p, q)
    best = dot(w, w)
    nearer, f, t, where = distance(
        0, solid.vertices, solid.box, solid.second, solid.first, solid.count, solid.corner,
        p, best, room.stack, room.gap,
    )  # fmt: skip
    if t < 0:
        t = guess
    else:
        best, q, feature = nearer, f, where
    if feature == 6:
        n = _at(solid.face, t)
    elif feature < 3:
        n = (solid.edge[t, feature, 0], solid.edge[t, feature, 1], solid.edge[t, feature, 2])
    else:
        k = feature - 3
        n = (solid.vertex[t, k, 0], solid.vertex[t, k, 1], solid.vertex[t, k, 2])
    apart = np.sqrt(best)
    return (apart if dot(n, sub(p, q)) < 0.0 else -apart), t


@njit(error_model="numpy", **KERNEL)
def _see(solid, surface, p, depth, t, out, room):
    """Keep p if it is deeper than what is known and t, the triangle nearest to it, or one as near is of the surface."""
    if depth <= out[0]:
        return
    if solid.surface[t] == surface:
        q, _ = _nearest_on(solid, t, p)
    else:
        q, t = _to_surface(solid, surface, p, TIE * depth * depth, room)
        if t < 0:
            return
    out[0] = depth
    for d in range(3):
        out[1 + d], out[4 + d] = p[d], q[d]


@njit(error_model="numpy", **KERNEL)
def _most(f):
    return max(f[0], f[1], f[2])


@njit(error_model="numpy", **KERNEL)
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


@njit(error_model="numpy", **KERNEL)
def _bound(solid, p, q, r, depth, nearest, enough):
    """No point of the triangle p q r is deeper: from its corners' depths and nearest triangles; less exact if `enough`.

    About the rim of an open mesh the depth leaps from one side to the other; there it is the distance that is bounded.
    """
    dp, dq, dr = depth
    if not solid.closed:
        dp, dq, dr = abs(dp), abs(dq), abs(dr)
    pq, qr, rp = norm(sub(p, q)), norm(sub(q, r)), norm(sub(r, p))
    cone = ((dp, dp + pq, dp + rp), (dq + pq, dq, dq + qr), (dr + rp, dr + qr, dr))
    bound = min(_most(cone[0]), _most(cone[1]), _most(cone[2]))
    if bound <= enough:
        return bound
    a, b, c = nearest
    far = (
        (abs(dp), _to_triangle(solid, a, q), _to_triangle(solid, a, r)),
        (_to_triangle(solid, b, p), abs(dq), _to_triangle(solid, b, r)),
        (_to_triangle(solid, c, p), _to_triangle(solid, c, q), abs(dr)),
    )
    for i in range(3):
        bound = min(bound, _most(far[i]), _peak(far[i], far[(i + 1) % 3]))
    if bound <= enough:
        return bound
    for i in range(3):
        for j in range(3):
            bound = min(bound, _peak(far[i], cone[j]))
    return bound


@njit(error_model="numpy", **KERNEL)
def _meets(solid, p, q, r, room):
    """Whether the triangle p q r meets any of the solid's."""
    low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
    high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
    box, stack = solid.box, room.stack
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        i = stack[top]
        if (
            box[i, 0] > high[0] or low[0] > box[i, 3]
            or box[i, 1] > high[1] or low[1] > box[i, 4]
            or box[i, 2] > high[2] or low[2] > box[i, 5]
        ):  # fmt: skip
            continue
        if solid.second[i] >= 0:
            stack[top], stack[top + 1] = i + 1, solid.second[i]
            top += 2
            continue
        for t in range(solid.first[i], solid.first[i] + solid.count[i]):
            a, b = _at(solid.vertices, solid.corner[t, 0]), _at(solid.vertices, solid.corner[t, 1])
            c = _at(solid.vertices, solid.corner[t, 2])
            if not planes_part(a, b, c, p, q, r, 0.0) and triangles_meet(a, b, c, p, q, r, room.work):
                return True
    return False


@njit(error_model="numpy", **KERNEL)
def _comes_out(solid, p, q, r, t, step, room):
    """Whether a step along the normal of the solid's triangle t takes all of p q r out of it."""
    n = _at(solid.face, t)
    p, q, r = along(p, step, n), along(q, step, n), along(r, step, n)
    if _meets(solid, p, q, r, room):
        return False
    depth, _ = _depth_at(solid, p, t, room)
    return depth < 0.0


@njit(error_model="numpy", **KERNEL)
def _reaches(solid, surface, middle, reach, room):
    """Whether the surface is nearer to a middle than `reach`."""
    _, t = _to_surface(solid, surface, middle, reach * reach, room)
    return t >= 0


@njit(error_model="numpy", **KERNEL)
def _add_node(solid, surface, other, node, guess, enough, pieces, room):
    """Put a node of the other's tree among the pieces, if there may be something deeper than `enough` in it."""
    box = other.box
    x, y, z = (
        0.5 * (box[node, 0] + box[node, 3]),
        0.5 * (box[node, 1] + box[node, 4]),
        0.5 * (box[node, 2] + box[node, 5]),
    )
    half = (box[node, 3] - x, box[node, 4] - y, box[node, 5] - z)
    radius = norm(half)
    r, o = other.rotation, other.translation
    middle = (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + o[0],
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + o[1],
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + o[2],
    )
    depth, t = _depth_at(solid, middle, guess, room)
    bound = radius + (depth if solid.closed else abs(depth))
    if bound <= enough or (solid.surface[t] != surface and not _reaches(solid, surface, middle, radius + bound, room)):
        return
    place = _place(pieces, bound)
    pieces.node[place] = node
    pieces.nearest[place, 0] = t


@njit(error_model="numpy", **KERNEL)
def _add_triangle(solid, surface, p, q, r, depth, nearest, enough, pieces, room):
    """Put a triangle among the pieces, if there may be something deeper than `enough` in it."""
    bound = _bound(solid, p, q, r, depth, nearest, enough)
    if bound <= enough:
        return
    on = solid.surface
    if on[nearest[0]] != surface and on[nearest[1]] != surface and on[nearest[2]] != surface:
        c = ((p[0] + q[0] + r[0]) / 3.0, (p[1] + q[1] + r[1]) / 3.0, (p[2] + q[2] + r[2]) / 3.0)
        radius = max(norm(sub(p, c)), norm(sub(q, c)), norm(sub(r, c)))
        if not _reaches(solid, surface, c, radius + bound, room):
            return
    place = _place(pieces, bound)
    pieces.node[place] = -1
    for d in range(3):
        pieces.corner[place, d], pieces.corner[place, 3 + d], pieces.corner[place, 6 + d] = p[d], q[d], r[d]
        pieces.depth[place, d], pieces.nearest[place, d] = depth[d], nearest[d]


@njit(error_model="numpy", **KERNEL)
def _open_leaf(solid, surface, other, node, guess, relative, precision, out, pieces, room):
    """Put the triangles of a leaf among the pieces."""
    for k in range(other.first[node], other.first[node] + other.count[node]):
        for c in range(3):
            v = other.corner[k, c]
            if other.nearest[v] < 0:
                other.depth[v], other.nearest[v] = _depth_at(solid, _at(other.vertices, v), guess, room)
            guess = other.nearest[v]
            _see(solid, surface, _at(other.vertices, v), other.depth[v], guess, out, room)
        i, j, h = other.corner[k, 0], other.corner[k, 1], other.corner[k, 2]
        _add_triangle(
            solid, surface, _at(other.vertices, i), _at(other.vertices, j), _at(other.vertices, h),
            (other.depth[i], other.depth[j], other.depth[h]), (other.nearest[i], other.nearest[j], other.nearest[h]),
            out[0] * (1.0 + relative) + precision, pieces, room,
        )  # fmt: skip


@njit(error_model="numpy", **KERNEL)
def _from_plane(solid, t, p):
    return dot(_at(solid.face, t), sub(p, _at(solid.vertices, solid.corner[t, 0])))


@njit(error_model="numpy", **KERNEL)
def _bisector(solid, p, q, tp, tq):
    """Where between p (0) and q (1) the planes of the triangles nearest to them are as far, if these are at an angle.

    There the nearest side changes, so that one step is enough for what lies on either side. -1 where that is of no
    use: near an end, or for sides that are almost parallel, where the middle takes fewer cuts (measured).
    """
    if abs(dot(_at(solid.face, tp), _at(solid.face, tq))) >= STEEP:
        return -1.0
    u = _from_plane(solid, tp, p) - _from_plane(solid, tq, p)
    v = _from_plane(solid, tp, q) - _from_plane(solid, tq, q)
    if not (u < 0.0 < v or v < 0.0 < u):
        return -1.0
    s = u / (u - v)
    return s if NEAR_END < s < 1.0 - NEAR_END else -1.0


@njit(error_model="numpy", **KERNEL)
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


@njit(error_model="numpy", **KERNEL)
def _open_triangle(solid, surface, place, relative, precision, out, pieces, room):
    """Cut a triangle in two, unless a step that is no longer than what counts takes it out of the solid."""
    c = pieces.corner[place]
    p, q, r = (c[0], c[1], c[2]), (c[3], c[4], c[5]), (c[6], c[7], c[8])
    dp, dq, dr = pieces.depth[place, 0], pieces.depth[place, 1], pieces.depth[place, 2]
    tp, tq, tr = pieces.nearest[place, 0], pieces.nearest[place, 1], pieces.nearest[place, 2]
    step = out[0] * (1.0 + relative) + precision
    if (
        _comes_out(solid, p, q, r, tp, step, room)
        or (tq != tp and _comes_out(solid, p, q, r, tq, step, room))
        or (tr != tp and tr != tq and _comes_out(solid, p, q, r, tr, step, room))
    ):
        return
    edge, at = _cut(solid, p, q, r, tp, tq, tr)
    if edge == 1:
        p, q, r, dp, dq, dr, tp, tq, tr = q, r, p, dq, dr, dp, tq, tr, tp
    elif edge == 2:
        p, q, r, dp, dq, dr, tp, tq, tr = r, p, q, dr, dp, dq, tr, tp, tq
    m = along(p, at, sub(q, p))
    dm, tm = _depth_at(solid, m, tp if _to_triangle(solid, tp, m) <= _to_triangle(solid, tq, m) else tq, room)
    _see(solid, surface, m, dm, tm, out, room)
    enough = out[0] * (1.0 + relative) + precision
    _add_triangle(solid, surface, p, m, r, (dp, dm, dr), (tp, tm, tr), enough, pieces, room)
    _add_triangle(solid, surface, m, q, r, (dm, dq, dr), (tm, tq, tr), enough, pieces, room)


@njit(error_model="numpy", **KERNEL)
def deepest(pairs, solid, other, relative, precision, budget, out, pieces, room):
    """The deepest points of the other's surfaces behind the solid, where nearest to one of its surfaces.

    pairs: (n, 2) surface of the solid, of the other. Only what is deeper than out[:, 0] is looked for, to within
    `relative` (1) and `precision` (m); beyond `budget` pieces opened for a pair, what has been seen counts. out: (n, 7)
    depth, the point, the nearest point of the solid's surface, in its frame. The number of pieces opened.
    """
    opened = 0
    for k in range(len(pairs)):
        surface, node = pairs[k, 0], other.root[pairs[k, 1]]
        best = out[k]
        pieces.size[0], pieces.size[1] = 0, 0
        start = solid.first[solid.root[surface]]
        _add_node(solid, surface, other, node, start, best[0] * (1.0 + relative) + precision, pieces, room)
        last = opened + budget
        at_hand = pieces.size[1] - 1
        while opened < last and pieces.size[1] + LEAF <= len(pieces.bound):
            enough = best[0] * (1.0 + relative) + precision
            if at_hand < 0 or pieces.bound[at_hand] <= enough:
                if pieces.size[0] == 0:
                    break
                at_hand = _pop(pieces)
                if pieces.bound[at_hand] <= enough:
                    break
            opened += 1
            fresh = pieces.size[1]
            node = pieces.node[at_hand]
            if node < 0:
                _open_triangle(solid, surface, at_hand, relative, precision, best, pieces, room)
            else:
                guess = pieces.nearest[at_hand, 0]
                if other.second[node] < 0:
                    _open_leaf(solid, surface, other, node, guess, relative, precision, best, pieces, room)
                else:
                    _add_node(solid, surface, other, node + 1, guess, enough, pieces, room)
                    _add_node(solid, surface, other, other.second[node], guess, enough, pieces, room)
            at_hand = -1
            for place in range(fresh, pieces.size[1]):
                if at_hand < 0 or pieces.bound[place] > pieces.bound[at_hand]:
                    at_hand, place = place, at_hand
                if place >= 0:
                    _push(pieces, place)
    return opened
