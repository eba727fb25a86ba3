"""`removal` and `disassembly`: the entry points of planning, and the greedy planner behind them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TypedDict, Unpack

import numpy as np

from collision import Tolerance
from constraints.recognition.fasteners import NUTS, SCREWS, FastenerKind
from vpframe.analysis.fits import PressFit
from vpframe.analysis.mate_motions import Progress, silent
from vpframe.analysis.static import base_parts
from vpframe.errors import VpframeError
from vpframe.planning import order, ways
from vpframe.planning.assembly import LINEAR, Assembly, Budget, BudgetError, Overlap
from vpframe.planning.certify import PartTrack, PathClearance, track
from vpframe.planning.order import KnownPath, RemovalStep, Unit, Ways
from vpframe.planning.support import Supports
from vpframe.planning.target import SECONDS as LEAST_SECONDS
from vpframe.planning.target import Option, least
from vpframe.planning.verdict import MOTIONS, Motion, Removal, Verdict, find
from vpframe.planning.ways import RemovalPath
from vpframe.planning.workers import Task, Workers
from vpframe.scene.scene import Scene
from vpframe.scene.subassembly import name_of, parts_named

RESERVE = 0.1
"""fraction of the budget of a whole model that is kept back to explain what does not come out"""
SECONDS, SECONDS_A_PART, MOST_SECONDS = 60.0, 2.5, 300.0
"""s of processor time: the budget of a disassembly where none is given is SECONDS_A_PART for each part, within these"""
ALONE = 10.0
"""s of processor time: the budget of `removal` where none is given"""
LOOSENED = SCREWS | NUTS | {FastenerKind.WASHER, FastenerKind.CIRCLIP, FastenerKind.KEY, FastenerKind.TIE}
"""kinds of fasteners that are taken out before other parts"""
BUT_FOR = 2.0
"""1: depth on a way over that as drawn, up to which an overlap counts as all that stops it"""
NOTHING_BEFORE = "all plans: nothing has to go before it"
LEAST_SHARE, MOST_SHARE = 0.1, 0.9
"""fraction of the remaining budget for the search of one part, with many and with few parts left"""


class RemovalOptions(TypedDict, total=False):
    """Keyword arguments of `removal`, the fields of `SearchOptions`."""

    budget: float | None
    seed: int
    motion: Motion
    clearance: float
    authorise: Iterable[tuple[str, str]]
    ignore: Iterable[tuple[str, str]]
    threads: Mapping[str, float] | None
    tolerance: Tolerance | None


class DisassemblyOptions(RemovalOptions, total=False):
    """Keyword arguments of `disassembly`, the fields of `PlanOptions`."""

    base: Iterable[str]
    carry: Iterable[Sequence[str]]
    jobs: int
    known: Iterable[tuple[Sequence[str], RemovalPath]]
    progress: Progress
    found: Callable[[Sequence[str], str], None]


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How ways are searched for, and which overlaps are allowed. Raises VpframeError for a bad motion or clearance."""

    budget: float | None = None
    """s (None: ALONE, of a disassembly by the number of parts): 500 questions each, so that the same call gives
    the same answer, and at most as much processor time, counted after the analysis of the assembly"""
    seed: int = 0
    """of the sampling"""
    motion: Motion = "free"
    """"straight" ways; "mates": also along threads and pushed along contacts; "free": also in six freedoms"""
    clearance: float = 0.0
    """m: least distance of surfaces on the way, except of those that are nearer at its start"""
    authorise: Iterable[tuple[str, str]] = ()
    """pairs of part names whose overlap as drawn is intended; it is never deepened"""
    ignore: Iterable[tuple[str, str]] = ()
    """pairs of part names that may pass through each other, such as a cable and its clamp; ways that do name them"""
    threads: Mapping[str, float] | None = None
    """m a turn by part name, negative for left-hand threads: its snug fits are threads, drawn as cylinders"""
    tolerance: Tolerance | None = None
    """of recognition, as in a session: `press_fit` is the largest interference that is not a clash"""

    def __post_init__(self) -> None:
        if self.motion not in MOTIONS:
            raise VpframeError(f"motion {self.motion!r}; known are {', '.join(MOTIONS)}")
        if not 0.0 <= self.clearance < float("inf"):
            raise VpframeError(f"clearance is {self.clearance!r}; give a length of at least 0 m")

    def assembly(self, scene: Scene, progress: Progress = silent) -> Assembly:
        """The scene with its authorised and ignored pairs and its threads; names may be those of subassemblies."""
        threads = {p: pitch for name, pitch in (self.threads or {}).items() for p in parts_named(scene.names, name)}
        authorised, ignored = _pairs(scene, self.authorise), _pairs(scene, self.ignore)
        return Assembly(scene, authorised, threads, progress=progress, ignored=ignored, recognition=self.tolerance)


@dataclass(frozen=True, kw_only=True)
class PlanOptions(SearchOptions):
    """Options of a disassembly."""

    base: Iterable[str] = ()
    """parts that stay; by default the fixed ones, else the largest"""
    carry: Iterable[Sequence[str]] = ()
    """groups of parts that come out as one"""
    jobs: int = 1
    """processes; the plan is the same for any number"""
    known: Iterable[tuple[Sequence[str], RemovalPath]] = ()
    """parts and ways of an earlier plan; they are swept again before they are used"""
    progress: Progress = silent
    """callback(fraction or None, text)"""
    found: Callable[[Sequence[str], str], None] = lambda parts, text: None
    """callback(part names, way in words) for each step"""


def removal(scene: Scene, part: str | Sequence[str], **options: Unpack[RemovalOptions]) -> Removal:
    """Return how one part (or several that move as one) comes out; all others stay where they are.

    options: the fields of `SearchOptions`.

    Raises
    ------
    UnknownPartError, VpframeError: no such part, a bad number or name.
    """
    search = SearchOptions(**options)
    names = (part,) if isinstance(part, str) else tuple(part)
    group = tuple(sorted(_named(scene, names)))
    if len(set(group)) != len(group) or not names:
        raise VpframeError(f"the parts to take out are {list(names)}; name each once")
    assembly = search.assembly(scene)
    others = [j for j in range(len(assembly)) if j not in group]
    assembly.prepare()
    return find(
        assembly,
        group,
        others,
        Budget(ALONE if search.budget is None else search.budget),
        search.motion,
        search.clearance,
        search.seed,
    )


def _named(scene: Scene, names: Iterable[str]) -> tuple[int, ...]:
    """Indices of the parts with these names: of parts, of subassemblies, or the end of a path."""
    return tuple(scene.index(part) for name in names for part in parts_named(scene.names, name))


def _pairs(scene: Scene, pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    return [(a, b) for x, y in pairs for a in parts_named(scene.names, x) for b in parts_named(scene.names, y)]


@dataclass(frozen=True, eq=False)
class PlannedStep:
    """Parts that come out together."""

    parts: tuple[str, ...]
    way: RemovalPath
    tracks: dict[str, PartTrack]
    """by part"""
    clearance: PathClearance
    after: tuple[str, ...]
    """parts that have to be gone before"""
    level: int
    """steps of one level may go side by side"""
    unsupported: tuple[str, ...] = ()
    """remaining parts that lose their support by this step (`vpframe.planning.support`)"""

    @property
    def motion(self) -> str:
        """ "straight", "screw", "slide" or "free\""""
        return self.way.motion

    @property
    def length(self) -> float:
        """Path length of the first part's origin, m."""
        return self.tracks[self.parts[0]].length


@dataclass(frozen=True, eq=False)
class Disassembly:
    """An order in which parts come out."""

    names: tuple[str, ...]
    """of all parts of the scene"""
    verdict: Verdict
    """"removable" if all wanted parts come out; "locked" or "enclosed" if the others are proven to stay as long as the
    base does; else "not found"; `stuck` has the result of each part"""
    steps: tuple[PlannedStep, ...]
    base: tuple[str, ...]
    """parts that stay"""
    remaining: tuple[str, ...]
    """wanted parts that did not come out"""
    target: str | None
    bound: int | None
    """with a target: lower bound of the number of steps over the plans of `scope`; None if unknown"""
    scope: str
    """the plans over which the steps are proven to be the fewest; empty without a proof"""
    stuck: dict[str, Removal]
    """result of each part that did not come out, among the parts left"""
    overlaps: tuple[Overlap, ...]
    mates: tuple[tuple[str, str, str], ...]
    """part, part, kind: fits and threads that paths keep; a session that executes the plan accepts these"""
    budget: Budget = field(repr=False)
    questions: int = 0
    interrupted: bool = False
    seconds: float = 0.0
    """processor time used by the search and its workers, s"""
    press_fits: tuple[PressFit, ...] = ()
    """at the initial poses: paths keep them on their axes; their force is not checked"""
    authorised: tuple[tuple[str, str], ...] = ()
    """pairs of parts whose overlap as drawn is intended"""
    ignored: tuple[tuple[str, str], ...] = ()
    """pairs of parts that may pass through each other"""
    tolerance: Tolerance | None = None
    """of recognition, if given: a session that executes the plan uses the same"""
    duplicates: tuple[tuple[str, ...], ...] = ()
    """parts that are drawn more than once at one place; they leave as one"""
    fasteners: Mapping[str, str] = field(default_factory=dict)
    """words for the parts that are fasteners to undo"""
    together: tuple[tuple[str, ...], ...] = ()
    """parts that left as one and were not taken apart further"""

    @property
    def proven(self) -> bool:
        """Whether no plan of `scope` has fewer steps."""
        return bool(self.scope)

    @property
    def precedence(self) -> dict[str, tuple[str, ...]]:
        """By part, the parts that have to be gone before it."""
        return {name: step.after for step in self.steps for name in step.parts}

    @property
    def levels(self) -> tuple[tuple[str, ...], ...]:
        """Parts that may go side by side, level by level."""
        count = max((step.level for step in self.steps), default=-1) + 1
        return tuple(tuple(n for step in self.steps if step.level == k for n in step.parts) for k in range(count))

    def __bool__(self) -> bool:
        return self.verdict == "removable"


def disassembly(scene: Scene, target: str | None = None, **options: Unpack[DisassemblyOptions]) -> Disassembly:
    """Return the order in which all parts come out, or the fewest removals before the target, and the target.

    options: the fields of `PlanOptions`. Names are of parts, of subassemblies, or the end of a path ("seal" for
    "cover/seal"). Ctrl-C ends the search: the steps found so far are returned, and `interrupted` is set.

    Raises
    ------
    UnknownPartError, VpframeError: no such part, a part in two groups, a target that is a base, a bad number or name.
    """
    given = PlanOptions(**options)
    plan = _Plan(given.assembly(scene, given.progress), target, given)
    plan.workers = Workers(plan.ways, given.jobs)
    try:
        return plan.run(given.known)
    finally:
        plan.workers.close()


_Scope = tuple[set[int], set[int], set[int]]
"""parts that are present, those of them that stay, and those that there were"""


class _Plan:
    def __init__(self, assembly: Assembly, target: str | None, options: PlanOptions) -> None:
        scene = assembly.scene
        self.assembly, self.options = assembly, options
        seconds = min(max(SECONDS, SECONDS_A_PART * len(assembly)), MOST_SECONDS)
        seconds = seconds if options.budget is None else options.budget
        self.budget = Budget(seconds, reserve=RESERVE if target is None else 0.0)
        self.wanted = () if target is None else _named(scene, [target])
        """the parts of the target"""
        self.target = self.wanted[0] if self.wanted else None
        given = _named(scene, options.base)
        self.base = set(given or (i for i in base_parts(scene) if i not in self.wanted))
        doubled = [same for same in assembly.duplicates if self.base & set(same)]
        self.base.update(i for same in doubled for i in same if i not in self.wanted)
        self.units = self._units(options.carry)
        if self.base & set(self.wanted):
            raise VpframeError(f"{target} is to come out and to stay; name another base with --base")
        for unit in self.units:
            if len(unit) > 1 and self.base & set(unit):
                raise VpframeError(f"{assembly.names[min(self.base & set(unit))]} stays, so nothing can carry it")
        self.ways = Ways(assembly, self.budget, options.motion, options.clearance)
        self.workers = Workers(self.ways, 1)
        self.steps: list[RemovalStep] = []
        self.out: set[int] = set()
        """removed parts, and the bases of removed groups"""
        self.results: dict[Unit, Removal] = {}
        """search results of units that did not come out"""
        self.bound: int | None = None
        self.scope = ""
        self.resumed = False
        self.interrupted = False

    def _units(self, carry: Iterable[Sequence[str]]) -> list[Unit]:
        groups = [tuple(sorted(_named(self.assembly.scene, group))) for group in carry]
        if len(self.wanted) > 1 and not any(set(self.wanted) <= set(group) for group in groups):
            groups.append(tuple(sorted(self.wanted)))
        taken = [i for group in groups for i in group]
        if len(set(taken)) != len(taken):
            twice = next(i for i in taken if taken.count(i) > 1)
            raise VpframeError(f"{self.assembly.names[twice]} is in two groups that come out as one; name it in one")
        for same in self.assembly.duplicates:  # what is drawn twice at one place leaves as one
            if not set(same) & {*taken, *self.base}:
                groups.append(same)
                taken += same
        single = [(i,) for i in range(len(self.assembly)) if i not in taken]
        return sorted([*groups, *single])

    def run(self, known: Iterable[tuple[Sequence[str], RemovalPath]] = ()) -> Disassembly:
        """Compute the plan; `known` paths are tried too."""
        everything = set(range(len(self.assembly)))
        self.assembly.prepare()
        self.budget.begin()
        try:
            for names, way in known:
                unit = tuple(sorted(self.assembly.scene.index(name) for name in names))
                if unit in self.units and way.motion not in ("straight", "screw"):  # those are found anew at once
                    self.ways.add(unit, self._about(unit, way))
                    self.resumed = True
            if self.target is None or not self._least(everything):
                self._peel(set(everything), self.base, everything)
        except BudgetError:
            self.budget.release()
            with suppress(BudgetError):
                self._explain(self._inside(), self.base)
        except KeyboardInterrupt:
            self.interrupted = True
        if self.target is not None and self.target in self.out:
            self.steps = order.needed(self.steps, self.target)
            if len(self.steps) == 1:
                self.bound, self.scope = 1, NOTHING_BEFORE
        return self._told()

    def _inside(self) -> set[int]:
        """Parts that have not left the assembly, by themselves or with a group."""
        present = set(range(len(self.assembly)))
        for step in self.steps:
            if set(step.unit) <= present:
                present -= set(step.unit)
        return present

    # -- the target, by the least number of removals

    def _least(self, everything: set[int]) -> bool:
        """Remove the target by the fewest removals along straight and screw paths; False if there is no such plan."""
        assert self.target is not None
        of_part = {i: u for u, unit in enumerate(self.units) for i in unit}
        alone = self.ways.free(self.units[of_part[self.target]], everything)
        if alone is not None:  # nothing has to go before it, so there is nothing to weigh
            self._take(alone, set(everything), everything)
            return True
        moving = [unit for unit in self.units if not self.base & set(unit)]
        known: dict[int, list[KnownPath]] = {}
        turned: set[int] = set()
        """units with known screw paths on which the larger part of the thread turns"""

        def units(parts: Iterable[int]) -> frozenset[int]:
            return frozenset(of_part[j] for j in parts)

        def option(k: KnownPath) -> Option:
            return Option(units(k.blockers), {of_part[v[0]]: units(by) for v, by in k.carried.items()}, k.way.larger)

        def options(u: int) -> list[Option]:
            """Paths that are not computed yet count as free, so that the bound holds for all plans."""
            if u not in known:
                return [Option(frozenset())] if self.units[u] in moving else []
            untested = u not in turned and self.ways.turns_as_larger(self.units[u])
            return [*map(option, known[u]), *([Option(frozenset(), last=True)] if untested else [])]

        while True:  # until all that a least plan goes along is known
            given = [options(u) for u in range(len(self.units))]
            found = least(given, of_part[self.target], min(LEAST_SECONDS, max(self.budget.left, 1.0)))
            if found is None:
                return False
            ask = {r.unit: r.unit in known for r in found.chosen if r.option >= len(known.get(r.unit, ()))}
            if not ask:
                break
            tasks: list[Task] = [("every", self.units[u], (moving, larger)) for u, larger in ask.items()]
            self.workers.ask(tasks, self.budget)
            for u, larger in ask.items():
                self.options.progress(len(known) / len(self.units), f"ways of {self.assembly.names[self.units[u][0]]}")
                known[u] = [*known.get(u, ()), *self.ways.of(self.units[u], moving, larger)]
                turned |= {u} if larger else set()
        chosen = [self.ways.together(known[r.unit][r.option], [self.units[v] for v in r.carried]) for r in found.chosen]
        static = set(everything)
        for k in chosen:
            static -= set(k.unit)
            if self.options.clearance and self.ways.clearance_of(k, static).distance < self.options.clearance:
                return False
        static = set(everything)
        for k in chosen:
            self._take(k, static, everything)
            static -= set(k.unit)
        threads = any(mate.pitch is not None for mates in self.assembly.mates.values() for mate in mates)
        self.bound, self.scope = found.bound, _scope(
            groups=any(len(unit) > 1 for unit in self.units), carried=threads,
            threads=threads and self.options.motion != "straight", resumed=self.resumed,
        )  # fmt: skip
        return True

    # -- everything, or until the target is out

    def _peel(self, present: set[int], base: set[int], scope: set[int]) -> None:
        """Remove parts until only the base is left, the target is out, or no more comes out.

        present: parts not yet removed. scope: the parts present at first. Groups that come out as one are taken apart
        separately. Paths are searched only when no part comes out along known paths, and then only of parts that would
        not come out without the overlaps as drawn.
        """
        easy: list[_Scope] = [(present, base, scope)]
        hard: list[_Scope] = []
        while (easy or hard) and self.target not in self.out:
            if easy:
                each = easy.pop(0)
                self._go_along_known_ways(*each, easy)
                hard.append(each)
                continue
            present, base, scope = hard[0]
            self._explain(present, base)
            held = {unit for unit, found in self.results.items() if found.verdict == "held"}
            left = [unit for unit in self._left(present, base) if unit not in held or self.target in unit]
            if self._search(left, present, scope):
                easy.append(hard.pop(0))
            else:
                hard.pop(0)

    def _left(self, present: set[int], base: set[int]) -> list[Unit]:
        return [unit for unit in self.units if set(unit) <= present and not base & set(unit)]

    def _go_along_known_ways(self, present: set[int], base: set[int], scope: set[int], inside: list[_Scope]) -> None:
        """Remove parts and groups along known paths; append removed groups, to be taken apart, to `inside`."""
        while True:
            for leaving in self._free(self.ways, present, base):
                static = set(present)
                self._measure(leaving, static)
                for known in leaving:  # each way was found among all that is there now
                    self._take(known, static, scope)
                    present -= set(known.unit)
            if present <= base or self.target in self.out or not self._group(present, base, scope, inside):
                break

    def _free(self, among: Ways, present: set[int], base: set[int]) -> Iterator[list[KnownPath]]:
        """Yield units that are free, rank by rank; the caller removes them from `present`.

        A unit is looked at again once a part that was found in its way is gone. Where a search is cut off, what was
        found of the last rank is yielded first.
        """
        queue = set(self._left(present, base))
        while queue and self.target not in self.out:
            rank = min(map(self._rank, queue))
            batch = sorted(unit for unit in queue if self._rank(unit) == rank)
            free: list[KnownPath] = []
            cut: BaseException | None = None
            try:
                if among is self.ways:
                    self.workers.ask([("free", unit, (frozenset(present),)) for unit in batch], self.budget)
                for n, unit in enumerate(batch):
                    done = len(self.out) / max(1, len(self.assembly))
                    self.options.progress(done, f"{len(self.steps)} steps found; part {n + 1} of {len(batch)}")
                    known = among.free(unit, present)
                    if known is not None:
                        free.append(known)
            except (BudgetError, KeyboardInterrupt) as stop:
                cut = stop
            leaving, before = self._in_a_row(self._side_by_side(free)), set(present)
            for known in leaving:
                among.learn(known)
            if leaving:
                yield leaving
            if cut is not None:
                raise cut
            gone, left = before - present, self._left(present, base)
            again = {known.unit for known in free}
            queue = {
                unit
                for unit in left
                if (unit in queue and unit not in batch) or unit in again or among.waits.get(unit, frozenset()) & gone
            }
            if leaving:
                among.larger = False
            if not queue and not among.larger:  # a bolt turns in its nut only where nothing else goes
                among.larger = True
                queue = {unit for unit in left if among.turns_as_larger(unit)}
        among.larger = False

    def _rank(self, unit: Unit) -> tuple[bool, int]:
        """Fasteners before other units, and small units before large ones, an octave at a time."""
        size = sum(map(self.assembly.size, unit))
        kinds = {self.assembly.fasteners[i].kind for i in unit if i in self.assembly.fasteners}
        return not kinds & LOOSENED, round(np.log2(max(size, 1e-9)))

    def _in_a_row(self, leaving: Sequence[KnownPath]) -> list[KnownPath]:
        """Paths that may be executed in any order, in a workshop's: side by side, tool by tool, the next one beside."""
        sides = {known.unit: tuple((np.round(known.way.direction, 3) + 0.0).tolist()) for known in leaving}
        tools = {known.unit: self._tool(known.unit) for known in leaving}
        places = {known.unit: self.assembly.ball(known.unit)[0] for known in leaving}
        count = Counter(sides.values())
        rest = sorted(leaving, key=lambda k: (-count[sides[k.unit]], sides[k.unit], tools[k.unit], k.unit))
        out: list[KnownPath] = []
        while rest:
            last = out[-1].unit if out else rest[0].unit

            def effort(known: KnownPath, last: Unit = last) -> tuple[bool, bool, float]:
                unit = known.unit
                away = float(np.linalg.norm(places[unit] - places[last]))
                return sides[unit] != sides[last], tools[unit] != tools[last], round(away, 9)

            out.append(min(rest, key=effort))
            rest.remove(out[-1])
        return out

    def _tool(self, unit: Unit) -> tuple[str, ...]:
        """What a unit is turned by, as far as it is known; one for each shape."""
        found = self.assembly.fasteners.get(unit[0])
        return (found.kind, found.drive, f"{found.diameter:.6f}") if found is not None else ("",)

    def _measure(self, leaving: Sequence[KnownPath], present: set[int]) -> None:
        """Measure the clearances of paths among the parts present, in worker processes."""
        rest = [frozenset(present - set(known.unit)) for known in leaving]
        tasks = [
            ("clearance", known.unit, (static, known.way.knots)) for known, static in zip(leaving, rest, strict=True)
        ]
        for k, found in self.workers.ask(tasks, self.budget).items():
            self.ways.keep_clearance(leaving[k], rest[k], found)

    def _side_by_side(self, free: Sequence[KnownPath]) -> list[KnownPath]:
        """Paths that may be executed at once: of each threaded pair only the smaller part's."""
        size = {known.unit: sum(map(self.assembly.size, known.unit)) for known in free}
        out: list[KnownPath] = []
        for known in sorted(free, key=lambda k: (size[k.unit], k.unit)):
            turned = [other.unit for other in out if other.way.motion == "screw" or known.way.motion == "screw"]
            mates = [m for unit in turned for m in ways.mates_between(self.assembly, known.unit, unit)]
            if not any(mate.kind == "screw" for mate in mates):
                out.append(known)
        return sorted(out, key=lambda k: k.unit)

    def _take(self, known: KnownPath, static: set[int], scope: set[int]) -> None:
        self.steps.append(self.ways.step(known, static, scope))
        self.out |= set(known.unit)
        gone = {self.assembly.names[i] for i in known.unit}  # what was found in another state holds no longer
        self.results = {u: r for u, r in self.results.items() if not gone & {*r.holders, *r.blockers}}
        self.options.found(tuple(self.assembly.names[i] for i in known.unit), known.way.text)

    def _group(self, present: set[int], base: set[int], scope: set[int], inside: list[_Scope]) -> bool:
        """Remove the best group that comes out as one, and append it to `inside`; False if there is none."""
        left = [unit for unit in self.units if set(unit) <= present]
        directions = order.group_directions(self.ways, left)
        tasks = [("blocked", unit, ([u for u in left if base & set(u)], directions)) for unit in left]
        self.workers.ask(tasks, self.budget)
        found = order.groups(self.ways, left, base)
        if not found:
            return False
        known = found[0]
        self._take(known, present, scope)
        present -= set(known.unit)
        bearing = all(self._kind(i) is FastenerKind.BEARING for i in known.unit)  # bought as one: nobody takes it apart
        if self.target in known.unit or (self.target is None and not bearing):
            members = [unit for unit in self.units if set(unit) <= set(known.unit)]
            largest = max(
                (unit for unit in members if self.target not in unit),
                key=lambda unit: (sum(map(self.assembly.size, unit)), unit),
            )
            self.out -= set(known.unit) - set(largest)
            inside.append((set(known.unit), set(largest), set(known.unit)))
        return True

    def _kind(self, i: int) -> FastenerKind | None:
        known = self.assembly.fasteners.get(i)
        return None if known is None else known.kind

    # -- what does not come out

    def _explain(self, present: set[int], base: set[int]) -> None:
        """Keep as results the units that overlaps as drawn hold: `BUT_FOR` times as deep, they would let them out."""
        names, left = self.assembly.names, self._left(present, base)
        pairs = {(i, j) for unit in left for i in unit for j in self.assembly.partners[i] & present - set(unit)}
        drawn = {frozenset(pair): found for pair in sorted(pairs) if (found := self.assembly.drawn_into(*pair))}
        if not drawn:
            return
        depths = {pair: max(BUT_FOR * o.depth, 2.0 * LINEAR) for pair, o in drawn.items()}
        among, there = self.ways.waiving(depths), set(present)
        for leaving in self._free(among, there, base):
            for known in leaving:
                unit, static = known.unit, present - set(known.unit)
                stands = {j for j in static if self.ways.stands_in(known, j)}
                clashes = [
                    drawn[pair] for j in sorted(stands & there) for i in unit if (pair := frozenset((i, j))) in drawn
                ]
                blockers = tuple(names[j] for j in sorted(stands))
                self.results[unit] = Removal(
                    tuple(names[i] for i in unit), "held", known.way, blockers=blockers, clashes=tuple(clashes)
                )
            for known in leaving:
                there -= set(known.unit)

    def _search(self, left: Sequence[Unit], present: set[int], scope: set[int]) -> bool:
        """Search a path for each remaining unit until one comes out; whether one did."""
        if self.options.motion == "straight":
            left = [unit for unit in left if self.target is None or self.target in unit]
        ranked = self._ranked(left)
        for n, unit in enumerate(ranked):
            least = 0.5 if self.target in unit else LEAST_SHARE
            share = self.budget.share(min(max(1.0 / (len(ranked) - n), least), MOST_SHARE))
            self.options.progress(None, f"{len(self.steps)} steps found; a way for {self.assembly.names[unit[0]]}")
            try:
                got = find(
                    self.assembly,
                    unit,
                    sorted(present - set(unit)),
                    share,
                    self.options.motion,
                    self.options.clearance,
                    self.options.seed,
                )
            finally:
                self.budget.give_back(share)
            if not (unit in self.results and got.verdict == "not found"):  # of the target: held is said, not that
                self.results[unit] = got
            known = None if got.way is None else self.ways.add(unit, got.way)  # swept once more, against all parts
            if known is not None and not known.blockers & (present - set(unit)):
                self._take(known, set(present), scope)
                present -= set(unit)
                return True
        return False

    def _ranked(self, units: Sequence[Unit]) -> list[Unit]:
        """The target first, then one unit of each shape by size, then the second of each shape, and so on."""
        seen: Counter[tuple[int, ...]] = Counter()
        keys = {}
        for unit in units:
            shape = tuple(id(self.assembly.scene.parts[i].shape) for i in unit)
            keys[unit] = self.target not in unit, seen[shape], sum(map(self.assembly.size, unit)), unit
            seen[shape] += 1
        return sorted(units, key=keys.__getitem__)

    # -- the answer

    def _mates(self) -> tuple[tuple[str, str, str], ...]:
        names = self.assembly.names
        found = {(names[a], names[b], m.kind) for (a, b), mates in self.assembly.mates.items() for m in mates}
        return tuple(sorted(found))

    def _about(self, unit: Unit, way: RemovalPath) -> RemovalPath:
        """A path of an earlier plan with the centre and radius of this unit, for the text of its legs."""
        middle, radius = self.assembly.ball(unit)
        return replace(way, middle=middle, radius=radius)

    def _stuck(self, present: set[int], units: Iterable[Unit]) -> dict[str, Removal]:
        """Result of each part that did not come out, among the parts present."""
        names, out = self.assembly.names, dict[str, Removal]()
        for unit in units:
            found = self.results.get(unit)
            if found is None:
                by = tuple(names[j] for j in sorted(self.ways.in_the_way(unit, present)))
                found = Removal(tuple(names[i] for i in unit), "not found", blockers=by, ended=self.budget.ended)
            out |= {names[i]: found for i in unit}
        return out

    def _verdict(self, stuck: Mapping[str, Removal], wanted: Iterable[str]) -> Verdict:
        """The common verdict of all parts, of proofs if they assume only parts that certainly stay; else "not found".

        These are the base, and parts locked by such parts.
        """
        stay = {self.assembly.names[i] for i in self.base}

        def certain(found: Removal) -> bool:
            return bool(found.holders) and set(found.holders) <= stay

        while new := {n for n, found in stuck.items() if found.verdict == "locked" and certain(found)} - stay:
            stay |= new
        told: set[Verdict] = {
            stuck[n].verdict if certain(stuck[n]) or stuck[n].verdict == "held" else "not found" for n in wanted
        }
        if len(told) == 1:
            return told.pop()
        return "not found" if "not found" in told else "held"

    def _told(self) -> Disassembly:
        names = self.assembly.names
        supports = Supports(self.assembly, self.base or self.wanted)
        present, steps = set(range(len(names))), []
        for step, level in zip(self.steps, order.levels(self.steps), strict=True):
            dropped: frozenset[int] = frozenset()
            if set(step.unit) <= present:  # not inside a group that is out
                dropped = supports.lost(present, step.unit)
                present -= set(step.unit)
            steps.append(
                PlannedStep(
                    tuple(names[i] for i in step.unit), step.way,
                    {names[i]: track(self.assembly.poses[i], step.way.knots) for i in step.unit}, step.clearance,
                    tuple(names[j] for j in sorted(step.after)), level, tuple(names[j] for j in sorted(dropped)),
                )
            )  # fmt: skip
        wanted = set(self.wanted) or set(range(len(names))) - self.base
        together = []
        for k, step in enumerate(self.steps):  # what left as a group, less what was taken out of it later
            rest = set(step.unit).difference(*(later.unit for later in self.steps[k + 1 :]))
            if step.unit not in self.units and len(rest) > 1:
                together.append(tuple(names[i] for i in sorted(rest)))
        remaining = sorted((wanted - self.out) & (present if self.target is None else wanted))
        units = [unit for unit in self.units if set(unit) & set(remaining)]
        stuck = self._stuck(present, units)
        proven = self.bound is not None and len(steps) <= self.bound and not remaining
        return Disassembly(
            names, self._verdict(stuck, [names[i] for i in remaining]) if remaining else "removable", tuple(steps),
            tuple(names[i] for i in sorted(self.base)), tuple(names[i] for i in remaining),
            name_of(names, [names[i] for i in self.wanted]) if self.wanted else None,
            self.bound, self.scope if proven else "", stuck, self.assembly.overlaps, self._mates(), self.budget,
            self.assembly.sweeps.count, self.interrupted, self.budget.spent,
            self.assembly.press_fits, self.assembly.authorised_pairs, self.assembly.ignored_pairs,
            self.assembly.recognition, tuple(tuple(names[i] for i in same) for same in self.assembly.duplicates),
            {
                names[i]: f"{one.size} {one.kind}".strip()
                for i, one in self.assembly.fasteners.items()
                if one.kind in LOOSENED
            },
            tuple(together),
        )  # fmt: skip


def _scope(groups: bool, carried: bool, threads: bool, resumed: bool) -> str:
    """The set of plans over which a number of removals is minimal, in words."""
    what = f"single parts{' and the groups carried' if groups else ''}"
    what += ", alone or with what is screwed onto them," if carried else ""
    along = f"straight ways{' and threads' if threads else ''}{', and ways of the earlier plan,' if resumed else ''}"
    return f"{what} along the {along} found"
