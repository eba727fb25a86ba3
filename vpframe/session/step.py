"""One step of a session: the stages, in order.

    commands -> follow <=> recognise -> dynamics -> contacts -> changes -> commit

Each stage takes the state and the step's `Inputs`, changes the state and returns events. `advance` runs all stages;
`Session.step` marks the state before and commits after, or goes back to the mark, so that a step that fails or is
interrupted changes nothing.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.contact import joined, picked
from constraints.errors import ConstraintsError
from constraints.recognition.attention import rows_about
from constraints.recognition.candidate import Candidate
from physics import SpringHand
from vpframe.errors import TaskError
from vpframe.events import NewEvent
from vpframe.hands.gripper import FACING, MOST_BLOCKERS
from vpframe.hands.paths import between
from vpframe.scene.boxes import corners
from vpframe.scene.names import face_words, holders, mates_words, obstacles_words
from vpframe.scene.subassembly import name_of
from vpframe.session.readings import Readings, along
from vpframe.session.state import COLUMNS, Changes, Decision, State
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


@dataclass(frozen=True, eq=False)
class HandTarget:
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


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of a step, and what its stages note down: their computing time, the way of the held parts."""

    targets: Sequence[HandTarget]
    decisions: Sequence[Decision]
    dt: float
    """length of the step, s"""
    measure_clearance: bool = False
    seconds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(("motion", "collision", "constraints", "physics"), 0.0)
    )
    """computing time by kind of work, s"""
    way: list[Mapping[int, pin.SE3]] = field(default_factory=list)
    """poses that held parts, and those that come along, went through, in order"""

    @property
    def firm(self) -> list[HandTarget]:
        """Targets of rigid grips."""
        return [target for target in self.targets if target.spring is None]


Stage = Callable[[State, Inputs], list[NewEvent]]


def commands(state: State, given: Inputs) -> list[NewEvent]:
    """Apply grips and decisions; parts of stated constraints move to satisfy them."""
    index = state.scene.index
    gripped = tuple((target.part, target.carried, target.spring is None) for target in given.targets)
    for target in given.targets:
        if target.spring is not None and (state.dynamics is None or index(target.part) not in state.dynamics.bodies):
            raise TaskError(f"{target.part} has no behaviours, so a spring cannot pull it; session.behave(...) first")
    if gripped != state.gripped:
        carried = {index(target.part): [index(name) for name in target.carried] for target in given.firm}
        held = [index(target.part) for target in given.targets]
        state.held = frozenset(held).union(*carried.values())
        state.remated |= state.motion.carry(carried, state.poses)
        state.gripped = gripped
    _reach_for(state, given.targets)
    events, state.untold = list(state.untold), ()
    for candidate in _decide(state, given.decisions):
        if state.held.isdisjoint(candidate.bodies):
            _assemble(state, candidate, given)
    return events


def follow(state: State, given: Inputs) -> list[NewEvent]:
    """Move held parts along the hands' motion, segment by segment, as far as solid bodies and constraints allow.

    Each segment repeats following and recognition, at most `MOST_ROUNDS` times, until no mate is made or broken. Of
    the segments after one in which blocked parts did not move only the last is followed.
    """
    wanted = _wanted(state, given.firm)
    events: list[NewEvent] = []
    segments, stuck = _segments(state, wanted), False
    for k, segment in enumerate(segments):
        if stuck and k + 1 < len(segments):
            continue
        began = state.poses
        for _ in range(MOST_ROUNDS):
            before = state.poses
            events += _follow_hands(state, segment, given)
            _renew_moved(state, before, given)
            found = recognise(state, segment, given)
            events += found
            if not any(event.kind in ("accepted", "removed") for event in found):
                break
        if state.blocked:
            moved = max(_travel(state, i, began[i], state.poses[i]) for i in segment)
            stuck = moved <= STUCK * state.tolerance.reach
    state.targets = wanted
    return events


def recognise(state: State, wanted: Mapping[int, pin.SE3], given: Inputs) -> list[NewEvent]:
    """Offer, accept and remove constraints at the present poses."""
    began = clock.perf_counter()
    force = {} if state.dynamics is None else state.dynamics.pull()
    asked = (state.mates.tolerance, state.rows, state.poses)
    if not (wanted or force or state.decided or state.recognised is None):
        tolerance, rows, poses = state.recognised
        if tolerance == asked[0] and rows is asked[1] and poses is asked[2]:
            return []  # same inputs, same result
    aims = [replace(t, pose=t.goal) for t in given.firm if t.goal is not None] if wanted else []
    goals, begun = _wanted(state, aims), frozenset(_wanted(state, [aim for aim in aims if aim.begins]))
    changes = state.mates.update(state.poses, state.rows, wanted, force, state.collision.versions, goals, begun)
    state.decided = False
    state.recognised = None if wanted or force else asked
    if changes:
        state.motion.sync()
        state.remated |= {i for change in changes for i in change.candidate.bodies}
        state.joined |= {state.pair(change.candidate) for change in changes if change.kind == "accepted"}
    given.seconds["constraints"] += clock.perf_counter() - began
    return [state.event(change) for change in changes]


def dynamics(state: State, given: Inputs) -> list[NewEvent]:
    """Move dynamic bodies under their forces."""
    physics = state.dynamics
    if physics is None:
        return []
    began = clock.perf_counter()
    index, targets = state.scene.index, given.targets
    springs = {index(t.part): replace(t.spring, target=t.pose) for t in targets if t.spring is not None}
    physics.join(state.in_force())
    physics.hold({i: state.poses[i] for i in state.held if i not in springs}, springs)
    before = state.poses
    free, rested = physics.step(given.dt)
    state.moved |= {i for i, pose in enumerate(state.poses) if pose is not before[i]}
    gone = [i for i in free if i not in state.held]
    if gone:  # contact rows of moved bodies are out of date
        state.rows = picked(state.rows, ~rows_about(state.rows["object_a"], state.rows["object_b"], gone))
    if rested:  # their candidates are offered from the next step on
        _renew(state, rested)
    events = []
    for i in sorted(rested):
        on = [state.names[j] for j in physics.resting_on(i)]
        text = f"{state.names[i]} comes to rest" + (f" on {', '.join(on)}" if on else "")
        events.append(NewEvent("landed", (state.names[i], *on), (), text))
    given.seconds["physics"] += clock.perf_counter() - began
    return events


STAGES: tuple[Stage, ...] = (commands, follow, dynamics)
"""stages that move parts"""


def contacts(state: State, before: Sequence[pin.SE3], given: Inputs) -> list[NewEvent]:
    """Update the colliding surfaces of moved parts; return events for pairs that began or ceased to collide."""
    began = clock.perf_counter()
    about = sorted({i for i, pose in enumerate(state.poses) if pose is not before[i]} | state.remated)
    remated, state.remated = state.remated, frozenset()
    if not about:
        return []
    old, fresh = state.colliding, not remated and bool((state.renewed[about] == state.collision.versions[about]).all())
    rows = picked(state.rows, state.rows["distance"] == 0.0)  # exactly the surfaces that intersect
    if fresh and not len(old) and not len(rows):
        given.seconds["collision"] += clock.perf_counter() - began
        return []
    theirs = rows_about(old[:, 0], old[:, 2], about)
    theirs &= ~_within_groups(state, old[:, 0], old[:, 2])
    if fresh:
        a, b = rows["object_a"], rows["object_b"]
        rows = picked(rows, rows_about(a, b, about) & ~_within_groups(state, a, b))
        new = np.stack([rows[column] for column in COLUMNS], axis=1)
    else:
        new = state.collision.colliding_surfaces(about)
    before_now = old[theirs]
    events = []
    if not np.array_equal(before_now, new):
        rows = np.concatenate([old[~theirs], new])
        state.colliding = rows[np.lexsort(rows.T[::-1])]
        events = _began_or_ceased(state, before_now, new)
    given.seconds["collision"] += clock.perf_counter() - began
    return events


def advance(state: State, readings: Readings, given: Inputs) -> Changes:
    """Run all stages and return the changes; the caller commits them."""
    before = state.poses
    events: list[NewEvent] = []
    for stage in STAGES:
        events += stage(state, given)
    events += contacts(state, before, given)
    poses = state.poses
    moved = [i for i, pose in enumerate(poses) if pose is not before[i]]
    if not state.moved.issuperset(moved) or not state.moved >= state.held:
        state.moved |= state.held.union(moved)
    state.last = {i: before[i] for i in moved}
    return standing(
        state,
        readings,
        poses={state.names[i]: poses[i] for i in moved},
        clearance=readings.least_clearance() if given.measure_clearance else None,
        events=tuple(events),
        mates=state.mates.state() if any(event.kind in _MATING for event in events) else None,
        way=_bends(state, before, given.way),
        timings=given.seconds,
    )


def _bends(
    state: State, before: Sequence[pin.SE3], way: Sequence[Mapping[int, pin.SE3]]
) -> tuple[Mapping[str, pin.SE3], ...]:
    """Return the poses, by part, at which a way that led from `before` bends: back along them is as free as out."""
    if len(way) < 2:
        return ()
    moved = sorted(set().union(*way))
    poses = [{i: before[i] for i in moved}]
    for there in way:
        poses.append({**poses[-1], **there})
    leads = [i for i in moved if i not in state.motion.groups.seats]
    points = np.empty((len(poses), 2 * len(leads), 3))
    for k, i in enumerate(leads):
        center = state.motion.shape(i)[0]
        size = float(np.linalg.norm(_corners(state, i) - center, axis=1).max())
        for at, there in enumerate(poses):
            points[at, 2 * k] = there[i].act(center)
            points[at, 2 * k + 1] = size * pin.log3(before[i].rotation.T @ there[i].rotation)
    within = state.tolerance.slop * state.tolerance.linear
    return tuple({state.names[i]: pose for i, pose in poses[at].items()} for at in bends(points, within))


def standing(state: State, readings: Readings, **step: Any) -> Changes:
    """Return the observable quantities of the present state; without those of a `step`, as before the first one."""
    freedom, joint = readings.freedoms()
    return Changes(
        colliding=state.colliding,
        touching=readings.near_pairs(),
        constraints=readings.views(),
        freedom=freedom,
        joint=joint,
        blocked=dict(state.blocked),
        **({"poses": {}, "clearance": None, "events": ()} | step),
    )


# ---- commands


def _reach_for(state: State, targets: Sequence[HandTarget]) -> None:
    """Extend the recogniser's reach to the assist of the hands."""
    reach = max((t.snap for t in targets), default=0.0)
    angle = max((t.snap_angle for t in targets if t.snap > 0.0), default=0.0)
    known = state.tolerance
    state.mates.assisted = reach > 0.0
    state.mates.tolerance = (
        known if reach <= known.reach else replace(known, reach=reach, reach_angular=max(angle, known.reach_angular))
    )


def _decide(state: State, decisions: Sequence[Decision]) -> list[Candidate]:
    """Carry out decisions; return the stated constraints among them."""
    state.decided |= bool(decisions)
    for decision in decisions:
        what = decision.id if decision.stated is None else decision.stated
        try:
            getattr(state.mates, decision.verb)(what, **dict(decision.limits))
        except ConstraintsError as error:
            raise DecisionError(f"{decision.verb}: {error}", decision) from None
    return [decision.stated for decision in decisions if decision.stated is not None]


def _assemble(state: State, candidate: Candidate, given: Inputs) -> None:
    """Move a part that no hand holds to satisfy a stated constraint: b moves to a, unless b is fixed."""
    a, b = candidate.bodies
    mover = a if state.scene.parts[b].fixed else b
    before = state.poses
    state.motion.step({mover: before[mover]}, before, along(state, {mover}))
    _renew_moved(state, before, given)


# ---- follow


def _wanted(state: State, targets: Sequence[HandTarget]) -> dict[int, pin.SE3]:
    """Target poses of held and carried objects."""
    wanted: dict[int, pin.SE3] = {}
    groups = state.motion.groups
    for target in targets:
        held = state.scene.index(target.part)
        wanted[held] = target.pose
        wanted |= groups.carried(held, target.pose)
    return wanted


def _segments(state: State, wanted: dict[int, pin.SE3]) -> list[dict[int, pin.SE3]]:
    """Divide the hands' motion in this step into segments short enough to detect every mate near it.

    The motion begins at the last targets, or where the parts are if that is nearer (after one that ended blocked).
    """
    poses, held = state.poses, wanted.keys() - state.motion.groups.seats.keys()

    def farthest(begun: Mapping[int, pin.SE3]) -> float:
        return max((_travel(state, i, begun[i], wanted[i]) for i in held), default=0.0)

    last = {i: state.targets.get(i, poses[i]) for i in wanted}
    far = farthest(last)
    if far > state.tolerance.reach:
        here = {i: poses[i] for i in wanted}
        last, far = min((last, far), (here, farthest(here)), key=lambda begun: begun[1])
    n = min(int(np.ceil(far / state.tolerance.reach)), MOST_SEGMENTS)
    if n <= 1 or not len(state.collision.object_pairs(sorted(wanted), within=far + state.mates.within)):
        return [wanted]
    return [{i: between(last[i], pose, k / n) for i, pose in wanted.items()} for k in range(1, n + 1)]


def _travel(state: State, i: int, a: pin.SE3, b: pin.SE3) -> float:
    """Greatest distance (m) of a point of the boxes of a part, and of those that it carries, between two poses.

    Displacement is affine in the point, so a corner goes farthest.
    """
    shift = _corners(state, i) @ (b.rotation - a.rotation).T + (b.translation - a.translation)
    return float(np.sqrt((shift * shift).sum(axis=1).max()))


def _corners(state: State, i: int) -> NDArray[np.float64]:
    """(n, 3), m: corners of the boxes of a part, and of those that it carries, in its frame."""
    groups = state.motion.groups
    known = state.boxes.get(i)
    if known is None or known[0] is not groups:
        members = groups.members.get(i, (i,))
        placed = [corners(state.scene.parts[i].mesh)]
        for j in members[1:]:
            seat = groups.seats[j][1]
            placed.append(corners(state.scene.parts[j].mesh) @ seat.rotation.T + seat.translation)
        known = state.boxes[i] = groups, np.concatenate(placed)
    return known[1]


def _follow_hands(state: State, wanted: dict[int, pin.SE3], given: Inputs) -> list[NewEvent]:
    if not wanted:
        state.blocked = {}
        return []
    began = clock.perf_counter()
    targets, index = given.firm, state.scene.index
    held = {index(target.part) for target in targets}
    result = state.motion.step({i: wanted[i] for i in sorted(held)}, state.poses, along(state, wanted))
    given.seconds["motion"] += clock.perf_counter() - began
    given.way.extend((*result.way, result.poses))
    before, blocked = state.blocked, {}
    events: list[NewEvent] = []
    if result.blocked:
        for name in sorted(target.part for target in targets):
            i = index(name)
            group = state.motion.groups.members.get(i, (i,))
            way = wanted[i].translation - state.poses[i].translation
            by, holding = _in_the_way(state, group, result.contacts, way)
            if not by and len(targets) > 1:
                continue  # the part of another hand was stopped
            blocked[name] = _blockers(state, group, by, holding) + _authorising(state, group, by)
            if name not in before:
                others = [state.names[i] for i in by]
                surfaces = (tuple(sorted(met)) for met in by.values())
                load = name_of(state.names, [name, *(state.names[j] for j in group if j != i)])
                text = f"{load} stops: {blocked[name]}"
                events.append(NewEvent("blocked", (name, *others), ((), *surfaces), text))
    state.blocked = blocked
    return events


def _blockers(
    state: State, group: Sequence[int], by: Mapping[int, Mapping[int, NDArray[np.float64]]], holding: Iterable[int]
) -> str:
    """Describe the obstacles found by `_in_the_way`, each with its nearest face and the point of contact."""
    if not by:
        mates = [(c.kind, other) for c in _mates(state) for other in {*c.bodies} - {*group} if {*c.bodies} & {*group}]
        known = mates_words((kind, state.names[other]) for kind, other in mates)
        return known or "its constraints to other parts prevent the motion"
    met = []
    for i, faces in by.items():
        surface, point = next(iter(faces.items()))
        at = ", ".join(f"{x + 0.0:.1f}" for x in np.round(1e3 * point, 1))
        met.append((state.scene.parts[i], f"{face_words(state.scene.parts[i], surface)}, at {at} mm"))
    return obstacles_words(met, {state.names[i] for i in holding})


def _mates(state: State) -> list[Candidate]:
    return [entry.candidate for entry in state.mates.accepted.values()]


def _authorising(state: State, group: Sequence[int], by: Iterable[int]) -> str:
    """Say which obstacles overlap the group as drawn, and how that is authorised; empty if none does.

    The overlap of a screw with its thread is not said: it is turned out.
    """
    near = {(a, b) if a in group else (b, a) for a, _, b, _ in state.colliding.tolist()}
    mates = (*state.mates.candidates.values(), *_mates(state))
    threads = {c.bodies for c in mates if c.kind == "screw"}
    text = ""
    for own, other in sorted(near):
        if own not in group or other not in by or {(own, other), (other, own)} & threads:
            continue
        depth = state.motion.overlap_as_drawn(own, other)
        if depth > state.tolerance.linear:
            a, b = state.names[own], state.names[other]
            text += f"; {a} and {b} overlap by {1e3 * depth:.3g} mm as drawn: if that is meant, "
            text += f'session.authorise("{a}", "{b}")'
    return text


def _in_the_way(
    state: State, group: Sequence[int], rows: NDArray[Any], way: NDArray[np.float64]
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
    mates = _mates(state)
    for c in mates:
        a, b = c.bodies
        if c.kind == "against" and (a in group) != (b in group):
            own = 0 if a in group else 1
            into = float(c.constraint.drawing(state.poses[a]).direction @ way) * (1 - 2 * own)
            if into > FACING * length:
                point = tuple(state.poses[a].act(c.match.local))
                met.append((False, 0.0, c.bodies[1 - own], c.surfaces[1 - own][0], point))
    ahead = [entry for entry in met if not entry[0]] or met
    names = {entry[2] for entry in ahead}
    holding = holders(names, group, [c.bodies for c in mates])
    by: dict[int, dict[int, NDArray[np.float64]]] = {}
    for _, _, other, surface, point in sorted(ahead, key=lambda entry: (entry[2] not in holding, entry)):
        if other in by or len(by) < MOST_BLOCKERS:
            by.setdefault(other, {}).setdefault(surface, np.array(point))
    return by, holding.intersection(by)


def _renew_moved(state: State, before: Sequence[pin.SE3], given: Inputs) -> None:
    """Recompute the contact rows of objects that moved since `before` or are newly held."""
    began = clock.perf_counter()
    stale = {i for i, pose in enumerate(state.poses) if pose is not before[i]} | (state.held - state.moved)
    if stale:
        _renew(state, stale)
        _take_along(state, before)
    given.seconds["collision"] += clock.perf_counter() - began


def _renew(state: State, about: Iterable[int]) -> None:
    """Recompute the contact rows of some objects."""
    ids = sorted(about)
    a, b = state.rows["object_a"], state.rows["object_b"]
    kept = ~rows_about(a, b, ids) | _within_groups(state, a, b)
    rows = state.collision.contacts(state.mates.within, ids)
    if kept.any():
        rows = joined([picked(state.rows, kept), rows])
        rows = picked(rows, np.lexsort([rows[c] for c in ("surface_b", "object_b", "surface_a", "object_a")]))
    state.rows = rows
    state.renewed = state.renewed.copy()
    state.renewed[ids] = state.collision.versions[ids]


def _within_groups(state: State, a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Mark the pairs of objects (n,), (n,) that move as one; their contact rows stay valid."""
    if not state.motion.groups.seats:
        return np.zeros(len(a), bool)
    carrier = state.motion.groups.carriers(len(state.names))
    found: NDArray[np.bool_] = carrier[a] == carrier[b]
    return found


def _take_along(state: State, before: Sequence[pin.SE3]) -> None:
    """Move the witness points of contact rows within rigid groups with their group."""
    if not state.motion.groups.seats:
        return
    rows, poses = state.rows, state.poses
    inside = _within_groups(state, rows["object_a"], rows["object_b"])
    for carrier in state.motion.groups.members if inside.any() else ():
        moved = poses[carrier] * before[carrier].inverse()
        own = inside & _within_groups(state, rows["object_a"], np.full(len(inside), carrier))
        for point in ("point_a", "point_b"):
            rows[point][own] = rows[point][own] @ moved.rotation.T + moved.translation


# ---- contacts


def _began_or_ceased(state: State, old: NDArray[np.int32], new: NDArray[np.int32]) -> list[NewEvent]:
    """Return events "collided" and "parted" for each pair of parts, with all surfaces that intersect or intersected."""
    was, now = _by_pair(old), _by_pair(new)
    events = []
    for kind, pairs in (("collided", sorted(set(now) - set(was))), ("parted", sorted(set(was) - set(now)))):
        for pair in pairs:
            rows = np.array((now if kind == "collided" else was)[pair])
            a, b = (state.names[i] for i in pair)
            surfaces = (tuple(np.unique(rows[:, 1]).tolist()), tuple(np.unique(rows[:, 3]).tolist()))
            faces = [", ".join(map(str, s)) for s in surfaces]
            text = f"{a} (surfaces {faces[0]}) and {b} (surfaces {faces[1]})"
            text = f"{text} {'meet' if kind == 'collided' else 'no longer meet'}"
            events.append(NewEvent(kind, (a, b), surfaces, text, {"pairs": rows[:, [1, 3]].tolist()}))
    return events


def _by_pair(rows: NDArray[np.int32]) -> dict[tuple[int, int], list[list[int]]]:
    pairs: dict[tuple[int, int], list[list[int]]] = {}
    for row in rows.tolist():
        pairs.setdefault((row[0], row[2]), []).append(row)
    return pairs
