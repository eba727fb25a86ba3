"""`Session`, the object that task scripts use: it connects a scene, hands and observers and advances them step by step.

`vpframe.session.state` is what changes, `vpframe.session.engine` has the managers, `vpframe.session.step` computes a
step.
"""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from collision import Tolerance
from collision.numeric.kernel import compilation
from constraints.recognition.candidate import Candidate
from vpframe import console, services
from vpframe.analysis.meanings import Meaning
from vpframe.errors import CheckpointError, OutputError, TaskError, VpframeError
from vpframe.events import ConstraintView, ContactPoint, Event, Frame, Observer, Poses
from vpframe.hands.access import Reach, reach_of
from vpframe.hands.arguments import FAR, as_pose, metres, vector
from vpframe.hands.driver import drive
from vpframe.hands.gripper import Gripper
from vpframe.hands.hand import Hand
from vpframe.hands.segment import Condition, Outcome, Verb
from vpframe.scene.boxes import above, bounds, half_size
from vpframe.scene.names import face_words, in_part_names
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed, parts_named
from vpframe.scripts import ON_REQUEST, in_one_line, place
from vpframe.session import expectations
from vpframe.session.checkpoint import Journal, advance_or_replay, journal_of
from vpframe.session.engine import Engine, HeldOverlap
from vpframe.session.interrupts import deferred
from vpframe.session.log import SessionLog
from vpframe.session.observers import Observers, recorders, viewers
from vpframe.session.pace import Pace, catching_up, under_way
from vpframe.session.readings import Readings
from vpframe.session.rules import Rule, accept_all
from vpframe.session.state import Changes, Decision, State
from vpframe.session.statements import ContradictionError, Place, limits, stated
from vpframe.session.step import DecisionError, HandTarget, Inputs, observed
from vpframe.session.trails import Trails

if TYPE_CHECKING:
    from physics import Behaviour, Material
    from vpframe.analysis.swept import SweptVolume


class SessionMark(NamedTuple):
    """Data kept by `Session.mark`."""

    state: State
    frame: Frame | None
    events: int
    """number of events so far"""
    shown: int
    """number of events that observers have received"""


class Session:
    """One run of a task on a scene. Use it as a context manager, or call `close()` to end recording and viewer.

    Parameters
    ----------
    scene: the parts; the session moves their poses.
    viewer: None, "meshcat", or any `Observer`.
    record: None, a `.rrd` file to write (an `Output` states which file it may replace), or any `Observer`.
    gravity: (3,) m/s², e.g. (0, 0, -9.81): acts on every free part that has mass from `behave` and no `Gravity` of its
        own. None: no gravity.
    rule: accepts or refuses candidate constraints (see `vpframe.session.rules`); the default accepts all.
    dt: length of a step, s.
    tolerance: limits below which surfaces count as touching, parallel or fitting.
    clearance: whether to measure the least clearance of moving parts at every step (observers show it).
    access: whether a straight tool must reach the parts that hands grab and turn: True, or a `Reach` of another size.
    observers: further observers.
    checkpoint: file in which the progress of the run is saved.
    resume: whether to continue the run saved in `checkpoint`.
    run: inputs on which the checkpoint depends, by name; a checkpoint with other values is not resumed.
    name: name of the task in the report; the default is the name of the model.
    """

    def __init__(
        self,
        scene: Scene,
        viewer: str | Observer | None = None,
        record: str | os.PathLike[str] | Observer | None = None,
        *,
        gravity: ArrayLike | None = None,
        rule: Rule = accept_all,
        dt: float = 1.0 / 60.0,
        tolerance: Tolerance | None = None,
        clearance: bool = False,
        access: Reach | bool = False,
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
        self.access = reach_of(access, "access")
        """tool that must reach the parts that hands grab and turn; None: no check"""
        self.rule = rule
        pull = vector((0.0, 0.0, 0.0) if gravity is None else gravity, "gravity")
        self.engine = Engine(scene, self.tolerance, pull, self._judge, self._make_hand)
        """managers of collision, constraints, motion and physics"""
        self._readings = Readings(self.engine)
        self.log = SessionLog()
        """observer that collects the data of the report"""
        everyone = [self.log, *viewers(viewer), *recorders(record), *observers]
        self._observers = Observers(everyone, lambda: (self.step_count, self.time))
        self.failure = ""
        """reason why the task failed; empty if it has not failed"""
        self.undecided = "the task has not ended"
        """reason why the result of the task is unknown; empty once the task has ended or failed"""
        self.complete = False
        """whether the task ran to its end"""
        self._rule_failed = self._step_failed = self._verb_failed = ""  # reasons for `_not_shown`
        self._lock = threading.RLock()
        self._concluded = False
        self._error_before = sys.exc_info()[1]  # an error handled by the caller, raised before this session was opened
        self._queues: dict[str, deque[Verb]] | None = None
        self._watch = console.watch(self._standing)
        self._frame: Frame | None = None
        self._changes: Changes | None = None
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
            if self.access is not None:
                depends["access"] = repr(self.access)
            self._journal = journal_of(checkpoint, scene, depends, resume)
        self._impose()

    # ---- steps

    @property
    def step_count(self) -> int:
        """Number of steps taken."""
        return self.engine.step

    @property
    def time(self) -> float:
        """Time since the session began, s."""
        return self.step_count * self.dt

    @property
    def start(self) -> Mapping[str, pin.SE3]:
        """Poses of all parts when the first step began, by name; empty before."""
        return self.log.start

    @property
    def frame(self) -> Frame | None:
        """The state after the last step; None before the first."""
        return self._frame

    @property
    def events(self) -> tuple[Event, ...]:
        """All events so far, in order."""
        return tuple(self._observers.events)

    @property
    def observers(self) -> list[Observer]:
        """The active observers: log of the report, viewer, recorder and others; observers that raised are removed."""
        return self._observers.observers

    def step(self) -> Frame:
        """Advance the session by one step of `dt` seconds and return its frame.

        A step that fails or is interrupted changes nothing (see `vpframe.session.step`).

        Raises
        ------
        KeyboardInterrupt: `interrupt()` was called since the last step; the state is that of the last step.
        VpframeError: the session is closed, or another thread uses it.
        """
        self._require_open()
        if self._stop:
            raise KeyboardInterrupt
        with self._alone(), self._watch:
            self.engine.keep_parts()
            count = self.step_count
            try:
                self._start()
                self._advance()
                self._observers.tell()
            except Exception as error:
                self._step_failed = f"step {count + 1} failed: {in_one_line(error)}"
                raise
            self._step_failed = ""
        assert self._frame is not None
        return self._frame

    def _require_open(self) -> None:
        if self._closed:
            raise VpframeError("the session is closed; open a new one")

    def _start(self) -> None:
        """Attach the parts, begin the observers, and create the managers, unless that is done."""
        self.engine.keep_parts()
        self._begin()
        self._observers.tell()
        self.engine.start()

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other threads out inside the block; VpframeError if one is inside already."""
        if not self._lock.acquire(blocking=False):
            raise VpframeError(
                "another thread uses this session; use it from one thread at a time, or open a session for each"
            )
        try:
            yield
        finally:
            self._lock.release()

    def show(self) -> Frame:
        """Show the present state to the observers without a step: before the first step, or after `undo`."""
        self._require_open()
        with self._alone(), self._watch:
            self._start()
            self._changes = observed(self.engine, self._readings)
            self._frame = None  # a new frame gets the poses of all parts
            self._frame = self._frame_of(self._changes)
            self._observers.show(self._frame)
            self._observers.tell()
        return self._frame

    @property
    def state(self) -> State:
        """All that changes while the session runs, as one value; `save` returns it as bytes."""
        self.engine.start()
        return self.engine.state

    def save(self) -> bytes:
        """Return the state as bytes, without behaviours and rules of the script."""
        return self.engine.save()

    def restore(self, saved: bytes) -> None:
        """Restore the bytes that `save` returned, in this or another process; the run continues bit for bit.

        The session must have the same scene, tolerance, rule, masses and behaviours. Raises StateError, and changes
        nothing, if the bytes are damaged or belong to another scene.
        """
        with self._alone():
            self.engine.restore(saved)
            self._changes = None

    def mark(self) -> SessionMark:
        """Return a mark of the present state for `undo`; parts must not be given mass in between.

        Raises VpframeError if the session keeps a checkpoint, because its journal cannot go back.
        """
        if self._journal is not None:
            raise VpframeError("a session that keeps a checkpoint cannot go back; open it without one")
        with self._alone():
            self._keep_parts()
            self._begin()
            self.engine.start()
            return SessionMark(self.engine.state, self._frame, len(self.events), self._observers.shown)

    def undo(self, mark: SessionMark) -> None:
        """Restore the state at a mark, bit for bit; later events are dropped, observers see it with `show`.

        Viewers and the report forget what followed; recordings and listeners keep it.
        """
        with self._alone(), deferred():
            self.engine.state, self._frame, self._changes = mark.state, mark.frame, None
            self._trails.rewind(self.step_count)
            self._observers.rewind(mark.events, mark.shown, mark.frame)

    def _advance(self) -> None:
        """Compute and commit one step; on any error or interrupt go back to the state before it, bit for bit."""
        before, events, committed = self.engine.state, len(self._observers.events), False
        try:
            offered = () if self._changes is None else self._changes.constraints
            given = self._inputs()
            requested = partial(self._observers.requested, offered, {decision.id for decision in given.decisions})
            with in_part_names(self.scene):
                changes, write = advance_or_replay(self.engine, self._readings, self._journal, given, requested)
            with deferred():
                write()
                committed = True
                self._commit(changes)
        except BaseException as error:
            if not committed:
                with deferred():
                    self.engine.state = before
                    self._observers.forget(events)
                    if isinstance(error, DecisionError):  # if it stayed queued, every later step would fail too
                        kept = (d for d in self.engine.decisions if d is not error.decision)
                        self.engine.decisions = tuple(kept)
            raise

    def _inputs(self) -> Inputs:
        """Collect the hand targets and the script's decisions for the next step."""
        hands = self.engine.hands.values()
        careful = any(hand.held is not None and hand.assist.slow_within > 0.0 for hand in hands)
        targets = []
        for hand in hands:
            wanted = hand.desire(self.dt, hand.assist.rate(self.engine.clearance))
            if hand.held is not None:
                assist = hand.assist
                snap, begins = (assist.snap, assist.snap_angle), hand.clock <= (1.0 + 1e-9) * self.dt
                target = HandTarget(hand.held, wanted, hand.carried, *snap, hand.spring, hand.goal(), begins)
                targets.append(target)
        decisions, self.engine.decisions = self.engine.decisions, ()
        return Inputs(targets, decisions, self.dt, self._shows_clearance or careful)

    def _commit(self, changes: Changes) -> None:
        """Record the changes of a step in trails, events and frame."""
        self._changes = changes
        for poses in changes.way:
            self._trails.add(self.step_count, [self._numbers[name] for name in poses], Poses.of(poses).rows)
        moved = [self._numbers[name] for name in changes.poses]
        self._trails.add(self.step_count, moved, self.engine.collision.packed_poses()[moved])
        for hand in self.engine.hands.values():
            hand.stopped_by = changes.blocked.get(hand.held, "") if hand.held else ""
        for event in changes.events:
            self._observers.record(event)
        self._frame = self._frame_of(changes)
        self._observers.show(self._frame)
        self._observers.drop_requests()

    def run(self, seconds: float) -> None:
        """Advance the session by `seconds`."""
        for _ in range(max(round(seconds / self.dt), 0)):
            self.step()

    def run_until(self, condition: Condition, limit: float = 60.0) -> bool:
        """Step until the condition holds, for at most `limit` seconds; return whether it holds."""
        for _ in range(round(limit / self.dt)):
            if condition(self):
                return True
            self.step()
        return condition(self)

    def interrupt(self) -> None:
        """End the run at the next step, which raises `KeyboardInterrupt`; also ends a viewer's pause. Safe in signal
        handlers."""
        self._stop = True
        self._observers.play()

    @property
    def compiling(self) -> bool:
        """Whether kernels are being compiled in the present step."""
        return compilation.active

    def perform(self, hand: Hand, verb: Verb) -> Outcome:
        """Run a verb to its end and return its outcome; inside `together`, only queue it."""
        if self._queues is not None:
            self._queues.setdefault(hand.name, deque()).append(verb)
            return Outcome(True, "queued until the end of `together`", self.time)
        return self._drive({hand.name: deque([verb])}, hand)[hand.name]

    def _drive(self, queues: dict[str, deque[Verb]], *hands: Hand) -> dict[str, Outcome]:
        with self._alone():
            for hand in hands:
                self.engine.hands.setdefault(hand.name, hand)
            self._keep_parts()
            try:
                return drive(self.engine.hands, queues, self.step)
            except Exception as error:
                self._verb_failed = in_one_line(error)
                raise

    @contextmanager
    def together(self) -> Iterator[None]:
        """Run the verbs of different hands in this block at the same time; the verbs of one hand still run in order."""
        if self._queues is not None:
            raise TaskError("session.together() inside another; close the first before")
        self._queues = {}
        try:
            yield
            queues = self._queues
        finally:
            self._queues = None
        self._drive(queues)

    def _keep_parts(self) -> None:
        if not self._closed:
            self.engine.keep_parts()

    def _begin(self) -> None:
        if self._begun:
            return
        self._trails = Trails()  # an interrupted start may have added rows already
        self._trails.add(0, range(len(self.scene)), Poses.of({part.name: part.pose for part in self.scene.parts}).rows)
        self._observers.begin(self.scene)
        self._begun = True

    def _frame_of(self, changes: Changes) -> Frame:
        changes.colliding.setflags(write=False)
        hands = self.engine.hands.values()
        last = None if self._frame is None else self._frame.poses
        still = not changes.poses and isinstance(last, Poses)
        poses = last if still else Poses(self._numbers, self.engine.collision.packed_poses())
        assert poses is not None
        return Frame(
            step=self.step_count,
            time=self.time,
            poses=poses,
            colliding=changes.colliding,
            constraints=changes.constraints,
            freedom=MappingProxyType(changes.freedom),
            joint=MappingProxyType(changes.joint),
            clearance=changes.clearance if self._shows_clearance else None,
            timings={**changes.timings, "observers": self._observers.seconds},
            held=tuple(hand.held for hand in hands if hand.held),
            hands=Poses.of({hand.name: hand.pose for hand in hands}),
            script="; ".join(hand.doing for hand in hands if hand.doing),
            events=self._observers.news(),
        )

    def _judge(self, candidate: Candidate) -> bool | None:
        """Return the rule's verdict on a candidate of a held part or of the initial assembly; None for all others."""
        if self.engine.started and self.engine.held.isdisjoint(candidate.bodies):
            return None
        state = "candidate" if self.engine.started and candidate.key not in self.engine.initial else "standing"
        try:
            verdict = self.rule(self._readings.view(-1, candidate, state))
        except Exception as error:
            self._rule_failed = f"the rule failed in step {self.step_count + 1}: {in_one_line(error)}"
            raise
        return None if verdict is None else verdict == "accept"

    # ---- hands

    def hand(
        self, name: str = "hand", at: pin.SE3 | ArrayLike | None = None, reach: Reach | bool | None = None
    ) -> Hand:
        """Return the hand of that name; create it at first use, at a world pose or position (default: above the scene).

        reach: tool or finger that must reach the parts this hand grabs or turns (`vp.Reach`; True: default size; False:
        none). The default is the session's `access`.
        """
        hands = self.engine.hands
        if name not in hands:
            here = pin.SE3(np.eye(3), above(self.scene)) if at is None else as_pose(at, pin.SE3.Identity())
            self._make_hand(name, here)
        elif at is not None:
            raise TaskError(f"{name} exists already; move it with {name}.move_to")
        hand = hands[name]
        assert isinstance(hand, Hand)
        if reach is not None:
            hand.access = reach_of(reach, "hand: reach")
        return hand

    def _make_hand(self, name: str, pose: pin.SE3) -> Hand:
        self.engine.hands[name] = hand = Hand(self, name, pose)
        hand.access = self.access
        return hand

    def holder(self, part: str) -> Gripper | None:
        """Return the hand that holds or carries a part, or any part of a subassembly; None if there is none."""
        group = set(self.group(part))
        return next((h for h in self.engine.hands.values() if not group.isdisjoint((h.held, *h.carried))), None)

    def note_grab(self, hand: Hand, named: str = "") -> None:
        """Record the event "grabbed"; a hand calls this after it closed on a part, or on a subassembly of that name."""
        assert hand.held is not None
        by = f" by {face_words(self.scene[hand.held], *hand.surfaces)}"
        text = f"{hand.name} holds {hand.holding(named, by)}"
        data = {"named": named or hand.held, "carried": list(hand.carried)}
        self._observers.happened("grabbed", (hand.held,), (hand.surfaces,), text, data)

    def note_release(self, hand: Hand) -> None:
        """Record the event "released"; a hand calls this before it opens."""
        assert hand.held is not None
        self._observers.happened("released", (hand.held,), (), f"{hand.name} lets go of {hand.held}", {})

    # ---- queries

    @property
    def constraints(self) -> tuple[ConstraintView, ...]:
        """Active constraints after the last step."""
        return self._constraints("active")

    @property
    def candidates(self) -> tuple[ConstraintView, ...]:
        """Candidate constraints on offer after the last step, highest score first."""
        return self._constraints("candidate")

    def _constraints(self, state: str) -> tuple[ConstraintView, ...]:
        known = self._readings.views() if self._changes is None else self._changes.constraints
        return tuple(c for c in known if c.state == state)

    def group(self, *names: str) -> tuple[str, ...]:
        """Return the parts with these names, each once: a part, or all of a subassembly (see `scene.subassembly`).

        Raises
        ------
        UnknownPartError: with near matches. TaskError: a name is ambiguous.
        """
        known = self._numbers
        return tuple(dict.fromkeys(p for n in names for p in ((n,) if n in known else parts_named(tuple(known), n))))

    def _indices(self, *names: str) -> list[int]:
        return [self._numbers[name] for name in self.group(*names)]

    def constraints_of(self, part: str, *carried: str) -> tuple[ConstraintView, ...]:
        """Return the active constraints that join a part or subassembly, with the parts it carries, to other parts."""
        group = set(self.group(part, *carried))
        return tuple(c for c in self.constraints if (c.parts[0] in group) != (c.parts[1] in group))

    def touching(self, part: str, *carried: str) -> dict[str, tuple[int, ...]]:
        """Surfaces, by part name, that a part or subassembly, with the parts it carries, touches.

        Mated surfaces are left out.
        """
        group = set(self._indices(part, *carried))
        found: dict[str, set[int]] = {}
        names = self.scene.names
        for a, sa, b, sb in self._touching().tolist():
            if (a in group) != (b in group):
                other, surface = (b, sb) if a in group else (a, sa)
                found.setdefault(names[other], set()).add(surface)
        return {name: tuple(sorted(surfaces)) for name, surfaces in sorted(found.items())}

    @property
    def meanings(self) -> tuple[Meaning, ...]:
        """What overlaps as drawn mean (threads, press fits, …), of parts with a common axis."""
        self.engine.start()
        return self.engine.meanings

    def held_by(self, part: str, *carried: str) -> tuple[HeldOverlap, ...]:
        """Overlaps that are meant (threads, press fits, …) and hold a part, with those it carries, to others now."""
        return self._readings.held_by(self._indices(part, *carried))

    def freedom(self, part: str, to: str | None = None, carried: str | Sequence[str] = ()) -> int:
        """Degrees of freedom that the active constraints leave a part or subassembly (0 if it is fixed).

        All other parts count as fixed. to: consider only constraints with this part or subassembly. carried: parts that
        move rigidly with it, such as the nut on a bolt.
        """
        return self._freedom(part, to, carried)[0]

    def joint(self, part: str, to: str | None = None, carried: str | Sequence[str] = ()) -> str:
        """Name of the lower pair for the same arguments as `freedom` ("free", "cylindrical", "revolute", …)."""
        return self._freedom(part, to, carried)[1]

    def _freedom(self, part: str, to: str | None, carried: str | Sequence[str]) -> tuple[int, str]:
        first, *rest = self._indices(part, *((carried,) if isinstance(carried, str) else carried))
        other = None if to is None else self._indices(to)
        if other is not None and not {first, *rest}.isdisjoint(other):
            raise TaskError(f"freedom({part!r}, to={to!r}): a part is on both sides; name another to measure to")
        if other is not None and all(self.scene.parts[i].fixed for i in (first, *rest)):
            first, rest, other = other[0], other[1:], [first, *rest]  # mobility between two parts is symmetric
        return self._readings.freedom(first, rest, other)

    def twists(self, part: str, carried: str | Sequence[str] = ()) -> NDArray[np.float64]:
        """(6, k) orthonormal twists that the constraints leave a part or subassembly, linear first (1 and 1/m), in the
        frame of its first part; `carried` as in `freedom`. Collisions are ignored."""
        first, *rest = self._indices(part, *((carried,) if isinstance(carried, str) else carried))
        return self._readings.twists(first, rest)

    def holding(self, part: str, twist: ArrayLike, carried: str | Sequence[str] = ()) -> tuple[ConstraintView, ...]:
        """Return the active constraints that a motion of a part or subassembly would break.

        twist: (6,) linear first, in the frame of its first part; `carried` as in `freedom`.
        """
        first, *rest = self._indices(part, *((carried,) if isinstance(carried, str) else carried))
        ids = set(self._readings.holding(first, rest, np.asarray(twist, np.float64)))
        return tuple(c for c in self.constraints if c.id in ids)

    def clearance(self, part: str, other: str | None = None) -> float:
        """Least distance (m) from a part or subassembly to another, or to all parts not constrained to it; inf if none.

        Parts held by the same hand are left out.
        """
        own = self._indices(part)
        if other is not None:
            to = [j for j in self._indices(other) if j not in own]
        else:
            group = self.group(part)
            grips = [(h.held, *h.carried) for h in self.engine.hands.values() if h.held]
            alike = [name for grip in grips if not set(grip).isdisjoint(group) for name in grip]
            mates = [name for c in self.constraints_of(part) for name in c.parts]
            left_out = {self._numbers[name] for name in (*mates, *alike, *group)}
            to = [j for j in range(len(self.scene)) if j not in left_out]
        with in_part_names(self.scene):
            return min(self._readings.clearance(i, to) for i in own)

    def velocity(self, part: str) -> pin.Motion:
        """Twist of a part's frame (of a subassembly its first part's), world axes: m/s at its origin, and rad/s."""
        return self._readings.velocity(self._indices(part)[0], self.dt)

    def contacts(self, part: str) -> tuple[ContactPoint, ...]:
        """Contact points of a part or subassembly, without mated surfaces; with forces if the part is dynamic."""
        own = self.group(part)
        found = [c for name in own for c in self._readings.contacts(self._numbers[name])]
        return tuple(c for c in found if c.other not in own)

    def clashes(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface that intersect now, without mated and authorised pairs."""
        return self.engine.colliding if self._changes is None else self._changes.colliding

    def misfits(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface of shafts in bores that clash now, also where no facets intersect;
        without mated and authorised pairs."""
        return self._readings.misfits()

    def _touching(self) -> NDArray[np.int32]:
        if self._changes is not None:
            return self._changes.touching
        return self._readings.near_pairs() if self.engine.started else np.zeros((0, 4), np.int32)

    def half_size(self, part: str) -> float:
        """Half the diagonal of a part's bounding box, m; of a subassembly, the largest value of its parts."""
        if part not in self.scene:
            return max(self.half_size(name) for name in self.group(part))
        if part not in self._sizes:
            self._sizes[part] = half_size(self.scene[part].mesh)
        return self._sizes[part]

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner (3,), m, of the bounding box of all parts, kept from the first use on."""
        if self._bounds is None:
            self._bounds = bounds(self.scene)
        return self._bounds

    def pitch_of(self, part: str) -> float | None:
        """Pitch of the thread on a part, m a turn, negative for a left-hand thread: from `thread`, else from a screw
        constraint; None if unknown."""
        return next(filter(None, map(self._readings.pitch_of, self._indices(part))), None)

    def trail(self, part: str) -> tuple[tuple[int, pin.SE3], ...]:
        """(step, pose) of each step in which the part (first part of a subassembly) moved, from step 0 on.

        A step has further rows, before its last one, where the way of the part bends within it.
        """
        self._begin()
        return self._trails.of(self._indices(part)[0])

    def plan_removal(self, parts: Sequence[str], seconds: float) -> Any:
        """Return the `planning.Removal` of some parts, moved as one, after a search of at most `seconds`."""
        return services.call("removal", self.scene, parts, budget=seconds, threads=self.threads)

    # ---- decisions of the script

    def accept(
        self, candidate: ConstraintView | int, break_distance: float | None = None, break_force: float | None = None
    ) -> None:
        """Accept a candidate, or the candidate with an id, from the next step on.

        break_distance: m; a pull beyond this distance removes the constraint, default `Tolerance.break_distance`.
        break_force: N; a spring (`hand.spring`) that pulls harder removes it; hands without a spring measure no force.
        """
        self._decide(Decision("accept", _id(candidate), limits("accept", break_distance, break_force)))

    def _decide(self, decision: Decision) -> None:
        self.engine.decisions = (*self.engine.decisions, decision)

    def refuse(self, candidate: ConstraintView | int) -> None:
        """Refuse a candidate, or the candidate with an id; it is not offered again until the parts have separated."""
        self._decide(Decision("refuse", _id(candidate)))

    def remove(self, constraint: ConstraintView | int) -> None:
        """Remove an active constraint, or the constraint with an id."""
        self._decide(Decision("remove", _id(constraint)))

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
        """Add a constraint that contact does not imply (see `vpframe.session.statements`), from the next step on.

        kind: "gear", "belt", "rack-and-pinion", "screw", "angle", "distance", "parallel", "fixed", or any other of
            `docs/constraints.md`. a, b: a part, or (part, surface). parameters: of the kind, e.g. `teeth=(20, 41)`.
        break_distance, break_force: as in `accept`; by default no pull removes the constraint.

        Raises
        ------
        ContradictionError: it contradicts the constraints in force. UnknownPartError, TaskError: invalid arguments.
        """
        bears = limits("constrain", break_distance, break_force)
        try:
            with in_part_names(self.scene):
                decision, view = stated(self.engine, self._readings, kind, a, b, parameters, bears)
        except ContradictionError as error:
            self._observers.happened("refused", error.parts, (), str(error), {"constraint": kind, "off": error.off})
            raise
        self._decide(decision)
        return view

    def _impose(self) -> None:
        """Put the constraints of the model file in force from the next step on."""
        for s in self.scene.statements:
            if not all(self.scene[name].fixed for name in s.parts):
                self.constrain(s.kind, s.a, s.b, **s.parameters)

    def thread(self, part: str, pitch: float) -> None:
        """Declare the pitch of a part's thread, m a turn: positive for a right-hand thread, negative for left-hand."""
        if not np.isfinite(pitch) or pitch == 0.0:
            raise TaskError(f"thread({part!r}, {pitch!r}): the pitch is metres a turn, negative for a left-hand thread")
        size = 2.0 * self.half_size(part)
        metres(pitch, f"thread({part!r}, {pitch!r})", part, size, FAR * size)
        self.engine.threads = {**self.engine.threads, self._one(part, "thread"): float(pitch)}

    def _one(self, part: str, what: str) -> int:
        """Return the index of a part; TaskError for a subassembly of several parts."""
        group = self.group(part)
        if len(group) > 1:
            raise TaskError(f"{what}({part!r}): that is {len(group)} parts, {listed(group)}; name one of them")
        return self._numbers[group[0]]

    @property
    def threads(self) -> dict[str, float]:
        """Pitches set with `thread` (m a turn, negative for left-hand threads), by part."""
        return {self.scene.names[i]: pitch for i, pitch in self.engine.threads.items()}

    def authorise(self, a: str, b: str) -> None:
        """State that the overlap of two parts or subassemblies as drawn is meant (press fit, seal): it is no clash.

        Hands move the two along the axis of their fit, with the overlap that is drawn and no deeper, or out of any
        other overlap; a motion that would deepen it is blocked.
        """
        for i, j in self._pairs(a, b, "authorise"):
            self.engine.authorise(i, j)

    def ignore(self, a: str, b: str | None = None) -> None:
        """Let two parts or subassemblies pass through each other (hose, cable), or one and all others, such as one that
        was taken away; verdict and report name them."""
        for i, j in self._pairs(a, b, "ignore"):
            self.engine.ignore(i, j)

    def _pairs(self, a: str, b: str | None, verb: str) -> list[tuple[int, int]]:
        """Indices of each part of a with each part of b, or with all others; TaskError if a part is on both sides."""
        own = self._indices(a)
        others = [j for j in range(len(self.scene)) if j not in own] if b is None else self._indices(b)
        pairs = [(i, j) for i in own for j in others]
        if any(i == j for i, j in pairs):
            raise TaskError(f"{verb}({a!r}, {b!r}): a part is on both sides; name two different ones")
        return pairs

    @property
    def authorised(self) -> list[tuple[str, str]]:
        """Pairs of parts whose overlap as drawn is meant, by name."""
        return [(self.scene.names[a], self.scene.names[b]) for a, b in self.engine.authorised]

    @property
    def ignored(self) -> list[tuple[str, str]]:
        """Pairs of parts that may pass through each other, by name: those of `ignore`, and authorised ones that forces
        move."""
        return [(self.scene.names[a], self.scene.names[b]) for a, b in self.engine.passing]

    def behave(
        self,
        part: str,
        *behaviours: Behaviour,
        material: str | float | Material | None = None,
        mass: float | None = None,
    ) -> None:
        """Give a part (each part of a subassembly) mass: forces move it whenever no hand holds it, with contact and
        friction.

        behaviours: forces (`vp.Drag()`, `vp.Gravity()` where the session has none, …) and contact laws
        (`vp.Friction(0.3)`, `vp.Elastic(0.6)`), which override the laws of the material.
        material: a `vp.Material`, a name from `vp.MATERIALS` (density, friction, restitution), or a density in kg/m³;
        without a density the part's own is used, else that of steel. mass: kg.
        """
        group = self.group(part)
        if len(group) > 1 and mass is not None:
            raise TaskError(f"behave({part!r}, mass={mass!r}): that is {len(group)} parts; name one, or a material")
        for fixed in (name for name in group if self.scene[name].fixed):
            raise TaskError(f"{fixed} is fixed in the scene; set part.fixed = False before giving it behaviours")
        from vpframe.session.dynamics import body_of

        bodies = {name: body_of(self.scene[name], material, mass) for name in group}
        for name, body in bodies.items():
            with self._alone(), in_part_names(self.scene):
                known = None if isinstance(material, int | float) else material
                self.engine.behave(self._numbers[name], body, behaviours, known)
            for note in body.notes:
                self.note(note)

    def reset(self) -> None:
        """Return to the start of the session (see `Engine.restart`); events, recording and log are kept."""
        with self._alone():
            self.engine.restart()
            self._changes = None
            self._impose()

    # ---- expectations

    def expect(self, condition: Condition | bool, reason: str = "") -> None:
        """Raise TaskError unless the condition holds; the task then fails even if the script catches the error."""
        holds = condition(self) if isinstance(condition, Condition) else bool(condition)
        text = reason or str(condition)
        self._observers.happened("expectation", (), (), f"{'holds' if holds else 'FAILS'}: {text}", {"holds": holds})
        if not holds:
            self.failure = f"expected {text}"  # whatever the script makes of the error
            raise TaskError(self.failure)

    def expect_constraint(self, kind: str, a: str, b: str) -> None:
        """Expect an active constraint of that kind between two parts or subassemblies."""
        self.expect(*expectations.constraint(self, kind, a, b))

    def expect_freedom(self, part: str, n: int, to: str | None = None, carried: str | Sequence[str] = ()) -> None:
        """Expect `n` degrees of freedom for a part or subassembly; `to` and `carried` as in `freedom`."""
        self.expect(*expectations.freedom(self, part, n, to, (carried,) if isinstance(carried, str) else carried))

    def expect_free(self, part: str, carried: str | Sequence[str] = ()) -> None:
        """Expect that a part or subassembly, with the parts it carries, is joined to no part and touches none."""
        self.expect(*expectations.free(self, part, (carried,) if isinstance(carried, str) else carried))

    def expect_no_clash(self) -> None:
        """Expect that no surfaces intersect, except those of mates, authorised and ignored pairs."""
        self.expect(*expectations.no_clash(self))

    def expect_at(self, part: str, pose: pin.SE3 | ArrayLike, within: float = 1e-3, angle: float = 0.02) -> None:
        """Expect a part at a pose: its centre within `within` m, its rotation within `angle` rad, modulo its symmetry
        (a shaft may be turned about its axis, a hexagonal nut by 60°). With a position (3,), rotation is not compared.

        For a subassembly, `pose` is that of its first part; the others must keep their initial poses relative to it.
        """
        self.expect(*expectations.at(self, part, pose, within, angle))

    # ---- events, log and report

    def on_event(self, listener: Callable[[Event], None]) -> None:
        """Call `listener` with every event as it happens."""
        self._observers.listeners.append(listener)

    def note(self, text: str) -> None:
        """Add a line of text to events, recording and report."""
        self._observers.happened("note", (), (), text, {})

    def fail(self, reason: str) -> None:
        """Mark the task as failed, with the reason for the report."""
        self.failure = reason
        self._last_note(f"failed: {reason}")

    def conclude(self, error: BaseException | None = None, script: Path | None = None) -> None:
        """Record the end of the task, with the error that ended it, if any. `with` and `close()` call this.

        A `TaskError` fails the task. Any other error (of the `script`, or Ctrl-C) leaves the task undecided, as does a
        session that was never concluded; its report does not state "can be done". A script that handles an error does
        not decide the task where a rule raised it, where no step was completed after the step that failed, or where a
        verb failed and no step was completed at all.
        """
        if error is None and self._concluded:
            return
        unshown = self._not_shown()
        self._concluded, self.complete = True, error is None and not self._stop and not unshown
        if isinstance(error, TaskError):
            self.undecided = ""
            self.fail(f"{place(error, script)}{error}")
        elif isinstance(error, KeyboardInterrupt) or (error is None and self._stop):
            self.undecided = ON_REQUEST
        elif error is not None:
            whose = "" if isinstance(error, CheckpointError | OutputError) else "script error: "
            self.undecided = f"{whose}{place(error, script)}{in_one_line(error)}"
        else:
            self.undecided = unshown
        if self.undecided and (error is not None or unshown):
            self._last_note(f"not decided: {self.undecided}")

    def _not_shown(self) -> str:
        """Return why a task that ran to its end has shown nothing; empty if it has."""
        if self._rule_failed or self._step_failed:
            return self._rule_failed or f"{self._step_failed} (no step was completed after it)"
        if self._verb_failed and self.step_count == 0:
            return f"no step was completed: {self._verb_failed}"
        return ""

    def _last_note(self, text: str) -> None:
        if not self._closed:
            self.note(text)

    def sweep(self, part: str) -> None:
        """Request the swept volume of a part (each part of a subassembly) and its collisions for the report."""
        self._swept += [name for name in self.group(part) if name not in self._swept]

    def swept(self, part: str, resolution: float | None = None) -> SweptVolume:
        """Return the volume that a part has swept so far and the parts it collides with (see `vpframe.analysis.swept`).

        Parts that a constraint ever joined to it, that are authorised to overlap it or ignored are not checked.
        """
        from vpframe.analysis.swept import swept_volume

        self.engine.start()
        pairs = [pair for pair in (*self.engine.joined, *self.authorised, *self.ignored) if part in pair]
        allowed = {part, *(name for pair in pairs for name in pair)}
        rest = [p for p in self.scene.parts if p.name not in allowed]
        return swept_volume(self.scene[part], [pose for _, pose in self.trail(part)], rest, resolution)

    def report(self, directory: str | os.PathLike[str]) -> Path:
        """Write the report folder (`index.html`, `report.json`, `clashes.csv`) and return its path; notebooks display
        it.

        Raises OutputError if a file to be replaced was not written by an earlier report.
        """
        swept = [self.swept(part) for part in self._swept]
        folder = services.call(
            "report",
            directory,
            self.log,
            failure=self.failure,
            undecided=self.undecided,
            complete=self.complete,
            task=self.name,
            authorised=self.authorised,
            ignored=self.ignored,
            swept=swept,
            tolerance=self.tolerance,
        )
        shown: Path = services.call("report_folder", folder)
        return shown

    def _repr_html_(self) -> str:
        """Return the HTML with which a notebook plays back the session so far."""
        page: str = services.call("page", self.scene, self.log.history, self.log.start)
        return page

    def close(self) -> None:
        """End viewer, recording and task; further calls do nothing.

        Raises OutputError if the recording or another observer's output could not be completed.
        """
        if self._closed:
            return
        if not self._concluded:
            error = sys.exc_info()[1]  # inside `finally`: the error that ended the task
            self.conclude(None if error is self._error_before else error)
        news = self._observers.news()
        if news and self._frame is not None:  # events after the last step
            self._observers.show(replace(self._frame, events=news))
            self._observers.tell()
        self.engine.leave()
        self._closed = True
        self._watch.close()
        if self._begun:
            self._observers.end()
        else:
            self._observers.observers.clear()  # releases the output files they claimed
        news = self._observers.news()
        if news and self._frame is not None:  # of observers that could not end
            self.log.frame(replace(self._frame, events=news))
        if self._journal is not None:
            self._journal.close()
        if self._observers.lost:
            raise self._observers.lost[0]

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.conclude(error)
        try:
            self.close()
        except OutputError:
            if error is None:  # do not hide the earlier error; this error is also noted in the events
                raise

    def _standing(self) -> str:
        journal = self._journal
        if journal is not None and journal.replaying:
            return catching_up(self.step_count, journal.left, self._pace)
        return under_way(self.time, list(self.engine.hands.values()), self._pace, self._stop)


def _id(constraint: ConstraintView | int) -> int:
    return constraint if isinstance(constraint, int) else constraint.id


__all__ = ["Part", "Session"]
