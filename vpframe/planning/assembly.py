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
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Stop, Sweeps, Tolerance, buried
from collision.numeric.kernel import compilation
from constraints.freedom.escape import Patch, contact_patch
from constraints.recognition.fasteners import Fastener
from vpframe.analysis.clash import clash, is_open
from vpframe.analysis.fasteners import fasteners_of
from vpframe.analysis.mate_motions import LINEAR, Mates, Progress, pairs_of, silent
from vpframe.errors import VpframeError
from vpframe.scene.boxes import half_size
from vpframe.scene.deflection import deflections
from vpframe.scene.scene import Scene

Array = NDArray[np.float64]
Knots = tuple[pin.SE3, ...]
"""world displacements from the initial poses, the first the identity"""
Key = tuple[Any, ...]
"""cache key of a sweep: moving part, static part, path"""
Answer = tuple[Stop | None, int]
"""result of a sweep, and the number of legs swept"""
TOLERANCE: Final = Tolerance(linear=LINEAR, slop=1e-6)
"""of planned motions: a leg presses surfaces by 1.5 pm at most, all legs of a way by 10 pm (`Sweeps`), where CAD
kernels place points to within 100 pm (1e-7 mm)"""
CLEAR: Final = 3e-3
"""m: final clearance of a removed part; beyond it a session's mates are released"""
LOOKED_AT: Final = 16
"""poses of a path at which depths are looked at"""
SAME: Final = 1e-7
"""m: by which the corners of a part that is drawn twice differ at most"""
QUESTIONS: Final = 500
"""per second of budget: sweeps and intersection tests; on slower machines the processor time ends first"""


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
    """What a search may use: `seconds` times QUESTIONS questions, and as many seconds of processor time.

    Raises VpframeError if `seconds` is not positive and finite. clock: returns the processor time, s. reserve: fraction
    of both that is kept back until `release`.
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = working, reserve: float = 0.0) -> None:
        if not 0.0 < seconds < np.inf:
            raise VpframeError(f"the budget is {seconds!r}; give a positive number of seconds")
        self.seconds, self.questions, self.used = seconds, int(np.ceil(seconds * QUESTIONS)), 0
        self._clock, self._late, self._part, self._ended = clock, False, 1.0 - reserve, ""
        self.by_clock = False
        """whether the processor time ended it, or a share of it: another run may then come farther"""
        self.begin()

    def begin(self) -> None:
        """Count processor time from now on."""
        self._began = self._clock()

    def ask(self, questions: int = 1) -> None:
        """Use up questions before they are computed; raises BudgetError when questions or time are used up."""
        self.used += questions
        if self.spent > self._part * self.seconds:
            self._late = self.by_clock = True
        if self._over:
            raise BudgetError(f"the budget of {self.ended} is used up")

    def release(self) -> None:
        """Let the reserve be used, too; `ended` still tells what ended the search before."""
        self._ended, self._late, self._part = self.ended, False, 1.0

    def take(self, seconds: float) -> None:
        """Add processor time of another process, s."""
        self._began -= seconds

    @property
    def spent(self) -> float:
        """Processor time used so far, s."""
        return self._clock() - self._began

    @property
    def ended(self) -> str:
        """The limit that was reached, in words; empty if none was."""
        return self._ended or self._over

    @property
    def _over(self) -> str:
        if self._late:
            return f"{self.seconds:.4g} s of processor time"
        return f"{self.questions} questions" if self.used > self._part * self.questions else ""

    def document(self) -> dict[str, Any]:
        """The budget in JSON; without the time spent, which is another in each run."""
        keys = ("seconds", "questions", "asked", "ended_by", "ended_by_clock")
        return dict(zip(keys, (self.seconds, self.questions, self.used, self.ended, self.by_clock), strict=True))

    @property
    def left(self) -> float:
        """Processor time left, s."""
        return max(0.0, self._part * self.seconds - self.spent)

    def share(self, part: float) -> Budget:
        """A budget of a fraction of what is left, for one search of several; `give_back` it."""
        out = Budget(max(part * self.left, 1e-3), self._clock)
        out.questions = int(np.ceil(part * max(self._part * self.questions - self.used, 0)))
        return out

    def give_back(self, share: Budget) -> None:
        """Add the questions that a share has used."""
        self.used += share.used
        self.by_clock |= share.by_clock


@dataclass(frozen=True)
class Overlap:
    """Surfaces that intersect at the initial poses by more than fits and facets explain."""

    parts: tuple[str, str]
    surfaces: tuple[int, ...]
    depth: float
    """m"""
    at: tuple[float, float, float] | None = None
    """(3,) world, m: the deepest point, where it is known"""
    clash: bool = True
    """whether it is more than the deflection of the triangles explains"""

    @property
    def text(self) -> str:
        """In words, without the parts."""
        place = "" if self.at is None else " at ({:.1f}, {:.1f}, {:.1f}) mm".format(*(1e3 * x for x in self.at))
        kind = "a clash" if self.clash else "within the deflection of the triangles"
        return f"{self.depth * 1e3:.3g} mm as drawn{place}: {kind}"


@dataclass(frozen=True, eq=False)
class GroupStop:
    """The stop of a group of parts that move as one body."""

    t: float
    """fraction of the leg, in [0, 1)"""
    part: int
    """of the group"""
    by: int
    stop: Stop


class Assembly(Mates):
    """The parts of a scene with their fits, contacts and cached sweeps, for planning.

    Parameters
    ----------
    authorised: pairs of part names whose overlap as drawn is meant.
    ignored: pairs of part names that may pass through each other.
    threads: m a turn by part name: its snug fits are threads, drawn without them.
    tolerance: of planned motions. recognition: by which fits are recognised and clashes judged.

    A bare mesh that is near no other part counts as one surface: no surfaces are searched on it (`Shape.unsegmented`).
    """

    def __init__(
        self,
        scene: Scene,
        authorised: Iterable[tuple[str, str]] = (),
        threads: Mapping[str, float] | None = None,
        tolerance: Tolerance = TOLERANCE,
        progress: Progress = silent,
        ignored: Iterable[tuple[str, str]] = (),
        recognition: Tolerance | None = None,
    ) -> None:
        near = (recognition or Tolerance()).clearance
        super().__init__(_unsegmented(scene, near, threads or ()), authorised, threads, recognition, progress)
        self.tolerance, self.ignored = tolerance, pairs_of(scene, ignored)
        self._forget()

    def _forget(self) -> None:
        self.sweeps = Sweeps(self.meshes, self.poses, self.tolerance, self.left_out)
        self._stops: dict[Key, Stop | None] = {}
        self._ahead: dict[Key, Answer] = {}
        self._new: dict[Key, Answer] = {}
        self._deepens: dict[Key, bool] = {}
        self._patches: dict[tuple[int, int], tuple[Patch, ...]] = {}
        self._new_patches: dict[tuple[int, int], tuple[Patch, ...]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """The state for worker processes, without cached answers."""
        left_out = {"world", "candidates", "sweeps", "_progress", "_stops", "_deepens"}
        left_out |= {"_ahead", "_new", "_patches", "_new_patches"}
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._progress = silent
        self._forget()

    def prepare(self) -> None:
        """Compute the analysis that all answers need, before a budget begins and before workers are started."""
        _ = self.mates, self._jams, self._touching, self.overlaps, self.fasteners

    def answer(self, stops: Mapping[Key, Answer], patches: Mapping[tuple[int, int], tuple[Patch, ...]]) -> None:
        """Store answers of worker processes; a question counts when the plan first uses it."""
        self._ahead |= {key: found for key, found in stops.items() if key not in self._stops}
        self._patches |= patches

    def new_answers(self) -> tuple[dict[Key, Answer], dict[tuple[int, int], tuple[Patch, ...]]]:
        """Answers since the last call: stops with their numbers of sweeps, and patches."""
        out = self._new, self._new_patches
        self._new, self._new_patches = {}, {}
        return out

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def overlaps(self) -> tuple[Overlap, ...]:
        """Overlaps as drawn that are neither authorised nor ignored, the deepest first."""
        meant = [*self.authorised_pairs, *self.ignored_pairs]
        rows = clash(self.scene, tolerance=self.recognition, authorised=meant, progress=self._progress)
        found = [Overlap(row.parts, row.surfaces, row.depth, row.point) for row in rows if is_open(row)]
        return tuple(sorted(found, key=lambda o: (-o.depth, o.parts, o.surfaces)))

    @property
    def authorised_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs of parts whose overlap as drawn is meant, in the order of the scene."""
        return self._named(self.authorised)

    @property
    def ignored_pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the pairs of parts that may pass through each other, in the order of the scene."""
        return self._named(self.ignored)

    def _named(self, pairs: Iterable[frozenset[int]]) -> tuple[tuple[str, str], ...]:
        return tuple((self.names[a], self.names[b]) for a, b in sorted(tuple(sorted(pair)) for pair in pairs))

    # -- contacts

    @cached_property
    def _touching(self) -> dict[tuple[int, int], set[tuple[int, int]]]:
        """Pairs of features that may touch at the initial poses, by pair of parts."""
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
        """Contact patches of part i, which may move, with part j at their initial poses. Cached.

        Of closed solids only, whose normals are known to point outwards.
        """
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

    @cached_property
    def partners(self) -> tuple[frozenset[int], ...]:
        """By part, the parts that it may touch, or has a fit, thread or clashing bore with, at the initial poses."""
        out: list[set[int]] = [set() for _ in self.names]
        for a, b in (*self.mates, *self._jams, *self._touching):
            out[a].add(b)
            out[b].add(a)
        return tuple(map(frozenset, out))

    @cached_property
    def clashing(self) -> dict[frozenset[int], Overlap]:
        """The deepest overlap of each pair of parts that overlap as drawn."""
        place = {name: i for i, name in enumerate(self.names)}
        return {frozenset(place[name] for name in o.parts): o for o in reversed(self.overlaps)}

    @cached_property
    def duplicates(self) -> tuple[tuple[int, ...], ...]:
        """Parts that are drawn more than once at one place: the same corners to within 0.1 µm."""
        alike: dict[tuple[int, int], list[int]] = {}
        for i, mesh in enumerate(self.meshes):
            alike.setdefault((len(mesh.vertices), len(mesh.triangles)), []).append(i)
        out: list[list[int]] = []
        for same in alike.values():
            found: list[list[int]] = []
            for i in same:
                twin = next((known for known in found if self._coincide(known[0], i)), None)
                found.append([i]) if twin is None else twin.append(i)
            out += [known for known in found if len(known) > 1]
        return tuple(sorted(map(tuple, out)))

    def _coincide(self, i: int, j: int) -> bool:
        low_high = np.stack([self.sweeps.extents(axis) for axis in np.eye(3)])
        if np.abs(low_high[:, :, i] - low_high[:, :, j]).max() > SAME:
            return False
        from scipy.spatial import cKDTree

        a, b = (self.meshes[k].vertices @ self.poses[k].rotation.T + self.poses[k].translation for k in (i, j))
        return bool(cKDTree(a).query(b)[0].max() <= SAME >= cKDTree(b).query(a)[0].max())

    @cached_property
    def fasteners(self) -> dict[int, Fastener]:
        """The parts that are fasteners."""
        return fasteners_of(self.scene)

    # -- questions

    def stop(self, i: int, j: int, knots: Knots) -> Stop | None:
        """The stop of part i by static part j along a path; None if it reaches the end. Cached."""
        if frozenset((i, j)) in self.ignored:
            return None
        key = i, j, *(k.homogeneous.tobytes() for k in knots)
        return self._asked(key, lambda: self.sweeps.stop(i, j, knots))

    def straight(self, i: int, j: int, direction: Array) -> Stop | None:
        """The stop of part i by part j on a straight path along a unit direction until they are apart. Cached."""
        if frozenset((i, j)) in self.ignored:
            return None
        key = i, j, direction.tobytes()
        back = j, i, (0.0 - direction).tobytes()
        if key not in self._stops and back in self._stops and self._stops[back] is None:
            return None
        return self._asked(key, lambda: self.sweeps.straight(i, j, direction, CLEAR))

    def known_stop(self, i: int, j: int, direction: Array) -> Stop | None:
        """The cached result of `straight`; None if there is none."""
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
        """Whether two parts overlap at their initial poses by more than the tolerance."""
        return max(self.sweeps.depths(i, j).values(), default=0.0) > self.tolerance.linear

    def drawn_into(self, i: int, j: int) -> Overlap | None:
        """What of two parts overlaps as drawn, other than by a fit or thread; None if nothing does."""
        pair = frozenset((i, j))
        if pair in self.ignored:
            return None
        if pair in self.clashing:
            return self.clashing[pair]
        identity = pin.SE3.Identity()
        fits = self.left_out(i, j, identity, identity)
        if j not in self.sweeps.beside(i, (identity, identity)):
            return None
        if fits is not None and not any(self.sweeps.overlap(i, j, tuple(fits))):
            return None
        depth = max(self.sweeps.depths(i, j).values(), default=0.0)
        return Overlap((self.names[i], self.names[j]), (), depth, None, False)

    def deepens(self, i: int, j: int, knots: Knots, depth: float) -> bool:
        """Whether part i gets deeper into part j, or j into i, than `depth` m at poses along a path."""
        key = i, j, depth, *(k.homogeneous.tobytes() for k in knots)
        if key not in self._deepens:
            each = max(1, LOOKED_AT // (len(knots) - 1))
            self._deepens[key] = any(
                self._is_deeper(i, j, start * pin.exp6(pin.log6(start.actInv(end)) * (k / each)), depth)
                for start, end in pairwise(knots)
                for k in range(1, each + 1)
            )
        return self._deepens[key]

    def _is_deeper(self, i: int, j: int, at: pin.SE3, depth: float) -> bool:
        pose = self.poses[j].actInv(at * self.poses[i])
        a, b = self.meshes[i], self.meshes[j]
        return bool(len(buried(a, b, pose, depth)) or len(buried(b, a, pose.inverse(), depth)))

    def size(self, i: int) -> float:
        """m: half the diagonal of a part's box."""
        return half_size(self.meshes[i])

    def ball(self, group: Iterable[int]) -> tuple[Array, float]:
        """Centre (3,), world, and half the diagonal of the box of a group at its initial poses, m."""
        corners = np.concatenate([self.sweeps.corners(i) for i in group])
        low, high = corners.min(axis=0), corners.max(axis=0)
        return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))

    def far(self, group: Sequence[int], others: Iterable[int], direction: Array, at: pin.SE3 | None = None) -> float:
        """Path length of a group, displaced by `at`, along a unit direction until a plane separates it, m."""
        front = float(self.sweeps.extents(direction)[1, list(others)].max(initial=-np.inf))
        if at is None:
            back = min(self.sweeps.extent(i, direction)[0] for i in group)
        else:
            turned = at.rotation.T @ direction
            back = min(float((self.sweeps.corners(i) @ turned).min()) for i in group)
            back += float(at.translation @ direction)
        return max(0.0, front - back) + CLEAR if np.isfinite(front) else CLEAR

    def with_tolerance(self, linear: float, slop: float) -> Sweeps:
        """Sweeps that stop at another distance `linear`, m, to within the fraction `slop`, to measure clearances."""
        return self.sweeps.with_tolerance(replace(self.tolerance, linear=linear, slop=slop))


def _unsegmented(scene: Scene, near: float, threaded: Container[str]) -> Scene:
    """The scene with every bare mesh as one surface, except where its surfaces matter: of parts within `near` m of
    others, between which there may be fits and contacts, and of those that are `threaded`."""
    parts = scene.parts
    bare = {k for k, p in enumerate(parts) if p.shape.unsegmented is not p.shape and p.name not in threaded}
    if not bare:
        return scene
    world = CollisionManager()
    for k, part in enumerate(parts):
        world.add(part.shape.unsegmented.mesh, part.pose, movable=k in bare)
    rows = world.contacts(near)
    bare -= {*rows["object_a"].tolist(), *rows["object_b"].tolist()}
    made = [p.copy(shape=p.shape.unsegmented) if k in bare else p for k, p in enumerate(parts)]
    return Scene(made, scene.source, scene.notes, scene.statements, scene.rules)


def translation(vector: Array) -> pin.SE3:
    """The displacement by a vector (3,), m."""
    return pin.SE3(np.eye(3), np.asarray(vector, np.float64))


def turned(origin: Array, axis: Array, angle: float, advance: float = 0.0) -> pin.SE3:
    """The displacement that turns by `angle` rad about a line and goes `advance` m along it."""
    rotation = pin.exp3(angle * axis)
    return pin.SE3(rotation, origin - rotation @ origin + advance * axis)
