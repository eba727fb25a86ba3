"""Triangle meshes as polyhedra: area, volume, boundary. Imports numpy only, because the reading process uses it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]


def triangle_area_vectors(vertices: Array, triangles: NDArray[np.int32]) -> Array:
    """(m, 3) half cross products: direction of the outward normal, length equal to the area, m²."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def without_flat(vertices: Array, triangles: Triangles, owners: Triangles) -> tuple[Triangles, Triangles]:
    """Return the triangles of positive area and their owners.

    A flat triangle with three distinct corners fills the gap between its longest edge and its middle corner. Without
    it, the neighbour at that edge is split at the corner, so that a closed mesh stays closed.
    """
    flat = np.linalg.norm(triangle_area_vectors(vertices, triangles), axis=1) == 0.0
    thin = np.flatnonzero(flat & (triangles != np.roll(triangles, 1, axis=1)).all(axis=1))
    if not len(thin):
        return triangles[~flat], owners[~flat]
    near = np.flatnonzero(
        np.isin(triangles, triangles[thin]).any(axis=1) & (~flat | np.isin(np.arange(len(flat)), thin))
    )
    local = {i: (tuple(triangles[i].tolist()), int(owners[i])) for i in near.tolist()}
    beside: dict[tuple[int, int], list[int]] = {}
    for i, (corners, _) in local.items():
        for edge in _edges(corners):
            beside.setdefault(edge, []).append(i)
    last, waiting = len(triangles), dict.fromkeys(thin.tolist())  # in order
    for _ in range(8 * len(waiting)):  # splitting a flat neighbour gives flat halves; it ends, except for rounding
        if not waiting:
            break
        at = next(iter(waiting))
        del waiting[at]
        corners, _ = local.pop(at)
        a, c, b = max(
            (corners, corners[1:] + corners[:1], corners[2:] + corners[:2]),
            key=lambda t: float(np.linalg.norm(vertices[t[0]] - vertices[t[1]])),
        )
        neighbour = next((i for i in beside.get((c, a), ()) if i in local), None)
        if neighbour is None:
            continue
        d = next(v for v in local[neighbour][0] if v not in (a, c))
        owner = local.pop(neighbour)[1]
        was_flat = neighbour in waiting
        if was_flat:
            del waiting[neighbour]
        for half in ((c, b, d), (b, a, d)):
            if b != d:
                local[last] = half, owner
                for edge in _edges(half):
                    beside.setdefault(edge, []).append(last)
                if was_flat:
                    waiting[last] = None
                last += 1
    for i in waiting:
        del local[i]
    kept = ~flat
    kept[near] = False
    mended = np.array([corners for corners, _ in local.values()], np.int32).reshape(-1, 3)
    owned = np.array([owner for _, owner in local.values()], np.int32)
    return np.concatenate([triangles[kept], mended]), np.concatenate([owners[kept], owned])


def _edges(corners: tuple[int, ...]) -> list[tuple[int, int]]:
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def open_edges(triangles: Triangles) -> NDArray[np.int64]:
    """(k, 2) directed edges (vertex indices) without an opposite edge: the boundary, sorted.

    An edge used twice in one direction and once in the other counts once. A mesh without open edges bounds a volume.
    """
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2).astype(np.int64)
    ends = ends[ends[:, 0] != ends[:, 1]]
    n = int(triangles.max(initial=0)) + 1
    key, which = np.unique(ends.min(axis=1) * n + ends.max(axis=1), return_inverse=True)
    excess = np.bincount(which.reshape(-1), np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0), len(key))
    pairs = np.column_stack([key // n, key % n])
    return np.concatenate([pairs[excess > 0], pairs[excess < 0][:, ::-1]])


def signed_volume(vertices: Array, triangles: NDArray[np.int32]) -> float:
    """Volume enclosed by triangles (m, 3), m³; negative if they are wound inwards, 0 without triangles.

    An open mesh is closed towards the middle of its border, which is exact for a flat hole.
    """
    if not len(triangles):
        return 0.0
    a, b, c = (vertices[triangles[:, k]] - vertices[triangles[0, 0]] for k in range(3))
    vectors = np.cross(b - a, c - a)
    volume = float(np.einsum("ij,ij->", a, vectors)) / 6.0
    open_area = vectors.sum(axis=0)  # zero for a closed mesh, whose volume depends on no origin
    if np.abs(open_area).max() > 1e-9 * np.abs(vectors).sum():
        volume -= float((_inner(vertices, triangles) - vertices[triangles[0, 0]]) @ open_area) / 6.0
    return volume


def _inner(vertices: Array, triangles: NDArray[np.int32]) -> Array:
    """Middle of the border of an open mesh; the first vertex of a closed one."""
    border = open_edges(triangles)
    middle: Array = vertices[border].mean(axis=(0, 1)) if len(border) else vertices[triangles[0, 0]]
    return middle


def mass_properties(vertices: Array, triangles: NDArray[np.int32]) -> tuple[float, Array, Array]:
    """Volume (m³), centre (3,) and inertia (3, 3) about it at density 1, of vertices (n, 3) and triangles (m, 3).

    An open mesh is closed towards the middle of its border, which is exact for a flat hole.
    """
    from physics.model.body import polyhedron  # imports numba, which the reading process rarely needs

    return polyhedron(vertices[triangles], _inner(vertices, triangles))
