"""Rank-revealing factorisations for blocks of a few hundred columns, as numba kernels.

They replace LAPACK because a threaded BLAS on a busy machine takes seconds instead of 10 ms at this size.
"""

from __future__ import annotations

import math

import numpy as np

from collision.numeric.kernel import inner_kernel, kernel


@inner_kernel
def _dot(x, y, n):
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    k = 0
    while k + 3 < n:
        a += x[k] * y[k]
        b += x[k + 1] * y[k + 1]
        c += x[k + 2] * y[k + 2]
        d += x[k + 3] * y[k + 3]
        k += 4
    while k < n:
        a += x[k] * y[k]
        k += 1
    return (a + b) + (c + d)


@kernel(allocates=True)
def pivoted_qr(columns, threshold):
    """QR with column pivoting (Businger and Golub 1965) of the matrix whose columns are rows of `columns` (n, m).

    Works in place: rows 0 … rank-1 of `columns` end as the columns of Q. Returns (order (n,), R (rank, n) by pivoted
    columns, rank, least kept |R_kk| over the largest); a pivot up to `threshold` times the largest counts as 0.
    """
    n, m = columns.shape
    order = np.arange(n)
    norms = np.empty(n)
    for j in range(n):
        norms[j] = _dot(columns[j], columns[j], m)
    R = np.zeros((min(n, m), n))
    first = 0.0
    rank = 0
    least = 1.0
    for k in range(min(n, m)):
        p = k
        for j in range(k + 1, n):
            if norms[j] > norms[p]:
                p = j
        if p != k:
            order[k], order[p] = order[p], order[k]
            norms[k], norms[p] = norms[p], norms[k]
            for i in range(m):
                columns[k, i], columns[p, i] = columns[p, i], columns[k, i]
            for i in range(k):
                R[i, k], R[i, p] = R[i, p], R[i, k]
        q = columns[k]
        for i in range(k):  # rounding errors along the columns before
            d = _dot(columns[i], q, m)
            R[i, k] += d
            for r in range(m):
                q[r] -= d * columns[i, r]
        size = math.sqrt(_dot(q, q, m))
        if k == 0:
            first = size
        if not size > threshold * first:
            break
        R[k, k] = size
        least = size / first
        rank = k + 1
        for r in range(m):
            q[r] /= size
        for j in range(k + 1, n):
            c = columns[j]
            d = _dot(q, c, m)
            R[k, j] = d
            for r in range(m):
                c[r] -= d * q[r]
            norms[j] = _dot(c, c, m)
    return order, R[:rank], rank, least


@kernel(allocates=True)
def null_basis(order, R, rank):
    """Null vectors (k, n) by rows, independent but not orthonormal, from `pivoted_qr`."""
    n = len(order)
    out = np.zeros((n - rank, n))
    for x in range(rank, n):
        v = out[x - rank]
        v[order[x]] = 1.0
        for i in range(rank - 1, -1, -1):
            s = -R[i, x]
            for j in range(i + 1, rank):
                s -= R[i, j] * v[order[j]]
            v[order[i]] = s / R[i, i]
    return out


@kernel(allocates=True)
def least_norm(columns, rhs, threshold):
    """Least-squares solution (n,) of least norm of A x = rhs; `columns` (n, m), the rows of Aᵀ, is overwritten."""
    n, m = columns.shape
    order, R, rank, _ = pivoted_qr(columns, threshold)
    left = rhs.copy()
    y = np.empty(rank)
    for k in range(rank):
        y[k] = _dot(columns[k], left, m)
        for r in range(m):
            left[r] -= y[k] * columns[k, r]
    x = np.zeros(n)
    for k in range(rank - 1, -1, -1):
        s = y[k]
        for j in range(k + 1, rank):
            s -= R[k, j] * x[order[j]]
        x[order[k]] = s / R[k, k]
    null = null_basis(order, R, rank)
    for a in range(len(null)):  # orthonormalised, and removed from x
        v = null[a]
        for _ in range(2):
            for b in range(a):
                d = _dot(null[b], v, n)
                for j in range(n):
                    v[j] -= d * null[b, j]
        size = math.sqrt(_dot(v, v, n))
        for j in range(n):
            v[j] /= size
        d = _dot(v, x, n)
        for j in range(n):
            x[j] -= d * v[j]
    return x


@kernel(allocates=True)
def row_space(rows, threshold):
    """Find the rows among (m, n) unit rows that are independent of earlier ones, and express the others by them.

    Returns (place (m,): number among the kept rows, or -1; weights (m, rank) of the kept rows in each dependent row).
    """
    m, n = rows.shape
    size = min(m, n)
    basis = np.empty((size, n))
    lower = np.zeros((size, size))  # the kept rows on the basis
    place = np.full(m, -1)
    weights = np.zeros((m, size))
    coefficient = np.empty(size)
    count = 0
    for i in range(m):
        v = rows[i].copy()
        coefficient[:count] = 0.0
        for _ in range(2):  # twice is enough (Kahan, in Parlett, The Symmetric Eigenvalue Problem, 6.9)
            for k in range(count):
                d = _dot(basis[k], v, n)
                coefficient[k] += d
                for j in range(n):
                    v[j] -= d * basis[k, j]
        left = math.sqrt(_dot(v, v, n))
        if left > threshold and count < size:
            lower[count, :count] = coefficient[:count]
            lower[count, count] = left
            basis[count] = v / left
            place[i] = count
            count += 1
        else:
            w = weights[i]
            for k in range(count - 1, -1, -1):
                s = coefficient[k]
                for j in range(k + 1, count):
                    s -= lower[j, k] * w[j]
                w[k] = s / lower[k, k]
    return place, weights[:, :count]
