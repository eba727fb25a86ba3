"""`SessionLog`: the observer that collects the data of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, isnan, nan
from operator import is_

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.analysis.clash_status import ClashKey
from vpframe.analysis.fits import PressFit, press_fits
from vpframe.events import Event, Frame
from vpframe.scene.scene import Scene
from vpframe.session.history import History
from vpframe.session.series import Series

DRAWN = 400
"""maximum number of constraints that are all drawn; of more, recordings and reports omit those that never change"""
PICTURED = ("grabbed", "released", "accepted", "refused", "removed", "blocked", "landed")
"""kinds of events that get a picture"""
STILL = 1e-9
"""m and rad: motion below which parts have not moved"""
SAMPLES = 8
"""number of steps of a clash that are kept for its depth"""


@dataclass
class Clash:
    """Two surfaces that intersected, over the whole session."""

    key: ClashKey
    first: Frame
    """step of the first intersection"""
    spans: list[tuple[int, int, float]]
    """periods of intersection: first step, last step, time of the last step (s)"""
    samples: list[Frame] = field(default_factory=list)
    """some of these steps, evenly spaced, with the first"""
    unmoved: bool = False
    """whether the two parts had their initial relative pose at the first intersection"""
    _stride: int = 1

    @property
    def steps(self) -> int:
        """Number of steps with intersection."""
        return sum(end - begin + 1 for begin, end, _ in self.spans)

    @property
    def last_time(self) -> float:
        """Time of the last step with intersection, s."""
        return self.spans[-1][2]

    def add(self, frame: Frame) -> None:
        """Add a step with intersection."""
        if self.steps % self._stride == 0:
            self.samples.append(frame)
            if len(self.samples) > SAMPLES:
                self.samples = self.samples[::2]
                self._stride *= 2
        begin, end, _ = self.spans[-1]
        if frame.step <= end + 1:
            self.spans[-1] = (begin, frame.step, frame.time)
        else:
            self.spans.append((frame.step, frame.step, frame.time))

    def rewind(self, step: int, time: float) -> None:
        """Forget the steps after one, which is not before the first, at its time (s)."""
        self.spans = [span for span in self.spans if span[0] <= step]
        begin, end, _ = self.spans[-1]
        if end > step:
            self.spans[-1] = (begin, step, time)
        self.samples = [frame for frame in self.samples if frame.step <= step]


@dataclass
class Stage:
    """A period in which the script's line stayed the same."""

    text: str
    start: float
    """s"""
    end: float
    """s"""


@dataclass
class Mate:
    """A constraint or candidate and its states over time."""

    id: int
    kind: str
    parts: tuple[str, str]
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    why: str
    residual: float
    """last known residual, m"""
    press: float = 0.0
    """radial interference of a press fit, m; 0 for anything else"""
    spans: list[tuple[str, float, float]] = field(default_factory=list)
    """state, start, end (s)"""


class SessionLog:
    """Collects stages, clashes, constraints, freedom, clearance, timings and events of a session.

    A step costs a few microseconds; memory is bounded, except for events.
    """

    def __init__(self) -> None:
        self.scene = Scene()
        self.start: dict[str, pin.SE3] = {}
        """poses before the first step"""
        self.stages: list[Stage] = []
        self.clashes: dict[ClashKey, Clash] = {}
        self._mates: dict[int, Mate] = {}
        self._freedom_last: tuple[Mapping[str, int], Mapping[str, str]] = {}, {}
        self._of: tuple[object, ...] | None = None
        self._unread: Frame | None = None
        self.freedom: dict[str, list[tuple[float, int, str]]] = {}
        """changes by part: time (s), degrees of freedom, name of the lower pair"""
        self.clearance: Series[tuple[float, float]] = Series(_nearer)
        """time (s), least clearance (m), NaN if not measured"""
        self.least: Frame | None = None
        """step of least clearance"""
        self.colliding: list[tuple[float, int]] = []
        """changes: time (s), number of colliding surface pairs"""
        self.timings: dict[str, Series[float]] = {}
        """s, for each step"""
        self.totals: dict[str, float] = {}
        """s, of the whole run"""
        self.moments: list[tuple[Event, Frame]] = []
        """events that get a picture"""
        self.history = History()
        self._names: tuple[str, ...] = ()
        self._rows: NDArray[np.int32] | None = None
        self._keys: list[ClashKey] = []
        """keys of `_rows`, reused while the colliding surfaces stay the same"""
        self._stood: tuple[Frame | None, dict[tuple[str, str], bool]] = (None, {})
        self._last_time = 0.0

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, in order."""
        return self.history.events

    @property
    def duration(self) -> float:
        """Time of the last step, s."""
        return self.history.last.time if self.history.last else 0.0

    @property
    def first(self) -> float:
        """Time of the first observed step, s."""
        return next((frame.time for frame, _ in self.history), 0.0)

    @property
    def first_step(self) -> int:
        """Number of the first observed step."""
        return next((frame.step for frame, _ in self.history), 0)

    def lasting(self) -> frozenset[int]:
        """Return the ids of the constraints and candidates that kept one state from start to end."""
        first, last = self.first, self.duration
        spans = ((id, mate.spans) for id, mate in self.mates.items())
        return frozenset(id for id, s in spans if len(s) == 1 and s[0][1] <= first and s[0][2] >= last)

    def uninvolved(self, many: int | None = None) -> frozenset[int]:
        """Return the lasting constraints of parts that no hand held; none if there are at most `many` (default
        DRAWN)."""
        if len(self.mates) <= (DRAWN if many is None else many):
            return frozenset()
        held = {name for frame, _ in self.history for name in frame.held}
        return frozenset(id for id in self.lasting() if held.isdisjoint(self.mates[id].parts))

    @property
    def steps(self) -> int:
        """Number of the last step."""
        return self.history.last.step if self.history.last else 0

    def begin(self, scene: Scene) -> None:
        """Keep the scene and its poses."""
        self.scene = scene
        self._names = scene.names
        self.start = {part.name: part.pose.copy() for part in scene.parts}

    def frame(self, frame: Frame) -> None:
        """Add one step."""
        self.history.add(frame)
        now = frame.time
        if self.stages and self.stages[-1].text == frame.script:
            self.stages[-1].end = now
        else:
            self.stages.append(Stage(frame.script, self.stages[-1].end if self.stages else now, now))
        self._collect_clashes(frame)
        self._collect_mates(frame)
        freedom_now = dict(frame.freedom), dict(frame.joint)
        changed = freedom_now != self._freedom_last
        self._freedom_last = freedom_now
        for part, freedom in frame.freedom.items() if changed else ():
            known = self.freedom.setdefault(part, [])
            joint = frame.joint.get(part, "")
            if not known or known[-1][1:] != (freedom, joint):
                known.append((now, freedom, joint))
        if frame.clearance is None:
            if self.clearance:
                self.clearance.add((now, nan))
        else:
            self.clearance.add((now, frame.clearance))
            if self.least is None or self.least.clearance is None or frame.clearance < self.least.clearance:
                self.least = frame
        for name, seconds in frame.timings.items():
            if name not in self.timings:
                self.timings[name] = Series()
            self.timings[name].add(seconds)
            self.totals[name] = self.totals.get(name, 0.0) + seconds
        first = frame.step <= 1 and not frame.held  # the initial constraints get no pictures
        self.moments.extend(
            (event, frame)
            for event in frame.events
            if event.kind in PICTURED and not (first and event.kind == "accepted")
        )

    def rewind(self, last: Frame | None, events: int) -> None:
        """Forget the frames after `last`, all if it is None, and the events after the first `events`.

        Computing time that was spent stays counted.
        """
        step, now = (-1, -inf) if last is None else (last.step, last.time)
        mates = self.mates
        self.history.rewind(last, events)
        self.stages = [s for k, s in enumerate(self.stages) if s.start < now or (k == 0 and s.start <= now)]
        for stage in self.stages[-1:]:
            stage.end = now
        self.clashes = {key: clash for key, clash in self.clashes.items() if clash.first.step <= step}
        for clash in self.clashes.values():
            clash.rewind(step, now)
        for mate in mates.values():
            mate.spans = [(state, start, min(end, now)) for state, start, end in mate.spans if start <= now]
        self._mates = {id: mate for id, mate in mates.items() if mate.spans}
        self._last_time, self._of = max(now, 0.0), None
        self.freedom = {part: kept for part, row in self.freedom.items() if (kept := [r for r in row if r[0] <= now])}
        self._freedom_last = {}, {}
        self.colliding = [row for row in self.colliding if row[0] <= now]
        known = set(map(id, self.history.events))
        self.moments = [moment for moment in self.moments if id(moment[0]) in known]
        self.clearance.rewind(lambda item: item[0] <= now)
        if self.least is not None and self.least.step > step:
            least = min((row[::-1] for row in self.clearance if not isnan(row[1])), default=None)
            near = [frame for frame, _ in self.history if least is None or frame.time <= least[1]]
            self.least = replace(near[-1], clearance=least[0]) if least and near else None

    def end(self) -> None:
        """Do nothing."""

    def _collect_clashes(self, frame: Frame) -> None:
        if frame.colliding is not self._rows:
            self._rows = frame.colliding
            met = sorted({(a, s, b, t) for a, s, b, t in frame.colliding.tolist()})
            self._keys = [ClashKey.of(self._names[a], s, self._names[b], t) for a, s, b, t in met]
        rows = self._keys
        if not self.colliding or self.colliding[-1][1] != len(rows):
            self.colliding.append((frame.time, len(rows)))
        for key in rows:
            clash = self.clashes.get(key)
            if clash is None:
                unmoved = self._unmoved(frame, key.part_a, key.part_b)
                self.clashes[key] = Clash(key, frame, [(frame.step, frame.step, frame.time)], [frame], unmoved)
            else:
                clash.add(frame)

    def _unmoved(self, frame: Frame, a: str, b: str) -> bool:
        """Whether two parts have their initial relative pose."""
        if self._stood[0] is not frame:
            self._stood = (frame, {})
        stood = self._stood[1]
        if (a, b) not in stood:
            now, then = (poses[a].actInv(poses[b]) for poses in (frame.poses, self.start))
            turned = float(np.abs(now.rotation - then.rotation).max())
            stood[a, b] = max(turned, float(np.abs(now.translation - then.translation).max())) <= STILL
        return stood[a, b]

    @property
    def mates(self) -> dict[int, Mate]:
        """All constraints and candidates so far, by id."""
        if self._unread is not None:
            self._read_mates(self._unread)
            self._unread = None
        return self._mates

    @property
    def press_fits(self) -> tuple[PressFit, ...]:
        """Press fits that were ever in force."""
        used = (m for m in self.mates.values() if any(state == "active" for state, _, _ in m.spans))
        return press_fits((m.parts, m.press) for m in used)

    def _collect_mates(self, frame: Frame) -> None:
        """Add the constraints of a step; of consecutive steps with the same ones only the first and last are read."""
        of = getattr(frame.constraints, "of", None)
        same = of is not None and self._of is not None and all(map(is_, of, self._of))
        if same:
            self._unread = frame
            return
        if self._unread is not None:
            self._read_mates(self._unread)
        self._of, self._unread = of, None
        self._read_mates(frame)

    def _read_mates(self, frame: Frame) -> None:
        for view in frame.constraints:
            mate = self._mates.get(view.id)
            if mate is None:
                mate = self._mates[view.id] = Mate(
                    view.id, view.kind, view.parts, view.surfaces, view.why, view.residual, view.press
                )
            mate.residual = view.residual
            last = mate.spans[-1] if mate.spans else None
            if last and last[0] == view.state and last[2] >= self._last_time:
                mate.spans[-1] = (last[0], last[1], frame.time)
            else:
                mate.spans.append((view.state, frame.time, frame.time))
        self._last_time = frame.time


def _nearer(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Return the entry of less clearance; NaN hides no value."""
    return b if isnan(a[1]) or b[1] < a[1] else a
