"""`Session`: a scene, hands, and the loop that joins collision, constraints and physics step by step.

One step: the hands' wishes -> contacts -> candidates and accepted constraints -> allowed motion -> what is free moves
under its forces -> new poses -> observers. The numerics are in `vpframe.session.step`; this file is what a script
talks to.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from vpframe.app.progress import Watch
from vpframe.app.script_errors import ON_REQUEST, in_one_line, place
from vpframe.errors import CheckpointError, OutputError, TaskError, VpframeError
from vpframe.hands.arguments import FAR, as_pose, metres
from vpframe.hands.conditions import Condition
from vpframe.hands.driver import drive
from vpframe.hands.hand import Hand, Outcome
from vpframe.hands.reach import above, bounds, half_size
from vpframe.report.log import SessionLog
from vpframe.scene.scene import Part, Scene
from vpframe.session import expectations
from vpframe.session.checkpoint import Journal, advance, journal_of
from vpframe.session.events import ConstraintView, Event, Frame, Observer
from vpframe.session.observers import Audience, recorders, viewers
from vpframe.session.pace import Pace, catching_up, under_way
from vpframe.session.rules import Rule, accept_all
from vpframe.session.statements import ContradictionError, Place, limits, state
from vpframe.session.step import Engine, Request, Result, Wish
from vpframe.session.trails import Trails
from vpframe.text import in_part_names

if TYPE_CHECKING:
    from physics import Behaviour
    from vpframe.hands.verbs import Verb
    from vpframe.report.swept import SweptVolume


class Session:
    """One run of a task on a scene.

    Parameters
    ----------
    scene: the parts; their poses are what the session moves.
    viewer: None, "meshcat", or any `Observer`.
    record: None, a `.rrd` file to write (an `Output` to say what it may replace), or any `Observer`.
    rule: who accepts candidate constraints (see `vpframe.session.rules`); by default all are accepted.
    dt: s, length of a step.
    tolerance: what counts as touching, parallel, fitting.
    clearance: whether to measure the least clearance of what moves at every step (observers show it).
    observers: more of them.
    checkpoint: a file that keeps where the run is; `resume` goes on from it, `run` names what it depends on.
    name: of the task, for the report; the model's by default.

    Use it as a context manager, or call `close()`: that ends recording and view.
    """

    def __init__(
        self,
        scene: Scene,
        viewer: str | Observer | None = None,
        record: str | os.PathLike[str] | Observer | None = None,
        *,
        rule: Rule = accept_all,
        dt: float = 1.0 / 60.0,
        tolerance: Tolerance | None = None,
        clearance: bool = False,
        observers: Iterable[Observer] = (),
        checkpoint: str | os.PathLike[str] | None = None,
        resume: bool = False,
        run: Mapping[str, str] | None = None,
        name: str = "",
    ) -> None:
        if not (np.isfinite(dt) and dt > 0.0):
            raise VpframeError(f"dt is {dt!r}; give a positive number of seconds")
        if not len(scene):
            raise VpframeError("the scene has no parts; load or add some before opening a session")
        self.scene = scene
        self.name = name
        self.dt = float(dt)
        self.tolerance = tolerance or Tolerance()
        self.step_count = 0
        self.engine = Engine(scene, self.tolerance, self.dt, rule, clearance)
        self.log = SessionLog()
        """what the report tells"""
        everyone = [self.log, *viewers(viewer), *recorders(record), *observers]
        self._audience = Audience(everyone, lambda: (self.step_count, self.time))
        self.failure = ""
        """why the task cannot be done; empty while nothing says so"""
        self.undecided = "the task has not ended"
        """why nothing can be said of the task; empty once it has ended, by itself or by a failure"""
        self.complete = False
        """whether the task ran to its end"""
        self._concluded = False
        self._handled = sys.exc_info()[1]  # not of this session: it is opened while that error is dealt with
        self._requests: list[Request] = []
        self._hands: dict[str, Hand] = {}
        self._queues: dict[str, deque[Verb]] | None = None
        self._watch = Watch(self._standing, always=True)
        self._frame: Frame | None = None
        self._result: Result | None = None
        self._sizes: dict[str, float] = {}
        self._bounds: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._swept: list[str] = []
        self._trails = Trails()
        self._numbers = {name: i for i, name in enumerate(scene.names)}
        self._begun = self._closed = self._stop = False
        self._shows_clearance = clearance
        self._pace = Pace()
        self._journal: Journal | None = None
        if checkpoint is not None:
            depends = {**(run or {}), "dt": repr(self.dt), "tolerance": repr(self.tolerance)}
            self._journal = journal_of(checkpoint, scene, depends, resume)

    # ---- the loop

    @property
    def time(self) -> float:
        """s since the session began."""
        return self.step_count * self.dt

    @property
    def frame(self) -> Frame | None:
        """The state after the last step; None before the first."""
        return self._frame

    @property
    def events(self) -> tuple[Event, ...]:
        """All that has happened, in order."""
        return tuple(self._audience.events)

    @property
    def observers(self) -> list[Observer]:
        """Who watches: the report's log, viewer and recorder, and those that were given; one that failed is gone."""
        return self._audience.observers

    def step(self) -> Frame:
        """One step of `dt` seconds: every hand goes on with its stroke, everything else follows.

        Raises
        ------
        KeyboardInterrupt: `interrupt()` was called since the last step; the state is that of the last step.
        """
        if self._closed:
            raise VpframeError("the session is closed; open a new one")
        if self._stop:
            raise KeyboardInterrupt
        with self._watch:
            self._begin()
        room = None if self._result is None else self._result.clearance
        careful = any(hand.held is not None and hand.assist.slow_within > 0.0 for hand in self._hands.values())
        self.engine.measure_clearance = self._shows_clearance or careful
        wishes = []
        for hand in self._hands.values():
            wanted = hand.desire(self.dt, hand.assist.rate(room))
            if hand.held is not None:
                wishes.append(
                    Wish(hand.held, wanted, hand.carried, hand.assist.snap, hand.assist.snap_angle, hand.spring)
                )
        requests, self._requests = self._requests, []
        with self._watch:
            offered = () if self._result is None else self._result.constraints
            with in_part_names(self.scene):
                result = advance(self.engine, self._journal, wishes, requests, lambda: self._audience.asked(offered))
        self.step_count += 1
        self._pace.beat()
        self._take_in(result)
        return self._publish(result)

    def run(self, seconds: float) -> None:
        """Let `seconds` pass."""
        for _ in range(max(round(seconds / self.dt), 0)):
            self.step()

    def run_until(self, condition: Condition, limit: float = 60.0) -> bool:
        """Step until the condition holds, for at most `limit` seconds; whether it did."""
        for _ in range(round(limit / self.dt)):
            if condition(self):
                return True
            self.step()
        return condition(self)

    def interrupt(self) -> None:
        """End the run at the next step, with `KeyboardInterrupt` raised from it. Safe in a signal handler.

        A person's pause ends too.
        """
        self._stop = True
        self._audience.play()

    @property
    def compiling(self) -> bool:
        """Whether kernels are being compiled in the present step."""
        return self._watch.compiling

    def perform(self, hand: Hand, verb: Verb) -> Outcome:
        """Run a verb to its end (inside `together`: queue it, and say so in the outcome)."""
        if self._queues is not None:
            self._queues.setdefault(hand.name, deque()).append(verb)
            return Outcome(True, "queued until the end of `together`", self.time)
        return drive(self._hands, {hand.name: deque([verb])}, self.step)[hand.name]

    @contextmanager
    def together(self) -> Iterator[None]:
        """Verbs of different hands inside it run at the same time; those of one hand still one after another."""
        if self._queues is not None:
            raise TaskError("session.together() inside another; close the first before")
        self._queues = {}
        try:
            yield
            queues = self._queues
        finally:
            self._queues = None
        drive(self._hands, queues, self.step)

    def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        self._pace.beat()
        for i, part in enumerate(self.scene.parts):
            self._trails.add(0, i, part.pose)
        self._audience.begin(self)

    def _take_in(self, result: Result) -> None:
        self._result = result
        for name, pose in result.poses.items():
            self.scene[name].pose = pose
            self._trails.add(self.step_count, self._numbers[name], pose)
        for hand in self._hands.values():
            hand.stopped_by = result.blocked.get(hand.held, "") if hand.held else ""
        for happening in result.happenings:
            self._audience.happened(*happening)

    def _publish(self, result: Result) -> Frame:
        self._frame = Frame(
            step=self.step_count,
            time=self.time,
            poses={name: part.pose for name, part in self.scene.items()},
            colliding=result.colliding,
            constraints=result.constraints,
            freedom=result.freedom,
            joint=result.joint,
            clearance=result.clearance if self._shows_clearance else None,
            timings={**result.timings, "observers": self._audience.seconds},
            held=tuple(hand.held for hand in self._hands.values() if hand.held),
            hands={hand.name: pin.SE3(hand.pose) for hand in self._hands.values()},
            script="; ".join(hand.doing for hand in self._hands.values() if hand.doing),
            events=self._audience.news(),
        )
        self._audience.show(self._frame)
        return self._frame

    # ---- hands

    def hand(self, name: str = "hand", at: pin.SE3 | ArrayLike | None = None) -> Hand:
        """The hand of that name; at first use it is made, at a world pose or position (over the scene by default)."""
        if name not in self._hands:
            here = pin.SE3(np.eye(3), above(self.scene)) if at is None else as_pose(at, pin.SE3.Identity())
            self._hands[name] = Hand(self, name, here)
        elif at is not None:
            raise TaskError(f"{name} exists already; move it with {name}.move_to")
        return self._hands[name]

    def holder(self, part: str) -> Hand | None:
        """The hand that holds (or carries) a part."""
        return next((h for h in self._hands.values() if h.held == part or part in h.carried), None)

    def note_grab(self, hand: Hand) -> None:
        """Called by a hand that has closed on a part."""
        assert hand.held is not None
        faces = ", ".join(map(str, hand.surfaces))
        extra = f", carrying {', '.join(hand.carried)}" if hand.carried else ""
        self._audience.happened(
            "grabbed", (hand.held,), (hand.surfaces,), f"{hand.name} holds {hand.held} by surfaces {faces}{extra}", {}
        )

    def note_release(self, hand: Hand) -> None:
        """Called by a hand about to open."""
        assert hand.held is not None
        self._audience.happened("released", (hand.held,), (), f"{hand.name} lets go of {hand.held}", {})

    # ---- what is so

    @property
    def constraints(self) -> tuple[ConstraintView, ...]:
        """Active constraints, as of the last step."""
        return self._constraints("active")

    @property
    def candidates(self) -> tuple[ConstraintView, ...]:
        """Candidates on offer as of the last step, best first."""
        return self._constraints("candidate")

    def _constraints(self, state: str) -> tuple[ConstraintView, ...]:
        known = self.engine.views() if self._result is None else self._result.constraints
        return tuple(c for c in known if c.state == state)

    def constraints_of(self, part: str) -> tuple[ConstraintView, ...]:
        """Active constraints on one part."""
        self.scene[part]
        return tuple(c for c in self.constraints if part in c.parts)

    def touching(self, part: str) -> dict[str, tuple[int, ...]]:
        """What the part touches, mated surfaces left out: by part name, the surfaces of that part."""
        me = self.scene.index(part)
        found: dict[str, set[int]] = {}
        names = self.scene.names
        for a, sa, b, sb in () if self._result is None else self._result.touching.tolist():
            if me in (a, b):
                other, surface = (b, sb) if a == me else (a, sa)
                found.setdefault(names[other], set()).add(surface)
        return {name: tuple(sorted(surfaces)) for name, surfaces in sorted(found.items())}

    def freedom(self, part: str) -> int:
        """Degrees of freedom left to a part by the active constraints (0 when it is fixed)."""
        return self.engine.freedom(self.scene.index(part))[0]

    def joint(self, part: str) -> str:
        """The lower pair that the active constraints leave a part, by name ("free", "cylindrical", "revolute", …)."""
        return self.engine.freedom(self.scene.index(part))[1]

    def clearance(self, part: str, other: str | None = None) -> float:
        """Least distance (m) of a part to another, or to all it is not constrained to; inf if there are none."""
        i = self.scene.index(part)
        if other is not None:
            with in_part_names(self.scene):
                return self.engine.clearance(i, [self.scene.index(other)])
        mates = {self.scene.index(name) for c in self.constraints_of(part) for name in c.parts}
        carried = {
            self.scene.index(n)
            for h in self._hands.values()
            if part in (h.held, *h.carried)
            for n in (h.held, *h.carried)
            if n
        }
        with in_part_names(self.scene):
            return self.engine.clearance(i, [j for j in range(len(self.scene)) if j not in mates | carried | {i}])

    def clashes(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface that intersect now, mated surfaces and authorised pairs left out."""
        return np.zeros((0, 4), np.int32) if self._result is None else self._result.colliding

    def half_size(self, part: str) -> float:
        """Half the diagonal of a part's bounding box, m."""
        if part not in self._sizes:
            self._sizes[part] = half_size(self.scene[part].mesh)
        return self._sizes[part]

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(3,) lower and upper corner of the box about all parts when a script first moved one, m."""
        if self._bounds is None:
            self._bounds = bounds(self.scene)
        return self._bounds

    def pitch_of(self, part: str) -> float | None:
        """m a turn, of the thread that holds a part, negative for a left-hand one: from `thread`, else from a screw
        constraint; None if neither tells."""
        return self.engine.pitch_of(self.scene.index(part))

    def trail(self, part: str) -> tuple[tuple[int, pin.SE3], ...]:
        """(step, pose) whenever the part moved, from step 0 on."""
        self._begin()
        return self._trails.of(self.scene.index(part))

    # ---- what the script decides

    def accept(
        self, candidate: ConstraintView, break_distance: float | None = None, break_force: float | None = None
    ) -> None:
        """Accept a candidate, from the next step on.

        break_distance: m; a pull farther than this ends it, `Tolerance.break_distance` if not given.
        break_force: N; a spring (`hand.spring`) that pulls harder ends it; other hands have no measure of force.
        """
        self._requests.append(Request("accept", candidate.id, limits("accept", break_distance, break_force)))

    def refuse(self, candidate: ConstraintView) -> None:
        """Refuse a candidate; it is not offered again until the parts have parted."""
        self._requests.append(Request("refuse", candidate.id))

    def remove(self, constraint: ConstraintView) -> None:
        """Drop an active constraint."""
        self._requests.append(Request("remove", constraint.id))

    def constrain(
        self,
        kind: str,
        a: Place,
        b: Place,
        *,
        break_distance: float | None = None,
        break_force: float | None = None,
        **parameters: Any,
    ) -> ConstraintView:
        """State a constraint that contact does not tell (see `vpframe.session.statements`), from the next step on.

        kind: "gear", "belt", "rack-and-pinion", "screw", "angle", "distance", "parallel", "fixed", or any other of
        `docs/constraints.md`. a, b: a part, or (part, surface). parameters: of the kind, e.g. `teeth=(20, 41)`.
        break_distance, break_force: as of `accept`; if not given, no pull ends it.

        Raises
        ------
        ContradictionError: it cannot hold with those in force, and by how much. UnknownPartError, TaskError: bad words.
        """
        bears = limits("constrain", break_distance, break_force)
        try:
            with in_part_names(self.scene):
                request, view = state(self.engine, self._requests, kind, a, b, parameters, bears)
        except ContradictionError as error:
            self._audience.happened("refused", error.parts, (), str(error), {"constraint": kind, "off": error.off})
            raise
        self._requests.append(request)
        return view

    def thread(self, part: str, pitch: float) -> None:
        """Say that a part is threaded with that pitch (m a turn): positive for a right-hand thread, else negative."""
        if not np.isfinite(pitch) or pitch == 0.0:
            raise TaskError(f"thread({part!r}, {pitch!r}): the pitch is metres a turn, negative for a left-hand thread")
        size = 2.0 * self.half_size(part)
        metres(pitch, f"thread({part!r}, {pitch!r})", part, size, FAR * size)
        self.engine.threads[self.scene.index(part)] = float(pitch)

    def authorise(self, a: str, b: str) -> None:
        """Let two parts overlap (a press fit, a seal): they neither clash nor block each other."""
        self.engine.authorise(self.scene.index(a), self.scene.index(b))

    def behave(
        self, part: str, *behaviours: Behaviour, material: str | float | None = None, mass: float | None = None
    ) -> None:
        """Give a part behaviours (`physics.Gravity()`, `physics.Elastic(0.6)`, …): with them it moves under forces
        whenever no hand holds it, and stands on, bounces off and slides along the other parts.

        material: a name from `physics.DENSITY` or kg/m³; the part's own density, else steel, if not given. mass: kg.
        """
        i = self.scene.index(part)
        if self.scene[part].fixed:
            raise TaskError(f"{part} is fixed in the scene; set part.fixed = False before giving it behaviours")
        from vpframe.session.dynamics import body_of

        body = body_of(self.scene[part], material, mass)
        with in_part_names(self.scene):
            self.engine.behave(i, body, behaviours)
        for note in body.notes:
            self.note(note)

    # ---- what the task expects

    def expect(self, condition: Condition | bool, reason: str = "") -> None:
        """Fail the task unless the condition holds: TaskError, and if the script goes on it has failed all the same."""
        holds = condition(self) if isinstance(condition, Condition) else bool(condition)
        text = reason or str(condition)
        self._audience.happened("expectation", (), (), f"{'holds' if holds else 'FAILS'}: {text}", {"holds": holds})
        if not holds:
            self.failure = f"expected {text}"  # whatever the script makes of the error
            raise TaskError(self.failure)

    def expect_constraint(self, kind: str, a: str, b: str) -> None:
        """Expect an active constraint of that kind between two parts."""
        self.expect(*expectations.constraint(self, kind, a, b))

    def expect_freedom(self, part: str, n: int) -> None:
        """Expect that a part has `n` degrees of freedom left."""
        self.expect(*expectations.freedom(self, part, n))

    def expect_free(self, part: str) -> None:
        """Expect that no constraint holds a part and that it touches nothing."""
        self.expect(*expectations.free(self, part))

    def expect_no_clash(self) -> None:
        """Expect that no surfaces intersect but mated ones and authorised pairs."""
        self.expect(*expectations.no_clash(self))

    def expect_at(self, part: str, pose: pin.SE3 | ArrayLike, within: float = 1e-3, angle: float = 0.02) -> None:
        """Expect a part at a pose: its centre within metres, its rotation within radians as far as it can be seen (a
        shaft may be turned about its axis, a hexagonal nut by 60°). Of a position (3,), as `move_to` takes it, rotation
        is not compared.
        """
        self.expect(*expectations.at(self, part, pose, within, angle))

    # ---- what is told

    def on_event(self, listener: Callable[[Event], None]) -> None:
        """Call `listener` with every event as it happens."""
        self._audience.listeners.append(listener)

    def note(self, text: str) -> None:
        """Put a line of the script's own into events, recording and report."""
        self._audience.happened("note", (), (), text, {})

    def fail(self, reason: str) -> None:
        """Mark the task as failed; the report says why."""
        self.failure = reason
        self._last_note(f"failed: {reason}")

    def conclude(self, error: BaseException | None = None, script: Path | None = None) -> None:
        """Say that the task has ended: by itself, or by an error. `with` and `close()` do so by themselves.

        A `TaskError` fails the task. Any other error (of the `script`, or Ctrl-C) leaves it undecided, and so does a
        session that nobody said this of: its report says no "can be done".
        """
        if error is None and self._concluded:
            return
        self._concluded, self.complete = True, error is None and not self._stop
        if isinstance(error, TaskError):
            self.undecided = ""
            self.fail(f"{place(error, script)}{error}")
        elif isinstance(error, KeyboardInterrupt) or (error is None and self._stop):
            self.undecided = ON_REQUEST
        elif error is not None:
            whose = "" if isinstance(error, CheckpointError | OutputError) else "script error: "
            self.undecided = f"{whose}{place(error, script)}{in_one_line(error)}"
        else:
            self.undecided = ""
        if error is not None and self.undecided:
            self._last_note(f"not decided: {self.undecided}")

    def _last_note(self, text: str) -> None:
        if not self._closed:
            self.note(text)

    def sweep(self, part: str) -> None:
        """Ask for the volume that a part sweeps in this session: the report shows it, and what it collides with."""
        name = self.scene[part].name
        if name not in self._swept:
            self._swept.append(name)

    def swept(self, part: str, resolution: float | None = None) -> SweptVolume:
        """The volume that a part has swept so far, and the parts that it collides with (see `vpframe.analysis.swept`).

        Parts that a constraint joined it to at any time, and those authorised to overlap it, are not checked.
        """
        from vpframe.analysis.swept import swept_volume

        self.engine.start()
        pairs = [pair for pair in (*self.engine.joined, *self.engine.authorised) if part in pair]
        allowed = {part, *(name for pair in pairs for name in pair)}
        rest = [p for p in self.scene.parts if p.name not in allowed]
        return swept_volume(self.scene[part], [pose for _, pose in self.trail(part)], rest, resolution)

    def report(self, directory: str | os.PathLike[str]) -> Path:
        """Write the report folder (`index.html`, `report.json`, `clashes.csv`), or the `OutputFolder` of one; its path.

        Raises OutputError where a file of such a name is none that an earlier report left.
        """
        from vpframe.report import write

        swept = [self.swept(part) for part in self._swept]
        return write(
            directory,
            self.log,
            failure=self.failure,
            undecided=self.undecided,
            complete=self.complete,
            task=self.name,
            authorised=self.engine.authorised,
            swept=swept,
        )

    def close(self) -> None:
        """End view and recording. Called once or more; nothing moves afterwards. It ends the task, if nothing did.

        Raises OutputError when the recording, or what another observer wrote, could not be written to its end.
        """
        if self._closed:
            return
        if not self._concluded:
            error = sys.exc_info()[1]  # in a `finally`, what ended the task
            self.conclude(None if error is self._handled else error)
        news = self._audience.news()
        if news and self._frame is not None:  # what happened after the last step
            self._audience.show(replace(self._frame, events=news))
        self._closed = True
        self._watch.close()
        if self._begun:
            self._audience.end()
        else:
            self._audience.observers.clear()  # what they claimed is free again
        if self._journal is not None:
            self._journal.close()
        if self._audience.lost:
            raise self._audience.lost[0]

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.conclude(error)
        try:
            self.close()
        except OutputError:
            if error is None:  # what went wrong before matters more; a note in the events says this
                raise

    def _standing(self) -> str:
        journal = self._journal
        if journal is not None and journal.replaying:
            return catching_up(self.step_count, len(journal.past), self._pace)
        return under_way(self.time, self.dt, list(self._hands.values()), self._pace, self._stop)


__all__ = ["Part", "Session"]
