"""The motions that the equations of a system leave at a pose: the null space of its Jacobian.

A small system is factorised as it is. In a large one the bodies hang on a tree of pairs; each pair of the tree leaves a
few motions (one, for a hinge), the twist of every body is a sum of those between it and the ground, and only the pairs
that close loops are left to be factorised, on as many columns as the tree has motions. A net of 65 hinged bars has 390
columns one way and 65 the other.
"""

from __future__ import annotations

import heapq

import numpy as np

from collision import Tolerance
from constraints.solve.ranks import null_basis, pivoted_qr
from constraints.solve.system import Array, Ints, System

DENSE = 12
"""bodies up to which a system is factorised as it is"""


def rank_threshold(system: System, worst: float, tolerance: Tolerance) -> float:
    """Pivots below this times the largest count as zero.

    `tolerance.rank`; where the constraints are inconsistent (by `worst`, m) their directions are uncertain by as much
    over a length, up to `tolerance.angular`.
    """
    return max(tolerance.rank, min(8.0 * worst / system.length, tolerance.angular))


def null_space(system: System, rotation: Array, translation: Array, tolerance: Tolerance) -> tuple[Array, float, float]:
    """Orthonormal scaled null space (movable, 6, k) of the Jacobian, the threshold used, and the least pivot kept."""
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
    """The same as `null_space`, by the motions of a spanning tree's pairs."""
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
    for parent, child in tree:  # what each pair leaves to the child
        rows = rows_of[min(parent, child), max(parent, child)]
        jacobian = np.where((pair[rows, 0] == child)[:, None], sides[0][rows], sides[1][rows])
        order, upper, rank, least = pivoted_qr(np.ascontiguousarray(jacobian.T), threshold)
        motions.append(np.linalg.qr(null_basis(order, upper, rank).T)[0])
        largest, margin = max(largest, abs(float(upper[0, 0]))), min(margin, float(least))
    root = tree[0][0]
    first = np.cumsum([0 if root < 0 else 6, *(m.shape[1] for m in motions)])
    twist = np.zeros((len(system.bodies), 6, first[-1]))  # of each body, scaled, by the motions of the tree
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
    """Rows of each pair of places in `bodies`, the lower one first; all fixed bodies are place -1."""
    node = np.where(system.slot[pair] >= 0, pair, -1)
    low, high = node.min(axis=1), node.max(axis=1)
    order = np.lexsort((np.arange(len(pair)), high, low))
    cuts = np.flatnonzero((np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)) + 1
    return {(int(low[rows[0]]), int(high[rows[0]])): rows for rows in np.split(order, cuts)}


def _spanning_tree(rows_of: dict[tuple[int, int], Ints]) -> list[tuple[int, int]]:
    """(parent, child) pairs, parents first, that reach every body by the pairs of most equations (Prim).

    They begin at -1, or at the lowest body where nothing is fixed.
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
    """Scaled twist (6, 6) of the child that goes along with the parent as one rigid body."""
    turn = rotation[child].T @ rotation[parent]
    x, y, z = rotation[parent].T @ (translation[child] - translation[parent])
    out = np.zeros((6, 6))
    out[:3, :3] = turn
    out[:3, 3:] = turn @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]) / system.extent[parent]
    out[3:, 3:] = turn * (system.extent[child] / system.extent[parent])
    return out
