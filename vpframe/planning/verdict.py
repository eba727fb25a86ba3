"""Take one part (or a group that moves as one) out from among the others: the way, or why there is none.

Ways are tried from the cheapest to the dearest: straight, along threads, pushed until something stops them (`slide`),
and sampled in six freedoms (`tree`). Each way that is returned was swept, leg by leg, by sweeps that are never late.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, Final, Literal, TypeVar

import numpy as np

from collision import Stop
from constraints.freedom.escape import EscapeCone, Lock
from vpframe.analysis.fits import PressFit
from vpframe.planning import certify, enclosure, slide, tree, ways
from vpframe.planning.assembly import CLEAR, Assembly, Budget, BudgetError, Overlap
from vpframe.planning.certify import PartTrack, PathClearance
from vpframe.planning.pushes import SearchResult
from vpframe.planning.ways import RemovalPath
from vpframe.scene.subassembly import listed

Verdict = Literal["removable", "held", "locked", "enclosed", "not found"]
Motion = Literal["straight", "mates", "free"]
"""paths tried: straight; also along threads and contacts; also in six freedoms"""
Joint = TypeVar("Joint", Overlap, PressFit)
JAMMED: Final = "any way"
"""`Tried.way` of a shaft that clashes with its bore: no motion is tried"""
MOTIONS: Final[tuple[Motion, ...]] = ("straight", "mates", "free")


@dataclass(frozen=True)
class Tried:
    """A path that was tried and is blocked."""

    way: str
    stopped_by: tuple[str, ...]
    """parts, in the order of the scene"""
    surfaces: tuple[tuple[str, int, str, int], ...]
    """part, surface, part, surface: contacts of the stop; of a search, of its last stop"""
    reached: float
    """path length up to the stop, m; of a search, the largest displacement"""
    why: str = ""
    """the reason in words, if it is not these parts"""


@dataclass(frozen=True)
class LockProof:
    """Surfaces that allow a part no motion: their contact rows with positive multipliers add up to exactly zero."""

    surfaces: tuple[tuple[str, int, str, int], ...]
    """part, surface, part, surface"""
    multipliers: tuple[Fraction, ...]
    margin: float
    """1: see `constraints.freedom.escape.Lock`"""
    tolerance: float
    """m: surfaces at most this far apart count as touching"""
    cone: EscapeCone = field(repr=False)
    lock: Lock = field(repr=False)


@dataclass(frozen=True, eq=False)
class Removal:
    """The removal of a group of parts: its path, or the reasons why none was found."""

    parts: tuple[str, ...]
    verdict: Verdict
    way: RemovalPath | None = None
    """where it is removable; of "held", if there were no overlaps as drawn"""
    tracks: dict[str, PartTrack] = field(default_factory=dict)
    """by part, where it is removable"""
    clearance: PathClearance | None = None
    blockers: tuple[str, ...] = ()
    """blockers along the least-obstructed direction, if no path was found; the enclosing parts"""
    holders: tuple[str, ...] = ()
    """parts assumed by the proof of "locked" or "enclosed": it holds while these stay at their poses"""
    ended: str = ""
    """the budget that was used up (`Budget.ended`), if no path was found within it"""
    tried: tuple[Tried, ...] = ()
    proof: LockProof | None = None
    overlaps: tuple[Overlap, ...] = ()
    """of these parts with others at the initial poses: never deepened"""
    clashes: tuple[Overlap, ...] = ()
    """of "held": overlaps as drawn without which these parts come out along `way`, once `blockers` are gone"""
    press_fits: tuple[PressFit, ...] = ()
    """of these parts with others at the initial poses: the path keeps their axes; their force is not checked"""
    questions: int = 0
    """sweeps and intersection tests computed"""
    seconds: float = 0.0
    """processor time used by the search, s"""

    @property
    def last(self) -> tuple[tuple[str, int, str, int], ...]:
        """Part, surface, part, surface: the contacts that stopped the last motion tried."""
        return next((t.surfaces for t in reversed(self.tried) if t.surfaces), ())

    @property
    def track(self) -> PartTrack | None:
        """Of the first part."""
        return self.tracks.get(self.parts[0])

    def __bool__(self) -> bool:
        return self.verdict == "removable"


def find(
    assembly: Assembly,
    group: Sequence[int],
    others: Iterable[int],
    budget: Budget,
    motion: Motion = "free",
    clearance: float = 0.0,
    seed: int = 0,
) -> Removal:
    """Search a path on which a group comes out from among static others.

    Parameters
    ----------
    group, others: indices of parts.
    clearance: least distance of surfaces on the path, except of those that are nearer at its start, m.
    seed: of the sampling.
    """
    search = _Search(assembly, tuple(group), tuple(others), budget, clearance, seed)
    before, began = assembly.sweeps.count, budget.spent
    found = search.run(motion)
    return replace(found, questions=assembly.sweeps.count - before, seconds=budget.spent - began)


class _Search:
    def __init__(
        self, assembly: Assembly, group: tuple[int, ...], others: tuple[int, ...], budget: Budget, clearance: float,
        seed: int,
    ) -> None:  # fmt: skip
        self.assembly, self.group, self.others = assembly, group, others
        self.budget, self.clearance, self.seed = budget, clearance, seed
        self.tried: list[Tried] = []
        self.ended = ""
        self.names = tuple(assembly.names[i] for i in group)

    def run(self, motion: Motion) -> Removal:
        if not self.others:
            return self._removable(
                RemovalPath("straight", ways.AXES[0], ways.straight(self.assembly, self.group, (), ways.AXES[0]).knots)
            )
        jammed = tuple(self.assembly.names[j] for j in self.others if any(self.assembly.jams(i, j) for i in self.group))
        if jammed:
            self.tried.append(Tried(JAMMED, jammed, (), 0.0, f"a shaft clashes with its bore: {listed(jammed)}"))
            return self._no("not found")
        cone, faces = ways.cone_of(self.assembly, self.group, self.others)
        try:
            way = self.straight(cone) or self.along_threads(motion)
            if way is not None:
                return way
            proof = self.locked(cone, faces)
            if proof is not None:
                return self._no("locked", [self.assembly.scene.index(s[2]) for s in proof.surfaces], proof)
            by = enclosure.enclosed_by(self.assembly, self.group, self.others)
            if by is not None:
                return self._no("enclosed", (by,))
            held = enclosure.caged_by(self.assembly, self.group, self.others)
            if held is not None:
                return self._no("enclosed", held)
            if motion != "straight":
                return self.searched(cone, motion) or self._no("not found")
        except BudgetError:
            self.ended = self.budget.ended
            self.tried.append(Tried("budget", (), (), 0.0, f"the budget of {self.ended} was used up"))
        return self._no("not found")

    def straight(self, cone: EscapeCone) -> Removal | None:
        """The shortest straight way."""
        free: list[tuple[float, int, RemovalPath]] = []
        for direction in ways.directions(self.assembly, self.group, self.others, cone):
            way = ways.straight(self.assembly, self.group, self.others, direction)
            if self._passes_straight(way):
                length = float(np.linalg.norm(way.knots[-1].translation))
                free.append((round(length, 9), len(free), way))
        for _, _, way in sorted(free, key=lambda entry: entry[:2]):
            found = self._wide_enough(way)
            if found is not None:
                return found
        return None

    def _stops(self, stop: Callable[[int, int], Stop | None]) -> Iterator[tuple[int, int, Stop]]:
        """Yield (part of the group, blocker, stop) for each blocked pair, within the budget."""
        for i in self.group:
            for j in self.others:
                before = self.assembly.sweeps.count
                found = stop(i, j)
                self.budget.ask(self.assembly.sweeps.count - before)
                if found is not None:
                    yield i, j, found

    def _passes_straight(self, way: RemovalPath) -> bool:
        stops = list(self._stops(lambda i, j: self.assembly.straight(i, j, way.direction)))
        if stops:
            # each pair is swept until it is apart, which may be sooner than the group is from all
            far = [self.assembly.sweeps.length_until_apart(i, j, way.direction) + CLEAR for i, j, _ in stops]
            reached = min(stop.t * length for (_, _, stop), length in zip(stops, far, strict=True))
            self._note(way.text, stops, reached)
        return not stops

    def along_threads(self, motion: Motion) -> Removal | None:
        """The removal along a thread; None for straight motion."""
        if motion == "straight":
            return None
        for way in ways.screws(self.assembly, self.group, self.others):
            if self.passes(way):
                found = self._wide_enough(way)
                if found is not None:
                    return found
        return None

    def passes(self, way: RemovalPath) -> bool:
        """Whether no part stops the group on a path; stops are recorded."""
        stops = list(self._stops(lambda i, j: self.assembly.stop(i, j, way.knots)))
        if stops:
            first = min(stop.leg + stop.t for _, _, stop in stops)
            leg = int(first)
            at = way.knots[leg].actInv(way.knots[min(leg + 1, len(way.knots) - 1)])
            before = replace(way, knots=way.knots[: leg + 1]).length
            reached = before + (first - leg) * float(np.linalg.norm(at.translation))
            self._note(way.text, stops, reached)
        return not stops

    def _note(self, text: str, stops: list, reached: float) -> None:  # type: ignore[type-arg]
        names = self.assembly.names
        by = sorted({j for _, j, _ in stops})
        faces = sorted(
            {(i, int(r["surface_a"]), j, int(r["surface_b"])) for i, j, stop in stops for r in stop.contacts}
        )
        surfaces = tuple((names[i], a, names[j], b) for i, a, j, b in faces)
        held = [names[j] for _, j, stop in stops if not len(stop.contacts)]
        why = f"held by the drawn thread in {listed(held)}" if held else ""
        self.tried.append(Tried(text, tuple(names[j] for j in by), surfaces, reached, why))

    def _wide_enough(self, way: RemovalPath) -> Removal | None:
        """The removal along a free path, unless its clearance is too small."""
        found = certify.least_clearance(self.assembly, self.group, self.others, way.knots, self.clearance)
        if found.distance < self.clearance:
            assert found.parts is not None and found.surfaces is not None
            names = self.assembly.names
            pair = (names[found.parts[0]], found.surfaces[0], names[found.parts[1]], found.surfaces[1])
            why = f"clearance {found.distance * 1e3:.3g} mm is less than {self.clearance * 1e3:.3g} mm"
            self.tried.append(Tried(way.text, (pair[2],), (pair,), 0.0, why))
            return None
        return self._removable(way, found)

    def _removable(self, way: RemovalPath, clearance: PathClearance | None = None) -> Removal:
        tracks = {self.assembly.names[i]: certify.track(self.assembly.poses[i], way.knots) for i in self.group}
        return self._result("removable", way=way, tracks=tracks, clearance=clearance or PathClearance(np.inf))

    def _result(self, verdict: Verdict, **known: Any) -> Removal:
        overlaps, press_fits = self._between(self.assembly.overlaps), self._between(self.assembly.press_fits)
        return Removal(
            self.names, verdict, tried=tuple(self.tried), overlaps=overlaps, press_fits=press_fits, **known
        )  # fmt: skip

    def _no(self, verdict: Verdict, holders: Iterable[int] = (), proof: LockProof | None = None) -> Removal:
        held = tuple(self.assembly.names[j] for j in sorted(set(holders)))
        stopped = [t.stopped_by for t in self.tried if t.stopped_by]
        blockers = min(stopped, key=lambda by: (len(by), by), default=())
        if verdict == "enclosed":
            blockers = held
        return self._result(verdict, blockers=blockers, holders=held, ended="" if held else self.ended, proof=proof)

    def _between(self, found: Iterable[Joint]) -> tuple[Joint, ...]:
        """The overlaps or press fits between the group and the others."""
        mine, theirs = set(self.names), {self.assembly.names[j] for j in self.others}
        return tuple(o for o in found if mine & set(o.parts) and theirs & set(o.parts))

    def locked(self, cone: EscapeCone, faces: Sequence[tuple[int, int, int, int]]) -> LockProof | None:
        """The proof that contacts allow the group no motion, None without one."""
        lock = cone.lock()
        if lock is None:
            return None
        names = self.assembly.names
        surfaces = tuple((names[i], a, names[j], b) for i, a, j, b in (faces[k] for k in lock.rows))
        return LockProof(surfaces, lock.multipliers, lock.margin, self.assembly.tolerance.linear, cone, lock)

    def searched(self, cone: EscapeCone, motion: Motion) -> Removal | None:
        """The removal found by pushes, then by sampling."""
        found = slide.search(self.assembly, self.group, self.others, cone, self.budget)
        self._note_search("slide", found)
        if found.way is None and motion == "free":
            found = tree.search(self.assembly, self.group, self.others, cone, self.budget, self.seed)
            self._note_search("free", found)
        return None if found.way is None else self._wide_enough(found.way)

    def _note_search(self, way: str, found: SearchResult) -> None:
        self.ended = found.ended
        why = f"the budget of {found.ended} was used up" if found.ended else ""
        names = self.assembly.names
        last = tuple((names[i], a, names[j], b) for i, a, j, b in found.last)
        self.tried.append(Tried(way, tuple(names[j] for j in found.stopped_by), last, found.reached, why))
