"""Numba kernels of `collision.proximity`: closest points of triangles, and of the trees above them.

A corner or a vector is a tuple (x, y, z). Triangles of b are moved into a's frame as `move` does it, by one rotation
and one translation. Whether two triangles meet is decided by the exact predicate alone; a box or a plane may only rule
a pair out when it does so beyond the rounding of its own arithmetic.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.kernels_vector import along, cross, dot, greatest, sub
from collision.polygons import triangles_meet
from collision.predicates import KERNEL

ROUNDING: Final = 1e-14
"""1: bound, generously, of the relative rounding error of the few dozen operations behind one pruning test."""
STACK: Final = 512
"""Places on a traversal's stack: more than the depths of two trees together."""


@njit(error_model="numpy", **KERNEL)
def move(rotation, translation, vertices, i):
    """Vertex i moved by a pose: the one formula by which a vertex of b comes into a's frame."""
    x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + translation[0],
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + translation[1],
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + translation[2],
    )


@njit(error_model="numpy", **KERNEL)
def closest_on_segment(p, a, b):
    """The point of the segment a b nearest p."""
    u = sub(b, a)
    length = dot(u, u)
    s = dot(sub(p, a), u)
    if s <= 0.0 or length == 0.0:
        return a
    if s >= length:
        return b
    return along(a, s / length, u)


@njit(error_model="numpy", **KERNEL)
def _vertex_edges(best, x, y, p, a, b, c):
    """Better the nearest pair (x on p's side, y on the triangle's) by the edges of a b c."""
    for k in range(3):
        if k == 0:
            q = closest_on_segment(p, a, b)
        elif k == 1:
            q = closest_on_segment(p, b, c)
        else:
            q = closest_on_segment(p, c, a)
        w = sub(p, q)
        d = dot(w, w)
        if d < best:
            best, x, y = d, p, q
    return best, x, y


@njit(error_model="numpy", **KERNEL)
def _vertex_face(best, x, y, p, a, b, c, n, nn):
    """Better the nearest pair by the foot of p inside the triangle a b c of normal n, nn = n·n > 0."""
    h = dot(n, sub(p, a))
    if h * h < best * nn:
        f = along(p, -h / nn, n)
        if (
            dot(cross(sub(b, a), sub(f, a)), n) >= 0.0
            and dot(cross(sub(c, b), sub(f, b)), n) >= 0.0
            and dot(cross(sub(a, c), sub(f, c)), n) >= 0.0
        ):
            w = sub(p, f)
            d = dot(w, w)
            if d < best:
                return d, p, f
    return best, x, y


@njit(error_model="numpy", **KERNEL)
def _edge_edge(best, x, y, p, u, q, v):
    """Better the nearest pair by the common normal of the edges p + s·u and q + t·v, where it meets both inside."""
    n = cross(u, v)
    nn = dot(n, n)
    if nn > 0.0:
        w = sub(q, p)
        h = dot(w, n)
        if h * h < best * nn:
            s = dot(cross(w, v), n) / nn
            t = dot(cross(w, u), n) / nn
            if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
                e = along(p, s, u)
                f = along(q, t, v)
                g = sub(e, f)
                d = dot(g, g)
                if d < best:
                    return d, e, f
    return best, x, y


@njit(error_model="numpy", **KERNEL)
def closest_features(a, b, c, p, q, r):
    """(squared distance, point of a b c, point of p q r) of the nearest features: 6 vertex-face and 9 edge-edge pairs.

    For triangles that do not meet this is their distance. Each candidate is a pair of points that lie on the triangles
    to rounding, so that an ill-conditioned candidate can only be too far, never too near (Ericson 2005, 5.1).
    """
    w = sub(a, p)
    best, x, y = dot(w, w), a, p
    best, x, y = _vertex_edges(best, x, y, a, p, q, r)
    best, x, y = _vertex_edges(best, x, y, b, p, q, r)
    best, x, y = _vertex_edges(best, x, y, c, p, q, r)
    best, y, x = _vertex_edges(best, y, x, p, a, b, c)
    best, y, x = _vertex_edges(best, y, x, q, a, b, c)
    best, y, x = _vertex_edges(best, y, x, r, a, b, c)
    ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
    pq, qr, rp = sub(q, p), sub(r, q), sub(p, r)
    n = cross(pq, qr)
    nn = dot(n, n)
    if nn > 0.0:
        best, x, y = _vertex_face(best, x, y, a, p, q, r, n, nn)
        best, x, y = _vertex_face(best, x, y, b, p, q, r, n, nn)
        best, x, y = _vertex_face(best, x, y, c, p, q, r, n, nn)
    n = cross(ab, bc)
    nn = dot(n, n)
    if nn > 0.0:
        best, y, x = _vertex_face(best, y, x, p, a, b, c, n, nn)
        best, y, x = _vertex_face(best, y, x, q, a, b, c, n, nn)
        best, y, x = _vertex_face(best, y, x, r, a, b, c, n, nn)
    for k in range(3):
        if k == 0:
            o, u = a, ab
        elif k == 1:
            o, u = b, bc
        else:
            o, u = c, ca
        best, x, y = _edge_edge(best, x, y, o, u, p, pq)
        best, x, y = _edge_edge(best, x, y, o, u, q, qr)
        best, x, y = _edge_edge(best, x, y, o, u, r, rp)
    return best, x, y


@njit(error_model="numpy", **KERNEL)
def _pierces(a, b, p, q, r):
    """(how deep inside the triangle p q r the segment a b pierces it, where); depth -1 where it does not."""
    n = cross(sub(q, p), sub(r, p))
    ha, hb = dot(n, sub(a, p)), dot(n, sub(b, p))
    if (ha > 0.0) == (hb > 0.0) or ha == hb:
        return -1.0, a
    f = along(a, ha / (ha - hb), sub(b, a))
    s = dot(cross(sub(q, p), sub(f, p)), n)
    t = dot(cross(sub(r, q), sub(f, q)), n)
    u = dot(cross(sub(p, r), sub(f, r)), n)
    return min(s, t, u), f


@njit(error_model="numpy", **KERNEL)
def common_point(a, b, c, p, q, r):
    """A point that two triangles have in common, to rounding: the middle of the segment in which they cross."""
    n = 0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(6):
        if k == 0:
            depth, f = _pierces(a, b, p, q, r)
        elif k == 1:
            depth, f = _pierces(b, c, p, q, r)
        elif k == 2:
            depth, f = _pierces(c, a, p, q, r)
        elif k == 3:
            depth, f = _pierces(p, q, a, b, c)
        elif k == 4:
            depth, f = _pierces(q, r, a, b, c)
        else:
            depth, f = _pierces(r, p, a, b, c)
        if depth >= 0.0:
            x, y, z = x + f[0], y + f[1], z + f[2]
            n += 1
    if n > 0:
        return (x / n, y / n, z / n)
    _, e, f = closest_features(a, b, c, p, q, r)  # touching, or coplanar
    return (0.5 * (e[0] + f[0]), 0.5 * (e[1] + f[1]), 0.5 * (e[2] + f[2]))


@njit(error_model="numpy", **KERNEL)
def _beyond(n, o, p, q, r, size, bound):
    """Whether p, q, r lie on one side of the plane (n, o), all farther from it than `bound`, whatever the rounding."""
    u, v, w = sub(p, o), sub(q, o), sub(r, o)
    h0, h1, h2 = dot(n, u), dot(n, v), dot(n, w)
    if h0 < 0.0 and h1 < 0.0 and h2 < 0.0:
        h0, h1, h2 = -h0, -h1, -h2
    near = min(h0, h1, h2)
    if near <= 0.0:
        return False
    near -= ROUNDING * size * max(greatest(u), greatest(v), greatest(w))
    return near > 0.0 and near * near > bound * bound * dot(n, n)


@njit(error_model="numpy", **KERNEL)
def planes_part(a, b, c, p, q, r, bound):
    """Whether the plane of one triangle proves that they are farther apart than `bound`."""
    u, v = sub(b, a), sub(c, a)
    if _beyond(cross(u, v), a, p, q, r, greatest(u) * greatest(v), bound):
        return True
    u, v = sub(q, p), sub(r, p)
    return _beyond(cross(u, v), p, a, b, c, greatest(u) * greatest(v), bound)


@njit(error_model="numpy", **KERNEL)
def box_gap(box_a, i, box_b, j, rotation, translation):
    """Lower bound of the squared distance of node i of a and node j of b: the gap along a's axes or along b's."""
    ax, ay, az = 0.5 * (box_a[i, 0] + box_a[i, 3]), 0.5 * (box_a[i, 1] + box_a[i, 4]), 0.5 * (box_a[i, 2] + box_a[i, 5])
    bx, by, bz = 0.5 * (box_b[j, 0] + box_b[j, 3]), 0.5 * (box_b[j, 1] + box_b[j, 4]), 0.5 * (box_b[j, 2] + box_b[j, 5])
    hx, hy, hz = box_a[i, 3] - ax, box_a[i, 4] - ay, box_a[i, 5] - az
    kx, ky, kz = box_b[j, 3] - bx, box_b[j, 4] - by, box_b[j, 5] - bz
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    dx = r00 * bx + r01 * by + r02 * bz + translation[0] - ax
    dy = r10 * bx + r11 * by + r12 * bz + translation[1] - ay
    dz = r20 * bx + r21 * by + r22 * bz + translation[2] - az
    gx = max(0.0, abs(dx) - hx - (abs(r00) * kx + abs(r01) * ky + abs(r02) * kz))
    gy = max(0.0, abs(dy) - hy - (abs(r10) * kx + abs(r11) * ky + abs(r12) * kz))
    gz = max(0.0, abs(dz) - hz - (abs(r20) * kx + abs(r21) * ky + abs(r22) * kz))
    along_a = gx * gx + gy * gy + gz * gz
    gx = max(0.0, abs(r00 * dx + r10 * dy + r20 * dz) - kx - (abs(r00) * hx + abs(r10) * hy + abs(r20) * hz))
    gy = max(0.0, abs(r01 * dx + r11 * dy + r21 * dz) - ky - (abs(r01) * hx + abs(r11) * hy + abs(r21) * hz))
    gz = max(0.0, abs(r02 * dx + r12 * dy + r22 * dz) - kz - (abs(r02) * hx + abs(r12) * hy + abs(r22) * hz))
    return max(along_a, gx * gx + gy * gy + gz * gz)


@njit(error_model="numpy", **KERNEL)
def rounding_of(box_a, box_b, rotation, translation):
    """m: how far a distance of boxes or points may be off, by its coordinates and the rotation's own error."""
    reach = 0.0
    for k in range(6):
        reach = max(reach, abs(box_a[0, k]), abs(box_b[0, k]))
    off = 0.0
    for i in range(3):
        reach = max(reach, abs(translation[i]))
        for j in range(3):
            d = -1.0 if i == j else 0.0
            for k in range(3):
                d += rotation[k, i] * rotation[k, j]
            off = max(off, abs(d))
    return (ROUNDING + 4.0 * off) * 2.0 * reach


@njit(error_model="numpy", **KERNEL)
def size_of(box, i):
    """Sum of the edges of box `i`: the larger is opened first."""
    return box[i, 3] - box[i, 0] + box[i, 4] - box[i, 1] + box[i, 5] - box[i, 2]


@njit(error_model="numpy", **KERNEL)
def _leaves(
    i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
    rotation, translation, bound, rounding, best, hit, work,
):  # fmt: skip
    """Better `best` and `hit` by the triangles of two leaves; the new bound."""
    for tb in range(first_b[j], first_b[j] + count_b[j]):
        p = move(rotation, translation, vertices_b, corner_b[tb, 0])
        q = move(rotation, translation, vertices_b, corner_b[tb, 1])
        r = move(rotation, translation, vertices_b, corner_b[tb, 2])
        low = (min(p[0], q[0], r[0]), min(p[1], q[1], r[1]), min(p[2], q[2], r[2]))
        high = (max(p[0], q[0], r[0]), max(p[1], q[1], r[1]), max(p[2], q[2], r[2]))
        for ta in range(first_a[i], first_a[i] + count_a[i]):
            ia, ib, ic = corner_a[ta, 0], corner_a[ta, 1], corner_a[ta, 2]
            a = (vertices_a[ia, 0], vertices_a[ia, 1], vertices_a[ia, 2])
            b = (vertices_a[ib, 0], vertices_a[ib, 1], vertices_a[ib, 2])
            c = (vertices_a[ic, 0], vertices_a[ic, 1], vertices_a[ic, 2])
            reach = bound + rounding
            square = 0.0
            for d in range(3):
                between = max(min(a[d], b[d], c[d]) - high[d], low[d] - max(a[d], b[d], c[d]))
                if between > 0.0:
                    square += between * between
            if square > reach * reach or planes_part(a, b, c, p, q, r, bound):
                continue
            # boxes that rounding cannot bring together hold no triangles that meet
            if square <= rounding * rounding and triangles_meet(a, b, c, p, q, r, work):
                x = common_point(a, b, c, p, q, r)
                best[0] = 0.0
                for d in range(3):
                    best[1 + d] = x[d]
                    best[4 + d] = x[d]
                hit[0], hit[1] = ta, tb
                return 0.0
            if bound == 0.0:
                continue
            d2, x, y = closest_features(a, b, c, p, q, r)
            distance = max(np.sqrt(d2), np.finfo(np.float64).tiny)  # they do not meet: never 0
            if distance < bound or (distance == bound and hit[0] < 0):
                bound = distance
                best[0] = distance
                for d in range(3):
                    best[1 + d] = x[d]
                    best[4 + d] = y[d]
                hit[0], hit[1] = ta, tb
    return bound


@njit(error_model="numpy", **KERNEL)
def closest(
    root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, bound, rounding, best, hit, work, stack, gap,
):  # fmt: skip
    """The nearest triangles below two nodes, if they are within `bound` (m): branch and bound, the nearer boxes first.

    best: (7,) distance, point on a, point on b, both in a's frame. hit: (2,) their places in leaf order, -1 if none is
    within the bound. Stops at the first triangles that meet.
    """
    hit[0] = -1
    hit[1] = -1
    stack[0, 0], stack[0, 1] = root_a, root_b
    gap[0] = box_gap(box_a, root_a, box_b, root_b, rotation, translation)
    top = 1
    while top > 0:
        top -= 1
        # beyond a gap that rounding explains nothing meets, and to rounding nothing there is nearer than what is known:
        # faces flat on one another would otherwise be searched to the last triangle
        reach = bound - rounding if hit[0] >= 0 and bound > 4.0 * rounding else bound + rounding
        if gap[top] > reach * reach:
            continue
        i, j = stack[top, 0], stack[top, 1]
        leaf_a, leaf_b = second_a[i] < 0, second_b[j] < 0
        if leaf_a and leaf_b:
            bound = _leaves(
                i, j, vertices_a, first_a, count_a, corner_a, vertices_b, first_b, count_b, corner_b,
                rotation, translation, bound, rounding, best, hit, work,
            )  # fmt: skip
            if hit[0] >= 0 and bound == 0.0:
                return
            continue
        if leaf_b or (not leaf_a and size_of(box_a, i) >= size_of(box_b, j)):
            i0, j0, i1, j1 = i + 1, j, second_a[i], j
        else:
            i0, j0, i1, j1 = i, j + 1, i, second_b[j]
        g0 = box_gap(box_a, i0, box_b, j0, rotation, translation)
        g1 = box_gap(box_a, i1, box_b, j1, rotation, translation)
        if g0 < g1:
            i0, j0, g0, i1, j1, g1 = i1, j1, g1, i0, j0, g0
        stack[top, 0], stack[top, 1], gap[top] = i0, j0, g0
        stack[top + 1, 0], stack[top + 1, 1], gap[top + 1] = i1, j1, g1
        top += 2


@njit(error_model="numpy", **KERNEL)
def near_surfaces(
    box_a, second_a, surface_a, box_b, second_b, surface_b, rotation, translation, reach, heeded, pairs, stack,
):  # fmt: skip
    """Surface pairs whose boxes come within `reach` (m): their number; as many as fit are written to `pairs`.

    heeded: (ka, kb) uint8, 0 where a surface pair is left out; (0, 0) where none is.
    """
    n = 0
    stack[0, 0], stack[0, 1] = 0, 0
    top = 1
    while top > 0:
        top -= 1
        i, j = stack[top, 0], stack[top, 1]
        if box_gap(box_a, i, box_b, j, rotation, translation) > reach * reach:
            continue
        s, t = surface_a[i], surface_b[j]
        if s >= 0 and t >= 0:
            if heeded.shape[0] > 0 and heeded[s, t] == 0:
                continue
            if n < len(pairs):
                pairs[n, 0], pairs[n, 1] = s, t
            n += 1
            continue
        if t >= 0 or (s < 0 and size_of(box_a, i) >= size_of(box_b, j)):
            stack[top, 0], stack[top, 1] = i + 1, j
            stack[top + 1, 0], stack[top + 1, 1] = second_a[i], j
        else:
            stack[top, 0], stack[top, 1] = i, j + 1
            stack[top + 1, 0], stack[top + 1, 1] = i, second_b[j]
        top += 2
    return n


@njit(error_model="numpy", **KERNEL)
def surface_contacts(
    pairs, root_a, root_b,
    vertices_a, box_a, second_a, first_a, count_a, corner_a,
    vertices_b, box_b, second_b, first_b, count_b, corner_b,
    rotation, translation, within, rounding, best, hit, work, stack, gap,
):  # fmt: skip
    """`closest` for each surface pair of `pairs`: rows of `best` (n, 7) and `hit` (n, 2)."""
    for k in range(len(pairs)):
        closest(
            root_a[pairs[k, 0]], root_b[pairs[k, 1]],
            vertices_a, box_a, second_a, first_a, count_a, corner_a,
            vertices_b, box_b, second_b, first_b, count_b, corner_b,
            rotation, translation, within, rounding, best[k], hit[k], work, stack, gap,
        )  # fmt: skip
