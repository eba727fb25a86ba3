"""The tree as the fast query reads it: nodes of eight, float32, no pointers at all.

Triangles in leaf order of the `MeshTree`, whose splits keep blocks of 8, 64, 512 … together. Within a surface of m
triangles level 1 has ceil(m / 8) leaves, each with eight consecutive triangles; level 2 has ceil(m / 64) nodes with the
boxes of eight consecutive leaves; and so on up to one node, the surface's top. The same over the surfaces, in the order
in which the tree has them: level 1 has nodes with the boxes of eight surfaces, up to one node for the mesh.

Boxes are about the mesh's centre and rounded outwards; triangles are about the centre of their leaf's box, so that
float32 resolves them to 1e-7 of the leaf's size, wherever it lies.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from collision.errors import MeshError
from collision.mesh import SurfaceMesh
from collision.shape import triangles_needed
from collision.tree import build_trees, share_out, tree_of

LANES: Final = 8
"""boxes or triangles a node"""
BOXES: Final = 6 * LANES
"""float32 an inner node takes: rows of the least x, y, z and of the greatest; an empty lane is (inf, -inf)"""
TRIANGLES: Final = 9 * LANES
"""float32 a leaf takes: rows of x, y, z of the corners p, q, r; an empty lane is all inf"""
LARGEST: Final = 1e30
"""m: the boxes are float32"""
INFO: Final = 16
"""numbers a surface in `WideTree.info`: see there"""
NUMBER, FIRST, COUNT, TOP, STARTS = range(5)
"""their places; the level l begins at `STARTS + l - 1`"""
NODES, ROWS, CORNERS, VERTICES, FRAME, SURFACES = range(6)
"""places in `WideTree.table`"""


@dataclass(frozen=True, slots=True)
class WideTree:
    """What the fast query needs of a mesh; all arrays flat and C-contiguous."""

    nodes: NDArray[np.float32]
    """nodes of `collision.lanes`: the levels over the surfaces, then the leaves and levels of each surface"""
    info: NDArray[np.int64]
    """(16 (k + 1),) for each surface in the tree's order: its number, its first triangle in leaf order, its number of
    triangles, its top level, and where in `nodes` its levels 1, 2, … begin, after the top one the place of its box (an
    entry each, up to 11 levels); at last such a row for the levels over the surfaces"""
    corner: NDArray[np.int32]
    """(3 m,) vertices of the triangles in leaf order"""
    vertices: NDArray[np.float64]
    """(3 n,) the mesh's vertices"""
    frame: NDArray[np.float64]
    """(7,) centre of the mesh's box, half its size, greatest magnitude of a coordinate"""

    table: NDArray[np.int64]
    """(6,) their addresses, in this order, and the number of surfaces: what the kernels are given"""
    address: int
    """that of the table"""
    n_surfaces: int

    @property
    def nbytes(self) -> int:
        """Bytes beyond those of the mesh and of its `MeshTree`."""
        return self.nodes.nbytes + self.info.nbytes + self.frame.nbytes


def wide_tree_of(mesh: SurfaceMesh) -> WideTree:
    """The mesh's wide tree, built at the first call and kept in `mesh._cache["wide"]`."""
    wide = mesh._cache.get("wide")
    return wide if wide is not None else _build(mesh)


def build_wide_trees(meshes: Iterable[SurfaceMesh]) -> None:
    """Build what is missing of the meshes' wide trees, and of the trees they rest on, on `tree.THREADS` threads."""
    missing = list({id(mesh): mesh for mesh in meshes if "wide" not in mesh._cache}.values())
    build_trees(missing)
    share_out(_build, missing)


def _build(mesh: SurfaceMesh) -> WideTree:
    from collision.kernels_tree import widen

    triangles_needed(mesh)
    largest = max(float(mesh.vertices.max()), -float(mesh.vertices.min()))
    if largest > LARGEST:
        raise MeshError(f"{mesh.name}: a coordinate is {largest:g}; the largest allowed is {LARGEST:g}", mesh.name)
    tree = tree_of(mesh)
    leaves = -(-np.diff(mesh.surface_start) // LANES)
    over = max(1, nodes_over(len(leaves))) + nodes_over(leaves)
    size = TRIANGLES * int(leaves.sum()) + BOXES * over
    nodes = np.empty(size, np.float32)
    info = np.empty(INFO * (len(leaves) + 1), np.int64)
    box = tree.box[0]
    frame = np.array([*(0.5 * (box[:3] + box[3:])), *(0.5 * (box[3:] - box[:3])), largest])
    widen(
        mesh.vertices, tree.corner, tree.box, tree.second, tree.first, tree.count, tree.root, np.argsort(tree.root),
        frame, nodes, info,
    )  # fmt: skip
    arrays = (nodes, info, tree.corner.ravel(), mesh.vertices.ravel(), frame)
    for array in arrays:
        array.setflags(write=False)
    table = np.array([*(array.ctypes.data for array in arrays), len(leaves)], np.int64)
    wide = WideTree(*arrays, table, table.ctypes.data, len(leaves))
    mesh._cache["wide"] = wide
    return wide


def nodes_over(boxes: int | NDArray[np.int32]) -> int:
    """Nodes of all levels over so many boxes, up to one node (a box alone needs none); of several trees, together."""
    total = 0
    boxes = np.atleast_1d(boxes)
    while len(boxes := boxes[boxes > 1]):
        boxes = -(-boxes // LANES)
        total += int(boxes.sum())
    return total
