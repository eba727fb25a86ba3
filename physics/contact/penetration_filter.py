"""Which contact points with a negative gap are penetrations, and which only lie behind a face.

A point that lies behind a face need not have come through it: the end of a ring's outer wall, flush with the end of
a bore, lies deep behind the bore's wall and touches nothing of it. `contact.find` cannot tell, it sees one instant.
A row is a penetration if its two features have crossed since a known earlier pose, or if no other surface of the
solid is nearer to the point than those of the row's own feature. Only surfaces count that the point's own material lies
in front of, as for `contact.find`: a corner sunk straight down along a wall has not come through the wall.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from physics.contact.features import (
    BODY_A,
    BODY_B,
    EDGE,
    FACE,
    FEATURE_A,
    FEATURE_B,
    FRONT,
    SURFACE_A,
    SURFACE_B,
    VERTEX,
    _dot,
    _from,
    _nearest,
)

NOTHING, CROSSED, SUNK = range(3)
"""verdicts: no penetration; one since the earlier pose (or a gap that is not negative); one that is older"""


@inner_kernel(allocates=True)
def _carried(r0, o0, r1, o1, p):
    """Where the point of a body that is now at `p` (world) was when the body was at (r0, o0)."""
    x, y, z = p[0] - o1[0], p[1] - o1[1], p[2] - o1[2]
    out = np.empty(3)
    a = r1[0, 0] * x + r1[1, 0] * y + r1[2, 0] * z
    b = r1[0, 1] * x + r1[1, 1] * y + r1[2, 1] * z
    c = r1[0, 2] * x + r1[1, 2] * y + r1[2, 2] * z
    for i in range(3):
        out[i] = r0[i, 0] * a + r0[i, 1] * b + r0[i, 2] * c + o0[i]
    return out


@inner_kernel(allocates=True)
def _material(shapes, shape, feature, r, other):
    """(k, 3) unit, the ways from a vertex or an edge into its own solid, in the frame `other`; none for other features.

    r, other: rotations of the feature's body and of the one it meets.
    """
    item = feature // 4
    if feature % 4 == VERTEX:
        first, last = shapes.neighbour_start[item + shape], shapes.neighbour_start[item + shape + 1]
        local = np.empty((last - first, 3))
        for j in range(first, last):
            way = shapes.vertices[shapes.neighbours[j]] - shapes.vertices[item]
            local[j - first] = way / np.sqrt(np.sum(way * way))
    elif feature % 4 == EDGE:
        local = shapes.wings[item].copy()
    else:
        local = np.empty((0, 3))
    return np.dot(np.dot(local, np.ascontiguousarray(r.T)), other)


@inner_kernel
def _before(material, n):
    """Whether all of the material's ways lead to the front of a face with the normal `n`."""
    for k in range(len(material)):
        if _dot(material[k, 0], material[k, 1], material[k, 2], n[0], n[1], n[2]) < -FRONT:
            return False
    return True


@inner_kernel(allocates=True)
def _shallow(shapes, shape, p, one, two, material):
    """Whether `one` or `two` is nearest to `p` (shape's frame) of all surfaces that its material is before."""
    first = shapes.first_surface[shape]
    last = shapes.first_surface[shape + 1] if shape + 1 < len(shapes.first_surface) else len(shapes.kinds)
    q = np.empty(3)
    own = np.inf
    for turn in range(2):  # its own surfaces first: they say how near another must be
        for s in range(last - first):
            if (s in (one, two)) != (turn == 0):
                continue
            box = shapes.boxes[first + s]
            if turn == 1:
                far = 0.0
                for k in range(3):
                    d = max(box[k] - p[k], p[k] - box[3 + k], 0.0)
                    far += d * d
                if far >= own:
                    continue
            row = first + s + shape
            for t in range(shapes.triangle_start[row], shapes.triangle_start[row + 1]):
                if turn == 1 and not _before(material, shapes.normals[t]):
                    continue
                v = shapes.triangles[t]
                _nearest(p, shapes.vertices[v[0]], shapes.vertices[v[1]], shapes.vertices[v[2]], q)
                x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
                d = _dot(x, y, z, x, y, z)
                if turn == 0:
                    own = min(own, d)
                elif d < own * (1.0 - 1e-9):
                    return False
    return True


@inner_kernel(allocates=True)
def _sunk(shapes, shape, surface, feature, r, o, point, other_shape, other_feature, other_r):
    """Whether `point` (world) of another body is no nearer to any other surface of a body than to the row's feature.

    shape, surface, feature, (r, o): of the body that it is behind, (r, o) its mesh frame; other_*: of the point's own.
    """
    one = two = surface
    if feature % 4 == EDGE:
        one, two = shapes.edge_surfaces[feature // 4, 0], shapes.edge_surfaces[feature // 4, 1]
    p = np.empty(3)
    _from(r, o, point, p)
    return _shallow(shapes, shape, p, one, two, _material(shapes, other_shape, other_feature, other_r, r))


@kernel(allocates=True)
def sift(ints, reals, known, rotations, origins, before_r, before_o, shape_of, shapes, tolerance):
    """(c,) verdict on each row that `contact.find` gave.

    known (c,): rows that touched before; they are taken as they are. before_r (n, 3, 3), before_o (n, 3): the mesh
    frames at an earlier instant, not long ago. tolerance: m, gaps above -tolerance are none.
    """
    out = np.full(len(ints), CROSSED)
    for i in range(len(ints)):
        gap = reals[i, 6]
        if known[i] or gap >= -tolerance:
            continue
        a, b = ints[i, BODY_A], ints[i, BODY_B]
        kind_a = ints[i, FEATURE_A] % 4
        n = reals[i, 3:6]
        on_a = reals[i, :3].copy()
        on_b = on_a - gap * n
        face = b
        if kind_a == FACE:
            on_b = reals[i, :3].copy()
            on_a = on_b + gap * n
            face = a
        was_a = _carried(before_r[a], before_o[a], rotations[a], origins[a], on_a)
        was_b = _carried(before_r[b], before_o[b], rotations[b], origins[b], on_b)
        turned = _carried(before_r[face], np.zeros(3), rotations[face], np.zeros(3), n)
        was = np.sum(turned * (was_a - was_b))
        if was >= 0.5 * gap:
            continue
        out[i] = SUNK
        if kind_a != FACE and not _sunk(
            shapes, shape_of[b], ints[i, SURFACE_B], ints[i, FEATURE_B], rotations[b], origins[b],
            on_a, shape_of[a], ints[i, FEATURE_A], rotations[a],
        ):  # fmt: skip
            out[i] = NOTHING
        if kind_a in (FACE, EDGE) and not _sunk(
            shapes, shape_of[a], ints[i, SURFACE_A], ints[i, FEATURE_A], rotations[a], origins[a],
            on_b, shape_of[b], ints[i, FEATURE_B], rotations[b],
        ):  # fmt: skip
            out[i] = NOTHING
    return out
