"""`SurfaceMesh`: triangles packed by the surface (B-rep face) they belong to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.errors import MeshError


class SurfaceMesh:
    """Immutable triangle mesh whose triangles are grouped into surfaces.

    Parameters
    ----------
    vertices: (n, 3) finite float64, metres.
    triangles: (m, 3) int, indices into `vertices`; wound so that normals point out of the material.
    surface_of_triangle: (m,) int, the surface of each triangle; numbers 0 … k-1, none left empty.
    name: the mesh's name in errors.

    Raises
    ------
    MeshError: naming the mesh and the first offending row: NaN or infinite coordinates, an index out of
        range, no triangles, a surface without triangles, arrays of the wrong shape.
    """

    __slots__ = ("_cache", "name", "order", "surface_of_triangle", "surface_start", "triangles", "vertices")

    def __init__(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        surface_of_triangle: ArrayLike | None = None,
        name: str = "mesh",
    ) -> None:
        v = _array(vertices, np.float64, 2, "vertices", name)
        t = _array(triangles, np.int32, 2, "triangles", name)
        if surface_of_triangle is None:
            surface_of_triangle = np.zeros(len(t), np.int32)
        s = _array(surface_of_triangle, np.int32, 1, "surface_of_triangle", name)
        _check(v, t, s, name)
        order = np.argsort(s, kind="stable").astype(np.int32)
        counts = np.bincount(s)
        for array in (v, t, s, order):
            array.setflags(write=False)
        self.name = name
        self.vertices: NDArray[np.float64] = v
        self.triangles: NDArray[np.int32] = t
        self.surface_of_triangle: NDArray[np.int32] = s
        self.order: NDArray[np.int32] = order
        """(m,) triangle indices, those of surface 0 first, then of surface 1, …"""
        self.surface_start: NDArray[np.int32] = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        """(k+1,) triangles of surface s are `order[surface_start[s]:surface_start[s+1]]`"""
        self.surface_start.setflags(write=False)
        self._cache: dict[str, Any] = {}

    @property
    def n_surfaces(self) -> int:
        """Number of surfaces."""
        return len(self.surface_start) - 1

    @property
    def n_triangles(self) -> int:
        """Number of triangles."""
        return len(self.triangles)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) least and greatest coordinates of the triangles, m. Read only."""
        bounds: NDArray[np.float64] | None = self._cache.get("corners")
        if bounds is None:
            used = self.vertices[np.unique(self.triangles)]
            bounds = self._cache["corners"] = np.array([used.min(axis=0), used.max(axis=0)])
        return bounds

    def triangles_of(self, surface: int) -> NDArray[np.int32]:
        """Return (j,) indices of the triangles of one surface, ascending."""
        return self.order[self.surface_start[surface] : self.surface_start[surface + 1]]

    def __reduce__(self) -> tuple[Any, ...]:
        # without the cache: a copy, or another process, derives its own
        return SurfaceMesh, (self.vertices, self.triangles, self.surface_of_triangle, self.name)

    def __repr__(self) -> str:
        return f"SurfaceMesh({self.name!r}, surfaces={self.n_surfaces}, triangles={self.n_triangles})"


def welded(vertices: NDArray[np.float64], grid: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the distinct ones (k, 3) of vertices (n, 3), in m, and the index (n,) of each vertex among them.

    grid: m; vertices that round to the same point of this grid are one. 0: only equal ones are.
    """
    at = vertices if grid == 0.0 else np.round((vertices - vertices[0]) / grid)
    _, first, index = np.unique(at, axis=0, return_index=True, return_inverse=True)
    return vertices[first], index.reshape(-1)


def _array(value: ArrayLike, dtype: type, ndim: int, what: str, name: str) -> NDArray[Any]:
    try:
        given = np.asarray(value)
        array: NDArray[Any] = np.array(given, dtype=dtype, order="C", copy=True)
    except (TypeError, ValueError, OverflowError) as error:
        raise MeshError(f"{name}: {what} cannot be read as {np.dtype(dtype).name}: {error}", name) from None
    if given.size and np.issubdtype(dtype, np.integer) and not np.array_equal(array, given):
        raise MeshError(f"{name}: {what} must be whole numbers that fit {np.dtype(dtype).name}", name)
    shape = "(n, 3)" if ndim == 2 else "(n,)"
    if array.ndim != ndim or (ndim == 2 and array.shape[1] != 3):
        raise MeshError(f"{name}: {what} has shape {given.shape}, needed is {shape}", name)
    return array


def _check(v: NDArray[Any], t: NDArray[Any], s: NDArray[Any], name: str) -> None:
    if len(t) == 0:
        raise MeshError(f"{name}: no triangles; give at least one", name)
    if len(s) != len(t):
        raise MeshError(f"{name}: {len(s)} surface numbers for {len(t)} triangles; give one a triangle", name)
    bad = np.flatnonzero(~np.isfinite(v).all(axis=1))
    if len(bad):
        i = int(bad[0])
        raise MeshError(f"{name}: vertex {i} is {v[i].tolist()}; coordinates must be finite", name, i)
    bad = np.flatnonzero(((t < 0) | (t >= len(v))).any(axis=1))
    if len(bad):
        i = int(bad[0])
        raise MeshError(f"{name}: triangle {i} is {t[i].tolist()}, but vertices are 0 … {len(v) - 1}", name, i)
    bad = np.flatnonzero(s < 0)
    if len(bad):
        i = int(bad[0])
        raise MeshError(f"{name}: triangle {i} has surface {int(s[i])}; surfaces count from 0", name, i)
    if int(s.max()) >= len(t):
        raise MeshError(f"{name}: surface {int(s.max())} with {len(t)} triangles; numbers must be 0 … k-1", name)
    empty = np.flatnonzero(np.bincount(s) == 0)
    if len(empty):
        i = int(empty[0])
        raise MeshError(f"{name}: surface {i} has no triangles; number the surfaces 0 … k-1 without gaps", name, i)
