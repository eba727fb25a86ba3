"""Small strictly convex quadratic programs, exactly: min ½ yᵀHy + gᵀy with C y >= lower.

The dual active-set method of Goldfarb and Idnani (1983), in the coordinates in which H is the identity: from the free
minimum on, the row that is violated most is made to hold, and rows that no longer press are let go on the way there.
It needs no start, ends after finitely many rows, and shows it when no y keeps them all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import inner_kernel, kernel
from constraints.errors import ConstraintsError

Array = NDArray[np.float64]

MOST_CHANGES = 1000
"""of the set of rows that hold, at least; the method needs about as many as there are unknowns"""
VIOLATED = 1e-13
"""m: a row that is off by less holds"""
DEPENDENT = 1e-8
"""1: what is left of a row beside the rows that hold already, below which it says nothing new"""


SOLVED, CONTRADICTORY, UNDECIDED = 0, 1, 2
UNMOVED = 1e-9
"""1: a row that is smaller is left out: no motion that is allowed changes it"""


class UndecidedError(ConstraintsError):
    """A quadratic program that had neither an answer nor a contradiction when its changes were used up."""


def quadratic_program(
    hessian: Array, gradient: Array, c: Array, lower: Array, most_changes: int | None = None
) -> tuple[Array, NDArray[np.int64]] | None:
    """The y (n,) of least ½ yᵀHy + gᵀy among those with C y >= lower, and the rows that it presses on, ascending.

    hessian (n, n): positive definite. gradient (n,). c (m, n). lower (m,): minus infinity asks for nothing. A row
    presses if it bears a force, or if it is at its bound and the free minimum lies beyond it: of several rows that say
    the same all are returned.

    most_changes: of the set of rows that hold; by default ten for each unknown and row, `MOST_CHANGES` at least.

    None when no y keeps all rows. Raises UndecidedError where `most_changes` did not suffice to tell.
    """
    kept = np.flatnonzero(np.abs(c).max(axis=1) > UNMOVED)
    c, lower = np.ascontiguousarray(c[kept]), lower[kept]
    y, force, free = np.empty(len(gradient)), np.zeros(len(lower)), np.empty(len(gradient))
    most = max(MOST_CHANGES, 10 * sum(c.shape)) if most_changes is None else most_changes
    status = _goldfarb_idnani(np.ascontiguousarray(hessian), gradient, c, lower, most, y, force, free)
    if status == UNDECIDED:
        raise UndecidedError(
            f"a quadratic program of {c.shape[1]} unknowns is undecided after {most} changes of {len(c)} rows"
        )
    if status == CONTRADICTORY:
        return None
    bound = (c @ y - lower < 1e3 * VIOLATED) & (c @ free - lower < -1e3 * VIOLATED)
    return y, kept[bound | (force > 1e3 * VIOLATED)]


def minimum(hessian: Array, gradient: Array) -> Array:
    """The y (n,) of least ½ yᵀHy + gᵀy; hessian (n, n), positive definite."""
    n = len(gradient)
    root, u, y = np.zeros((n, n)), np.empty(n), np.empty(n)
    _free_minimum(np.ascontiguousarray(hessian), gradient, root, u, y)
    return y


@kernel
def _free_minimum(h: Array, g: Array, root: Array, u: Array, y: Array) -> None:  # pragma: no cover - compiled
    _factored(h, g, root, u)
    _back(root, u, y)


@inner_kernel
def _factored(h: Array, g: Array, root: Array, u: Array) -> None:  # pragma: no cover - compiled
    """Fill the lower triangle root (n, n) of H = root·rootᵀ (Cholesky), and u (n,) of root·u = -g."""
    for i in range(len(g)):
        for j in range(i + 1):
            total = h[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(total) if i == j else total / root[j, j]
    for i in range(len(g)):
        total = -g[i]
        for k in range(i):
            total -= root[i, k] * u[k]
        u[i] = total / root[i, i]


@kernel(allocates=True)
def _goldfarb_idnani(
    h: Array, g: Array, c: Array, lower: Array, most_changes: int, y: Array, force: Array, free: Array
) -> int:  # pragma: no cover - compiled
    """Fills y (n,), force (m,) of each row and the free minimum (n,); returns a status."""
    n, m = len(g), len(lower)
    root, u = np.zeros((n, n)), np.empty(n)  # H = root·rootᵀ, u = rootᵀ·y
    _factored(h, g, root, u)
    d = np.empty((m, n))  # rows in the new coordinates: C·root⁻ᵀ
    for p in range(m):
        for i in range(n):
            total = c[p, i]
            for k in range(i):
                total -= root[i, k] * d[p, k]
            d[p, i] = total / root[i, i]
    _back(root, u, free)
    active = np.empty(n + 1, np.int64)
    q, r = np.zeros((n, n)), np.zeros((n, n))  # of the rows that hold: columns of q are orthonormal, dᵀ = q·r
    along, pull, rest = np.zeros(n), np.zeros(n), np.empty(n)
    count = 0
    added = -1
    for _ in range(most_changes):
        if added < 0:
            worst = -VIOLATED
            for p in range(m):
                slack = -lower[p]
                for k in range(n):
                    slack += d[p, k] * u[k]
                if slack < worst:
                    worst, added = slack, p
            if added < 0:
                _back(root, u, y)
                return SOLVED
        size = 0.0
        for k in range(n):
            rest[k] = d[added, k]
            size += rest[k] * rest[k]
        for j in range(n):
            along[j] = 0.0
        for _again in range(2):  # twice is enough (Kahan): what is left is orthogonal to rounding
            for j in range(count):
                total = 0.0
                for k in range(n):
                    total += q[k, j] * rest[k]
                along[j] += total
                for k in range(n):
                    rest[k] -= total * q[k, j]
        left, slack = 0.0, -lower[added]
        for k in range(n):
            left += rest[k] * rest[k]
            slack += d[added, k] * u[k]
        for j in range(count - 1, -1, -1):
            total = along[j]
            for k in range(j + 1, count):
                total -= r[j, k] * pull[k]
            pull[j] = total / r[j, j]
        step, let_go = np.inf, -1
        for j in range(count):
            if pull[j] > 0.0 and force[active[j]] / pull[j] < step:
                step, let_go = force[active[j]] / pull[j], j
        fresh = left > DEPENDENT * DEPENDENT * size
        if fresh and -slack / left <= step:
            step, let_go = -slack / left, -1
        if step == np.inf:
            return CONTRADICTORY
        if fresh:
            for k in range(n):
                u[k] += step * rest[k]
        for j in range(count):
            force[active[j]] -= step * pull[j]
        force[added] += step
        if let_go < 0:
            length = np.sqrt(left)
            for k in range(n):
                q[k, count] = rest[k] / length
                r[k, count] = along[k]
            r[count, count] = length
            active[count] = added
            count += 1
            added = -1
            continue
        force[active[let_go]] = 0.0
        count -= 1
        for j in range(let_go, count):
            active[j] = active[j + 1]
        for j in range(let_go, count):  # the later columns anew
            for k in range(n):
                q[k, j] = d[active[j], k]
                r[k, j] = 0.0
            for _again in range(2):
                for i in range(j):
                    total = 0.0
                    for k in range(n):
                        total += q[k, i] * q[k, j]
                    r[i, j] += total
                    for k in range(n):
                        q[k, j] -= total * q[k, i]
            length = 0.0
            for k in range(n):
                length += q[k, j] * q[k, j]
            r[j, j] = np.sqrt(length)
            for k in range(n):
                q[k, j] /= r[j, j]
    return UNDECIDED


@inner_kernel
def _back(root: Array, u: Array, y: Array) -> None:  # pragma: no cover - compiled
    """y of rootᵀ·y = u, root lower triangular."""
    for i in range(len(u) - 1, -1, -1):
        total = u[i]
        for k in range(i + 1, len(u)):
            total -= root[k, i] * y[k]
        y[i] = total / root[i, i]
