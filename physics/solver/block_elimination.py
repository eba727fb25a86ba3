"""Sparse linear systems of 6x6 blocks: one block row per body, one block per pair of bodies in contact.

Bodies are eliminated by least degree (Tinney and Walker, Proc. IEEE 55, 1967), so that the cost of a heap follows its
contacts: a row of bodies costs by its length. Pivoting is within blocks only.
"""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel

SMALL = 16
"""bodies: systems of no more are solved as one dense matrix, with pivots"""


@kernel(allocates=True)
def structure(n, pairs):
    """Where the blocks of an elimination lie, from pairs of body numbers (c, 2) that share a block row, -1 for none.

    Returns order (n,), start (n + 1,), later: the bodies that are eliminated after order[k] and joined with it then
    are later[start[k] : start[k + 1]]; and slot (n, n), the number of each block in `values`, -1 where there is none.
    """
    slot = np.full((n, n), -1, np.int32)
    if n <= SMALL:
        for i in range(n):
            for j in range(n):
                slot[i, j] = i * n + j
        return np.arange(n), np.zeros(n + 1, np.int64), np.zeros(0, np.int64), slot, n * n
    joined = np.zeros((n, n), np.bool_)
    for c in range(pairs.shape[0]):
        i, j = pairs[c, 0], pairs[c, 1]
        if i >= 0 and j >= 0 and i != j:
            joined[i, j] = joined[j, i] = True
    degree = np.zeros(n, np.int64)
    for i in range(n):
        for j in range(n):
            degree[i] += joined[i, j]
    order = np.empty(n, np.int64)
    start = np.zeros(n + 1, np.int64)
    later = np.empty(16 * n, np.int64)
    done = np.zeros(n, np.bool_)
    count = 0
    for k in range(n):
        p = -1
        for i in range(n):
            if not done[i] and (p < 0 or degree[i] < degree[p]):
                p = i
        order[k] = p
        done[p] = True
        slot[p, p] = count
        count += 1
        begin = start[k]
        end = begin
        for j in range(n):
            if joined[p, j] and not done[j]:
                if end == len(later):
                    grown = np.empty(2 * end, np.int64)
                    grown[:end] = later
                    later = grown
                later[end] = j
                end += 1
                slot[p, j] = count
                slot[j, p] = count + 1
                count += 2
                degree[j] -= 1
        for x in range(begin, end):
            i = later[x]
            for y in range(x + 1, end):
                j = later[y]
                if not joined[i, j]:
                    joined[i, j] = joined[j, i] = True
                    degree[i] += 1
                    degree[j] += 1
        start[k + 1] = end
    return order, start, later[: start[n]], slot, count


@inner_kernel
def _invert(a, out):
    """Inverse of a (6, 6) by Gauss and Jordan with row pivots; `a` is overwritten."""
    for i in range(6):
        for j in range(6):
            out[i, j] = 1.0 if i == j else 0.0
    for k in range(6):
        p = k
        for i in range(k + 1, 6):
            if abs(a[i, k]) > abs(a[p, k]):
                p = i
        if p != k:
            for j in range(6):
                a[k, j], a[p, j] = a[p, j], a[k, j]
                out[k, j], out[p, j] = out[p, j], out[k, j]
        scale = 1.0 / a[k, k]
        for j in range(6):
            a[k, j] *= scale
            out[k, j] *= scale
        for i in range(6):
            f = a[i, k]
            if i != k and f != 0.0:
                for j in range(6):
                    a[i, j] -= f * a[k, j]
                    out[i, j] -= f * out[k, j]


@kernel(allocates=True)
def solve_blocks(values, order, start, later, slot, right):
    """x (n, 6) with A x = `right`; `values` (blocks, 6, 6), laid out by `structure`, is overwritten."""
    n = len(order)
    if n <= SMALL:
        dense = np.empty((6 * n, 6 * n))
        for i in range(n):
            for j in range(n):
                for k in range(6):
                    for m in range(6):
                        dense[6 * i + k, 6 * j + m] = values[i * n + j, k, m]
        return np.linalg.solve(dense, right.reshape(6 * n)).reshape(n, 6)
    x = right.copy()
    inverse = np.empty((n, 6, 6))
    factor = np.empty((6, 6))
    for k in range(n):
        p = order[k]
        d = inverse[p]
        _invert(values[slot[p, p]], d)
        for u in range(start[k], start[k + 1]):
            i = later[u]
            lower = values[slot[i, p]]
            for a in range(6):
                for b in range(6):
                    total = 0.0
                    for c in range(6):
                        total += lower[a, c] * d[c, b]
                    factor[a, b] = total
            for a in range(6):
                for c in range(6):
                    x[i, a] -= factor[a, c] * x[p, c]
            for w in range(start[k], start[k + 1]):
                j = later[w]
                upper = values[slot[p, j]]
                target = values[slot[i, j]]
                for a in range(6):
                    for c in range(6):
                        f = factor[a, c]
                        for b in range(6):
                            target[a, b] -= f * upper[c, b]
    right_side = np.empty(6)
    for k in range(n - 1, -1, -1):
        p = order[k]
        for a in range(6):
            right_side[a] = x[p, a]
        for u in range(start[k], start[k + 1]):
            j = later[u]
            upper = values[slot[p, j]]
            for a in range(6):
                for c in range(6):
                    right_side[a] -= upper[a, c] * x[j, c]
        for a in range(6):
            total = 0.0
            for c in range(6):
                total += inverse[p, a, c] * right_side[c]
            x[p, a] = total
    return x
