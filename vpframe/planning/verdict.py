"""Take one part (or a group that moves as one) out from among the others: the way, or why there is none.

Ways are tried from the cheapest to the dearest: straight, along threads, pushed until something stops them (`slide`),
and sampled in six freedoms (`tree`). Each way that is returned was swept, leg by leg, by sweeps that are never late.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Final, Literal, TypeVar

import numpy as np

from collision.query.blocking import Stop
from constraints.freedom.escape import EscapeCone, Lock
from vpframe.analysis.fits import PressFit
from vpframe.planning import certify, enclosure, slide, tree, ways
from vpframe.planning.assembly import CLEAR, Array, Assembly, Budget, BudgetError, Overlap
from vpframe.planning.certify import Clearance, Track
from vpframe.planning.pushes import Found
from vpframe.planning.ways import Way
from vpframe.scene.subassembly import listed

Verdict = Literal["removable", "locked", "enclosed", "not found"]
Motion = Literal["straight", "mates", "free"]
"""what is tried: straight ways; threads and pushes along what is touched, too; six freedoms, too"""
Joint = TypeVar("Joint", Overlap, PressFit)
JAMMED: Final = "any way"
"""way of what is tried with a part that clashes with another, a shaft in a bore: it does not move"""
MOTIONS: Final[tuple[Motion, ...]] = ("straight", "mates", "free")


@dataclass(frozen=True)
class Tried:
    """A way that was tried and does not lead out."""

    way: str
    stopped_by: tuple[str, ...]
    """parts, in the order of the scene"""
    surfaces: tuple[tuple[str, int, str, int], ...]
    """part, surface, part, surface that meet there"""
    reached: float
    """m: how far it came"""
    why: str = ""
    """in words, where it is not those parts"""


@dataclass(frozen=True)
class LockProof:
    """Surfaces that leave a part no motion: with positive multipliers their contact rows add up to exactly zero."""

    surfaces: tuple[tuple[str, int, str, int], ...]
    """part, surface, part, surface"""
    multipliers: tuple[Fraction, ...]
    margin: float
    """1: see `constraints.freedom.escape.Lock`"""
    tolerance: float
    """m: surfaces this near were taken as touching"""
    cone: EscapeCone = field(repr=False)
    lock: Lock = field(repr=False)


@dataclass(frozen=True, eq=False)
class Removal:
    """What came of taking a group of parts out."""

    parts: tuple[str, ...]
    verdict: Verdict
    way: Way | None = None
    """where it is removable"""
    tracks: dict[str, Track] = field(default_factory=dict)
    """by part, where it is removable"""
    clearance: Clearance | None = None
    blockers: tuple[str, ...] = ()
    """parts in the way of the straight way that fewest are in, where none leads out; what a part is enclosed by"""
    holders: tuple[str, ...] = ()
    """parts that the proof of "locked" or "enclosed" is about: it holds while these stay where they are"""
    ended: str = ""
    """the budget that was used up (`Budget.ended`), where nothing was found within it"""
    tried: tuple[Tried, ...] = ()
    proof: LockProof | None = None
    overlaps: tuple[Overlap, ...] = ()
    """of these parts with others, as they stand: never deepened"""
    press_fits: tuple[PressFit, ...] = ()
    """of these parts with others, as they stand: the way keeps them to their axes; their force is not checked"""
    questions: int = 0
    """sweeps and tests that were asked"""

    @property
    def track(self) -> Track | None:
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
    """Take a group out from among others, all where they stand; nothing else moves.

    Parameters
    ----------
    group, others: places of parts.
    budget: of questions.
    clearance: m: surfaces that are not as near where the parts stand keep it all the way.
    seed: of the sampling.
    """
    search = _Search(assembly, tuple(group), tuple(others), budget, clearance, seed)
    before = assembly.sweeps.count
    found = search.run(motion)
    return replace(found, questions=assembly.sweeps.count - before)


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
                Way("straight", ways.AXES[0], ways.straight(self.assembly, self.group, (), ways.AXES[0]).knots)
            )
        jammed = tuple(self.assembly.names[j] for j in self.others if any(self.assembly.jams(i, j) for i in self.group))
        if jammed:
            self.tried.append(Tried(JAMMED, jammed, (), 0.0, f"a shaft clashes with its bore: {listed(jammed)}"))
            return self._no("not found")
        cone, told = ways.cone_of(self.assembly, self.group, self.others)
        try:
            way = self.straight(cone) or self.along_threads(motion)
            if way is not None:
                return way
            proof = self.locked(cone, told)
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
        free: list[tuple[float, int, Way]] = []
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
        """Part of the group, what stops it, and where; each pair is asked in turn, within the budget."""
        for i in self.group:
            for j in self.others:
                before = self.assembly.sweeps.count
                found = stop(i, j)
                self.budget.ask(self.assembly.sweeps.count - before)
                if found is not None:
                    yield i, j, found

    def _passes_straight(self, way: Way) -> bool:
        stops = list(self._stops(lambda i, j: self.assembly.straight(i, j, way.direction)))
        if stops:
            # each pair is swept until it is apart, which may be sooner than the group is from all
            far = [self.assembly.sweeps.length_until_apart(i, j, way.direction) + CLEAR for i, j, _ in stops]
            reached = min(stop.t * length for (_, _, stop), length in zip(stops, far, strict=True))
            self._note(way.text, stops, reached)
        return not stops

    def along_threads(self, motion: Motion) -> Removal | None:
        """Along threads; not where only straight ways are asked for."""
        if motion == "straight":
            return None
        for way in ways.screws(self.assembly, self.group, self.others):
            if self.passes(way):
                found = self._wide_enough(way)
                if found is not None:
                    return found
        return None

    def passes(self, way: Way) -> bool:
        """Whether nothing stops the group on a way; what does is noted."""
        stops = list(self._stops(lambda i, j: self.assembly.stop(i, j, way.knots)))
        if stops:
            first = min(stop.leg + stop.t for _, _, stop in stops)
            leg = int(first)
            at = way.knots[leg].actInv(way.knots[min(leg + 1, len(way.knots) - 1)])
            reached = sum(
                float(np.linalg.norm(b.translation - a.translation))
                for a, b in zip(way.knots[:leg], way.knots[1 : leg + 1], strict=True)
            ) + (first - leg) * float(np.linalg.norm(at.translation))
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

    def _wide_enough(self, way: Way) -> Removal | None:
        """The removal along a way that nothing stops, unless its clearance is too small."""
        found = certify.least_clearance(self.assembly, self.group, self.others, way.knots, self.clearance)
        if found.distance < self.clearance:
            assert found.parts is not None and found.surfaces is not None
            names = self.assembly.names
            pair = (names[found.parts[0]], found.surfaces[0], names[found.parts[1]], found.surfaces[1])
            why = f"clearance {found.distance * 1e3:.3g} mm is less than {self.clearance * 1e3:.3g} mm"
            self.tried.append(Tried(way.text, (pair[2],), (pair,), 0.0, why))
            return None
        return self._removable(way, found)

    def _removable(self, way: Way, clearance: Clearance | None = None) -> Removal:
        tracks = {self.assembly.names[i]: certify.track(self.assembly.poses[i], way.knots) for i in self.group}
        return Removal(
            self.names, "removable", way, tracks, clearance or Clearance(np.inf), tried=tuple(self.tried),
            overlaps=self._between(self.assembly.overlaps), press_fits=self._between(self.assembly.press_fits),
        )  # fmt: skip

    def _no(self, verdict: Verdict, holders: Iterable[int] = (), proof: LockProof | None = None) -> Removal:
        held = tuple(self.assembly.names[j] for j in sorted(set(holders)))
        stopped = [t.stopped_by for t in self.tried if t.stopped_by]
        blockers = min(stopped, key=lambda by: (len(by), by), default=())
        if verdict == "enclosed":
            blockers = held
        return Removal(
            self.names, verdict, blockers=blockers, holders=held, ended="" if held else self.ended,
            tried=tuple(self.tried), proof=proof, overlaps=self._between(self.assembly.overlaps),
            press_fits=self._between(self.assembly.press_fits),
        )  # fmt: skip

    def _between(self, found: Iterable[Joint]) -> tuple[Joint, ...]:
        """Those of some overlaps or press fits that are between the group and the others."""
        mine, theirs = set(self.names), {self.assembly.names[j] for j in self.others}
        return tuple(o for o in found if mine & set(o.parts) and theirs & set(o.parts))

    def locked(self, cone: EscapeCone, told: Sequence[tuple[int, int, int, int]]) -> LockProof | None:
        """The proof that contacts leave the group no motion."""
        lock = cone.lock()
        if lock is None:
            return None
        names = self.assembly.names
        surfaces = tuple((names[i], a, names[j], b) for i, a, j, b in (told[k] for k in lock.rows))
        return LockProof(surfaces, lock.multipliers, lock.margin, self.assembly.tolerance.linear, cone, lock)

    def searched(self, cone: EscapeCone, motion: Motion) -> Removal | None:
        """Pushed, then sampled."""
        found = slide.search(self.assembly, self.group, self.others, cone, self.budget)
        self._note_search("slide", found)
        if found.way is None and motion == "free":
            found = tree.search(self.assembly, self.group, self.others, cone, self.budget, self.seed)
            self._note_search("free", found)
        return None if found.way is None else self._wide_enough(found.way)

    def _note_search(self, way: str, found: Found) -> None:
        self.ended = found.ended
        why = f"the budget of {found.ended} was used up" if found.ended else ""
        by = tuple(self.assembly.names[j] for j in found.stopped_by)
        self.tried.append(Tried(way, by, (), found.reached, why))


def center_of(assembly: Assembly, group: Sequence[int]) -> Array:
    """(3,) middle of a group's box where it stands, world, m."""
    corners = np.concatenate([assembly.sweeps.corners(i) for i in group])
    return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
