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
