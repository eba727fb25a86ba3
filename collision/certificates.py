"""Why two surfaces are apart, kept from one question to the next: planes between pieces of them. Kernels.

A certificate is of a piece X of a (children of a node, or a leaf) and a piece Y of b, between which a plane lay at the
pose (R₀, t₀) when it was made: n · (R₀ y + t₀) - n · x ≥ gap for all x in X, y in Y. With c and r a ball about Y in b's
frame, and u = R₀ᵀn, which is n as b saw it then,

    n · (R y + t) = n · (R c + t) + u · (y - c) + (Rᵀn - u) · (y - c)
                  ≥ n · (R₀ y + t₀) + n · (R c + t) - n · (R₀ c + t₀) - r |Rᵀn - u|,

so X and Y are apart at any pose (R, t), whatever lay between, where k + n · (R c + t) > r |Rᵀn - u|, k being
gap - n · (R₀ c + t₀). Motion along the plane costs nothing, turning by the size of the piece only. Eight are checked at
once, in float32, and must hold by more than the rounding, which is at most twice that of a box (`lanes.MOTION`).

A front is a list of certificates that together account for all pairs of triangles of all surfaces that do not meet: if
all hold, nothing is searched. (Planes kept between bodies: Baraff, "Curved Surfaces and Coherence for Non-penetrating
Rigid Body Simulation", SIGGRAPH 1990. A traversal's front kept and mended: Ehmann & Lin, "Accurate and Fast Proximity
Queries Between Polyhedra Using Convex Surface Decomposition", Eurographics 2001.)
"""

# mypy: disable-error-code="call-arg, var-annotated"
# (numba's intrinsics take one argument less than they are written with)

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from collision.lanes import clearances
from collision.memory import f32, f64, i64, lowest, put_f32, put_i64
from collision.predicates import INNER
from collision.tables import CAPACITY, FREE, N_FREE, OVERFLOW, PIECES, PLANES, ROOM, SIZE
from collision.wide import LANES

ROW: Final = 11 * LANES
"""float32 that eight certificates take: rows of n, u, c, r and k"""


@njit("void(int64, int64, " + "float64, " * 8 + "int64, int64)", **INNER)
def record(front, pose, nx, ny, nz, gap, cx, cy, cz, r, pair, task):
    """Keep that pieces are `gap` apart along n at `pose`; a gap of -inf: nothing is known of them."""
    if i64(front, N_FREE) > 0:
        put_i64(front, N_FREE, i64(front, N_FREE) - 1)
        slot = i64(i64(front, FREE), i64(front, N_FREE))
    elif i64(front, SIZE) < i64(front, CAPACITY):
        slot = i64(front, SIZE)
        put_i64(front, SIZE, slot + 1)
    else:
        put_i64(front, OVERFLOW, 1)
        return
    put_i64(i64(front, PIECES), 2 * slot, pair)
    put_i64(i64(front, PIECES), 2 * slot + 1, task)
    ux = f64(pose, 0) * nx + f64(pose, 3) * ny + f64(pose, 6) * nz
    uy = f64(pose, 1) * nx + f64(pose, 4) * ny + f64(pose, 7) * nz
    uz = f64(pose, 2) * nx + f64(pose, 5) * ny + f64(pose, 8) * nz
    k = gap - (ux * cx + uy * cy + uz * cz) - (nx * f64(pose, 12) + ny * f64(pose, 13) + nz * f64(pose, 14))
    planes, at = i64(front, PLANES), ROW * (slot >> 3) + (slot & 7)
    put_f32(planes, at, nx)
    put_f32(planes, at + 8, ny)
    put_f32(planes, at + 16, nz)
    put_f32(planes, at + 24, ux)
    put_f32(planes, at + 32, uy)
    put_f32(planes, at + 40, uz)
    put_f32(planes, at + 48, cx)
    put_f32(planes, at + 56, cy)
    put_f32(planes, at + 64, cz)
    put_f32(planes, at + 72, r)
    put_f32(planes, at + 80, k)


@njit(**INNER)
def hopeless(front, slot):
    """Whether this stands for triangles between which no plane was found."""
    planes, at = i64(front, PLANES), ROW * (slot >> 3) + (slot & 7)
    return f32(planes, at + 80) == -np.inf and f32(planes, at + 72) > 0.0


@njit(**INNER)
def drop(front, slot):
    """Forget a certificate: its place passes every check until it is taken again."""
    planes, at = i64(front, PLANES), ROW * (slot >> 3) + (slot & 7)
    for row in range(10):
        put_f32(planes, at + 8 * row, 0.0)
    put_f32(planes, at + 80, np.inf)
    put_i64(i64(front, FREE), i64(front, N_FREE), slot)
    put_i64(front, N_FREE, i64(front, N_FREE) + 1)


@njit(**INNER)
def record_boxes(front, pose, boxes_a, lane_a, step_a, moved, boxes_b, lane_b, step_b, lanes, pair, task):
    """Certificates for boxes that do not overlap: in each of `lanes` (bits) that at lane_a + step_a·i of a and that at
    lane_b + step_b·i of b, one step being 0 and the other 1. `task` is that of the pair of nodes, its mask empty.

    One certificate for all lanes that are farthest apart along the same direction of the six.
    """
    directions = 0
    left = lanes
    while left != 0:
        i = lowest(left)
        left &= left - 1
        xa, xb = lane_a + step_a * i, lane_b + step_b * i
        widest, best = -np.inf, 0
        for d in range(3):
            above = f32(moved, xb + 8 * d) - f32(boxes_a, xa + 24 + 8 * d)
            below = f32(boxes_a, xa + 8 * d) - f32(moved, xb + 24 + 8 * d)
            if above > widest:
                widest, best = above, d
            if below > widest:
                widest, best = below, d + 3
        directions |= best << (4 * i)
    for direction in range(6):
        d = direction % 3
        mask = 0
        gap = np.inf
        x0 = y0 = z0 = np.inf
        x1 = y1 = z1 = -np.inf
        left = lanes
        while left != 0:
            i = lowest(left)
            left &= left - 1
            if (directions >> (4 * i)) & 15 != direction:
                continue
            mask |= 1 << i
            xa, xb = lane_a + step_a * i, lane_b + step_b * i
            if direction < 3:
                gap = min(gap, np.float64(f32(moved, xb + 8 * d)) - np.float64(f32(boxes_a, xa + 24 + 8 * d)))
            else:
                gap = min(gap, np.float64(f32(boxes_a, xa + 8 * d)) - np.float64(f32(moved, xb + 24 + 8 * d)))
            x0, x1 = min(x0, f32(boxes_b, xb)), max(x1, f32(boxes_b, xb + 24))
            y0, y1 = min(y0, f32(boxes_b, xb + 8)), max(y1, f32(boxes_b, xb + 32))
            z0, z1 = min(z0, f32(boxes_b, xb + 16)), max(z1, f32(boxes_b, xb + 40))
        if mask != 0 and np.isfinite(gap):
            sign = 1.0 if direction < 3 else -1.0
            r = 0.5000001 * np.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0) + (z1 - z0) * (z1 - z0))
            record(
                front, pose, sign * (d == 0), sign * (d == 1), sign * (d == 2), gap,
                0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1), r, pair, task | mask,
            )  # fmt: skip


@njit(**INNER)
def record_leaves(front, pose, leaf_a, at_a, n_a, leaf_b, at_b, n_b, sx, sy, sz, off, cx, cy, cz, r, lanes, pair, task):
    """Certificates for the triangles `lanes` of a leaf of b, all apart from the n_a of a leaf of a.

    Both leaves prepared, that of b off by the shift s, with (cx, cy, cz, r) about it in b's frame. Directions tried:
    the axes and the normal of every second triangle (two make a facet). One certificate for all triangles if one plane
    will do, else for those that the same plane clears best, and one that never holds for those that none clears.
    """
    room = i64(front, ROOM)
    for j in range(8):
        put_f32(room, j, -np.inf)
        put_f32(room, 8 + j, 0.0)
    doubt = 4.0 * off
    whole, whole_by = doubt, -1
    normals_a = (n_a + 1) >> 1
    for candidate in range(3 + normals_a + ((n_b + 1) >> 1)):
        nx, ny, nz = _direction(leaf_a, at_a, normals_a, leaf_b, at_b, candidate)
        clearances(
            leaf_a, at_a, n_a, leaf_b, at_b, lanes, nx, ny, nz, nx * sx + ny * sy + nz * sz, 2.0 * candidate, room
        )
        if f32(room, 16) > whole:
            whole, whole_by = f32(room, 16), 2 * candidate
        if f32(room, 24) > whole:
            whole, whole_by = f32(room, 24), 2 * candidate + 1
        if whole > r:
            break
    left = lanes
    while left != 0:
        j = lowest(left)
        by, gap, mask = f32(room, 8 + j), np.float64(f32(room, j)), 0
        if whole_by >= 0:
            by, gap, mask = whole_by, whole, left
        elif not gap > doubt:
            gap = -np.inf
        for i in range(j, 8):
            if (left >> i) & 1 and whole_by < 0:
                own = np.float64(f32(room, i))
                if (f32(room, 8 + i) == by and own > doubt) if gap > 0.0 else not own > doubt:
                    mask |= 1 << i
                    gap = min(gap, own) if gap > 0.0 else gap
        left &= ~mask
        nx, ny, nz = _direction(leaf_a, at_a, normals_a, leaf_b, at_b, int(by) >> 1)
        sign = 1.0 if int(by) & 1 == 0 else -1.0
        record(front, pose, sign * nx, sign * ny, sign * nz, gap - doubt, cx, cy, cz, r, pair, task | mask)


@njit(**INNER)
def _direction(leaf_a, at_a, normals_a, leaf_b, at_b, candidate):
    """A direction of unit length, or 0 where a triangle has none."""
    if candidate < 3:
        return np.float32(candidate == 0), np.float32(candidate == 1), np.float32(candidate == 2)
    i = candidate - 3
    leaf, at = (leaf_a, at_a + 2 * i) if i < normals_a else (leaf_b, at_b + 2 * (i - normals_a))
    x, y, z = np.float64(f32(leaf, at + 120)), np.float64(f32(leaf, at + 128)), np.float64(f32(leaf, at + 136))
    length = np.sqrt(x * x + y * y + z * z)
    s = 1.0 / length if length > 0.0 else 0.0
    return np.float32(s * x), np.float32(s * y), np.float32(s * z)
