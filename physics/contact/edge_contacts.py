"""Contact of convex edges: with each other where they cross, and with round bars.

Two edges touch only where the wings of both part (the Gauss-map test). A bar that is known to be a cylinder is met at
its radius, wherever its facets are: the nearest point of the edge to the axis says where.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel
from physics.contact.contact_features import EDGE, FACE, FRONT, TILT, _emit, _from, _listed, _over, _to, _union
from physics.model.shapes import CYLINDER

PARALLEL = 1e-9
"""1: sine of the angle below which an edge does not cross another, or an axis; vertices at its ends count as over the
faces then"""
FLUSH = 1e-2
"""1: sine of the angle between edges below which flush faces give a better normal"""


@inner_kernel
def _outward(ux, uy, uz, wings, k):
    """Outward unit normal of the face along wing k of a convex edge in the direction u."""
    w, other = wings[k], wings[1 - k]
    x, y, z = uy * w[2] - uz * w[1], uz * w[0] - ux * w[2], ux * w[1] - uy * w[0]
    size = np.sqrt(x * x + y * y + z * z)
    if x * other[0] + y * other[1] + z * other[2] > 0.0:
        size = -size
    return x / size, y / size, z / size


@inner_kernel
def _flush(ux, uy, uz, wings_a, vx, vy, vz, wings_b, normal):
    """Whether a face at the edge u of a lies flat on one at the edge v of b; then that face's normal, into `normal`.

    The cross product of two nearly parallel edges is too inexact to be a normal.
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


BEYOND = 0.1
"""1: part of an edge by which a crossing may lie past its end, where a curve continues there"""


@inner_kernel
def _crosses(s, bend, depth):
    """Whether a crossing at `s` of an edge (0 … 1) is on it or, sunk in by `depth` (in lengths of the edge), just past.

    Where a curve of facets bends, a penetrating crossing leaves one edge before it reaches the next.
    """
    if -1e-9 <= s <= 1.0 + 1e-9:
        return True
    past, turn = (-s, bend[0]) if s < 0.0 else (s - 1.0, bend[1])
    return past <= min(BEYOND, 2.0 * depth * turn)


@inner_kernel(allocates=True)
def edges_on_edges(
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
            past = s < -1e-9 or s > 1.0 + 1e-9 or t < -1e-9 or t > 1.0 + 1e-9
            if past and not (
                _crosses(s, shapes.edge_bend[ea], abs(gap) * np.sqrt(vv / nn))
                and _crosses(t, shapes.edge_bend[eb], abs(gap) * np.sqrt(uu / nn))
            ):
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
            if gap > margin or gap < -depth or (past and gap >= 0.0):
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
            n = _emit(n, ints, reals, a, b, sa, sb, 4 * ea + EDGE, 4 * eb + EDGE, rb, pb, at, normal, gap, 1)
    return n


@kernel
def _nearest_to_axis(p0, p1, cylinder, q):
    """The point of the segment p0 p1 that is nearest to a cylinder's axis, into `q`; False where that is an end."""
    ux, uy, uz = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
    wx, wy, wz = p0[0] - cylinder[0], p0[1] - cylinder[1], p0[2] - cylinder[2]
    ax, ay, az = cylinder[3], cylinder[4], cylinder[5]
    along = ux * ax + uy * ay + uz * az
    off = wx * ax + wy * ay + wz * az
    vx, vy, vz = ux - along * ax, uy - along * ay, uz - along * az  # seen along the axis
    wx, wy, wz = wx - off * ax, wy - off * ay, wz - off * az
    vv = vx * vx + vy * vy + vz * vz
    if vv <= PARALLEL * PARALLEL * (ux * ux + uy * uy + uz * uz):
        return False
    s = -(wx * vx + wy * vy + wz * vz) / vv
    if s <= 0.0 or s >= 1.0:
        return False
    q[0], q[1], q[2] = p0[0] + s * ux, p0[1] + s * uy, p0[2] + s * uz
    return True


@inner_kernel(allocates=True)
def edges_on_bars(
    shapes, pairs, first, last, side, fa, fb, ra, pa, rb, pb, margin, depth, n, ints, reals, stamps_e, done
):  # fmt: skip
    """Straight edges of one body (column `side`) across round bars of the other; `ra`, `fa`, … are the first's.

    Edges that border an analytic surface are chords of it and are left out. done: see `_vertices_on_faces`.
    """
    ga, gb = shapes.first_surface[fa], shapes.first_surface[fb]
    bars = False
    for row in range(first, last):
        bar = gb + pairs[row, 3 - 2 * side]
        bars = bars or (shapes.kinds[bar] == CYLINDER and shapes.analytic[bar, 7] > 0)
    if not bars:
        return n
    edges = _union(
        pairs, first, last, side, ga + fa, shapes.edge_start, shapes.surface_edges, stamps_e, shapes.kinds,
        shapes.analytic, ga,
    )  # fmt: skip
    a, b = pairs[first, 2 * side], pairs[first, 2 - 2 * side]
    reach = max(margin, depth)
    world = np.empty(3)
    ends = np.empty((len(edges), 2, 3))
    for i in range(len(edges)):
        for k in range(2):
            _to(ra, pa, shapes.vertices[shapes.edges[edges[i], k]], world)
            _from(rb, pb, world, ends[i, k])
    q = np.empty(3)
    wing = np.empty(3)
    normal = np.empty(3)
    zero = np.zeros(3)
    done[-1] += 1
    for row in range(first, last):
        sb = pairs[row, 3 - 2 * side]
        bar = gb + sb
        if done[bar] == done[-1] or shapes.kinds[bar] != CYLINDER or shapes.analytic[bar, 7] < 0:
            continue
        done[bar] = done[-1]
        box = shapes.boxes[bar]
        for i in range(len(edges)):
            e = edges[i]
            if shapes.edge_sense[e] != 0:
                continue
            p0, p1 = ends[i, 0], ends[i, 1]
            apart = False
            for k in range(3):
                apart = apart or min(p0[k], p1[k]) > box[3 + k] + reach or max(p0[k], p1[k]) < box[k] - reach
            if apart or not _nearest_to_axis(p0, p1, shapes.analytic[bar], q):
                continue
            gap = _over(shapes, (bar, bar + fb), q, margin, depth, normal)
            if gap == np.inf:
                continue
            front = True
            for k in range(2):
                _to(ra, zero, shapes.wings[e, k], world)
                _from(rb, zero, world, wing)
                front = front and normal[0] * wing[0] + normal[1] * wing[1] + normal[2] * wing[2] > -FRONT
            if not front:
                continue
            sa = shapes.edge_surfaces[e, 0]
            if not _listed(pairs, first, last, sa, sb, side):
                sa = shapes.edge_surfaces[e, 1]
                if not _listed(pairs, first, last, sa, sb, side):
                    continue
            sign = 1 - 2 * side
            n = _emit(n, ints, reals, a, b, sa, sb, 4 * e + EDGE, 4 * sb + FACE, rb, pb, q, normal, gap, sign)
    return n
