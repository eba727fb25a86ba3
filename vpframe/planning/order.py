"""Order of removal: greedy peeling along known paths, and groups where single parts block each other.

Removing a part never blocks another, so peeling what is free until nothing is finds every part that the known ways can
take out one at a time. Where single parts do not come out, the strong components of the blocking graph of a direction
may come out as one (Wilson & Latombe, "Geometric reasoning about mechanical assembly", 1994).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from copy import copy
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
ALIKE: Final = 1e-6
"""1: unit vectors that differ by less are one direction"""
MOST_DIRECTIONS: Final = 24
"""along which groups are looked for"""
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
        self.waived: Mapping[frozenset[int], float] = {}
        """m: depths to which pairs of parts may get into each other"""
        self.waits: dict[Unit, frozenset[int]] = {}
        """of each unit that was not `free`: parts, of each of its ways one that blocks it"""
        self._ways: dict[Unit, list[RemovalPath]] = {}
        self._known: dict[tuple[Unit, int], KnownPath] = {}
        self._wide: dict[tuple[Unit, tuple[bytes, ...], frozenset[int]], PathClearance] = {}
        self._likely: dict[tuple[Unit, bytes], tuple[int, ...]] = {}
        self._learnt: dict[int, list[Array]] = {}
        """by shape: directions, in its frame, along which parts of this shape came out"""

    def waiving(self, depths: Mapping[frozenset[int], float]) -> Ways:
        """The same ways, as if some pairs of parts might get into each other as deep as is given, m."""
        out = copy(self)
        out.waived, out.waits, out._known, out._wide = depths, {}, {}, {}
        return out

    def _others(self, unit: Unit) -> list[int]:
        return [j for j in range(len(self.assembly)) if j not in unit]

    def _candidates(self, unit: Unit) -> list[RemovalPath]:
        """Paths of a unit among all parts, the simplest first, then the likeliest, then the shortest."""
        if unit not in self._ways:
            others = self._others(unit)
            cone, _ = ways.cone_of(self.assembly, unit, others)
            found = [
                ways.straight(self.assembly, unit, others, direction)
                for direction in ways.directions(self.assembly, unit, others, cone)
            ]
            if self.motion != "straight":
                found += ways.screws(self.assembly, unit, others)
            axis = ways.out_of(self.assembly, unit)
            self._ways[unit] = sorted(found, key=lambda way: _simplest(way, axis))
        return self._ways[unit]

    def _in_turn(self, unit: Unit) -> list[RemovalPath]:
        """The paths of a unit, those first along which another part of its shape came out."""
        found = self._candidates(unit)
        learnt = self._learnt.get(id(self.assembly.scene.parts[unit[0]].shape), ()) if len(unit) == 1 else ()
        if not learnt:
            return found
        back = self.assembly.poses[unit[0]].rotation.T

        def is_new(way: RemovalPath) -> bool:
            return not any(np.abs(back @ way.direction - known).max() <= ALIKE for known in learnt)

        return sorted(found, key=is_new)

    def learn(self, known: KnownPath) -> None:
        """Try the direction of a path first for other parts of the same shape."""
        if len(known.unit) == 1:
            (i,) = known.unit
            directions = self._learnt.setdefault(id(self.assembly.scene.parts[i].shape), [])
            direction = self.assembly.poses[i].rotation.T @ known.way.direction
            if not any(np.abs(direction - other).max() <= ALIKE for other in directions):
                directions.append(direction)

    def likely(self, unit: Unit, way: RemovalPath) -> tuple[int, ...]:
        """Parts that may block a path, the likeliest first: they hold the unit, touch it against the path, or are near.

        All other parts certainly do not.
        """
        key = unit, way.direction.tobytes() if way.motion == "straight" else b"%d" % id(way)
        if key not in self._likely:
            assembly, held = self.assembly, set[int]()
            against: dict[int, float] = {}
            for i in unit:
                if way.motion == "straight":
                    met = assembly.sweeps.ahead(i, way.direction)
                else:
                    met = assembly.sweeps.beside(i, way.knots)
                for j in {*met.tolist(), *(k for k in assembly.partners[i] if self._holds(i, k))} - set(unit):
                    touching = assembly.patches(i, j) if j in assembly.partners[i] else ()
                    pushed = [float((patch.normals @ way.direction).min()) for patch in touching]
                    against[j] = min([against.get(j, 0.0), *pushed])
                    if self._holds(i, j) or frozenset((i, j)) in assembly.clashing:
                        held.add(j)
            back = min(assembly.sweeps.extent(i, way.direction)[0] for i in unit)
            gap = {j: max(0.0, assembly.sweeps.extent(j, way.direction)[0] - back) for j in against}
            self._likely[key] = tuple(sorted(against, key=lambda j: (j not in held, round(against[j], 6), gap[j], j)))
        return self._likely[key]

    def _holds(self, i: int, j: int) -> bool:
        """Whether a drawn thread, or a clash of a shaft with its bore, holds two parts together."""
        return any(mate.drawn for mate in self.assembly.mates_of(i, j)) or bool(self.assembly.jams(i, j))

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
            blockers = frozenset(j for j in self.likely(unit, way) if self._stands_in(unit, way, j))
            self._known[key] = KnownPath(unit, way, blockers, way.length)
        return self._known[key]

    def _stands_in(self, unit: Unit, way: RemovalPath, j: int) -> bool:
        """Whether part j, of those that are `likely`, stops any part of a unit on a path."""
        before = self.assembly.sweeps.count
        out = any(self._stops(i, way, j) for i in unit)
        self.budget.ask(self.assembly.sweeps.count - before)
        return out

    def _stops(self, i: int, way: RemovalPath, j: int) -> bool:
        assembly, straight = self.assembly, way.motion == "straight"
        stop = assembly.straight(i, j, way.direction) if straight else assembly.stop(i, j, way.knots)
        depth = self.waived.get(frozenset((i, j)))
        if stop is None or depth is None:
            return stop is not None
        knots = ways.straight(assembly, (i,), (j,), way.direction).knots if straight else way.knots
        return assembly.deepens(i, j, knots, depth)

    def blocked(self, unit: Unit, j: int, direction: Array) -> bool:
        """Whether part j stops any part of a unit on its straight way along a direction."""
        return self.stands_in(KnownPath(unit, RemovalPath("straight", direction, ()), frozenset(), 0.0), j)

    def first_blocker(self, unit: Unit, way: RemovalPath, present: Set[int]) -> int | None:
        """A part present that blocks a path of a unit; None if there is none."""
        return next((j for j in self.likely(unit, way) if j in present and self._stands_in(unit, way, j)), None)

    def stands_in(self, known: KnownPath, j: int) -> bool:
        """Whether part j blocks a path."""
        return j in self.likely(known.unit, known.way) and self._stands_in(known.unit, known.way, j)

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
        """The simplest, then likeliest, then shortest way of a unit that no part still there blocks, and that is wide
        enough.

        A way is left at the first part that blocks it; `waits` keeps these parts.
        """
        waits = set[int]()
        for way in self._in_turn(unit):
            if way.larger and not self.larger:
                continue
            by = self.first_blocker(unit, way, present)
            if by is not None:
                waits.add(by)
                continue
            known = self._with_blockers(unit, way)
            if not self.clearance:
                return known
            near = self.clearance_of(known, frozenset(set(present) - set(unit)))
            if near.distance >= self.clearance:
                return known
            waits |= set(near.parts or ()) - set(unit)
        self.waits[unit] = frozenset(waits)
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


def _simplest(way: RemovalPath, axis: Array | None) -> tuple[int, bool, float]:
    along = axis is not None and bool(np.abs(way.direction - axis).max() <= ALIKE)
    return SIMPLEST.index(way.motion), not along, round(way.length, 9)


def groups(all_ways: Ways, units: Sequence[Unit], base: Set[int]) -> list[KnownPath]:
    """Groups of units that come out together, straight, from among all of `units`; the best first.

    In the blocking graph of a direction a strong component that leads to no other moves freely along it. The best are
    those whose parts contacts join, then the smallest. Parts of `base` stay.
    """
    assembly = all_ways.assembly
    present = frozenset(i for unit in units for i in unit)
    found: dict[Unit, KnownPath] = {}
    for direction in group_directions(all_ways, units):
        for unit in free_components(all_ways, units, base, direction):
            if unit in found or len(unit) == len(present):
                continue
            others = [j for j in range(len(assembly)) if j not in unit]
            way = ways.straight(assembly, unit, others, direction)
            blockers = frozenset(j for j in others if all_ways.blocked(unit, j, direction))
            found[unit] = KnownPath(unit, way, blockers, way.length)
    ranked = sorted(found.values(), key=lambda g: (not _joined(assembly, g.unit), len(g.unit), g.unit))
    return ranked[:SMALLEST_GROUPS]


def group_directions(all_ways: Ways, units: Iterable[Unit]) -> list[Array]:
    """Directions along which groups are looked for: those that most units have in common."""
    found: dict[tuple[float, ...], Array] = {}
    count = Counter[tuple[float, ...]]()
    for unit in units:
        for direction in all_ways.straight_directions(unit):
            key = tuple((np.round(direction, 6) + 0.0).tolist())
            found.setdefault(key, direction)
            count[key] += 1
    return [found[key] for key, _ in count.most_common(MOST_DIRECTIONS)]


def free_components(all_ways: Ways, units: Sequence[Unit], base: Set[int], direction: Array) -> list[Unit]:
    """The parts of each strong component of the units that no other unit blocks along a direction; none of the base.

    A unit that leads to the base belongs to no such component. Most do, and one part in their way shows it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    stay, left = {i for unit in units if base & set(unit) for i in unit}, [u for u in units if not base & set(u)]
    way = RemovalPath("straight", direction, ())
    while new := {unit for unit in left if all_ways.first_blocker(unit, way, stay) is not None}:
        stay |= {i for unit in new for i in unit}
        left = [unit for unit in left if unit not in new]
    n = len(left)
    blocked = np.zeros((n, n), bool)
    for a, unit in enumerate(left):
        for b, other in enumerate(left):
            blocked[a, b] = a != b and any(all_ways.blocked(unit, j, direction) for j in other)
    count, label = connected_components(coo_matrix(blocked), directed=True, connection="strong")
    out = []
    for k in range(count):
        members = np.flatnonzero(label == k)
        if not blocked[np.ix_(members, label != k)].any():
            out.append(tuple(sorted(i for m in members for i in left[m])))
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
