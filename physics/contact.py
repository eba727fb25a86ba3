"""Contact points between near surfaces: vertex on face, edge on edge, and analytic spheres, cylinders and rims.

For each near surface pair the kernel lists the features that can touch, with the signed gap along the contact normal.
A vertex touches a face only where the material about the vertex lies on the face's outer side, an edge an edge only
where both edges' wings part (the Gauss-map test): so a vertex that rests flush with a neighbouring side face is not
pushed by it, and concave parts need no decomposition. Surfaces known analytically are judged as what they are: the
triangles say where, the sphere or cylinder says how far and which way.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from physics.rotations import cross
from physics.shapes import CYLINDER, FACETED, SPHERE

# columns of the integer rows
BODY_A, BODY_B, SURFACE_A, SURFACE_B, FEATURE_A, FEATURE_B = range(6)
# columns of the real rows
POINT, NORMAL, GAP = 0, 3, 6

# a feature is numbered by its index times 4 plus its kind; a face, a sphere or a bore is its surface
VERTEX, EDGE, FACE, RIM = 0, 1, 2, 3

TILT = 1e-6
"""1: sine of the angle below which a rim lies flat on a face, and its vertices stand for it"""
PARALLEL = 1e-9
"""1: sine of the angle below which two edges do not cross; the vertices at their ends count as over the faces then"""
FLUSH = 1e-2
"""1: sine of the angle between edges below which faces that lie flat on one another give a better normal"""
FRONT = 1e-2
"""1: sine of the angle by which material may reach behind a face and still count as in front of it"""


@njit(cache=True)
def _to(rotation, origin, p, out):
    """World point of `p`, into `out`."""
    for i in range(3):
        out[i] = rotation[i, 0] * p[0] + rotation[i, 1] * p[1] + rotation[i, 2] * p[2] + origin[i]


@njit(cache=True)
def _from(rotation, origin, p, out):
    """Local point of the world point `p`, into `out`."""
    x, y, z = p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]
    for i in range(3):
        out[i] = rotation[0, i] * x + rotation[1, i] * y + rotation[2, i] * z


@njit(cache=True)
def _emit(n, ints, reals, a, b, sa, sb, fa, fb, rotation, origin, p, normal, gap, sign):
    """Append a row; `p` and `normal` are in the frame (rotation, origin); `sign` -1 turns the normal from a to b round.

    Rows hold a < b and the normal from b to a, so a pair has one way to be written.
    """
    if n < ints.shape[0]:
        ints[n, 0], ints[n, 1], ints[n, 2], ints[n, 3], ints[n, 4], ints[n, 5] = a, b, sa, sb, fa, fb
        for i in range(3):
            reals[n, i] = rotation[i, 0] * p[0] + rotation[i, 1] * p[1] + rotation[i, 2] * p[2] + origin[i]
            reals[n, 3 + i] = sign * (
                rotation[i, 0] * normal[0] + rotation[i, 1] * normal[1] + rotation[i, 2] * normal[2]
            )
        reals[n, 6] = gap
    return n + 1


@njit(cache=True)
def _inside(p, a, b, c, n):
    """Whether `p`, seen along the normal `n`, lies in the triangle (its border counts)."""
    for e in range(3):
        if e == 0:
            u, v = a, b
        elif e == 1:
            u, v = b, c
        else:
            u, v = c, a
        ex, ey, ez = v[0] - u[0], v[1] - u[1], v[2] - u[2]
        px, py, pz = p[0] - u[0], p[1] - u[1], p[2] - u[2]
        side = n[0] * (ey * pz - ez * py) + n[1] * (ez * px - ex * pz) + n[2] * (ex * py - ey * px)
        if side < -1e-9 * (ex * ex + ey * ey + ez * ez):
            return False
    return True


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _listed(pairs, first, last, sa, sb, side):
    """Whether rows first … last-1 list surface sa of the one body (column 1, or 3 for side 1) with sb of the other."""
    found = False
    for i in range(first, last):
        found = found or (pairs[i, 1 + 2 * side] == sa and pairs[i, 3 - 2 * side] == sb)
    return found


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _vertices_on_faces(
    shapes, pairs, first, last, side, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_v, done
):  # fmt: skip
    """Vertices of the one body (column `side`) on the faces of the other; `ra`, `fa`, … are the one's.

    done: (surfaces,) scratch stamps that tell which of the other's surfaces have been looked at.
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
            # the wall of a bore bends towards a shaft in it: its chords lead into the shaft and say nothing
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
            if side == 0:
                n = _emit(n, ints, reals, a, b, sa, sb, 4 * v + VERTEX, 4 * sb + FACE, rb, pb, p, normal, gap, 1.0)
            else:
                n = _emit(n, ints, reals, b, a, sb, sa, 4 * sb + FACE, 4 * v + VERTEX, rb, pb, p, normal, gap, -1.0)
    return n


@njit(cache=True)
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
        if sign > 0:
            n = _emit(n, ints, reals, a, b, sa, sb, rim, 4 * sb + FACE, rb, pb, q, normal, gap, 1.0)
        else:
            n = _emit(n, ints, reals, b, a, sb, sa, 4 * sb + FACE, rim, rb, pb, q, normal, gap, -1.0)
    return n


@njit(cache=True)
def _dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz


@njit(cache=True)
def _nearest(p, a, b, c, out):
    """Point of the triangle nearest to `p` (Ericson, "Real-Time Collision Detection", 5.1.5), into `out`."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = _dot(ux, uy, uz, x, y, z), _dot(vx, vy, vz, x, y, z)
    x, y, z = p[0] - b[0], p[1] - b[1], p[2] - b[2]
    d3, d4 = _dot(ux, uy, uz, x, y, z), _dot(vx, vy, vz, x, y, z)
    x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
    d5, d6 = _dot(ux, uy, uz, x, y, z), _dot(vx, vy, vz, x, y, z)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0  # the point is a + s (b - a) + t (c - a)
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        s = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        t = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:
        total = va + vb + vc
        s, t = vb / total, vc / total
    out[0] = a[0] + s * ux + t * vx
    out[1] = a[1] + s * uy + t * vy
    out[2] = a[2] + s * uz + t * vz


@njit(cache=True)
def _ball_on_surface(shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, sign):
    """A convex sphere of a against one surface of b: sphere, cylinder or the nearest of its triangles."""
    ball = shapes.analytic[row_a[0]]
    other = shapes.analytic[row_b[0]]
    kind = shapes.kinds[row_b[0]]
    radius = ball[6]
    world = np.empty(3)
    p = np.empty(3)
    q = np.empty(3)
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
            _nearest(p, shapes.vertices[v[0]], shapes.vertices[v[1]], shapes.vertices[v[2]], q)
            x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
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
    if sign > 0:
        return _emit(n, ints, reals, a, b, sa, sb, 4 * sa + FACE, 4 * sb + FACE, rb, pb, p, normal, gap, 1.0)
    return _emit(n, ints, reals, b, a, sb, sa, 4 * sb + FACE, 4 * sa + FACE, rb, pb, p, normal, gap, -1.0)


@njit(cache=True)
def _outward(ux, uy, uz, wings, k):
    """Outward unit normal of the face along wing k of a convex edge in the direction u."""
    w, other = wings[k], wings[1 - k]
    x, y, z = uy * w[2] - uz * w[1], uz * w[0] - ux * w[2], ux * w[1] - uy * w[0]
    size = np.sqrt(x * x + y * y + z * z)
    if x * other[0] + y * other[1] + z * other[2] > 0.0:
        size = -size
    return x / size, y / size, z / size


@njit(cache=True)
def _flush(ux, uy, uz, wings_a, vx, vy, vz, wings_b, normal):
    """Whether a face at the edge u of a lies flat on one at the edge v of b; then that face's normal, into `normal`.

    The cross product of two edges that are nearly parallel says little about it.
    """
    for k in range(2):
        ax, ay, az = _outward(ux, uy, uz, wings_a, k)
        for m in range(2):
            bx, by, bz = _outward(vx, vy, vz, wings_b, m)
            x, y, z = ax + bx, ay + by, az + bz
            if x * x + y * y + z * z < TILT * TILT:
                normal[0], normal[1], normal[2] = bx, by, bz
                return True
    return False


@njit(cache=True)
def _edges_on_edges(
    shapes, pairs, first, last, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_e
):  # fmt: skip
    """Crossings of convex edges of both bodies, in b's frame."""
    ga, gb = shapes.first_surface[fa], shapes.first_surface[fb]
    a, sa, b, sb = pairs[first]
    mine = _union(
        pairs, first, last, 0, ga + fa, shapes.edge_start, shapes.surface_edges, stamps_e, shapes.kinds,
        shapes.analytic, ga,
    )  # fmt: skip
    others = _union(
        pairs, first, last, 1, gb + fb, shapes.edge_start, shapes.surface_edges, stamps_e, shapes.kinds,
        shapes.analytic, gb,
    )  # fmt: skip
    reach = max(margin, depth)
    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    for k in range(len(others)):
        for end in range(2):
            v = shapes.vertices[shapes.edges[others[k], end]]
            for m in range(3):
                low[m] = min(low[m], v[m] - reach)
                high[m] = max(high[m], v[m] + reach)
    world = np.empty(3)
    p0 = np.empty(3)
    p1 = np.empty(3)
    at = np.empty(3)
    normal = np.empty(3)
    wings = np.empty((2, 3))
    zero = np.zeros(3)
    for i in range(len(mine)):
        ea = mine[i]
        _to(ra, pa, shapes.vertices[shapes.edges[ea, 0]], world)
        _from(rb, pb, world, p0)
        _to(ra, pa, shapes.vertices[shapes.edges[ea, 1]], world)
        _from(rb, pb, world, p1)
        if (
            min(p0[0], p1[0]) > high[0] or min(p0[1], p1[1]) > high[1] or min(p0[2], p1[2]) > high[2]
            or max(p0[0], p1[0]) < low[0] or max(p0[1], p1[1]) < low[1] or max(p0[2], p1[2]) < low[2]
        ):  # fmt: skip
            continue
        ux, uy, uz = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
        uu = ux * ux + uy * uy + uz * uz
        for j in range(len(others)):
            eb = others[j]
            if shapes.edge_sense[ea] | shapes.edge_sense[eb] == 3:
                continue  # a fit: chords of a bore against a shaft; the vertices on the analytic surface tell more
            q0 = shapes.vertices[shapes.edges[eb, 0]]
            q1 = shapes.vertices[shapes.edges[eb, 1]]
            if (
                min(p0[0], p1[0]) > max(q0[0], q1[0]) + reach or max(p0[0], p1[0]) < min(q0[0], q1[0]) - reach
                or min(p0[1], p1[1]) > max(q0[1], q1[1]) + reach or max(p0[1], p1[1]) < min(q0[1], q1[1]) - reach
                or min(p0[2], p1[2]) > max(q0[2], q1[2]) + reach or max(p0[2], p1[2]) < min(q0[2], q1[2]) - reach
            ):  # fmt: skip
                continue
            vx, vy, vz = q1[0] - q0[0], q1[1] - q0[1], q1[2] - q0[2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            nn = nx * nx + ny * ny + nz * nz
            vv = vx * vx + vy * vy + vz * vz
            if nn < PARALLEL * PARALLEL * uu * vv:
                continue  # the ends are vertices on faces
            wx, wy, wz = q0[0] - p0[0], q0[1] - p0[1], q0[2] - p0[2]
            size = np.sqrt(nn)
            gap = -(wx * nx + wy * ny + wz * nz) / size
            if abs(gap) > reach:
                continue
            s = (wx * (vy * nz - vz * ny) + wy * (vz * nx - vx * nz) + wz * (vx * ny - vy * nx)) / nn
            t = (wx * (uy * nz - uz * ny) + wy * (uz * nx - ux * nz) + wz * (ux * ny - uy * nx)) / nn
            if s < -1e-9 or s > 1.0 + 1e-9 or t < -1e-9 or t > 1.0 + 1e-9:
                continue
            normal[0], normal[1], normal[2] = nx / size, ny / size, nz / size
            for k in range(2):
                _to(ra, zero, shapes.wings[ea, k], world)
                _from(rb, zero, world, wings[k])
            if nn < FLUSH * FLUSH * uu * vv and _flush(ux, uy, uz, wings, vx, vy, vz, shapes.wings[eb], normal):
                at[0], at[1], at[2] = s * ux - t * vx, s * uy - t * vy, s * uz - t * vz
                gap = (at[0] - wx) * normal[0] + (at[1] - wy) * normal[1] + (at[2] - wz) * normal[2]
            up, down = True, True
            for k in range(2):
                wing = wings[k]
                h = normal[0] * wing[0] + normal[1] * wing[1] + normal[2] * wing[2]
                up = up and h > -FRONT
                down = down and h < FRONT
                w = shapes.wings[eb, k]
                h = normal[0] * w[0] + normal[1] * w[1] + normal[2] * w[2]
                up = up and h < FRONT
                down = down and h > -FRONT
            if not (up or down):
                continue
            if not up:
                normal[0], normal[1], normal[2] = -normal[0], -normal[1], -normal[2]
                gap = -gap
            if gap > margin or gap < -depth:
                continue
            listed = False
            for k in range(2):
                for m in range(2):
                    surface_a, surface_b = shapes.edge_surfaces[ea, k], shapes.edge_surfaces[eb, m]
                    if not listed and _listed(pairs, first, last, surface_a, surface_b, 0):
                        listed = True
                        sa, sb = surface_a, surface_b
            if not listed:
                continue
            at[0], at[1], at[2] = p0[0] + s * ux, p0[1] + s * uy, p0[2] + s * uz
            n = _emit(n, ints, reals, a, b, sa, sb, 4 * ea + EDGE, 4 * eb + EDGE, rb, pb, at, normal, gap, 1.0)
    return n


@njit(cache=True)
def find(pairs, rotations, origins, shape_of, shapes, margins, depths, ints, reals, stamps_v, stamps_e, stamps_s):
    """Contact points of near surface pairs; returns how many (more than fit: call again with larger arrays).

    pairs: (k, 4) int64 rows (body a, its surface, body b, its surface), a < b, sorted.
    rotations (n, 3, 3), origins (n, 3): mesh frames in the world. shape_of (n,): each body's shape in `shapes`.
    margins, depths: (k,) m, alike for all rows of an object pair; gaps from -depth to margin are listed.
    ints (c, 6): bodies, surfaces, features of a and b. reals (c, 7): point (3) m, normal (3) from b to a, gap m.
    stamps: scratch, one more than there are vertices, edges and surfaces; kept from call to call, zero at first.
    A feature that several surface pairs see is listed once.
    """
    n = 0
    first = 0
    while first < pairs.shape[0]:
        a, b = pairs[first, 0], pairs[first, 2]
        last = first + 1
        while last < pairs.shape[0] and pairs[last, 0] == a and pairs[last, 2] == b:
            last += 1
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
                if shapes.kinds[gb + sb] == FACETED:
                    n = _rims_on_faces(
                        shapes, a, b, sa, sb, row_a, row_b, ra, pa, rb, pb, margin, depth, n, ints, reals, 1
                    )
                if shapes.kinds[ga + sa] == FACETED:
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
        n = _edges_on_edges(shapes, pairs, first, last, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_e)
        first = last
    return n


@njit(cache=True)
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
