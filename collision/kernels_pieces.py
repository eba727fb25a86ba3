"""Numba kernels: the pieces of a search for the deepest point, and a heap of those that are not yet opened."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from collision.predicates import KERNEL


class Pieces(NamedTuple):
    """Room for the pieces of a search, and the heap of those that are not yet opened, greatest bound first."""

    bound: Any
    """(n,) no point is deeper"""
    node: Any
    """(n,) the node of the tree, -1 for a triangle"""
    corner: Any
    """(n, 9) of a triangle"""
    depth: Any
    """(n, 3) of its corners"""
    nearest: Any
    """(n, 3) triangle of the solid nearest to each of its corners; the first, to the middle of a node"""
    heap: Any
    """(n,) places"""
    size: Any
    """(2,) length of the heap, places used"""


def room_for(pieces: int) -> Pieces:
    """Room for so many pieces."""
    return Pieces(
        np.empty(pieces), np.empty(pieces, np.int64), np.empty((pieces, 9)), np.empty((pieces, 3)),
        np.empty((pieces, 3), np.int64), np.empty(pieces, np.int64), np.zeros(2, np.int64),
    )  # fmt: skip


@njit(error_model="numpy", **KERNEL)
def new_place(pieces, bound):
    """A place for a piece."""
    place = pieces.size[1]
    pieces.size[1] += 1
    pieces.bound[place] = bound
    return place


@njit(error_model="numpy", **KERNEL)
def push(pieces, place):
    """Put a piece in the heap, by its bound."""
    key, heap = pieces.bound, pieces.heap
    i = pieces.size[0]
    pieces.size[0] += 1
    while i > 0:
        up = (i - 1) // 2
        if key[heap[up]] >= key[place]:
            break
        heap[i] = heap[up]
        i = up
    heap[i] = place


@njit(error_model="numpy", **KERNEL)
def pop(pieces):
    """The place of the piece of greatest bound, which is taken out of the heap."""
    key, heap = pieces.bound, pieces.heap
    pieces.size[0] -= 1
    n = pieces.size[0]
    top, last = heap[0], heap[n]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= n:
            break
        if child + 1 < n and key[heap[child + 1]] > key[heap[child]]:
            child += 1
        if key[heap[child]] <= key[last]:
            break
        heap[i] = heap[child]
        i = child
    heap[i] = last
    return top
