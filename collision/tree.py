"""The packed hierarchy of a mesh: one binary tree of boxes whose subtrees are the surfaces.

Object-median splits along the longest axis of the centres, leaves of `LEAF` triangles, nodes in preorder, so that a
tree needs no pointers but one a node and its size is known before it is built (Ericson, *Real-Time Collision
Detection*, 2005, 6.2 and 6.6.2). Built at first need and kept on the mesh: `tree_of(mesh)`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.mesh import SurfaceMesh

LEAF = 8
"""Greatest number of triangles in a leaf; every leaf of a surface but the last is full. (With 4, distances take a fifth
less time, and a triangle 17 bytes more.)"""
THREADS = 2
"""Threads that build trees; the tree does not depend on it."""


@dataclass(frozen=True, slots=True)
class MeshTree:
    """Boxes over the n nodes, m triangles and k surfaces of one mesh; all arrays flat, C-contiguous and read-only.

    Node 0 holds the whole mesh. Nodes above the surface roots group whole surfaces; the node `root[s]` and all below it
    hold triangles of surface s only. Preorder: the first child of an inner node i is i + 1, its second is `second[i]`;
    a leaf has `second[i] == -1`. The subtree of i is the nodes i … `past[i]` - 1: to skip it, go on at past[i].
    """

    box: NDArray[np.float64]
    """(n, 6) least x, y, z and greatest x, y, z of the node's triangles, in the mesh's frame, m; exact (no rounding)"""
    second: NDArray[np.int32]
    """(n,) second child, -1 at a leaf"""
    past: NDArray[np.int32]
    """(n,) one past the last node of the subtree"""
    first: NDArray[np.int32]
    """(n,) the node's triangles are `order[first[i]:first[i] + count[i]]` (inner nodes too)"""
    count: NDArray[np.int32]
    """(n,) number of triangles in the node"""
    surface: NDArray[np.int32]
    """(n,) the surface all its triangles belong to, -1 above the surface roots"""
    root: NDArray[np.int32]
    """(k,) node of each surface"""
    order: NDArray[np.int32]
    """(m,) triangle indices of the mesh in leaf order"""
    corner: NDArray[np.int32]
    """(m, 3) vertex indices of those triangles, `mesh.triangles[order]`: one look-up less in a leaf"""

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays."""
        return sum(getattr(self, name).nbytes for name in self.__slots__)


def bounds_of(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """(7,) the box of the mesh's triangles and the radius of the sphere about its centre that holds them, kept on the
    mesh; takes no tree."""
    bounds: NDArray[np.float64] | None = mesh._cache.get("bounds")
    if bounds is None:
        used = mesh.vertices[np.unique(mesh.triangles)]
        low, high = used.min(axis=0), used.max(axis=0)
        radius = np.linalg.norm(used - (0.5 * low + 0.5 * high), axis=1).max()
        bounds = mesh._cache["bounds"] = np.array([*low, *high, radius])
    return bounds


def tree_of(mesh: SurfaceMesh) -> MeshTree:
    """The mesh's hierarchy, built at the first call and kept in `mesh._cache["tree"]`."""
    tree = mesh._cache.get("tree")
    if tree is None:
        build_trees([mesh])
        tree = mesh._cache["tree"]
    return tree


def build_trees(meshes: Iterable[SurfaceMesh]) -> None:
    """Build what is missing of the meshes' hierarchies, on `THREADS` threads: meshes, or the surfaces of a mesh."""
    missing = list({id(mesh): mesh for mesh in meshes if "tree" not in mesh._cache}.values())
    if len(missing) == 1:
        _build(missing[0], THREADS if missing[0].n_triangles > 4096 else 1)
    else:
        share_out(_build, missing)


def share_out(build: Callable[[SurfaceMesh], Any], meshes: list[SurfaceMesh]) -> None:
    """Call `build` for each mesh, every thread for its share: to hand them over one by one takes what threads gain."""
    largest_first = sorted(meshes, key=lambda mesh: -mesh.n_triangles)
    if len(meshes) == 1:
        build(meshes[0])
    elif meshes:
        with ThreadPoolExecutor(THREADS) as pool:
            shares = (largest_first[t::THREADS] for t in range(THREADS))
            list(pool.map(lambda share: [build(mesh) for mesh in share], shares))


def _build(mesh: SurfaceMesh, threads: int = 1) -> None:
    from collision.kernels_tree import build_surface, close_top, plan_top

    k, m = mesh.n_surfaces, mesh.n_triangles
    leaves = -(-np.diff(mesh.surface_start) // LEAF)
    n = int((2 * leaves - 1).sum()) + k - 1
    box = np.empty((n, 6))
    second, past, first, count, surface = (np.full(n, -1, np.int32) for _ in range(5))
    root = np.empty(k, np.int32)
    begin = np.empty(k, np.int32)
    order = np.empty(m, np.int32)
    corner = np.empty((m, 3), np.int32)
    plan_top(
        mesh.vertices, mesh.triangles, mesh.order, mesh.surface_start, LEAF,
        second, past, first, count, root, begin,
    )  # fmt: skip
    arguments = (
        mesh.vertices, mesh.triangles, mesh.order, mesh.surface_start, LEAF,
        box, second, past, first, count, surface, root, begin, order, corner,
    )  # fmt: skip
    if threads == 1:
        build_surface(*arguments, 0, k)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda share: build_surface(*arguments, *share), _shares(mesh.surface_start, threads)))
    close_top(box, second, surface)
    arrays = (box, second, past, first, count, surface, root, order, corner)
    for array in arrays:
        array.setflags(write=False)
    mesh._cache["tree"] = MeshTree(*arrays)


def _shares(surface_start: NDArray[np.int32], parts: int) -> list[tuple[int, int]]:
    """Consecutive ranges of surfaces of about equal triangle counts."""
    total = int(surface_start[-1])
    cuts = np.searchsorted(surface_start, [total * i // parts for i in range(1, parts)])
    ends = [0, *(int(c) for c in cuts), len(surface_start) - 1]
    return [(a, b) for a, b in pairwise(ends) if b > a]
