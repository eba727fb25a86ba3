"""Contact points between near surfaces: vertex on face, edges, and analytic spheres, cylinders and rims.

For each near surface pair the kernel lists the features that can touch, with the signed gap along the contact normal.
A vertex touches a face only where the material about the vertex lies on the face's outer side, an edge an edge only
where both edges' wings part (the Gauss-map test): so a vertex that rests flush with a neighbouring side face is not
pushed by it, and concave parts need no decomposition. Surfaces known analytically are treated exactly: the
triangles say where, the sphere or cylinder says how far and which way.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from collision.numeric.point_triangle import closest_on_triangle
from collision.numeric.vectors import cross, sub
from collision.numeric.vectors import row as point
from physics.contact.contact_features import (
    FACE,
    FRONT,
    RIM,
    TILT,
    VERTEX,
    _belongs,
    _emit,
    _from,
    _over,
    _to,
    _union,
    end_of_pair,
)
from physics.contact.edge_contacts import edges_on_bars, edges_on_edges
from physics.model.shapes import CYLINDER, FACETED, SPHERE


@inner_kernel(allocates=True)
def _vertices_on_faces(
    shapes, pairs, first, last, side, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_v, done
):  # fmt: skip
    """Vertices of one body (column `side`) on the faces of the other; `ra`, `fa`, … are the first's.

    done: (surfaces,) stamps, workspace: surfaces of the second object that have been tested.
    """
    ga, gb = shapes.first_surface[fa], shapes.first_surface[fb]
    vertices = _union(
        pairs, first, last, side, ga + fa, shapes.vertex_start, shapes.surface_vertices, stamps_v, shapes.kinds,
        shapes.analytic, ga,
    )  # fmt: skip
    points = np.empty((len(vertices), 3))
    world = np.empty(3)
    for i in range(len(vertices)):
        _to(ra, pa, shapes.vertices[vertices[i]], world)
        _from(rb, pb, world, points[i])
    a, b = pairs[first, 2 * side], pairs[first, 2 - 2 * side]
    reach = max(margin, depth)
    q = np.empty(3)
    normal = np.empty(3)
    zero = np.zeros(3)
    done[-1] += 1
    stamp = done[-1]
    for row in range(first, last):
        sb = pairs[row, 3 - 2 * side]
        if done[gb + sb] == stamp or (shapes.kinds[gb + sb] == SPHERE and shapes.analytic[gb + sb, 7] > 0):
            continue
        done[gb + sb] = stamp
        box = shapes.boxes[gb + sb]
        for i in range(len(vertices)):
            p = points[i]
            if (
                p[0] < box[0] - reach or p[1] < box[1] - reach or p[2] < box[2] - reach
                or p[0] > box[3] + reach or p[1] > box[4] + reach or p[2] > box[5] + reach
            ):  # fmt: skip
                continue
            gap = _over(shapes, (gb + sb, gb + sb + fb), p, margin, depth, normal)
            if gap == np.inf:
                continue
            v = vertices[i]
            front = True
            # the wall of a bore curves towards a shaft in it: its chords lead into the shaft, and are no evidence
            bore = (
                shapes.vertex_bore[v] if shapes.kinds[gb + sb] == CYLINDER and shapes.analytic[gb + sb, 7] > 0 else -1
            )
            for j in range(shapes.neighbour_start[v + fa], shapes.neighbour_start[v + fa + 1]):
                if bore >= 0 and shapes.vertex_bore[shapes.neighbours[j]] == bore:
                    continue
                _to(ra, pa, shapes.vertices[shapes.neighbours[j]], world)
                _from(rb, pb, world, q)
                x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
                if normal[0] * x + normal[1] * y + normal[2] * z < -FRONT * np.sqrt(x * x + y * y + z * z):
                    front = False
                    break
            if front and shapes.vertex_rim[v] >= 0 and shapes.kinds[gb + sb] == FACETED:
                _to(ra, zero, shapes.circles[shapes.vertex_rim[v], 3:6], world)
                _from(rb, zero, world, q)
                x, y, z = cross(normal, q)
                front = x * x + y * y + z * z < TILT * TILT  # else the rim itself touches first
            if not front or not _belongs(shapes, pairs, first, last, side, ga + fa, v, sb):
                continue
            sa = pairs[row, 1 + 2 * side]
            sign = 1 - 2 * side
            n = _emit(n, ints, reals, a, b, sa, sb, 4 * v + VERTEX, 4 * sb + FACE, rb, pb, p, normal, gap, sign)
    return n


@inner_kernel(allocates=True)
def _rims_on_faces(shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, sign):
    """The point of a rim that reaches farthest towards a flat face, wherever the rim is tilted at all."""
    q = np.empty(3)
    d = np.empty(3)
    world = np.empty(3)
    normal = np.empty(3)
    zero = np.zeros(3)
    for c in range(shapes.circle_start[row_a[1]], shapes.circle_start[row_a[1] + 1]):
        circle = shapes.circles[c]
        _to(ra, pa, circle[:3], world)
        _from(rb, pb, world, q)
        _to(ra, zero, circle[3:6], world)
        _from(rb, zero, world, d)
        t = shapes.triangle_start[row_b[1]]
        nt = shapes.normals[t]
        along = nt[0] * d[0] + nt[1] * d[1] + nt[2] * d[2]
        x, y, z = nt[0] - along * d[0], nt[1] - along * d[1], nt[2] - along * d[2]
        tilt = np.sqrt(x * x + y * y + z * z)
        if tilt < TILT:
            continue
        r = circle[6] / tilt
        q[0], q[1], q[2] = q[0] - r * x, q[1] - r * y, q[2] - r * z
        gap = _over(shapes, row_b, q, margin, depth, normal)
        if gap == np.inf:
            continue
        rim = 4 * int(circle[7]) + RIM
        n = _emit(n, ints, reals, a, b, sa, sb, rim, 4 * sb + FACE, rb, pb, q, normal, gap, sign)
    return n


@inner_kernel(allocates=True)
def _ball_on_surface(shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, sign):
    """A convex sphere of a against one surface of b: sphere, cylinder or the nearest of its triangles."""
    ball = shapes.analytic[row_a[0]]
    other = shapes.analytic[row_b[0]]
    kind = shapes.kinds[row_b[0]]
    radius = ball[6]
    world = np.empty(3)
    p = np.empty(3)
    normal = np.zeros(3)
    _to(ra, pa, ball[:3], world)
    _from(rb, pb, world, p)
    gap = np.inf
    if kind == SPHERE:
        x, y, z = p[0] - other[0], p[1] - other[1], p[2] - other[2]
        distance = np.sqrt(x * x + y * y + z * z)
        if distance == 0.0:
            return n
        sense = other[7]
        gap = sense * (distance - other[6]) - radius
        normal[0], normal[1], normal[2] = sense * x / distance, sense * y / distance, sense * z / distance
    elif kind == CYLINDER:
        gap = _over(shapes, row_b, p, margin + radius, depth, normal) - radius
    else:
        least = np.inf
        for t in range(shapes.triangle_start[row_b[1]], shapes.triangle_start[row_b[1] + 1]):
            nt = shapes.normals[t]
            v = shapes.triangles[t]
            q, _ = closest_on_triangle(
                (p[0], p[1], p[2]),
                point(shapes.vertices, v[0]),
                point(shapes.vertices, v[1]),
                point(shapes.vertices, v[2]),
            )
            x, y, z = sub((p[0], p[1], p[2]), q)
            d2 = x * x + y * y + z * z
            if d2 >= least:
                continue
            least = d2
            height = nt[0] * x + nt[1] * y + nt[2] * z
            distance = np.sqrt(d2)
            if height <= 0.0 and distance > -height * (1.0 + 1e-9):
                gap = np.inf  # behind the face and past its border: another surface is in front
            elif abs(height) >= distance * (1.0 - 1e-15) or distance == 0.0:
                gap = height - radius
                normal[0], normal[1], normal[2] = nt[0], nt[1], nt[2]
            else:
                gap = distance - radius
                normal[0], normal[1], normal[2] = x / distance, y / distance, z / distance
    if not (-depth <= gap <= margin):
        return n
    for i in range(3):
        p[i] -= (radius + 0.5 * gap) * normal[i]
    return _emit(n, ints, reals, a, b, sa, sb, 4 * sa + FACE, 4 * sb + FACE, rb, pb, p, normal, gap, sign)


@kernel
def find(pairs, rotations, origins, shape_of, shapes, margins, depths, ints, reals, stamps_v, stamps_e, stamps_s):
    """Contact points of near surface pairs; returns how many (more than fit: call again with larger arrays).

    pairs: (k, 4) int64 rows (body a, its surface, body b, its surface), a < b, sorted.
    rotations (n, 3, 3), origins (n, 3): mesh frames in the world. shape_of (n,): each body's shape in `shapes`.
    margins, depths: (k,) m, alike for all rows of an object pair; gaps from -depth to margin are listed.
    ints (c, 6): bodies, surfaces, features of a and b. reals (c, 7): point (3) m, normal (3) from b to a, gap m.
    stamps: workspace, one more than there are vertices, edges and surfaces; kept from call to call, zero at first.
    A feature that several surface pairs see is listed once.
    """
    n = 0
    first = 0
    while first < pairs.shape[0]:
        a, b = pairs[first, 0], pairs[first, 2]
        last = end_of_pair(pairs, first)
        margin, depth = margins[first], depths[first]
        fa, fb = shape_of[a], shape_of[b]
        ga, gb = shapes.first_surface[fa], shapes.first_surface[fb]
        ra, pa, rb, pb = rotations[a], origins[a], rotations[b], origins[b]
        start = n
        for i in range(first, last):
            sa, sb = pairs[i, 1], pairs[i, 3]
            row_a, row_b = (ga + sa, ga + sa + fa), (gb + sb, gb + sb + fb)
            if shapes.kinds[ga + sa] == SPHERE and shapes.analytic[ga + sa, 7] > 0:
                n = _ball_on_surface(
                    shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, 1
                )
            elif shapes.kinds[gb + sb] == SPHERE and shapes.analytic[gb + sb, 7] > 0:
                n = _ball_on_surface(
                    shapes, b, a, sb, sa, row_b, row_a, rb, pb, ra, pa, margin, depth, n, ints, reals, -1
                )
            else:
                # (most surfaces have no rims: not even workspace is made for them)
                rims_a = shapes.circle_start[row_a[1]] < shapes.circle_start[row_a[1] + 1]
                rims_b = shapes.circle_start[row_b[1]] < shapes.circle_start[row_b[1] + 1]
                if rims_a and shapes.kinds[gb + sb] == FACETED:
                    n = _rims_on_faces(
                        shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, 1
                    )
                if rims_b and shapes.kinds[ga + sa] == FACETED:
                    n = _rims_on_faces(
                        shapes, b, a, sb, sa, row_b, row_a, rb, pb, ra, pa, margin, depth, n, ints, reals, -1
                    )
        n = _once(ints, reals, start, start, n)
        n = _vertices_on_faces(
            shapes, pairs, first, last, 0, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_v, stamps_s
        )
        n = _vertices_on_faces(
            shapes, pairs, first, last, 1, fb, fa, rb, pb, ra, pa, margin, depth, n, ints, reals, stamps_v, stamps_s
        )
        n = edges_on_edges(shapes, pairs, first, last, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_e)
        n = edges_on_bars(
            shapes, pairs, first, last, 0, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_e, stamps_s
        )
        n = edges_on_bars(
            shapes, pairs, first, last, 1, fb, fa, rb, pb, ra, pa, margin, depth, n, ints, reals, stamps_e, stamps_s
        )
        first = last
    return n


@inner_kernel(allocates=True)
def _once(ints, reals, first, start, n):
    """Drop rows start … n-1 that name the features of an earlier row from `first` on; the new count."""
    if n > ints.shape[0]:
        return n
    keep = start
    for i in range(start, n):
        known = False
        for j in range(first, keep):
            if ints[j, 4] == ints[i, 4] and ints[j, 5] == ints[i, 5]:
                known = True
                break
        if known:
            continue
        if keep != i:
            ints[keep] = ints[i]
            reals[keep] = reals[i]
        keep += 1
    return keep
