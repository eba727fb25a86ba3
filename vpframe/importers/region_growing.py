"""Kernels of segmentation: neighbours of triangles, and growth of an analytic surface over them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from constraints.recognition.patches import CONE, CYLINDER, SPHERE, refine_at

PLANE = -1
_ITERATIONS = 10


class Mesh(NamedTuple):
    """A triangulation that is segmented."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    normals: NDArray[np.float64]
    """(m, 3)"""
    needle: NDArray[np.bool_]
    """(m,) triangles whose normal is ignored"""
    across: NDArray[np.int32]
    """(m, 3) triangles across the edges (`neighbours`)"""
    label: NDArray[np.int64]
    """(m,) segment of each triangle; -1 for free ones"""
    tolerance: float
    """m from the surface to a vertex, at most"""
    cosine: float
    """least cosine between the normals of a triangle and the surface"""


class Scratch(NamedTuple):
    """Arrays of growth. Marks hold the number `stamp[0]` where something was visited, so that they need no clearing."""

    stamp: NDArray[np.int64]
    """(1,)"""
    mark: NDArray[np.int64]
    """(3, max(m, n)) of facets, vertices and triangles"""
    out: NDArray[np.int64]
    """(m,) triangles"""
    more: NDArray[np.int64]
    """(m,) triangles"""
    corners: NDArray[np.int64]
    """(n,) vertices"""
    q: NDArray[np.float64]
    """(8,)"""


def scratch(triangles: int, vertices: int) -> Scratch:
    """Return the arrays for a mesh."""
    out, more = np.empty((2, triangles), np.int64)
    mark = np.full((3, max(triangles, vertices)), -1, np.int64)
    return Scratch(np.zeros(1, np.int64), mark, out, more, np.empty(vertices, np.int64), np.zeros(8))


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
def _reach(kind, q, seed, mesh, label, mark, stamp, out):
    """Find the triangles with a label of -1 that are connected to `seed`, whose corners lie on the surface, and whose
    normals agree with it; writes them to `out` and returns their number."""
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
            v = mesh.triangles[t, k]
            x, y, z = mesh.vertices[v, 0], mesh.vertices[v, 1], mesh.vertices[v, 2]
            mx, my, mz = mx + x / 3.0, my + y / 3.0, mz + z / 3.0
            if _gap(kind, q, x, y, z)[0] > mesh.tolerance:
                good = False
                break
        if good and not mesh.needle[t]:
            _, nx, ny, nz = _gap(kind, q, mx, my, mz)
            along = nx * mesh.normals[t, 0] + ny * mesh.normals[t, 1] + nz * mesh.normals[t, 2]
            if side == 0.0:
                side = 1.0 if along > 0.0 else -1.0
            good = along * side >= mesh.cosine
        if not good:
            continue
        out[kept] = t  # kept < read: overwritten entries have been visited
        kept += 1
        for k in range(3):
            n = mesh.across[t, k]
            if n >= 0 and label[n] < 0 and mark[n] != stamp:
                mark[n] = stamp
                out[write] = n
                write += 1
    return kept


@inner_kernel
def _grow(kind, numbers, seed, mesh, scratch, out):
    for d in range(8):
        scratch.q[d] = numbers[d]
    if kind == CONE:
        scratch.q[6], scratch.q[7] = np.cos(numbers[6]), np.sin(numbers[6])
    scratch.stamp[0] += 1
    return _reach(kind, scratch.q, seed, mesh, mesh.label, scratch.mark[2], scratch.stamp[0], out)


@inner_kernel
def _corners_of(count, mesh, scratch):
    """Write the vertices of the first triangles in `out` to `corners`; returns their number."""
    scratch.stamp[0] += 1
    n = 0
    for i in range(count):
        for k in range(3):
            v = mesh.triangles[scratch.out[i], k]
            if scratch.mark[1, v] != scratch.stamp[0]:
                scratch.mark[1, v] = scratch.stamp[0]
                scratch.corners[n] = v
                n += 1
    return n


@kernel
def settle(kind, numbers, patch, seed, mesh, facet, scratch, work):
    """Alternate growth of a surface from a triangle `seed` and its fit, while it grows beyond `patch` triangles.

    kind, numbers: as in `constraints.recognition.patches`; the fitted numbers are written back. Returns the numbers of
    triangles (written to `scratch.out`), of their vertices, and of their facets.
    """
    count = _grow(kind, numbers, seed, mesh, scratch, scratch.out)
    while count > patch:
        n = _corners_of(count, mesh, scratch)
        for d in range(8):
            work.best[d] = numbers[d]
        if n < 3 or not refine_at(kind, mesh.vertices, scratch.corners, n, _ITERATIONS, work):
            break
        more = _grow(kind, work.best, seed, mesh, scratch, scratch.more)
        if more < count:
            break
        for d in range(8):
            numbers[d] = work.best[d]
        for i in range(more):
            scratch.out[i] = scratch.more[i]
        patch, count = count, more
    scratch.stamp[0] += 1
    facets = 0
    for i in range(count):
        f = facet[scratch.out[i]]
        if scratch.mark[0, f] != scratch.stamp[0]:
            scratch.mark[0, f] = scratch.stamp[0]
            facets += 1
    return count, _corners_of(count, mesh, scratch), facets


@kernel
def flat_facets(order, planes, mesh, cosine, facet, work):
    """Group connected coplanar triangles, from seeds in `order`, into `facet` (m,), which begins as -1.

    planes: (m, 8) plane of each triangle: point, normal, two zeros. cosine: replaces that of `mesh`. work: (2, m)
    integers, row 0 -1. Returns the number of facets.
    """
    mark, out = work[0], work[1]
    flat = Mesh(
        mesh.vertices, mesh.triangles, mesh.normals, mesh.needle, mesh.across, mesh.label, mesh.tolerance, cosine
    )
    count = 0
    for t in order:
        if facet[t] >= 0:
            continue
        n = _reach(PLANE, planes[t], t, flat, facet, mark, t, out)
        for i in range(n):
            facet[out[i]] = count
        count += 1
    return count


@kernel(allocates=True)
def patches_at(seeds, around, rounds, free, corners, first, most, needed, scratch):
    """Assemble the patches that are fitted at each seed facet: the kinds, and the facets and vertices of each.

    around, rounds: neighbours of facet f are `around[rounds[f]:rounds[f + 1]]`, longest border first; free: (facets,)
    corners, first: vertices of facet f are `corners[first[f]:first[f + 1]]`. most: facets of a patch, at most. needed:
    (4,) vertices that each kind needs at least.

    Returns for each patch its seed's place and kind; then the vertices and their ends, the facets and their ends.
    """
    patches, mark, stamp = 0, scratch.mark, scratch.stamp[0]
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
    scratch.stamp[0] = stamp
    return owner[:patches].copy(), kinds[:patches].copy(), parts
