"""Memory layout of a bounding volume hierarchy: nodes of eight boxes, packets of eight triangles, no pointers.

A box is named by its lane: lane = 8·node + (0 … 7). Node 0 has one box, that of the mesh, in lane 0. Below it come the
nodes over the surfaces, eight children each, and below every surface's lane the nodes over its triangles, so that each
subtree holds one surface. `child[lane]` is the node of the eight boxes below a box, or ~p for the packet p of up to
eight triangles; triangles are numbered in leaf order, packet p has those from `first[p]` to `first[p + 1]` - 1.

Coordinates of boxes are relative to the centre of the mesh's box and rounded outwards; those of a packet's triangles
are relative to the centre of their box in float32, so that float32 resolves them to 1e-7 of the packet's size.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from collision.numeric.simd import LANES, NODE, PACKET, PREPARED

__all__ = ["LANES", "LARGEST", "NODE", "PACKET", "PREPARED", "Bvh", "nbytes"]

LARGEST: Final = 1e30
"""m: coordinates beyond which boxes do not fit float32"""


class Bvh(NamedTuple):
    """N nodes over P packets of m triangles in k surfaces, as flat read-only arrays (Any: numba's types have no
    names)."""

    boxes: Any
    """(48 N,) float32, m about the centre: rows of least x, y, z and greatest x, y, z; an empty lane is (inf, -inf)"""
    child: Any
    """(8 N,) int32, by lane: the node below, or ~packet"""
    size: Any
    """(8 N,) float32, by lane: sum of the edges of the box, m; the larger of two boxes is opened first"""
    surface: Any
    """(8 N,) int32, by lane: the surface of all triangles below, -1 above the surfaces"""
    root: Any
    """(k,) int32: the lane of each surface"""
    packets: Any
    """(72 P,) float32, m about the centre of the packet's box: rows of x, y, z of p, q, r; an empty lane is all inf"""
    first: Any
    """(P + 1,) int32: the packets' first triangles"""
    order: Any
    """(m,) int32: the mesh's triangles in leaf order"""
    corner: Any
    """(3 m,) int32: their vertices"""
    vertices: Any
    """(3 n,) float64, m: the mesh's own"""
    frame: Any
    """(7,) float64, m: centre of the mesh's box, half its edges, greatest magnitude of a coordinate"""


def nbytes(bvh: Bvh) -> int:
    """Return the size of a hierarchy in bytes, without the vertices, which it shares with its mesh."""
    return sum(array.nbytes for name, array in zip(bvh._fields, bvh, strict=True) if name != "vertices")
