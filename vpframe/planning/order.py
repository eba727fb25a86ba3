"""Order of removal: greedy peeling along known paths, and groups where single parts block each other.

Removing a part never blocks another, so peeling what is free until nothing is finds every part that the known ways can
take out one at a time. Where single parts do not come out, the strong components of the blocking graph of a direction
may come out as one (Wilson & Latombe, "Geometric reasoning about mechanical assembly", 1994).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from vpframe.planning import certify, ways
from vpframe.planning.assembly import Array, Assembly, Budget
from vpframe.planning.certify import PathClearance
from vpframe.planning.ways import RemovalPath

Unit = tuple[int, ...]
"""parts that move as one"""
SIMPLEST: Final = ("straight", "screw", "slide", "free")
SMALLEST_GROUPS: Final = 6
"""how many groups that come out are weighed against each other"""


@dataclass(frozen=True, eq=False)
class KnownPath:
    """A path of a unit, and its blockers among all parts."""

    unit: Unit
    way: RemovalPath
    blockers: frozenset[int]
    length: float
    """m, of its straight part"""
    carried: Mapping[Unit, frozenset[int]] = field(default_factory=dict)
    """blocking units screwed onto it that it may carry, each with its own blockers"""


@dataclass(frozen=True, eq=False)
class RemovalStep:
    """The removal of a unit."""

    unit: Unit
    way: RemovalPath
    clearance: PathClearance
    after: frozenset[int]
    """parts that have to be gone before"""
    scope: frozenset[int]
    """parts that there were: of a group that is taken apart by itself, its parts"""


class Ways:
    """Straight and screw paths of units with their blockers, cached."""

    def __init__(self, assembly: Assembly, budget: Budget, motion: str, clearance: float) -> None:
        self.assembly, self.budget, self.motion, self.clearance = assembly, budget, motion, clearance
        self.larger = False
        """whether `free` counts ways by which the larger part of a thread turns, not the smaller"""
        self._ways: dict[Unit, list[RemovalPath]] = {}
        self._known: dict[tuple[Unit, int], KnownPath] = {}
        self._wide: dict[tuple[Unit, tuple[bytes, ...], frozenset[int]], PathClearance] = {}

    def _others(self, unit: Unit) -> list[int]:
        return [j for j in range(len(self.assembly)) if j not in unit]

    def _candidates(self, unit: Unit) -> list[RemovalPath]:
        """Paths of a unit among all parts, the simplest and shortest first."""
        if unit not in self._ways:
            others = self._others(unit)
            cone, _ = ways.cone_of(self.assembly, unit, others)
            found = [
                ways.straight(self.assembly, unit, others, direction)
                for direction in ways.directions(self.assembly, unit, others, cone)
            ]
            if self.motion != "straight":
                found += ways.screws(self.assembly, unit, others)
            self._ways[unit] = sorted(found, key=_simplest)
        return self._ways[unit]

    def straight_directions(self, unit: Unit) -> list[Array]:
        """(3,) unit vectors, along which straight ways of a unit are looked for."""
        return [way.direction for way in self._candidates(unit) if way.motion == "straight"]

    def directions_of(self, units: Iterable[Unit]) -> list[Array]:
        """The same of several units, each once."""
        return ways.distinct(d for unit in units for d in self.straight_directions(unit))

    def of(self, unit: Unit, units: Iterable[Unit], larger: bool = False) -> tuple[KnownPath, ...]:
        """Paths of a unit, with the blockers of each, and the units among `units` that it may carry.

        larger: only screw paths on which the larger part of a thread turns; else all others.
        """
        smaller = self._screwed_on(unit, units)
        found = (self._with_blockers(unit, way) for way in self._candidates(unit) if way.larger == larger)
        return tuple(
            replace(known, carried=self._carried(known, smaller)) if known.way.motion == "straight" else known
            for known in found
        )

    def turns_as_larger(self, unit: Unit) -> bool:
        """Whether there are ways by which a unit turns as the larger part of a thread."""
        return any(way.larger for way in self._candidates(unit))

    def _screwed_on(self, unit: Unit, units: Iterable[Unit]) -> list[Unit]:
        """Units smaller than a unit that share a thread with it."""
        size = sum(map(self.assembly.size, unit))
        return [
            other
            for other in units
            if other != unit
            and sum(map(self.assembly.size, other)) < size
            and any(mate.kind == "screw" for mate in ways.mates_between(self.assembly, unit, other))
        ]

    def _carried(self, known: KnownPath, smaller: Iterable[Unit]) -> dict[Unit, frozenset[int]]:
        direction = known.way.direction
        return {
            other: frozenset(j for j in self._others(other) if self.blocked(other, j, direction))
            for other in smaller
            if set(other) & known.blockers
        }

    def together(self, known: KnownPath, carried: Sequence[Unit]) -> KnownPath:
        """A straight path of a unit together with the units that it carries."""
        if not carried:
            return known
        unit = tuple(sorted({*known.unit, *(i for other in carried for i in other)}))
        way = ways.straight(self.assembly, unit, self._others(unit), known.way.direction)
        blockers = known.blockers.union(*(known.carried[other] for other in carried)) - set(unit)
        return KnownPath(unit, way, blockers, way.length)

    def _with_blockers(self, unit: Unit, way: RemovalPath) -> KnownPath:
        key = unit, id(way)
        if key not in self._known:
            blockers = frozenset(j for j in self._others(unit) if self._stands_in(unit, way, j))
            self._known[key] = KnownPath(unit, way, blockers, way.length)
        return self._known[key]

    def _stands_in(self, unit: Unit, way: RemovalPath, j: int) -> bool:
        if way.motion == "straight":
            return self.blocked(unit, j, way.direction)
        before = self.assembly.sweeps.count
        out = any(self.assembly.stop(i, j, way.knots) is not None for i in unit)
        self.budget.ask(self.assembly.sweeps.count - before)
        return out

    def blocked(self, unit: Unit, j: int, direction: Array) -> bool:
        """Whether part j stops any part of a unit on its straight way along a direction."""
        before = self.assembly.sweeps.count
        out = any(self.assembly.straight(i, j, direction) is not None for i in unit)
        self.budget.ask(self.assembly.sweeps.count - before)
        return out

    def add(self, unit: Unit, way: RemovalPath) -> KnownPath:
        """Store a path found by a search, with its blockers among all parts."""
        self._candidates(unit)
        self._ways[unit].append(way)
        return self._with_blockers(unit, way)

    def in_the_way(self, unit: Unit, present: Set[int]) -> frozenset[int]:
        """Parts still there in the straight way that fewest are known to be in; nothing is swept."""
        static = sorted(set(present) - set(unit))
        known = [
            frozenset(j for j in static if any(self.assembly.known_stop(i, j, direction) for i in unit))
            for direction in self.straight_directions(unit)
        ]
        return min(filter(None, known), key=lambda by: (len(by), sorted(by)), default=frozenset())

    def free(self, unit: Unit, present: Set[int]) -> KnownPath | None:
        """The simplest, then shortest, way of a unit that no part still there blocks, and that is wide enough.

        A way is left at the first part that blocks it; what is found is kept.
        """
        static = sorted(set(present) - set(unit))
        for way in self._candidates(unit):
            if way.larger and not self.larger:
                continue
            if any(self._stands_in(unit, way, j) for j in static):
                continue
            known = self._with_blockers(unit, way)
            if not self.clearance or self.clearance_of(known, frozenset(static)).distance >= self.clearance:
                return known
        return None

    def clearance_of(self, known: KnownPath, static: Set[int]) -> PathClearance:
        """The least clearance of a way among parts that do not block it."""
        key = _key(known, static)
        if key not in self._wide:
            self._wide[key] = certify.least_clearance(
                self.assembly, known.unit, sorted(static), known.way.knots, self.clearance
            )
        return self._wide[key]

    def keep_clearance(self, known: KnownPath, static: Set[int], found: PathClearance) -> None:
        """Keep a clearance that a worker measured."""
        self._wide[_key(known, static)] = found

    def step(self, known: KnownPath, present: Set[int], scope: Set[int]) -> RemovalStep:
        """The step that takes a unit out along a way while some parts of a scope are still there."""
        static = frozenset(present) - set(known.unit)
        after = known.blockers & frozenset(scope)
        return RemovalStep(known.unit, known.way, self.clearance_of(known, static), after, frozenset(scope))


def _key(known: KnownPath, static: Set[int]) -> tuple[Unit, tuple[bytes, ...], frozenset[int]]:
    return known.unit, tuple(k.homogeneous.tobytes() for k in known.way.knots), frozenset(static)


def _simplest(way: RemovalPath) -> tuple[int, float]:
    return SIMPLEST.index(way.motion), round(way.length, 9)


def groups(all_ways: Ways, units: Sequence[Unit], base: Set[int]) -> list[KnownPath]:
    """Groups of units that come out together, straight, from among all of `units`; the best first.

    In the blocking graph of a direction a strong component that leads to no other moves freely along it. The best are
    those whose parts contacts join, then the smallest. Parts of `base` stay.
    """
    assembly = all_ways.assembly
    present = frozenset(i for unit in units for i in unit)
    tried = all_ways.directions_of(units)
    found: dict[Unit, KnownPath] = {}
    for direction in tried:
        for members in free_components(all_ways, units, direction):
            unit = tuple(sorted(i for k in members for i in units[k]))
            if base & set(unit) or unit in found or len(unit) == len(present):
                continue
            others = [j for j in range(len(assembly)) if j not in unit]
            way = ways.straight(assembly, unit, others, direction)
            blockers = frozenset(j for j in others if all_ways.blocked(unit, j, direction))
            found[unit] = KnownPath(unit, way, blockers, way.length)
    ranked = sorted(found.values(), key=lambda g: (not _joined(assembly, g.unit), len(g.unit), g.unit))
    return ranked[:SMALLEST_GROUPS]


def free_components(all_ways: Ways, units: Sequence[Unit], direction: Array) -> list[list[int]]:
    """Places of the units of each strong component that no other unit blocks along a direction."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    n = len(units)
    blocked = np.zeros((n, n), bool)
    for a, unit in enumerate(units):
        for b, other in enumerate(units):
            blocked[a, b] = a != b and any(all_ways.blocked(unit, j, direction) for j in other)
    count, label = connected_components(coo_matrix(blocked), directed=True, connection="strong")
    out = []
    for k in range(count):
        members = np.flatnonzero(label == k)
        if not blocked[np.ix_(members, label != k)].any():
            out.append(members.tolist())
    return out


def _joined(assembly: Assembly, unit: Unit) -> bool:
    """Whether contacts or fits join all parts of a unit."""
    reached, queue = {unit[0]}, [unit[0]]
    while queue:
        i = queue.pop()
        for j in unit:
            if j not in reached and (assembly.mates_of(i, j) or assembly.patches(i, j)):
                reached.add(j)
                queue.append(j)
    return len(reached) == len(unit)


def levels(steps: Sequence[RemovalStep]) -> tuple[int, ...]:
    """Level of each step, from 0: one more than the highest level among the steps that must precede it."""
    level: dict[int, int] = {}
    out = []
    for step in steps:
        mine = 1 + max((level[j] for j in step.after | set(step.unit) if j in level), default=-1)
        out.append(mine)
        for i in step.unit:
            level[i] = mine
    return tuple(out)


def needed(steps: Sequence[RemovalStep], target: int) -> list[RemovalStep]:
    """Drop steps that the target does not depend on."""
    wanted: set[int] = {target}
    kept: list[RemovalStep] = []
    for step in reversed(steps):
        if wanted & set(step.unit):
            kept.append(step)
            wanted |= step.after
    return kept[::-1]
