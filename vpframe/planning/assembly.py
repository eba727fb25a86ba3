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

from collision import Tolerance
from collision.numeric.kernel import compilation
from collision.query.blocking import Stop, Sweeps
from constraints.freedom.escape import Patch, contact_patch
from vpframe.analysis.clash import clash, is_open
from vpframe.analysis.fits import BAD_KINDS
from vpframe.analysis.mate_motions import LINEAR, Mates, Progress, pairs_of, silent
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
TOLERANCE: Final = Tolerance(linear=LINEAR, slop=1e-6)
"""of planned motions: a leg presses surfaces by 1.5 pm at most, all legs of a way by 10 pm (`Sweeps`), where CAD
kernels place points to within 100 pm (1e-7 mm)"""
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


class Assembly(Mates):
    """A scene as planning sees it.

    Parameters
    ----------
    authorised: pairs of part names whose overlap as drawn is meant.
    ignored: pairs of part names that may pass through each other.
    threads: m a turn by part name: its snug fits are threads, drawn without them.
    tolerance: of planned motions. recognition: by which fits are recognised and clashes judged.
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
        super().__init__(scene, authorised, threads, recognition, progress)
        self.tolerance, self.ignored = tolerance, pairs_of(scene, ignored)
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
        self._progress = silent
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
    def overlaps(self) -> tuple[Overlap, ...]:
        """What overlaps where the parts stand and is neither authorised nor ignored, the deepest first."""
        meant = [*self.authorised_pairs, *self.ignored_pairs]
        rows = clash(self.scene, tolerance=self.recognition, authorised=meant, progress=self._progress)["pairs"]
        found = [
            Overlap(tuple(row["parts"]), tuple(row["surfaces"]), row["depth"])
            for row in rows
            if row["kind"] in BAD_KINDS and is_open(row)
        ]
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


def translation(vector: Array) -> pin.SE3:
    """The displacement by a vector (3,), m."""
    return pin.SE3(np.eye(3), np.asarray(vector, np.float64))


def turned(origin: Array, axis: Array, angle: float, advance: float = 0.0) -> pin.SE3:
    """The displacement that turns by `angle` rad about a line and goes `advance` m along it."""
    rotation = pin.exp3(angle * axis)
    return pin.SE3(rotation, origin - rotation @ origin + advance * axis)
