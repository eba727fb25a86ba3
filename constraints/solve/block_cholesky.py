"""Block-sparse Cholesky factorisation of JᵀJ, in blocks of 6×6: elimination order and kernels."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Elimination:
    """Symbolic block Cholesky factorisation over movable bodies (blocks of 6), by minimum degree.

    Block k is the diagonal of column k; off-diagonal blocks follow, column by column. `update` lists, for each column
    and each pair (i >= j) of its rows, the block from which L_ik L_jkᵀ is subtracted.
    """

    position: Ints
    """(n,) column of each movable slot"""
    column: Ints
    """(n+1,) first off-diagonal block of each column, counted from n"""
    row: Ints
    """row (as a column number) of each off-diagonal block"""
    update: Ints
    update_start: Ints
    """(n+1,)"""
    block_of: dict[tuple[int, int], int]
    """(row, column) -> block"""


def eliminate(n: int, edges: Iterable[tuple[int, int]]) -> Elimination:
    """Return the minimum-degree elimination of n bodies with these edges; ties go to the lower slot."""
    neighbours: list[set[int]] = [set() for _ in range(n)]
    for a, b in edges:
        neighbours[a].add(b)
        neighbours[b].add(a)
    order: list[int] = []
    columns: list[set[int]] = []
    left = set(range(n))
    while left:
        s = min(left, key=lambda x: (len(neighbours[x]), x))
        left.remove(s)
        clique = neighbours[s]
        for x in clique:
            neighbours[x] |= clique
            neighbours[x] -= {x, s}
        order.append(s)
        columns.append(clique)
    position = np.empty(n, dtype=np.int64)
    position[order] = np.arange(n)
    column, row = [0], list[int]()
    block_of: dict[tuple[int, int], int] = {}
    for k, clique in enumerate(columns):
        for i in sorted(int(position[x]) for x in clique):
            block_of[i, k] = n + len(row)
            row.append(i)
        column.append(len(row))
    update, update_start = list[int](), [0]
    for k in range(n):
        rows = row[column[k] : column[k + 1]]
        update += [i if i == j else block_of[i, j] for x, i in enumerate(rows) for j in rows[: x + 1]]
        update_start.append(len(update))
    columns_of, rows_of, updates, starts = (np.array(x, np.int64) for x in (column, row, update, update_start))
    return Elimination(position, columns_of, rows_of, updates, starts, block_of)


@inner_kernel
def _factor_block(blocks, k):
    """Factor the 6×6 diagonal block k in place (Cholesky, lower); return False if it is not positive definite."""
    D = blocks[k]
    for j in range(6):
        x = D[j, j]
        for p in range(j):
            x -= D[j, p] * D[j, p]
        if not x > 0.0:
            return False
        x = math.sqrt(x)
        D[j, j] = x
        for i in range(j + 1, 6):
            y = D[i, j]
            for p in range(j):
                y -= D[i, p] * D[j, p]
            D[i, j] = y / x
    return True


@kernel
def factor(blocks, column, row, update, update_start):
    """Factor H = L Lᵀ in place; return False if H is not positive definite. blocks (b, 6, 6): see `Elimination`."""
    n = len(column) - 1
    for k in range(n):
        if not _factor_block(blocks, k):
            return False
        D = blocks[k]
        first, last = n + column[k], n + column[k + 1]
        for b in range(first, last):  # L_ik = H_ik D⁻ᵀ
            L = blocks[b]
            for i in range(6):
                for j in range(6):
                    y = L[i, j]
                    for p in range(j):
                        y -= L[i, p] * D[j, p]
                    L[i, j] = y / D[j, j]
        t = update_start[k]
        for x in range(first, last):
            X = blocks[x]
            for y in range(first, x + 1):
                Y = blocks[y]
                T = blocks[update[t]]
                t += 1
                for i in range(6):
                    for j in range(6):
                        s = 0.0
                        for p in range(6):
                            s += X[i, p] * Y[j, p]
                        T[i, j] -= s
    return True


@kernel
def substitute(blocks, column, row, x):
    """Solve L Lᵀ y = x in place; x (n, 6) by columns."""
    n = len(column) - 1
    for k in range(n):
        D = blocks[k]
        for i in range(6):
            y = x[k, i]
            for p in range(i):
                y -= D[i, p] * x[k, p]
            x[k, i] = y / D[i, i]
        for c in range(column[k], column[k + 1]):
            L = blocks[n + c]
            r = row[c]
            for i in range(6):
                for p in range(6):
                    x[r, i] -= L[i, p] * x[k, p]
    for k in range(n - 1, -1, -1):
        for c in range(column[k], column[k + 1]):
            L = blocks[n + c]
            r = row[c]
            for i in range(6):
                for p in range(6):
                    x[k, p] -= L[i, p] * x[r, i]
        D = blocks[k]
        for i in range(5, -1, -1):
            y = x[k, i]
            for p in range(i + 1, 6):
                y -= D[p, i] * x[k, p]
            x[k, i] = y / D[i, i]
