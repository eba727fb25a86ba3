"""One step of a session: the stages, in order.

    commands -> follow <=> recognise -> dynamics -> contacts -> changes

Each stage takes the engine and the step's `Inputs`, changes the engine's state and returns events; `follow` calls
`recognise`. `advance` runs the `STAGES` and returns the `Changes`. `Session.step` keeps the state before and commits
the changes after, or goes back to that state, so that a step that fails or is interrupted changes nothing.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.contact import joined, picked, surfaces_of
from constraints.errors import ConstraintsError
from constraints.motion.walls import NOT_SEARCHED, Searched
from constraints.recognition.attention import rows_about
from constraints.recognition.candidate import Candidate
from physics import SpringHand
from vpframe.errors import TaskError
from vpframe.events import NewEvent
from vpframe.hands.gripper import FACING, MOST_BLOCKERS
from vpframe.hands.paths import between
from vpframe.scene.boxes import corners, corners_of
from vpframe.scene.names import face_words, holders, mates_words, obstacles_words
from vpframe.scene.subassembly import name_of
from vpframe.session.engine import Engine
from vpframe.session.readings import Readings, along
from vpframe.session.state import Changes, Decision
from vpframe.session.trails import bends

MOST_SEGMENTS = 16
"""maximum number of segments of a hand's motion in one step"""
STUCK = 0.01
"""travel of a blocked part in a segment, relative to the reach, up to which it does not move"""
MOST_ROUNDS = 2
"""maximum rounds of follow and recognise in a segment: a part may snap on or off once"""
_MATING = ("recognised", "withdrawn", "accepted", "refused", "satisfied", "removed")


class DecisionError(TaskError):
    """A `decision` cannot be carried out, such as accepting a candidate that is no longer on offer."""

    def __init__(self, message: str, decision: Decision) -> None:
        super().__init__(message)
        self.decision = decision


class HandTarget(NamedTuple):
    """Target pose of a held part in one step."""

    part: str
    pose: pin.SE3
    carried: tuple[str, ...] = ()
    snap: float = 0.0
    """reach of the assist's snapping, m"""
    snap_angle: float = 0.0
    """angular reach of the assist's snapping, rad"""
    spring: SpringHand | None = None
    """spring that pulls with limited force instead of a rigid grip; its target is `pose`"""
    goal: pin.SE3 | None = None
    """target at the end of the motion, if that is known"""
    begins: bool = False
    """whether the motion begins in this step"""

    def key(self) -> bytes:
        """Return the target as bytes: equal targets have equal keys."""
        what = (self.part, self.carried, self.snap, self.snap_angle, self.spring is not None, self.begins)
        words = repr(what).encode()
        poses = (pose for pose in (self.pose, self.goal) if pose is not None)
        return words + b"".join(np.ascontiguousarray(pose.homogeneous).tobytes() for pose in poses)


class Inputs(NamedTuple):
    """Inputs of a step."""

    targets: Sequence[HandTarget]
    decisions: Sequence[Decision]
    dt: float
    """length of the step, s"""
    measure_clearance: bool = False

    @property
    def firm(self) -> list[HandTarget]:
        """Targets of rigid grips."""
        return [target for target in self.targets if target.spring is None]


@dataclass(eq=False)
class Work:
    """What the stages of a step note down: their computing time and the way of the held parts."""

    before: Sequence[pin.SE3]
    """poses of all parts before the step"""
    seconds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("motion", "collision", "constraints", "physics"), 0.0)
    )
    """computing time by kind of work, s"""
    way: list[Mapping[int, pin.SE3]] = field(default_factory=list)
    """poses that held parts, and those that come along, went through, in order"""

    @contextmanager
    def timed(self, kind: str) -> Iterator[None]:
        """Add the computing time of the block to a kind of work."""
        began = clock.perf_counter()
        try:
            yield
        finally:
            self.seconds[kind] += clock.perf_counter() - began


Stage = Callable[[Engine, Inputs, Work], list[NewEvent]]


def commands(engine: Engine, given: Inputs, work: Work) -> list[NewEvent]:
    """Apply grips and decisions; parts of stated constraints move to satisfy them."""
    index = engine.number.__getitem__
    gripped = tuple((target.part, target.carried, target.spring is None) for target in given.targets)
    for target in given.targets:
        if target.spring is not None and (engine.dynamics is None or index(target.part) not in engine.dynamics.bodies):
            raise TaskError(f"{target.part} has no behaviours, so a spring cannot pull it; session.behave(...) first")
    if gripped != engine.gripped:
        carried = {index(target.part): [index(name) for name in target.carried] for target in given.firm}
        held = [index(target.part) for target in given.targets]
        engine.held = frozenset(held).union(*carried.values())
        _remate(engine, engine.motion.carry(carried, engine.poses))
        engine.gripped = gripped
    _reach_for(engine, given.targets)
    events, engine.untold = list(engine.untold), ()
    for candidate in _decide(engine, given.decisions):
        if engine.held.isdisjoint(candidate.bodies):
            _assemble(engine, candidate)
    return events


def follow(engine: Engine, given: Inputs, work: Work) -> list[NewEvent]:
    """Move held parts along the hands' motion, segment by segment, as far as solid bodies and constraints allow.

    Each segment repeats following and recognition, at most `MOST_ROUNDS` times, until no mate is made or broken. Of
    the segments after one in which blocked parts did not move only the last is followed.
    """
    wanted = engine.motion.groups.with_carried({engine.number[t.part]: t.pose for t in given.firm})
    events: list[NewEvent] = []
    segments, stuck = _segments(engine, wanted), False
    for k, segment in enumerate(segments):
        if stuck and k + 1 < len(segments):
            continue
        began = engine.poses
        for _ in range(MOST_ROUNDS):
            before = engine.poses
            events += _follow_hands(engine, segment, given, work)
            with work.timed("collision"):
                _renew_moved(engine, before)
            with work.timed("constraints"):
                found = recognise(engine, segment, given)
            events += found
            if not any(event.kind in ("accepted", "removed") for event in found):
                break
        if engine.blocked:
            moved = max(_travel(engine, i, began[i], engine.poses[i]) for i in segment)
            stuck = moved <= STUCK * engine.tolerance.reach
    engine.targets = wanted
    return events


def recognise(engine: Engine, wanted: Mapping[int, pin.SE3], given: Inputs) -> list[NewEvent]:
    """Offer, accept and remove constraints at the present poses."""
    force = {} if engine.dynamics is None else engine.dynamics.pull()
    asked = (engine.mates.tolerance, engine.rows, engine.poses)
    if not (wanted or force or engine.decided or engine.recognised is None):
        tolerance, rows, poses = engine.recognised
        if tolerance == asked[0] and rows is asked[1] and poses is asked[2]:
            return []  # same inputs, same result
    goals = {engine.number[t.part]: t.goal for t in given.firm if t.goal is not None} if wanted else {}
    begun = frozenset(engine.number[t.part] for t in given.firm if t.begins)
    changes = engine.mates.update(engine.poses, engine.rows, wanted, force, engine.collision.versions, goals, begun)
    engine.decided = False
    engine.recognised = None if wanted or force else asked
    if changes:
        engine.motion.sync()
        _remate(engine, {i for change in changes for i in change.candidate.bodies})
        engine.joined |= {engine.pair(change.candidate) for change in changes if change.kind == "accepted"}
    return [engine.event(change) for change in changes]


def dynamics(engine: Engine, given: Inputs, work: Work) -> list[NewEvent]:
    """Move dynamic bodies under their forces."""
    physics = engine.dynamics
    if physics is None:
        return []
    index, targets = engine.number.__getitem__, given.targets
    springs = {index(t.part): replace(t.spring, target=t.pose) for t in targets if t.spring is not None}
    physics.join(engine.in_force())
    physics.hold({i: engine.poses[i] for i in engine.held if i not in springs}, springs)
    before = engine.poses
    free, rested = physics.step(given.dt)
    moved = _moved(engine, before)
    engine.moved |= moved
    gone = [i for i in free if i not in engine.held]
    if moved or gone:
        engine.searched = {}
    if gone:  # contact rows of moved bodies are out of date
        engine.rows = picked(engine.rows, ~rows_about(engine.rows["object_a"], engine.rows["object_b"], gone))
    if rested:  # their candidates are offered from the next step on
        _renew(engine, rested)
    events = []
    for i in sorted(rested):
        on = [engine.names[j] for j in physics.resting_on(i)]
        text = f"{engine.names[i]} comes to rest" + (f" on {', '.join(on)}" if on else "")
        events.append(NewEvent("landed", (engine.names[i], *on), (), text))
    return events


def contacts(engine: Engine, given: Inputs, work: Work) -> list[NewEvent]:
    """Update the colliding surfaces of moved parts; return events for pairs that began or ceased to collide."""
    about = sorted(_moved(engine, work.before) | engine.remated)
    remated, engine.remated = engine.remated, frozenset()
    if not about:
        return []
    old = engine.colliding
    fresh = not remated and engine.searched.keys() >= set(about)
    rows = picked(engine.rows, engine.rows["distance"] == 0.0)  # exactly the surfaces that intersect
    if fresh and not len(old) and not len(rows):
        return []
    theirs = rows_about(old[:, 0], old[:, 2], about)
    theirs &= ~_within_groups(engine, old[:, 0], old[:, 2])
    if fresh:
        a, b = rows["object_a"], rows["object_b"]
        rows = picked(rows, rows_about(a, b, about) & ~_within_groups(engine, a, b))
        new = surfaces_of(rows).copy()
    else:
        new = engine.collision.colliding_surfaces(about)
    if np.array_equal(old[theirs], new):
        return []
    now = np.concatenate([old[~theirs], new])
    engine.colliding = now[np.lexsort(now.T[::-1])]
    return _began_or_ceased(engine, old[theirs], new)


STAGES: tuple[tuple[Stage, str], ...] = ((commands, ""), (follow, ""), (dynamics, "physics"), (contacts, "collision"))
"""the stages in order, and the kind of work that each is, unless it consists of several"""


def advance(engine: Engine, readings: Readings, given: Inputs) -> Changes:
    """Run all stages and return the changes; the caller commits them."""
    engine.collision.forget_nearest()  # the step depends on the state alone
    events, work = list[NewEvent](), Work(engine.poses)
    for stage, kind in STAGES:
        with work.timed(kind) if kind else nullcontext():
            events += stage(engine, given, work)
    before, poses = work.before, engine.poses
    moved = sorted(_moved(engine, before))
    if not engine.moved.issuperset(moved) or not engine.moved >= engine.held:
        engine.moved |= engine.held.union(moved)
    engine.last = {i: before[i] for i in moved}
    engine.clearance = readings.least_clearance() if given.measure_clearance else None
    engine.step += 1
    return observed(
        engine,
        readings,
        poses={engine.names[i]: poses[i] for i in moved},
        clearance=engine.clearance,
        events=tuple(events),
        mates=engine.mates.snapshot if any(event.kind in _MATING for event in events) else None,
        way=_bends(engine, before, work.way),
        timings=work.seconds,
    )


def _bends(
    engine: Engine, before: Sequence[pin.SE3], way: Sequence[Mapping[int, pin.SE3]]
) -> tuple[Mapping[str, pin.SE3], ...]:
    """Return the poses, by part, at which a way that led from `before` bends: back along them is as free as out."""
    if len(way) < 2:
        return ()
    moved = sorted(set().union(*way))
    poses = [{i: before[i] for i in moved}]
    for there in way:
        poses.append({**poses[-1], **there})
    leads = [i for i in moved if i not in engine.motion.groups.seats]
    points = np.empty((len(poses), 2 * len(leads), 3))
    for k, i in enumerate(leads):
        center = engine.motion.shape(i)[0]
        size = float(np.linalg.norm(_corners(engine, i) - center, axis=1).max())
        for at, there in enumerate(poses):
            points[at, 2 * k] = there[i].act(center)
            points[at, 2 * k + 1] = size * pin.log3(before[i].rotation.T @ there[i].rotation)
    within = engine.tolerance.slop * engine.tolerance.linear
    return tuple({engine.names[i]: pose for i, pose in poses[at].items()} for at in bends(points, within))


def observed(engine: Engine, readings: Readings, **step: Any) -> Changes:
    """Return the observable quantities of the present state; without those of a `step`, as before the first one."""
    freedom, joint = readings.freedoms()
    return Changes(
        colliding=engine.colliding,
        touching=readings.near_pairs(),
        constraints=readings.views(),
        freedom=freedom,
        joint=joint,
        blocked=dict(engine.blocked),
        **({"poses": {}, "clearance": None, "events": ()} | step),
    )


# ---- commands


def _reach_for(engine: Engine, targets: Sequence[HandTarget]) -> None:
    """Extend the recogniser's reach to the assist of the hands."""
    reach = max((t.snap for t in targets), default=0.0)
    angle = max((t.snap_angle for t in targets if t.snap > 0.0), default=0.0)
    tolerance = engine.tolerance
    if reach > tolerance.reach:
        tolerance = replace(tolerance, reach=reach, reach_angular=max(angle, tolerance.reach_angular))
    engine.mates.assisted = reach > 0.0
    if engine.mates.tolerance is not tolerance and engine.mates.tolerance != tolerance:
        engine.mates.tolerance = tolerance


def _decide(engine: Engine, decisions: Sequence[Decision]) -> list[Candidate]:
    """Carry out decisions; return the stated constraints among them."""
    if decisions:
        engine.decided, engine.searched = True, {}
    for decision in decisions:
        what = decision.id if decision.stated is None else decision.stated
        try:
            getattr(engine.mates, decision.verb)(what, **dict(decision.limits))
        except ConstraintsError as error:
            raise DecisionError(f"{decision.verb}: {error}", decision) from None
    return [decision.stated for decision in decisions if decision.stated is not None]


def _assemble(engine: Engine, candidate: Candidate) -> None:
    """Move a part that no hand holds to satisfy a stated constraint: b moves to a, unless b is fixed."""
    a, b = candidate.bodies
    mover = a if engine.scene.parts[b].fixed else b
    before = engine.poses
    engine.motion.step({mover: before[mover]}, before, along(engine, {mover}))
    _renew_moved(engine, before)


# ---- follow


def _segments(engine: Engine, wanted: dict[int, pin.SE3]) -> list[dict[int, pin.SE3]]:
    """Divide the hands' motion in this step into segments short enough to detect every mate near it.

    The motion begins at the last targets, or where the parts are if that is nearer (after one that ended blocked).
    """
    poses, held = engine.poses, wanted.keys() - engine.motion.groups.seats.keys()

    def farthest(begun: Mapping[int, pin.SE3]) -> float:
        return max((_travel(engine, i, begun[i], wanted[i]) for i in held), default=0.0)

    last = {i: engine.targets.get(i, poses[i]) for i in wanted}
    far = farthest(last)
    if far > engine.tolerance.reach:
        here = {i: poses[i] for i in wanted}
        last, far = min((last, far), (here, farthest(here)), key=lambda begun: begun[1])
    n = min(int(np.ceil(far / engine.tolerance.reach)), MOST_SEGMENTS)
    if n <= 1 or not len(engine.collision.object_pairs(sorted(wanted), within=far + engine.mates.within)):
        return [wanted]
    return [{i: between(last[i], pose, k / n) for i, pose in wanted.items()} for k in range(1, n + 1)]


def _travel(engine: Engine, i: int, a: pin.SE3, b: pin.SE3) -> float:
    """Greatest distance (m) of a point of the box of a part, and of those that it carries, between two poses.

    Displacement is affine in the point, so a corner goes farthest.
    """
    shift = _corners(engine, i) @ (b.rotation - a.rotation).T + (b.translation - a.translation)
    return float(np.sqrt((shift * shift).sum(axis=1).max()))


def _corners(engine: Engine, i: int) -> NDArray[np.float64]:
    """(8, 3), m: corners of the box around the boxes of a part, and of those that it carries, in its frame."""
    groups = engine.motion.groups
    known = engine.boxes.get(i)
    if known is None or known[0] is not groups:
        members = groups.members.get(i, (i,))
        placed = [corners(engine.scene.parts[i].mesh)]
        for j in members[1:]:
            seat = groups.seats[j][1]
            placed.append(corners(engine.scene.parts[j].mesh) @ seat.rotation.T + seat.translation)
        every = np.concatenate(placed)
        known = engine.boxes[i] = groups, corners_of(every.min(axis=0), every.max(axis=0))
    return known[1]


def _follow_hands(engine: Engine, wanted: dict[int, pin.SE3], given: Inputs, work: Work) -> list[NewEvent]:
    if not wanted:
        engine.blocked = {}
        return []
    targets, index = given.firm, engine.number.__getitem__
    held = {index(target.part) for target in targets}
    movable = along(engine, wanted)
    held_at = {i: wanted[i] for i in sorted(held)}
    with work.timed("motion"):
        result = engine.motion.step(held_at, engine.poses, movable, searched=_searched(engine, movable))
    work.way.extend((*result.way, result.poses))
    before, blocked = engine.blocked, {}
    events: list[NewEvent] = []
    if result.blocked:
        for name in sorted(target.part for target in targets):
            i = index(name)
            group = engine.motion.groups.members.get(i, (i,))
            way = wanted[i].translation - engine.poses[i].translation
            by, holding = _in_the_way(engine, group, result.contacts, way)
            if not by and len(targets) > 1:
                continue  # the part of another hand was stopped
            blocked[name] = _blockers(engine, group, by, holding) + _authorising(engine, group, by)
            if name not in before:
                others = [engine.names[i] for i in by]
                surfaces = (tuple(sorted(met)) for met in by.values())
                load = name_of(engine.names, [name, *(engine.names[j] for j in group if j != i)])
                text = f"{load} stops: {blocked[name]}"
                events.append(NewEvent("blocked", (name, *others), ((), *surfaces), text))
    engine.blocked = blocked
    return events


def _blockers(
    engine: Engine, group: Sequence[int], by: Mapping[int, Mapping[int, NDArray[np.float64]]], holding: Iterable[int]
) -> str:
    """Describe the obstacles found by `_in_the_way`, each with its nearest face and the point of contact."""
    if not by:
        mates = [(c.kind, other) for c in _mates(engine) for other in {*c.bodies} - {*group} if {*c.bodies} & {*group}]
        overlaps = [(held.meaning.kind, held.other) for held in engine.held_by(group)]
        known = mates_words([*((kind, engine.names[other]) for kind, other in mates), *overlaps])
        return known or "its constraints to other parts prevent the motion"
    met = []
    for i, faces in by.items():
        surface, point = next(iter(faces.items()))
        at = ", ".join(f"{x + 0.0:.1f}" for x in np.round(1e3 * point, 1))
        met.append((engine.scene.parts[i], f"{face_words(engine.scene.parts[i], surface)}, at {at} mm"))
    return obstacles_words(met, {engine.names[i] for i in holding})


def _mates(engine: Engine) -> list[Candidate]:
    return [entry.candidate for entry in engine.mates.accepted.values()]


def _authorising(engine: Engine, group: Sequence[int], by: Iterable[int]) -> str:
    """Say which obstacles overlap the group as drawn, and how that is authorised; empty if none does.

    An overlap that is meant is left out: a screw is turned out of its thread.
    """
    near = {(a, b) if a in group else (b, a) for a, _, b, _ in engine.colliding.tolist()}
    mates = (*engine.mates.candidates.values(), *_mates(engine))
    threads = {c.bodies for c in mates if c.kind == "screw"} | {meaning.parts for meaning in engine.meanings}
    text = ""
    for own, other in sorted(near):
        if own not in group or other not in by or {(own, other), (other, own)} & threads:
            continue
        depth = engine.motion.overlap_as_drawn(own, other)
        if depth > engine.tolerance.linear:
            a, b = engine.names[own], engine.names[other]
            text += f"; {a} and {b} overlap by {1e3 * depth:.3g} mm as drawn: if that is meant, "
            text += f'session.authorise("{a}", "{b}")'
    return text


def _in_the_way(
    engine: Engine, group: Sequence[int], rows: NDArray[Any], way: NDArray[np.float64]
) -> tuple[dict[int, dict[int, NDArray[np.float64]]], frozenset[int]]:
    """Return the surfaces of other objects that a group meets on its motion `way` (3,), m, from contact rows and across
    `against` mates, each with a point of contact (3,), world, m; and which of the objects hold the group.

    At most `MOST_BLOCKERS` objects: first those that hold the group (see `holders`), then nearest first; obstacles
    beside the motion only if none lies ahead.
    """
    length = float(np.linalg.norm(way))
    met: list[tuple[bool, float, int, int, tuple[float, float, float]]] = []
    for row in rows:
        a, b = int(row["object_a"]), int(row["object_b"])
        if a not in group and b not in group:
            continue
        other, end, sign = (b, "b", 1.0) if a in group else (a, "a", -1.0)
        to = sign * (row["point_b"] - row["point_a"])
        beside = float(to @ way) < FACING * length * float(np.linalg.norm(to))
        met.append((beside, float(row["distance"]), other, int(row["surface_" + end]), tuple(row["point_" + end])))
    mates = _mates(engine)
    for c in mates:
        a, b = c.bodies
        if c.kind == "against" and (a in group) != (b in group):
            own = 0 if a in group else 1
            into = float(c.constraint.drawing(engine.poses[a]).direction @ way) * (1 - 2 * own)
            if into > FACING * length:
                point = tuple(engine.poses[a].act(c.match.local))
                met.append((False, 0.0, c.bodies[1 - own], c.surfaces[1 - own][0], point))
    ahead = [entry for entry in met if not entry[0]] or met
    names = {entry[2] for entry in ahead}
    holding = holders(names, group, [c.bodies for c in mates])
    by: dict[int, dict[int, NDArray[np.float64]]] = {}
    for _, _, other, surface, point in sorted(ahead, key=lambda entry: (entry[2] not in holding, entry)):
        if other in by or len(by) < MOST_BLOCKERS:
            by.setdefault(other, {}).setdefault(surface, np.array(point))
    return by, holding.intersection(by)


def _renew_moved(engine: Engine, before: Sequence[pin.SE3]) -> None:
    """Recompute the contact rows of objects that moved since `before` or are newly held."""
    stale = _moved(engine, before) | (engine.held - engine.moved)
    if stale:
        _renew(engine, stale)
        _take_along(engine, before)


def _moved(engine: Engine, before: Sequence[pin.SE3]) -> set[int]:
    """Return the objects that have moved since they were at the poses `before`."""
    poses = engine.poses
    return set() if poses is before else {i for i, pose in enumerate(poses) if pose is not before[i]}


def _renew(engine: Engine, about: Iterable[int]) -> None:
    """Recompute the contact rows of some objects."""
    ids = sorted(about)
    a, b = engine.rows["object_a"], engine.rows["object_b"]
    kept = ~rows_about(a, b, ids) | _within_groups(engine, a, b)
    rows = engine.collision.contacts(engine.mates.within, ids)
    if kept.any():
        rows = joined([picked(engine.rows, kept), rows])
        rows = picked(rows, np.lexsort([rows[c] for c in ("surface_b", "object_b", "surface_a", "object_a")]))
    engine.rows = rows
    engine.searched = {**engine.searched, **dict.fromkeys(ids, engine.mates.within)}


def _remate(engine: Engine, about: Set[int]) -> None:
    """Note that collision leaves out other surfaces of some objects than before."""
    if about:
        engine.remated |= about
        engine.searched = {i: within for i, within in engine.searched.items() if i not in about}


def _searched(engine: Engine, objects: Collection[int]) -> Searched:
    """Return the contact rows of some objects that the state has, without those among objects that move as one."""
    within = min((engine.searched.get(i, -1.0) for i in objects), default=-1.0)
    if within < 0.0:
        return NOT_SEARCHED
    if not len(engine.rows):
        return Searched(engine.rows, within)
    a, b = engine.rows["object_a"], engine.rows["object_b"]
    return Searched(picked(engine.rows, rows_about(a, b, objects) & ~_within_groups(engine, a, b)), within)


def _within_groups(engine: Engine, a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Mark the pairs of objects (n,), (n,) that move as one; their contact rows stay valid."""
    if not engine.motion.groups.seats:
        return np.zeros(len(a), bool)
    carrier = engine.motion.groups.carriers(len(engine.names))
    found: NDArray[np.bool_] = carrier[a] == carrier[b]
    return found


def _take_along(engine: Engine, before: Sequence[pin.SE3]) -> None:
    """Move the witness points of contact rows within rigid groups with their group."""
    if not engine.motion.groups.seats:
        return
    rows, poses = engine.rows, engine.poses
    inside = _within_groups(engine, rows["object_a"], rows["object_b"])
    for carrier in engine.motion.groups.members if inside.any() else ():
        moved = poses[carrier] * before[carrier].inverse()
        own = inside & _within_groups(engine, rows["object_a"], np.full(len(inside), carrier))
        for point in ("point_a", "point_b"):
            rows[point][own] = rows[point][own] @ moved.rotation.T + moved.translation


# ---- contacts


def _began_or_ceased(engine: Engine, old: NDArray[np.int32], new: NDArray[np.int32]) -> list[NewEvent]:
    """Return events "collided" and "parted" for each pair of parts, with all surfaces that intersect or intersected."""
    was, now = ({(a, b) for a, _, b, _ in rows.tolist()} for rows in (old, new))
    events = []
    for kind, pairs, rows in (("collided", now - was, new), ("parted", was - now, old)):
        for i, j in sorted(pairs):
            a, b, own = engine.names[i], engine.names[j], rows[(rows[:, 0] == i) & (rows[:, 2] == j)]
            surfaces = (tuple(np.unique(own[:, 1]).tolist()), tuple(np.unique(own[:, 3]).tolist()))
            faces = [", ".join(map(str, s)) for s in surfaces]
            text = f"{a} (surfaces {faces[0]}) and {b} (surfaces {faces[1]})"
            text = f"{text} {'meet' if kind == 'collided' else 'no longer meet'}"
            events.append(NewEvent(kind, (a, b), surfaces, text, {"pairs": own[:, [1, 3]].tolist()}))
    return events
