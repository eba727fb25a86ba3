"""Features in contact: how a contact row is written, which features surfaces list, gaps of points over faces.

A row of integers names bodies, surfaces and features of a contact, one of reals its point, normal and gap.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel
from physics.model.shapes import CYLINDER, SPHERE

# columns of the integer rows
BODY_A, BODY_B, SURFACE_A, SURFACE_B, FEATURE_A, FEATURE_B = range(6)

# a feature is numbered by its index times 4 plus its kind; a face, a sphere or a bore is its surface
VERTEX, EDGE, FACE, RIM = 0, 1, 2, 3

TILT = 1e-6
"""1: sine of the angle below which a rim lies flat on a face, and its vertices are used in its place"""
FRONT = 1e-2
"""1: sine of the angle by which material may reach behind a face and still count as in front of it"""


@inner_kernel
def end_of_pair(pairs, first):
    """The row after the last one of `pairs` (k, 4) that has the objects of row `first`."""
    last = first + 1
    while last < len(pairs) and pairs[last, 0] == pairs[first, 0] and pairs[last, 2] == pairs[first, 2]:
        last += 1
    return last


@inner_kernel
def _to(rotation, origin, p, out):
    """World point of `p`, into `out`."""
    for i in range(3):
        out[i] = rotation[i, 0] * p[0] + rotation[i, 1] * p[1] + rotation[i, 2] * p[2] + origin[i]


@inner_kernel
def _from(rotation, origin, p, out):
    """Local point of the world point `p`, into `out`."""
    x, y, z = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
    for i in range(3):
        out[i] = rotation[0, i] * x + rotation[1, i] * y + rotation[2, i] * z


@inner_kernel
def _emit(n, ints, reals, a, b, sa, sb, fa, fb, rotation, origin, p, normal, gap, sign):
    """Append a contact: integers (6,) bodies, surfaces, features; reals (7,) point, normal from b to a, gap.

    Point `p` and `normal` are in the frame (rotation, origin) of body b. Where `sign` is -1, a and b change places, so
    that every row holds a < b.
    """
    if n < ints.shape[0]:
        if sign < 0.0:
            a, b, sa, sb, fa, fb = b, a, sb, sa, fb, fa
        ints[n, 0], ints[n, 1], ints[n, 2], ints[n, 3], ints[n, 4], ints[n, 5] = a, b, sa, sb, fa, fb
        for i in range(3):
            reals[n, i] = rotation[i, 0] * p[0] + rotation[i, 1] * p[1] + rotation[i, 2] * p[2] + origin[i]
            reals[n, 3 + i] = sign * (
                rotation[i, 0] * normal[0] + rotation[i, 1] * normal[1] + rotation[i, 2] * normal[2]
            )
        reals[n, 6] = gap
    return n + 1


@inner_kernel
def _inside(p, a, b, c, n):
    """Whether `p`, seen along the normal `n`, lies in the triangle (its border counts)."""
    for u, v in ((a, b), (b, c), (c, a)):
        ex, ey, ez = v[0] - u[0], v[1] - u[1], v[2] - u[2]
        px, py, pz = p[0] - u[0], p[1] - u[1], p[2] - u[2]
        side = n[0] * (ey * pz - ez * py) + n[1] * (ez * px - ex * pz) + n[2] * (ex * py - ey * px)
        if side < -1e-9 * (ex * ex + ey * ey + ez * ez):
            return False
    return True


@inner_kernel
def _over(shapes, row, p, margin, depth, normal):
    """Gap of the point `p` to the faces of one surface that it lies over, least in size; the normal into `normal`.

    On a cylinder gap and normal are the analytic ones. inf where it is over none, or farther than `margin`, or deeper
    than `depth`.
    """
    surface, start = row
    best = np.inf
    round_ = shapes.kinds[surface] == CYLINDER
    slack = 0.0
    if round_:
        c = shapes.analytic[surface]
        if c[10] > 0.0:
            height = (p[0] - c[0]) * c[3] + (p[1] - c[1]) * c[4] + (p[2] - c[2]) * c[5]
            if c[8] <= height <= c[9]:
                return _radial(c, p, margin, depth, normal)
            return np.inf
        slack = 0.1 * c[6]
    for t in range(shapes.triangle_start[start], shapes.triangle_start[start + 1]):
        nx, ny, nz = shapes.normals[t, 0], shapes.normals[t, 1], shapes.normals[t, 2]
        k = shapes.triangles[t, 0]
        gap = (
            nx * (p[0] - shapes.vertices[k, 0])
            + ny * (p[1] - shapes.vertices[k, 1])
            + nz * (p[2] - shapes.vertices[k, 2])
        )
        if gap > margin + slack or gap < -depth - slack or abs(gap) >= abs(best):
            continue
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue
        a = shapes.vertices[k]
        b = shapes.vertices[shapes.triangles[t, 1]]
        c = shapes.vertices[shapes.triangles[t, 2]]
        if not _inside(p, a, b, c, shapes.normals[t]):
            continue
        if round_:
            return _radial(shapes.analytic[surface], p, margin, depth, normal)
        best = gap
        normal[0], normal[1], normal[2] = nx, ny, nz
    return best


@inner_kernel
def _radial(cylinder, p, margin, depth, normal):
    """Gap of `p` to an analytic cylinder (material inside for sense +1, outside for -1), outward normal."""
    x, y, z = p[0] - cylinder[0], p[1] - cylinder[1], p[2] - cylinder[2]
    h = x * cylinder[3] + y * cylinder[4] + z * cylinder[5]
    x, y, z = x - h * cylinder[3], y - h * cylinder[4], z - h * cylinder[5]
    rho = np.sqrt(x * x + y * y + z * z)
    sense = cylinder[7]
    gap = sense * (rho - cylinder[6])
    if rho == 0.0 or gap > margin or gap < -depth:
        return np.inf
    normal[0], normal[1], normal[2] = sense * x / rho, sense * y / rho, sense * z / rho
    return gap


@inner_kernel
def _listed(pairs, first, last, sa, sb, side):
    """Whether rows first … last-1 list surface sa of one body (column 1, or 3 for side 1) with sb of the other."""
    found = False
    for i in range(first, last):
        found = found or (pairs[i, 1 + 2 * side] == sa and pairs[i, 3 - 2 * side] == sb)
    return found


@inner_kernel(allocates=True)
def _union(pairs, first, last, side, surface_row, start, items, stamps, kinds, analytic, surface):
    """Items (vertices or edges) of the surfaces in one column of rows first … last-1, each once; balls have none."""
    stamps[-1] += 1
    stamp = stamps[-1]
    n = 0
    out = np.empty(64, np.int64)
    before = -1
    for i in range(first, last):
        s = pairs[i, 1 + 2 * side]
        if s == before:
            continue
        before = s
        if kinds[surface + s] == SPHERE and analytic[surface + s, 7] > 0:
            continue
        for k in range(start[surface_row + s], start[surface_row + s + 1]):
            item = items[k]
            if stamps[item] != stamp:
                stamps[item] = stamp
                if n == len(out):
                    grown = np.empty(2 * n, np.int64)
                    grown[:n] = out
                    out = grown
                out[n] = item
                n += 1
    return out[:n]


@inner_kernel
def _belongs(shapes, pairs, first, last, side, row, v, s):
    """Whether vertex v lies on some surface that is listed with surface s of the other body."""
    for i in range(first, last):
        if pairs[i, 3 - 2 * side] != s:
            continue
        mine = row + pairs[i, 1 + 2 * side]
        for k in range(shapes.vertex_start[mine], shapes.vertex_start[mine + 1]):
            if shapes.surface_vertices[k] == v:
                return True
    return False
