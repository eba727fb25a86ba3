"""`Assembly`: a scene as planning sees it. What holds what, what overlaps already, and sweeps that know of both.

All motions start where the parts stand. What a motion may do to each pair of parts:

- surfaces that are apart stay apart, by `Tolerance.linear` at least;
- surfaces that touch get no deeper than where the parts stand, but for rounding (`TOLERANCE`);
- an overlap as drawn, deeper than 1 µm, only shrinks, seen from one of the two parts (`Sweeps`);
- the surfaces of a fit or thread are excused while the motion keeps the two on their common axis (or centre), as those
  of a mate in a session are: their facets cross although the true surfaces fit;
- a press fit is excused like any other fit: along its axis it keeps the overlap it is drawn with;
- a drawn thread lets nothing pass but its own screw, until its two cylinders share no length;
- a shaft that clashes with its bore, being larger than a press fit allows, or off its axis, does not move in it, unless
  the user authorised the overlap of the pair: then it is a fit, however great its interference; all else holds of this
  pair, too;
- a pair of parts that the user ignores never stops anything.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from collision.numeric.kernel import compilation
from collision.query.blocking import Pairing, Stop, Sweeps
from constraints import Candidate
from constraints.freedom.escape import Patch, contact_patch
from constraints.geometry.sleeve import sleeve, sleeve_of
from constraints.geometry.surfaces import Cylinder, Sphere
from constraints.geometry.views import Extent
from constraints.recognition.mated import adjacent_surfaces
from constraints.recognition.misfits import Misfit
from vpframe.analysis.clash import clash, is_open
from vpframe.analysis.fits import BAD_KINDS, PressFit, fit_of, misfits_of, press_fits
from vpframe.analysis.static import candidates, threaded_features, world_of
from vpframe.errors import VpframeError
from vpframe.scene.boxes import half_size
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene

Array = NDArray[np.float64]
Knots = tuple[pin.SE3, ...]
"""world displacements from where the parts stand, the first the identity"""
Key = tuple[Any, ...]
"""a question: the parts that move and stand, the way"""
Answer = tuple[Stop | None, int]
"""and the sweeps that it took"""
Progress = Callable[[float | None, str], None]
"""hears the fraction done and what has been found so far"""

LINEAR: Final = 1e-6
"""m: how near planned motions let surfaces come that are apart, and how near surfaces count as touching"""
TOLERANCE: Final = Tolerance(linear=LINEAR, slop=1e-6)
"""of planned motions: a leg presses surfaces by 1.5 pm at most, all legs of a way by 10 pm (`Sweeps`), where CAD
kernels place points to within 100 pm (1e-7 mm)"""
ON_AXIS: Final = 1e-6
"""m: how far an axis may leave its own line before its fit is excused no longer"""
CLEAR: Final = 3e-3
"""m: by how much parts that come out end clear of the others: beyond it a session's mates let go, too"""
QUESTIONS: Final = 500
"""a second of budget: sweeps and intersection tests. A machine that is slower ends by its processor time"""


class BudgetError(VpframeError):
    """The questions or the time of a plan are used up."""


class _Working:
    """Processor time of this process, s, without what it compiles."""

    def __init__(self) -> None:
        self._compiled = self._began = 0.0
        compilation.listeners.append(self._compiling)

    def _compiling(self, begins: bool) -> None:
        now = time.process_time()
        if begins:
            self._began = now
        else:
            self._compiled += now - self._began

    def __call__(self) -> float:
        return time.process_time() - self._compiled


working: Final = _Working()


class Budget:
    """What a plan may ask: `seconds` times QUESTIONS questions, and as many seconds of processor time."""

    def __init__(self, seconds: float, clock: Callable[[], float] = working) -> None:
        if not 0.0 < seconds < np.inf:
            raise VpframeError(f"the budget is {seconds!r}; give a positive number of seconds")
        self.seconds, self.questions, self.asked = seconds, int(np.ceil(seconds * QUESTIONS)), 0
        self._clock, self._late = clock, False
        self.by_clock = False
        """whether the processor time ended it, or a share of it: another run may then come farther"""
        self.begin()

    def begin(self) -> None:
        """Count processor time from now on."""
        self._end = self._clock() + self.seconds

    def ask(self, questions: int = 1) -> None:
        """Count questions that are about to be asked; BudgetError when there are none left."""
        self.asked += questions
        if self._clock() > self._end:
            self._late = self.by_clock = True
        if self.ended:
            raise BudgetError(f"the budget of {self.ended} is used up")

    def take(self, seconds: float) -> None:
        """Count processor time that another process has spent."""
        self._end -= seconds

    @property
    def ended(self) -> str:
        """What ended it, with its amount; empty while it lasts."""
        if self._late:
            return f"{self.seconds:.4g} s of processor time"
        return f"{self.questions} questions" if self.asked > self.questions else ""

    @property
    def left(self) -> float:
        """s of processor time until it ends."""
        return max(0.0, self._end - self._clock())

    def share(self, part: float) -> Budget:
        """A budget of a part of what is left, for one question among several; `give_back` it."""
        out = Budget(max(part * self.left, 1e-3), self._clock)
        out.questions = int(np.ceil(part * max(self.questions - self.asked, 0)))
        return out

    def give_back(self, share: Budget) -> None:
        """Count what was asked of a share."""
        self.asked += share.asked
        self.by_clock |= share.by_clock


@dataclass(frozen=True, eq=False)
class Mate:
    """A fit or thread between two parts as they stand: the motions of a against b that keep it, and its surfaces."""

    parts: tuple[int, int]
    kind: str
    """"concentric", "screw" or "spherical\""""
    origin: Array
    """(3,) world, m: a point of the axis, or the centre"""
    axis: Array
    """(3,) unit, world"""
    pitch: float | None
    """m a turn, of a thread"""
    drawn: bool
    """whether it is a thread that is drawn as two cylinders"""
    apart: tuple[float, float]
    """m: how far a goes along the axis, and against it, until the two surfaces share no length"""
    excused: tuple[Pairing, ...]
    """surfaces of a, surfaces of b"""
    press: float = 0.0
    """m, radial: interference of a press fit; 0 for any other mate"""

    def keeps(self, start: pin.SE3, end: pin.SE3) -> bool:
        """Whether the motion of a against b from one displacement to another, along a screw, keeps the mate."""
        return all(self._holds(d) for d in (start, end)) and (self.pitch is None or self._engages(start, end))

    def _holds(self, d: pin.SE3) -> bool:
        shift = d.act(self.origin) - self.origin
        if self.kind == "spherical":
            return bool(np.linalg.norm(shift) <= ON_AXIS)
        arm = max(1.0, float(np.linalg.norm(d.translation)))
        aside = shift - (shift @ self.axis) * self.axis
        tilt = np.linalg.norm(d.rotation @ self.axis - self.axis)
        return bool(np.linalg.norm(aside) <= ON_AXIS and tilt * arm <= ON_AXIS)

    def _engages(self, start: pin.SE3, end: pin.SE3) -> bool:
        assert self.pitch is not None
        advance = (end.act(self.origin) - start.act(self.origin)) @ self.axis
        turn = pin.log3(end.rotation @ start.rotation.T) @ self.axis
        return bool(abs(advance - self.pitch * turn / (2.0 * np.pi)) <= ON_AXIS)

    def engaged(self, d: pin.SE3) -> bool:
        """Whether the two share some length at a displacement of a against b."""
        along = float((d.act(self.origin) - self.origin) @ self.axis)
        return -self.apart[1] + ON_AXIS < along < self.apart[0] - ON_AXIS


@dataclass(frozen=True, eq=False)
class Jam:
    """A shaft and a bore that clash."""

    origin: Array
    """(3,) world, m: middle of the length they share"""
    axis: Array
    """(3,) unit, world"""
    length: float
    """m"""

    def engaged(self, d: pin.SE3) -> bool:
        """Whether the two share some length at a displacement of the first against the second."""
        return abs(float((d.act(self.origin) - self.origin) @ self.axis)) < self.length - ON_AXIS


@dataclass(frozen=True)
class Overlap:
    """Surfaces that reach into each other where the parts stand, beyond what fits and facets explain."""

    parts: tuple[str, str]
    surfaces: tuple[int, ...]
    depth: float
    """m"""


@dataclass(frozen=True, eq=False)
class GroupStop:
    """What stops a group of parts that move as one body."""

    t: float
    """in [0, 1): how far along the leg"""
    part: int
    """of the group"""
    by: int
    stop: Stop


def _silent(fraction: float | None, text: str) -> None:
    pass


class Assembly:
    """A scene as it stands.

    Parameters
    ----------
    authorised: pairs of part names whose overlap as drawn is meant.
    ignored: pairs of part names that may pass through each other.
    threads: m a turn by part name: its snug fits are threads, drawn without them.
    tolerance: of planned motions.
    """

    def __init__(
        self,
        scene: Scene,
        authorised: Iterable[tuple[str, str]] = (),
        threads: Mapping[str, float] | None = None,
        tolerance: Tolerance = TOLERANCE,
        progress: Progress = _silent,
        ignored: Iterable[tuple[str, str]] = (),
    ) -> None:
        self.scene, self.tolerance = scene, tolerance
        self.names = scene.names
        self.poses = tuple(pin.SE3(part.pose) for part in scene.parts)
        self.meshes = tuple(part.mesh for part in scene.parts)
        self.authorised, self.ignored = _pairs(scene, authorised), _pairs(scene, ignored)
        self._threads = {scene.index(name): pitch for name, pitch in (threads or {}).items()}
        for name, pitch in (threads or {}).items():
            if not (np.isfinite(pitch) and pitch != 0.0):
                raise VpframeError(f"the thread of {name} has a pitch of {pitch!r}; give metres a turn, not zero")
        self._progress = progress
        self._forget()

    def _forget(self) -> None:
        self.sweeps = Sweeps(self.meshes, self.poses, self.tolerance, self.left_out)
        self._stops: dict[Key, Stop | None] = {}
        self._ahead: dict[Key, Answer] = {}
        self._new: dict[Key, Answer] = {}
        self._patches: dict[tuple[int, int], tuple[Patch, ...]] = {}
        self._new_patches: dict[tuple[int, int], tuple[Patch, ...]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """For worker processes: the assembly as it stands, without answers."""
        left_out = (
            "world",
            "candidates",
            "overlaps",
            "sweeps",
            "_progress",
            "_stops",
            "_ahead",
            "_new",
            "_patches",
            "_new_patches",
        )
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._progress = _silent
        self._forget()

    def prepare(self) -> None:
        """Compute what all answers need, before a budget begins and before worker processes do so each."""
        _ = self.mates, self._jams, self._touching, self.overlaps

    def answer(self, stops: Mapping[Key, Answer], patches: Mapping[tuple[int, int], tuple[Patch, ...]]) -> None:
        """Keep answers that are given ahead: a question counts when it is asked."""
        self._ahead |= {key: found for key, found in stops.items() if key not in self._stops}
        self._patches |= patches

    def new_answers(self) -> tuple[dict[Key, Answer], dict[tuple[int, int], tuple[Patch, ...]]]:
        """Answers since the last time: stops with their questions, patches."""
        out = self._new, self._new_patches
        self._new, self._new_patches = {}, {}
        return out

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def world(self) -> CollisionManager:
        """The parts where they stand, under the tolerance of recognition."""
        return world_of(self.scene)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """What the features of parts that touch are to each other, best first."""
        return candidates(self.scene, self.world, lambda done: self._progress(done, "mates"), implied=True)

    @cached_property
    def overlaps(self) -> tuple[Overlap, ...]:
        """What overlaps where the parts stand and is neither authorised nor ignored, the deepest first."""
        rows = clash(self.scene, authorised=self.meant, progress=self._progress)["pairs"]
        found = [
            Overlap(tuple(row["parts"]), tuple(row["surfaces"]), row["depth"])
            for row in rows
            if row["kind"] in BAD_KINDS and is_open(row)
        ]
        return tuple(sorted(found, key=lambda o: (-o.depth, o.parts, o.surfaces)))

    @property
    def meant(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs of parts that are authorised or ignored, in the order of the scene."""
        pairs = sorted(tuple(sorted(pair)) for pair in self.authorised | self.ignored)
        return tuple((self.names[a], self.names[b]) for a, b in pairs)

    # -- mates

    @cached_property
    def mates(self) -> dict[tuple[int, int], tuple[Mate, ...]]:
        """Fits and threads by pair of parts (a, b), a < b."""
        features, _ = threaded_features(self.scene)
        sags = [float(deflections(part.shape).max(initial=0.0)) for part in self.scene.parts]
        out: dict[tuple[int, int], list[Mate]] = {}
        for candidate in self.candidates:
            mate = self._mate(candidate, features, sags)
            if mate is not None:
                out.setdefault(mate.parts, []).append(mate)
        for found in self._misfits:
            a, fa, b, fb = found.pair
            if frozenset((a, b)) in self.authorised:
                ends = ((a, features[a][fa]), (b, features[b][fb]))
                out.setdefault((a, b), []).append(self._authorised_fit(found, ends))
        return {pair: tuple(mates) for pair, mates in sorted(out.items())}

    @property
    def press_fits(self) -> tuple[PressFit, ...]:
        """The press fits among the mates, the tightest of each pair of parts."""
        mates = (mate for mates in self.mates.values() for mate in mates)
        return press_fits(((self.names[m.parts[0]], self.names[m.parts[1]]), m.press) for m in mates)

    def _mate(self, candidate: Candidate, features: Sequence[Any], sags: Sequence[float]) -> Mate | None:
        a, fa, b, fb, kind = candidate.key
        first, second = features[a][fa].geometry, features[b][fb].geometry
        t = self.world.tolerance
        if kind == "spherical" and isinstance(first, Sphere):
            origin, axis = self.poses[a].act(first.center), np.zeros(3)
        elif kind in ("concentric", "screw") and isinstance(first, Cylinder) and isinstance(second, Cylinder):
            origin, axis = self.poses[a].act(first.origin), self.poses[a].rotation @ first.axis
        else:
            return None
        stated = self._threads.get(a, self._threads.get(b)) if kind == "concentric" else None
        pitch = candidate.pitch if stated is None else stated
        thread = kind == "screw" or stated is not None
        found = fit_of(candidate, t)
        # what fits loosely needs no excuse; what overlaps and is neither a press fit nor authorised has none
        meant = found is not None and (found.kind != "clash" or frozenset((a, b)) in self.authorised)
        excusable = meant and found is not None and found.gap <= sags[a] + sags[b] + t.linear
        if not (thread or excusable):
            return None
        apart = np.inf, np.inf
        if isinstance(first, Cylinder):
            apart = self._until_apart(((a, features[a][fa]), (b, features[b][fb])), origin, axis)
        excused = self._with_faces_beside((a, b), candidate.surfaces)
        inside = sleeve(candidate, features, (self.meshes[a], self.meshes[b]), t.fit)
        if inside is not None:
            excused.append(inside)
        return Mate(
            (a, b), "screw" if thread else kind, np.asarray(origin), np.asarray(axis), pitch if thread else None,
            thread and candidate.match.fit is not None, apart, tuple(excused), 0.0 if thread else candidate.match.press,
        )  # fmt: skip

    def _authorised_fit(self, found: Misfit, ends: tuple[tuple[int, Any], tuple[int, Any]]) -> Mate:
        """A shaft in a bore that is too small for it, whose overlap is authorised: along the axis it is excused."""
        (a, one), (b, other) = ends
        excused = self._with_faces_beside((a, b), (one.surfaces, other.surfaces))
        inside = sleeve_of(one, other, (self.meshes[a], self.meshes[b]), self.world.tolerance.fit)
        excused += [] if inside is None else [inside]
        apart = self._until_apart(ends, *found.line)
        return Mate((a, b), "concentric", *found.line, None, False, apart, tuple(excused))

    def _with_faces_beside(self, parts: tuple[int, int], surfaces: Sequence[tuple[int, ...]]) -> list[Pairing]:
        """The surfaces of a fit with each other, and with those beside the other's."""
        mine, theirs = (adjacent_surfaces(self.meshes[i], s) for i, s in zip(parts, surfaces, strict=True))
        return [(surfaces[0], surfaces[1] + theirs), (mine, surfaces[1])]

    def _until_apart(
        self, ends: tuple[tuple[int, Any], tuple[int, Any]], origin: Array, axis: Array
    ) -> tuple[float, float]:
        """m: how far the first part goes along a world line, and against it, until two cylinders share no length."""
        heights = [self._heights(i, f.geometry, Extent.of(f).spans, origin, axis) for i, f in ends]
        (low_a, high_a), (low_b, high_b) = heights
        return max(high_b - low_a, 0.0), max(high_a - low_b, 0.0)

    def _heights(self, i: int, cylinder: Any, spans: Array, origin: Array, axis: Array) -> tuple[float, float]:
        """Least and greatest height (m) of a cylinder of part i along a world line, from its spans along its own."""
        own = self.poses[i].rotation @ cylinder.axis
        base = (self.poses[i].act(cylinder.origin) - origin) @ axis
        ends = base + (own @ axis) * np.array([spans[0, 0], spans[-1, 1]])
        return float(ends.min()), float(ends.max())

    def mates_of(self, i: int, j: int) -> tuple[Mate, ...]:
        """Fits and threads of two parts."""
        return self.mates.get((min(i, j), max(i, j)), ())

    def excused(self, i: int, j: int) -> tuple[Pairing, ...]:
        """Surfaces of i, surfaces of j that some motions leave out."""
        pairs = [(m.parts[0] == i, pairing) for m in self.mates_of(i, j) for pairing in m.excused]
        return tuple(pairing if first else (pairing[1], pairing[0]) for first, pairing in pairs)

    def left_out(self, i: int, j: int, start: pin.SE3, end: pin.SE3) -> Iterable[Pairing] | None:
        """The surfaces of fits and threads that a leg of part i keeps with part j; None: a drawn thread lets none pass,
        or a shaft and a bore that clash.

        `Sweeps` asks it of each leg.
        """
        out: list[Pairing] = []
        for mate in self.mates_of(i, j):
            first = mate.parts[0] == i
            one, other = (start, end) if first else (start.inverse(), end.inverse())
            if mate.keeps(one, other):
                out += mate.excused if first else [(b, a) for a, b in mate.excused]
            elif mate.drawn and mate.engaged(one) and mate.axis @ mate.axis > 0.0:
                return None
        if i > j:
            start = start.inverse()
        return None if any(jam.engaged(start) for jam in self.jams(i, j)) else out

    def jams(self, i: int, j: int) -> tuple[Jam, ...]:
        """The shafts and bores of two parts that clash where the parts stand; none if the pair is authorised."""
        return () if frozenset((i, j)) in self.authorised else self._jams.get((min(i, j), max(i, j)), ())

    @cached_property
    def _misfits(self) -> tuple[Misfit, ...]:
        """The shafts in bores that clash where the parts stand."""
        sags = [float(deflections(part.shape).max(initial=0.0)) for part in self.scene.parts]
        contacts = self.world.contacts(within=self.world.tolerance.linear + 2.0 * max(sags, default=0.0))
        return misfits_of(self.scene, self.world, contacts, sags)

    @cached_property
    def _jams(self) -> dict[tuple[int, int], tuple[Jam, ...]]:
        out: dict[tuple[int, int], list[Jam]] = {}
        for found in self._misfits:
            out.setdefault((found.pair[0], found.pair[2]), []).append(Jam(*found.line, found.length))
        return {pair: tuple(jams) for pair, jams in out.items()}

    # -- contacts

    @cached_property
    def _touching(self) -> dict[tuple[int, int], set[tuple[int, int]]]:
        """Pairs of features by pair of parts that may touch where the parts stand."""
        features = [part.features for part in self.scene.parts]
        place = [{s: f for f, feature in enumerate(own) for s in feature.surfaces} for own in features]
        sag = max((float(deflections(part.shape).max(initial=0.0)) for part in self.scene.parts), default=0.0)
        out: dict[tuple[int, int], set[tuple[int, int]]] = {}
        for row in self.world.contacts(within=2.0 * sag + 2.0 * self.tolerance.linear):
            a, b = int(row["object_a"]), int(row["object_b"])
            fa, fb = place[a].get(int(row["surface_a"])), place[b].get(int(row["surface_b"]))
            if fa is not None and fb is not None and frozenset((a, b)) not in self.ignored:
                out.setdefault((a, b), set()).add((fa, fb))
        return out

    def patches(self, i: int, j: int) -> tuple[Patch, ...]:
        """Where part i, which may move, touches part j where they stand; of closed solids only, whose normals tell the
        outside. Kept."""
        if (i, j) not in self._patches:
            low, high = min(i, j), max(i, j)
            found = []
            closed = self.scene.parts[i].shape.closed and self.scene.parts[j].shape.closed
            for fa, fb in sorted(self._touching.get((low, high), ())) if closed else ():
                mine, theirs = (fa, fb) if i == low else (fb, fa)
                patch = contact_patch(
                    self.scene.parts[i].features[mine], self.poses[i],
                    self.scene.parts[j].features[theirs], self.poses[j], self.tolerance.linear,
                )  # fmt: skip
                if patch is not None:
                    found.append(patch)
            self._patches[i, j] = self._new_patches[i, j] = tuple(found)
        return self._patches[i, j]

    # -- questions

    def stop(self, i: int, j: int, knots: Knots) -> Stop | None:
        """Where part j, standing, stops part i on its way; None if it goes to the end. Kept."""
        if frozenset((i, j)) in self.ignored:
            return None
        key = i, j, *(k.homogeneous.tobytes() for k in knots)
        return self._asked(key, lambda: self.sweeps.stop(i, j, knots))

    def straight(self, i: int, j: int, direction: Array) -> Stop | None:
        """Where part j stops part i on its straight way along a unit direction until they are apart. Kept."""
        if frozenset((i, j)) in self.ignored:
            return None
        key = i, j, direction.tobytes()
        back = j, i, (0.0 - direction).tobytes()
        if key not in self._stops and back in self._stops and self._stops[back] is None:
            return None
        return self._asked(key, lambda: self.sweeps.straight(i, j, direction, CLEAR))

    def known_stop(self, i: int, j: int, direction: Array) -> Stop | None:
        """The answer of `straight`, where it was asked; else None."""
        return self._stops.get((i, j, direction.tobytes()))

    def _asked(self, key: Key, ask: Callable[[], Stop | None]) -> Stop | None:
        if key not in self._stops:
            if key in self._ahead:
                self._stops[key], questions = self._ahead.pop(key)
                self.sweeps.count += questions
            else:
                before = self.sweeps.count
                self._stops[key] = ask()
                self._new[key] = self._stops[key], self.sweeps.count - before
        return self._stops[key]

    def first_stop(self, group: Sequence[int], others: Iterable[int], start: pin.SE3, end: pin.SE3) -> GroupStop | None:
        """The first stop of a group that moves as one body from one displacement to another, None without one."""
        best: GroupStop | None = None
        for i in group:
            for j in others:
                if frozenset((i, j)) in self.ignored:
                    continue
                found = self.sweeps.stop(i, j, (start, end))
                if found is not None and (best is None or found.t < best.t):
                    best = GroupStop(found.t, i, j, found)
        return best

    def pressed(self, i: int, j: int) -> bool:
        """Whether two parts overlap where they stand by more than a touch."""
        return max(self.sweeps.depths(i, j).values(), default=0.0) > self.tolerance.linear

    def size(self, i: int) -> float:
        """m: half the diagonal of a part's box."""
        return half_size(self.meshes[i])

    def far(self, group: Sequence[int], others: Iterable[int], direction: Array, at: pin.SE3 | None = None) -> float:
        """m: how far a group, displaced by `at`, goes along a unit direction until a plane parts it from all others."""
        front = max((self.sweeps.extent(j, direction)[1] for j in others), default=-np.inf)
        if at is None:
            back = min(self.sweeps.extent(i, direction)[0] for i in group)
        else:
            turned = at.rotation.T @ direction
            back = min(float((self.sweeps.corners(i) @ turned).min()) for i in group)
            back += float(at.translation @ direction)
        return max(0.0, front - back) + CLEAR if np.isfinite(front) else CLEAR

    def with_tolerance(self, linear: float, slop: float) -> Sweeps:
        """Sweeps that stop at another distance (m), to within `slop` of it: to find the least clearance of a way."""
        return self.sweeps.with_tolerance(replace(self.tolerance, linear=linear, slop=slop))


def _pairs(scene: Scene, names: Iterable[tuple[str, str]]) -> frozenset[frozenset[int]]:
    out = set()
    for a, b in names:
        if a == b:
            raise VpframeError(f"{a}:{b}: a part is on both sides; name two different ones")
        out.add(frozenset((scene.index(a), scene.index(b))))
    return frozenset(out)


def translation(vector: Array) -> pin.SE3:
    """The displacement by a vector (3,), m."""
    return pin.SE3(np.eye(3), np.asarray(vector, np.float64))


def turned(origin: Array, axis: Array, angle: float, advance: float = 0.0) -> pin.SE3:
    """The displacement that turns by `angle` rad about a line and goes `advance` m along it."""
    rotation = pin.exp3(angle * axis)
    return pin.SE3(rotation, origin - rotation @ origin + advance * axis)
