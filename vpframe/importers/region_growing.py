"""Kernels of segmentation: neighbours of triangles, and growth of an analytic surface over them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus

PLANE, CYLINDER, CONE, SPHERE, TORUS = range(5)


def packed(geometry: Geometry) -> tuple[int, NDArray[np.float64]]:
    """Return the kind's number and (8,) point, direction and two sizes, the arguments of `reach`."""
    match geometry:
        case Plane():
            return PLANE, np.array([*geometry.origin, *geometry.normal, 0.0, 0.0])
        case Cylinder():
            return CYLINDER, np.array([*geometry.origin, *geometry.axis, geometry.radius, 0.0])
        case Cone():
            angle = geometry.half_angle
            return CONE, np.array([*geometry.apex, *geometry.axis, np.cos(angle), np.sin(angle)])
        case Sphere():
            return SPHERE, np.array([*geometry.center, 0.0, 0.0, 1.0, geometry.radius, 0.0])
        case Torus():
            return TORUS, np.array([*geometry.center, *geometry.axis, geometry.major, geometry.minor])
    raise TypeError(f"{geometry.kind} has no closed form")


def neighbours(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """(m, 3) triangle across the edge from corner k to k+1; -1 at a border, or where more than two triangles meet."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    key = ends.min(axis=1) * (int(triangles.max()) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    first = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    pairs = first[np.diff(np.r_[first, len(key)]) == 2]
    a, b = order[pairs], order[pairs + 1]
    across = np.full(len(key), -1, np.int32)
    across[a], across[b] = b // 3, a // 3
    return across.reshape(-1, 3)


@inner_kernel
def _gap(kind, q, x, y, z):
    """Return the distance of a point from the surface, and the surface's unit normal there."""
    dx, dy, dz = x - q[0], y - q[1], z - q[2]
    if kind == SPHERE:
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        if length == 0.0:
            return q[6], 0.0, 0.0, 1.0
        return abs(length - q[6]), dx / length, dy / length, dz / length
    height = dx * q[3] + dy * q[4] + dz * q[5]
    if kind == PLANE:
        return abs(height), q[3], q[4], q[5]
    rx, ry, rz = dx - height * q[3], dy - height * q[4], dz - height * q[5]
    radius = np.sqrt(rx * rx + ry * ry + rz * rz)
    if radius == 0.0:
        return np.inf if kind != CONE else abs(height * q[7]), 0.0, 0.0, 0.0
    rx, ry, rz = rx / radius, ry / radius, rz / radius
    if kind == CYLINDER:
        return abs(radius - q[6]), rx, ry, rz
    if kind == CONE:
        return (
            abs(radius * q[6] - height * q[7]),
            rx * q[6] - q[3] * q[7],
            ry * q[6] - q[4] * q[7],
            rz * q[6] - q[5] * q[7],
        )
    across = radius - q[6]
    length = np.sqrt(across * across + height * height)
    if length == 0.0:
        return q[7], rx, ry, rz
    across, along = across / length, height / length
    return abs(length - q[7]), rx * across + q[3] * along, ry * across + q[4] * along, rz * across + q[5] * along


@kernel
def reach(kind, q, seed, vertices, triangles, normals, needle, across, label, tolerance, cosine, mark, stamp, out):
    """Find the free triangles connected to `seed` whose corners lie on the surface and whose normals agree with it.

    Writes them to `out` and returns their number. Normals of `needle` triangles are ignored; `label` is -1 for free
    triangles; `mark` holds `stamp` for visited ones, so that it need not be cleared.
    """
    side = 0.0
    out[0] = seed
    mark[seed] = stamp
    read, write = 0, 1
    kept = 0
    while read < write:
        t = out[read]
        read += 1
        good = True
        mx = my = mz = 0.0
        for k in range(3):
            v = triangles[t, k]
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            mx, my, mz = mx + x / 3.0, my + y / 3.0, mz + z / 3.0
            if _gap(kind, q, x, y, z)[0] > tolerance:
                good = False
                break
        if good and not needle[t]:
            _, nx, ny, nz = _gap(kind, q, mx, my, mz)
            along = nx * normals[t, 0] + ny * normals[t, 1] + nz * normals[t, 2]
            if side == 0.0:
                side = 1.0 if along > 0.0 else -1.0
            good = along * side >= cosine
        if not good:
            continue
        out[kept] = t  # kept < read: overwritten entries have been visited
        kept += 1
        for k in range(3):
            n = across[t, k]
            if n >= 0 and label[n] < 0 and mark[n] != stamp:
                mark[n] = stamp
                out[write] = n
                write += 1
    return kept


@kernel
def flat_facets(order, planes, vertices, triangles, normals, needle, across, tolerance, cosine, facet, work):
    """Group connected coplanar triangles, from seeds in `order`, into `facet` (m,), which begins as -1.

    planes: (m, 8) plane of each triangle, as of `packed`. work: (2, m) integers, row 0 -1. Returns the number of
    facets.
    """
    mark, out = work[0], work[1]
    count = 0
    for t in order:
        if facet[t] >= 0:
            continue
        n = reach(
            PLANE, planes[t], t, vertices, triangles, normals, needle, across, facet, tolerance, cosine, mark, t, out
        )
        for i in range(n):
            facet[out[i]] = count
        count += 1
    return count


@kernel(allocates=True)
def patches_at(seeds, around, rounds, free, corners, first, most, needed, mark, stamp):
    """Assemble the patches that are fitted at each seed facet: the kinds, and the facets and vertices of each.

    around, rounds: neighbours of facet f are `around[rounds[f]:rounds[f + 1]]`, longest border first; free: (facets,)
    corners, first: vertices of facet f are `corners[first[f]:first[f + 1]]`. most: facets of a patch, at most. needed:
    (4,) vertices that each kind needs at least. mark: (2, max(facets, vertices)) integers below `stamp`.

    Returns for each patch its seed's place and kind; then the vertices and their ends, the facets and their ends.
    """
    patches = 0
    size = len(seeds) * 16
    owner, kinds = np.empty(size, np.int64), np.empty(size, np.int64)
    ends, stops = np.zeros(size + 1, np.int64), np.zeros(size + 1, np.int64)
    vertices, facets = np.empty(64 * size, np.int64), np.empty(8 * size, np.int64)
    near, group = np.empty(most, np.int64), np.empty(2 * most + 4, np.int64)
    for place in range(len(seeds)):
        f = seeds[place]
        count = 0
        for i in range(rounds[f], rounds[f + 1]):
            if free[around[i]] and count < most - 1:
                near[count] = around[i]
                count += 1
        close = min(count, 4)
        pairs = close * (close - 1) // 2
        for number in range(close + pairs + 6):
            group[0] = f
            if number < close:
                kind, n = 0, 2
                group[1] = near[number]
            elif number < close + pairs:
                kind, n = 1, 3
                a, left = 0, number - close
                while left >= close - 1 - a:
                    left -= close - 1 - a
                    a += 1
                group[1], group[2] = near[a], near[a + 1 + left]
            else:
                which = number - close - pairs
                kind = 0 if which == 0 else 2 if which == 3 else 1 if which < 3 else 3
                wide = which == 0 or which == 2 or which == 5
                stamp += 1
                mark[0, f] = stamp
                n = 1
                for i in range(count):
                    group[n] = near[i]
                    mark[0, near[i]] = stamp
                    n += 1
                for i in range(count if wide else 0):
                    for j in range(rounds[near[i]], rounds[near[i] + 1]):
                        h = around[j]
                        if n >= most or j - rounds[near[i]] >= most:
                            break
                        if free[h] and mark[0, h] != stamp:
                            mark[0, h] = stamp
                            group[n] = h
                            n += 1
            stamp += 1
            points = ends[patches]
            for i in range(n):
                for j in range(first[group[i]], first[group[i] + 1]):
                    v = corners[j]
                    if mark[1, v] != stamp:
                        mark[1, v] = stamp
                        if points == len(vertices):
                            vertices = np.concatenate((vertices, vertices))
                        vertices[points] = v
                        points += 1
            if points - ends[patches] <= needed[kind]:
                continue
            if stops[patches] + n > len(facets):
                facets = np.concatenate((facets, facets))
            for i in range(n):
                facets[stops[patches] + i] = group[i]
            owner[patches], kinds[patches] = place, kind
            patches += 1
            ends[patches], stops[patches] = points, stops[patches - 1] + n
    done = ends[patches], stops[patches]
    parts = (
        vertices[: done[0]].copy(),
        ends[: patches + 1].copy(),
        facets[: done[1]].copy(),
        stops[: patches + 1].copy(),
    )
    return owner[:patches].copy(), kinds[:patches].copy(), parts, stamp
