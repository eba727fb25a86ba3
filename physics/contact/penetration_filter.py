"""Penetration filter: tells contact points inside a solid from points that only lie behind the plane of a face.

A point behind a face need not be inside the solid: the end of a ring's outer wall, flush with the end of a bore, lies
deep behind the bore's wall and touches nothing of it. `narrow_phase.find` looks at one instant and lists both. A row is
a penetration if its two features have passed each other since an earlier pose, or if no other surface of the solid is
nearer to the point than the surfaces of the row's feature. Surfaces count only if the point's own material lies in
front of them: a corner sunk straight down along a wall has not come through the wall.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import dot, row, sub
from physics.contact.contact_features import (
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
    _from,
)

OUTSIDE, ENTERED, INSIDE = range(3)
"""verdicts: no penetration; penetration since the earlier pose, or a gap that is not negative; older penetration"""


@inner_kernel(allocates=True)
def _carried(r0, o0, r1, o1, p):
    """(3,) world position, when the body was at (r0, o0), of the point that is at `p` with the body at (r1, o1)."""
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
    """(k, 3) unit directions from a vertex or an edge into its own solid, in the frame `other`; (0, 3) for the rest.

    r, other: rotations of the feature's body and of the body it meets.
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
    """Whether all directions into the material point to the front of a face with normal `n`."""
    least = 0.0
    for k in range(len(material)):
        least = min(least, dot(material[k], n))
    return least >= -FRONT


@inner_kernel(allocates=True)
def _shallow(shapes, shape, p, one, two, material):
    """Whether surface `one` or `two` is the nearest to `p` (shape's frame) of all that its material is in front of."""
    first = shapes.first_surface[shape]
    last = shapes.first_surface[shape + 1] if shape + 1 < len(shapes.first_surface) else len(shapes.kinds)
    at = p[0], p[1], p[2]
    own = np.inf
    for turn in range(2):  # the feature's own surfaces first: their distance bounds the search
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
            start = first + s + shape
            for t in range(shapes.triangle_start[start], shapes.triangle_start[start + 1]):
                if turn == 1 and not _before(material, shapes.normals[t]):
                    continue
                v = shapes.triangles[t]
                q, _ = closest_on_triangle(
                    at, row(shapes.vertices, v[0]), row(shapes.vertices, v[1]), row(shapes.vertices, v[2])
                )
                d = dot(sub(at, q), sub(at, q))
                if turn == 0:
                    own = min(own, d)
                elif d < own * (1.0 - 1e-9):
                    return False
    return True


@inner_kernel(allocates=True)
def _sunk(shapes, shape, surface, feature, r, o, point, other_shape, other_feature, other_r):
    """Whether no other surface of a body is nearer to `point` (world) of another body than the row's feature.

    shape, surface, feature, (r, o): of the body that the point is behind, (r, o) its mesh frame; other_*: of the
    point's own body.
    """
    one = two = surface
    if feature % 4 == EDGE:
        one, two = shapes.edge_surfaces[feature // 4, 0], shapes.edge_surfaces[feature // 4, 1]
    p = np.empty(3)
    _from(r, o, point, p)
    return _shallow(shapes, shape, p, one, two, _material(shapes, other_shape, other_feature, other_r, r))


@kernel(allocates=True)
def classify(ints, reals, known, rotations, origins, before_r, before_o, shape_of, shapes, tolerance):
    """(c,) verdict on each row of `narrow_phase.find`.

    known: (c,) rows that touched before; not examined. before_r (n, 3, 3), before_o (n, 3): mesh frames a little
    earlier. tolerance: m, depths up to it are no penetration.
    """
    out = np.full(len(ints), ENTERED)
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
        out[i] = INSIDE
        if kind_a != FACE and not _sunk(
            shapes, shape_of[b], ints[i, SURFACE_B], ints[i, FEATURE_B], rotations[b], origins[b],
            on_a, shape_of[a], ints[i, FEATURE_A], rotations[a],
        ):  # fmt: skip
            out[i] = OUTSIDE
        if kind_a in (FACE, EDGE) and not _sunk(
            shapes, shape_of[a], ints[i, SURFACE_A], ints[i, FEATURE_A], rotations[a], origins[a],
            on_b, shape_of[b], ints[i, FEATURE_B], rotations[b],
        ):  # fmt: skip
            out[i] = OUTSIDE
    return out
