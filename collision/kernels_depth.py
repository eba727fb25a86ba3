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

from numba import njit

from collision.kernels_boundary import comes_out, depth_at, nearest_on, reaches, to_surface, to_triangle, winds
from collision.kernels_pieces import new_place, pop, push
from collision.kernels_vector import along, dot, norm, row, sub
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


@njit(error_model="numpy", **KERNEL)
def _see(solid, surface, p, depth, t, out, room):
    """Keep p if it is deeper than what is known and t, the triangle nearest to it, or one as near is of the surface.

    A closed mesh must wind about it, too: where it meets itself, what is behind the nearest triangle may be outside.
    """
    if depth <= out[0]:
        return
    if solid.surface[t] == surface:
        q, _ = nearest_on(solid, t, p)
    else:
        q, t = to_surface(solid, surface, p, TIE * depth * depth, room)
        if t < 0:
            return
    if solid.closed and not winds(solid, p, room):
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
        (abs(dp), to_triangle(solid, a, q), to_triangle(solid, a, r)),
        (to_triangle(solid, b, p), abs(dq), to_triangle(solid, b, r)),
        (to_triangle(solid, c, p), to_triangle(solid, c, q), abs(dr)),
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
    depth, t = depth_at(solid, middle, guess, room)
    bound = radius + (depth if solid.closed else abs(depth))
    if bound <= enough or (solid.surface[t] != surface and not reaches(solid, surface, middle, radius + bound, room)):
        return
    place = new_place(pieces, bound)
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
        if not reaches(solid, surface, c, radius + bound, room):
            return
    place = new_place(pieces, bound)
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
                other.depth[v], other.nearest[v] = depth_at(solid, row(other.vertices, v), guess, room)
            guess = other.nearest[v]
            _see(solid, surface, row(other.vertices, v), other.depth[v], guess, out, room)
        i, j, h = other.corner[k, 0], other.corner[k, 1], other.corner[k, 2]
        _add_triangle(
            solid, surface, row(other.vertices, i), row(other.vertices, j), row(other.vertices, h),
            (other.depth[i], other.depth[j], other.depth[h]), (other.nearest[i], other.nearest[j], other.nearest[h]),
            out[0] * (1.0 + relative) + precision, pieces, room,
        )  # fmt: skip


@njit(error_model="numpy", **KERNEL)
def _from_plane(solid, t, p):
    return dot(row(solid.normal[t], 6), sub(p, row(solid.vertices, solid.corner[t, 0])))


@njit(error_model="numpy", **KERNEL)
def _bisector(solid, p, q, tp, tq):
    """Where between p (0) and q (1) the planes of the triangles nearest to them are as far, if these are at an angle.

    There the nearest side changes, so that one step is enough for what lies on either side. -1 where that is of no
    use: near an end, or for sides that are almost parallel, where the middle takes fewer cuts (measured).
    """
    if abs(dot(row(solid.normal[tp], 6), row(solid.normal[tq], 6))) >= STEEP:
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
        comes_out(solid, p, q, r, tp, step, room)
        or (tq != tp and comes_out(solid, p, q, r, tq, step, room))
        or (tr != tp and tr != tq and comes_out(solid, p, q, r, tr, step, room))
    ):
        return
    edge, at = _cut(solid, p, q, r, tp, tq, tr)
    if edge == 1:
        p, q, r, dp, dq, dr, tp, tq, tr = q, r, p, dq, dr, dp, tq, tr, tp
    elif edge == 2:
        p, q, r, dp, dq, dr, tp, tq, tr = r, p, q, dr, dp, dq, tr, tp, tq
    m = along(p, at, sub(q, p))
    dm, tm = depth_at(solid, m, tp if to_triangle(solid, tp, m) <= to_triangle(solid, tq, m) else tq, room)
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
                at_hand = pop(pieces)
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
                    push(pieces, place)
    return opened
