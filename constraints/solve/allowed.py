"""Solutions of a few linear equations: the solution of least norm, and a basis of the null space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import kernel

Array = NDArray[np.float64]
DEPENDENT = 1e-7
"""1: singular values below this times the largest count as 0"""
SMALL = 48
"""unknowns up to which Jacobi rotations are faster than LAPACK"""
NOTHING = 1e-15
"""1: columns shorter than this times the longest are rounding errors"""


def allowed(residual: Array, jacobian: Array) -> tuple[Array, Array]:
    """Return the least-squares solutions x = origin + basis·y of J x = -r: (n,) and (n, k), orthonormal.

    residual (m,), jacobian (m, n). Singular values from a QR decomposition of [J r] and one-sided Jacobi rotations of
    its triangle (Drmač and Veselić 2008); for many unknowns, LAPACK's of the triangle.
    """
    m, n = jacobian.shape
    if not m:
        return np.zeros(n), np.eye(n)
    if n <= SMALL:
        origin, v = np.zeros(n), np.eye(n)
        work = np.zeros((max(m, n), n + 1))
        work[:m, :n], work[:m, n] = jacobian, residual
        rank = _allowed(work, origin, v)
        return origin, np.ascontiguousarray(v[:, rank:])
    triangle: Array = np.linalg.qr(np.column_stack([jacobian, residual]), mode="r")[:n]  # type: ignore[assignment]
    u, s, vt = np.linalg.svd(triangle[:, :n])
    rank = int((s > DEPENDENT * s[0]).sum())
    return -vt[:rank].T @ ((u[:, :rank].T @ triangle[:, n]) / s[:rank]), vt[rank:].T


@kernel
def _allowed(a, origin, v):  # pragma: no cover - compiled
    """Fill origin (n,) and turn v (n, n), the identity, into the singular vectors of J, a (m, n + 1) = [J r], m >= n.

    Returns the rank; the first columns of v belong to the singular values that count. `a` is overwritten.
    """
    m, n = a.shape[0], a.shape[1] - 1
    size = 0.0
    for i in range(m):
        for j in range(n):
            size += a[i, j] * a[i, j]
    for k in range(n):  # Householder: J becomes its triangle R, r becomes Qᵀr
        length = 0.0
        for i in range(k, m):
            length += a[i, k] * a[i, k]
        if length <= NOTHING * NOTHING * size:  # rounding errors, whose squares may underflow
            for i in range(k, m):
                a[i, k] = 0.0
            continue
        length = np.sqrt(length)
        if a[k, k] > 0.0:
            length = -length
        a[k, k] -= length
        scale = -1.0 / (length * a[k, k])
        for j in range(k + 1, n + 1):
            total = 0.0
            for i in range(k, m):
                total += a[i, k] * a[i, j]
            total *= scale
            for i in range(k, m):
                a[i, j] -= total * a[i, k]
        a[k, k] = length
        for i in range(k + 1, m):
            a[i, k] = 0.0
    longest = 0.0
    for k in range(n):
        length = 0.0
        for i in range(k + 1):
            length += a[i, k] * a[i, k]
        longest = max(longest, length)
    least = longest * NOTHING * NOTHING
    for _sweep in range(40):
        rotated = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                alpha = beta = gamma = 0.0
                for i in range(n):
                    alpha += a[i, p] * a[i, p]
                    beta += a[i, q] * a[i, q]
                    gamma += a[i, p] * a[i, q]
                if min(alpha, beta) <= least or abs(gamma) <= 1e-15 * np.sqrt(alpha * beta):
                    continue
                rotated = True
                zeta = (beta - alpha) / (2.0 * gamma)
                t = 1.0 / (abs(zeta) + np.sqrt(1.0 + zeta * zeta))
                t = t if zeta > 0.0 else -t
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = c * t
                for i in range(n):
                    x, y = a[i, p], a[i, q]
                    a[i, p], a[i, q] = c * x - s * y, s * x + c * y
                    x, y = v[i, p], v[i, q]
                    v[i, p], v[i, q] = c * x - s * y, s * x + c * y
        if not rotated:
            break
    greatest = 0.0
    for k in range(n):
        length = 0.0
        for i in range(n):
            length += a[i, k] * a[i, k]
        greatest = max(greatest, length)
    rank = 0
    for k in range(n):
        length = along = 0.0
        for i in range(n):
            length += a[i, k] * a[i, k]
            along += a[i, k] * a[i, n]
        if length <= DEPENDENT * DEPENDENT * greatest:
            continue
        for i in range(n):
            origin[i] -= v[i, k] * (along / length)
            v[i, k], v[i, rank] = v[i, rank], v[i, k]
            a[i, k], a[i, rank] = a[i, rank], a[i, k]
        rank += 1
    return rank
