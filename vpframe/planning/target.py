"""The least number of removals after which a part comes out, over the ways that are known: an integer program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SECONDS = 30.0
"""s by the clock after which the best plan so far is taken"""


@dataclass(frozen=True)
class Least:
    """A least set of removals."""

    chosen: tuple[tuple[int, int], ...]
    """(unit, which of its ways), in an order in which none is blocked; the target last"""
    bound: int
    """no plan over these ways has fewer removals"""

    @property
    def proven(self) -> bool:
        """Whether there is none with fewer, over these ways."""
        return len(self.chosen) <= self.bound


def least(blockers: Sequence[Sequence[frozenset[int]]], target: int, seconds: float = SECONDS) -> Least | None:
    """The least set of removals that ends with the target; None if the ways do not reach it.

    blockers: of each unit, of each of its ways, the units that have to be gone before; a unit that stays has none.

    x_u is 1 if u goes, y_w if by way w, and t_u is its place in the order, against cycles: t_j + 1 <= t_u for each j
    that blocks the way of u (Miller, Tucker & Zemlin, "Integer Programming Formulation of Traveling Salesman Problems",
    1960).
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import lil_matrix

    reachable = _reachable(blockers)
    if target not in reachable:
        return None
    n = len(blockers)
    columns = [
        (u, k)
        for u in range(n)
        for k, by in enumerate(blockers[u])
        if by <= reachable and not any(other < by for other in blockers[u])
    ]
    m = len(columns)
    rows = n + sum(2 * len(blockers[u][k]) for u, k in columns)
    a = lil_matrix((rows, 2 * n + m))
    low, high = np.full(rows, -np.inf), np.zeros(rows)
    for u in range(n):  # one way each that goes
        a[u, u] = 1.0
        low[u] = 0.0
    for c, (u, _) in enumerate(columns):
        a[u, n + c] = -1.0
    at = n
    for c, (u, k) in enumerate(columns):
        for j in sorted(blockers[u][k]):
            a[at, n + c], a[at, j] = 1.0, -1.0  # y <= x_j
            a[at + 1, n + m + j], a[at + 1, n + m + u], a[at + 1, n + c] = 1.0, -1.0, float(n)
            high[at + 1] = n - 1.0  # t_j - t_u + n y <= n - 1
            at += 2
    lower, upper = np.zeros(2 * n + m), np.ones(2 * n + m)
    lower[target] = 1.0
    upper[n + m :] = n
    cost = np.zeros(2 * n + m)
    cost[:n] = 1.0
    whole = np.concatenate([np.ones(n + m), np.zeros(n)])
    found = milp(
        cost, constraints=LinearConstraint(a.tocsr(), low, high), bounds=Bounds(lower, upper), integrality=whole,
        options={"time_limit": seconds},
    )  # fmt: skip
    if found.x is None:
        return None
    taken = {columns[c] for c in np.flatnonzero(found.x[n : n + m] > 0.5)}
    order = _ordered(blockers, dict(sorted(taken)), target)
    dual = getattr(found, "mip_dual_bound", None)
    bound = int(np.ceil((dual if dual is not None else 1.0) - 1e-6))
    return Least(tuple(order), bound)


def _reachable(blockers: Sequence[Sequence[frozenset[int]]]) -> frozenset[int]:
    """Units that come out at all, peeled one after another."""
    gone: set[int] = set()
    while True:
        new = {u for u in range(len(blockers)) if u not in gone and any(by <= gone for by in blockers[u])}
        if not new:
            return frozenset(gone)
        gone |= new


def _ordered(blockers: Sequence[Sequence[frozenset[int]]], way: dict[int, int], target: int) -> list[tuple[int, int]]:
    """The chosen ways, each after what blocks it; only what the target waits for."""
    out: list[tuple[int, int]] = []
    done: set[int] = set()

    def visit(u: int) -> None:
        if u in done:
            return
        done.add(u)
        for j in sorted(blockers[u][way[u]]):
            visit(j)
        out.append((u, way[u]))

    visit(target)
    return out
