"""The least number of removals after which a part comes out, over the ways that are known: an integer program."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

SECONDS = 30.0
"""s of processor time after which the best plan so far is taken"""


@dataclass(frozen=True)
class Option:
    """A way of a unit."""

    blockers: frozenset[int]
    """units that have to be gone before, or are carried along"""
    carried: Mapping[int, frozenset[int]] = field(default_factory=dict)
    """units that may be carried along, and what stands in the way of each"""
    last: bool = False
    """whether it is taken only where it saves a removal"""


@dataclass(frozen=True)
class Removed:
    """A unit that goes by one of its options."""

    unit: int
    option: int
    carried: tuple[int, ...] = ()
    """units that go with it"""


@dataclass(frozen=True)
class Least:
    """A least set of removals."""

    chosen: tuple[Removed, ...]
    """in an order in which none is blocked; the target last"""
    bound: int
    """no plan over these ways has fewer removals"""

    @property
    def proven(self) -> bool:
        """Whether there is none with fewer, over these ways."""
        return len(self.chosen) <= self.bound


def least(options: Sequence[Sequence[Option]], target: int, seconds: float = SECONDS) -> Least | None:
    """The least set of removals that ends with the target; None if the ways do not reach it.

    options: of each unit; a unit that stays has none. seconds: of processor time.

    Of plans with as few removals one is taken with the fewest units carried and options that are `last`. y_c is 1 if a
    unit goes by option c, z_cv if c carries v, x_u if u goes, alone or carried. t_u is its place in the order, against
    cycles: t_j + 1 <= t_u for each j that blocks u and is not carried with it (Miller, Tucker & Zemlin, "Integer
    Programming Formulation of Traveling Salesman Problems", 1960).
    """
    reachable = _reachable(options)
    if target not in reachable:
        return None
    n = len(options)
    columns = [
        (u, k)
        for u in range(n)
        for k, option in enumerate(options[u])
        if option.blockers <= reachable and not any(_better(other, option) for other in options[u])
    ]
    carried = [
        (c, v)
        for c, (u, k) in enumerate(columns)
        for v, by in options[u][k].carried.items()
        if v != target and by - {u} <= reachable
    ]
    at_carried = {pair: n + len(columns) + p for p, pair in enumerate(carried)}
    whole = n + len(columns) + len(carried)
    entries: list[tuple[int, int, float]] = []  # row, column, value
    low: list[float] = []
    high: list[float] = []

    def row(terms: Mapping[int, float], at_most: float, at_least: float = -np.inf) -> None:
        entries.extend((len(high), column, value) for column, value in terms.items())
        low.append(at_least)
        high.append(at_most)

    def before(j: int, u: int, goes: int, with_it: int | None) -> None:
        """j goes before u if `goes`, unless it is carried `with_it`."""
        row({goes: 1.0, j: -1.0}, 0.0)  # it goes at all
        terms = {whole + j: 1.0, whole + u: -1.0, goes: float(n)}
        row(terms | ({} if with_it is None else {with_it: -float(n)}), n - 1.0)

    for u in range(n):  # one way each that goes
        mine = {n + c: -1.0 for c, (unit, _) in enumerate(columns) if unit == u}
        row({u: 1.0} | mine | {at: -1.0 for (_, v), at in at_carried.items() if v == u}, 0.0, 0.0)
    for c, (u, k) in enumerate(columns):
        for j in sorted(options[u][k].blockers):
            before(j, u, n + c, at_carried.get((c, j)))
    for (c, v), at in at_carried.items():
        u, k = columns[c]
        row({at: 1.0, n + c: -1.0}, 0.0)
        row({whole + u: 1.0, whole + v: -1.0, at: float(n)}, float(n))  # at the same time
        row({whole + v: 1.0, whole + u: -1.0, at: float(n)}, float(n))
        for j in sorted(options[u][k].carried[v] - {u}):
            before(j, v, at, at_carried.get((c, j)))
    cost, lower, upper = np.zeros(whole + n), np.zeros(whole + n), np.ones(whole + n)
    weight = 1.0 + len(columns) + len(carried)
    cost[n:whole] = 1.0
    for c, (u, k) in enumerate(columns):
        cost[n + c] = weight + options[u][k].last
    lower[target] = 1.0
    upper[whole:] = n
    solution, least_cost = _solved(cost, entries, low, high, lower, upper, np.arange(whole + n) < whole, seconds)
    if solution is None:
        return None
    taken = {
        u: Removed(u, k, tuple(v for (d, v), at in at_carried.items() if d == c and solution[at] > 0.5))
        for c, (u, k) in enumerate(columns)
        if solution[n + c] > 0.5
    }
    bound = int(np.ceil((least_cost - weight + 1.0) / weight - 1e-6))
    return Least(tuple(_ordered(options, taken, target)), max(bound, 1))


def _solved(
    cost: np.ndarray, entries: Sequence[tuple[int, int, float]], low: Sequence[float], high: Sequence[float],
    lower: np.ndarray, upper: np.ndarray, whole: np.ndarray, seconds: float,
) -> tuple[np.ndarray | None, float]:  # fmt: skip
    """The best solution found, or None, and a bound below its cost.

    HiGHS ends by the clock; where it had less than `seconds` of processor time by then, it begins anew with more time.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_matrix

    rows, columns, values = zip(*entries, strict=True)
    a = csr_matrix((values, (rows, columns)), shape=(len(high), len(cost)))
    limit = seconds
    while True:
        began = time.process_time()
        found = milp(
            cost, constraints=LinearConstraint(a, low, high), bounds=Bounds(lower, upper),
            integrality=whole.astype(np.int64), options={"time_limit": limit, "mip_rel_gap": 0.0},
        )  # fmt: skip
        if found.status != 1 or time.process_time() - began >= 0.9 * seconds:
            break
        limit *= 2.0
    dual = getattr(found, "mip_dual_bound", None)
    return found.x, 0.0 if dual is None else float(dual)


def _better(other: Option, option: Option) -> bool:
    """Whether an option is never taken where there is another."""
    return other.blockers < option.blockers and not option.carried and other.last <= option.last


def _reachable(options: Sequence[Sequence[Option]]) -> frozenset[int]:
    """Units that come out at all, peeled one after another."""
    gone: set[int] = set()
    while True:
        new = set[int]()
        for u in range(len(options)):
            for option in options[u]:  # also of a unit that is gone: it may carry others by another way
                along = _carriable(u, option, gone)
                if option.blockers <= gone | along:
                    new |= {u} | along
        if new <= gone:
            return frozenset(gone)
        gone |= new


def _carriable(u: int, option: Option, gone: Set[int]) -> set[int]:
    """Units that may be carried along once others are gone."""
    along = set(option.carried) - gone
    while stopped := {v for v in along if not option.carried[v] - {u} <= gone | along}:
        along -= stopped
    return along


def _ordered(options: Sequence[Sequence[Option]], taken: Mapping[int, Removed], target: int) -> list[Removed]:
    """The chosen ways, each after what blocks it; only what the target waits for."""
    leader = {v: u for u, removed in taken.items() for v in (u, *removed.carried)}
    out: list[Removed] = []
    done: set[int] = set()

    def visit(u: int) -> None:
        if u in done:
            return
        done.add(u)
        removed = taken[u]
        option = options[u][removed.option]
        waits = option.blockers.union(*(option.carried[v] for v in removed.carried))
        for j in sorted(waits - {u, *removed.carried}):
            visit(leader[j])
        out.append(removed)

    visit(target)
    return out
