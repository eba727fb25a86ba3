"""Null space of the Jacobian of a system: the instantaneous motions that its equations allow at a pose.

A small system is factorised directly. A large one is parametrised by a spanning tree of pairs of bodies: each pair of
the tree allows a few motions (one, for a hinge), the twist of a body is the sum of the motions between it and the
ground, and only the pairs that close loops are factorised, with one column for each motion of the tree. A net of 65
hinged bars has 390 columns directly and 65 through the tree.
"""

from __future__ import annotations

import heapq

import numpy as np

from collision import Tolerance
from constraints.solve.ranks import null_basis, pivoted_qr
from constraints.solve.system import Array, Ints, System

DENSE = 12
"""greatest number of bodies of a system that is factorised directly"""


def rank_threshold(system: System, worst: float, tolerance: Tolerance) -> float:
    """Return the threshold, relative to the largest pivot, below which pivots count as zero.

    It is `tolerance.rank`, or the uncertainty of directions if the constraints are inconsistent (by `worst`, m), up to
    `tolerance.angular`.
    """
    return max(tolerance.rank, min(8.0 * worst / system.length, tolerance.angular))


def null_space(system: System, rotation: Array, translation: Array, tolerance: Tolerance) -> tuple[Array, float, float]:
    """Return the orthonormal scaled null space (movable, 6, k), the threshold used, and the least pivot kept."""
    bodies = len(system.movable)
    if bodies > DENSE:
        return through_tree(system, rotation, translation, tolerance)
    r, jacobian = system.dense(rotation, translation)
    threshold = rank_threshold(system, float(np.abs(r).max()), tolerance)
    order, upper, rank, margin = pivoted_qr(np.ascontiguousarray(jacobian.T), threshold)
    null = np.linalg.qr(null_basis(order, upper, rank).T)[0]
    return null.reshape(bodies, 6, -1), threshold, float(margin)


def through_tree(
    system: System, rotation: Array, translation: Array, tolerance: Tolerance
) -> tuple[Array, float, float]:
    """Return `null_space`, computed from the motions of the pairs of a spanning tree."""
    r, ja, jb = system.evaluate(rotation, translation)
    threshold = rank_threshold(system, float(np.abs(r * system.weight).max()), tolerance)
    equation = np.repeat(np.arange(len(system.code)), np.diff(np.append(system.start, system.rows)))
    pair = system.body[equation]
    sides = []
    for side, jacobian in ((0, ja), (1, jb)):
        scaled = jacobian * system.weight[:, None]
        scaled[:, 3:] /= system.extent[pair[:, side]][:, None]
        sides.append(scaled)
    rows_of = _rows_of_pairs(system, pair)
    tree = _spanning_tree(rows_of)
    largest, margin = 0.0, 1.0
    motions: list[Array] = []
    for parent, child in tree:  # motions of the child that each pair allows
        rows = rows_of[min(parent, child), max(parent, child)]
        jacobian = np.where((pair[rows, 0] == child)[:, None], sides[0][rows], sides[1][rows])
        order, upper, rank, least = pivoted_qr(np.ascontiguousarray(jacobian.T), threshold)
        motions.append(np.linalg.qr(null_basis(order, upper, rank).T)[0])
        largest, margin = max(largest, abs(float(upper[0, 0]))), min(margin, float(least))
    root = tree[0][0]
    first = np.cumsum([0 if root < 0 else 6, *(m.shape[1] for m in motions)])
    twist = np.zeros((len(system.bodies), 6, first[-1]))  # scaled twist of each body for unit motions of the tree
    if root >= 0:
        twist[root, :, :6] = np.eye(6)
    for k, (parent, child) in enumerate(tree):
        if parent >= 0:
            twist[child] = _carried(system, rotation, translation, parent, child) @ twist[parent]
        twist[child, :, first[k] : first[k + 1]] += motions[k]
    closing = np.ones(system.rows, bool)
    for parent, child in tree:
        closing[rows_of[min(parent, child), max(parent, child)]] = False
    a, b = pair[closing].T
    loops = np.einsum("ri,rij->rj", sides[0][closing], twist[a]) + np.einsum("ri,rij->rj", sides[1][closing], twist[b])
    free = np.eye(first[-1])
    steepest = float(np.linalg.norm(loops, axis=0).max(initial=0.0))
    if steepest > threshold * largest:
        order, upper, rank, least = pivoted_qr(np.ascontiguousarray(loops.T), threshold * max(1.0, largest / steepest))
        free, margin = null_basis(order, upper, rank).T, min(margin, float(least))
    null = np.linalg.qr((twist[list(system.moving)] @ free).reshape(6 * len(system.movable), -1))[0]
    return null.reshape(len(system.movable), 6, -1), threshold, margin


def _rows_of_pairs(system: System, pair: Ints) -> dict[tuple[int, int], Ints]:
    """Rows of each pair of indices in `bodies`, the lower first; all fixed bodies are -1."""
    node = np.where(system.slot[pair] >= 0, pair, -1)
    low, high = node.min(axis=1), node.max(axis=1)
    order = np.lexsort((np.arange(len(pair)), high, low))
    cuts = np.flatnonzero((np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)) + 1
    return {(int(low[rows[0]]), int(high[rows[0]])): rows for rows in np.split(order, cuts)}


def _spanning_tree(rows_of: dict[tuple[int, int], Ints]) -> list[tuple[int, int]]:
    """(parent, child) pairs, parents first, of the tree of pairs with most equations (Prim).

    The root is -1, or the lowest body if none is fixed.
    """
    neighbours: dict[int, list[tuple[int, int]]] = {}
    for (a, b), rows in rows_of.items():
        neighbours.setdefault(a, []).append((-len(rows), b))
        neighbours.setdefault(b, []).append((-len(rows), a))
    start = min(neighbours)
    seen, out = {start}, []
    heap = [(weight, start, x) for weight, x in neighbours[start]]
    heapq.heapify(heap)
    while heap:
        _, parent, child = heapq.heappop(heap)
        if child in seen:
            continue
        seen.add(child)
        out.append((parent, child))
        for weight, x in neighbours[child]:
            if x not in seen:
                heapq.heappush(heap, (weight, child, x))
    return out


def _carried(system: System, rotation: Array, translation: Array, parent: int, child: int) -> Array:
    """(6, 6) map from the scaled twist of the parent to that of the child, if both are one rigid body."""
    turn = rotation[child].T @ rotation[parent]
    x, y, z = rotation[parent].T @ (translation[child] - translation[parent])
    out = np.zeros((6, 6))
    out[:3, :3] = turn
    out[:3, 3:] = turn @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) / system.extent[parent]
    out[3:, 3:] = turn * (system.extent[child] / system.extent[parent])
    return out
