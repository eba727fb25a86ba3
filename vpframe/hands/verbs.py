"""Verbs of hands: each is a generator of motion segments, so that several hands can work in the same steps.

A verb yields `MotionSegment`s, receives the `Outcome` of each, and returns the outcome of the whole. It decides from
the scene at the start of each segment.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from pathlib import Path as FilePath
from typing import TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.errors import TaskError
from vpframe.hands import paths
from vpframe.hands.access import refused, to_grab, to_turn
from vpframe.hands.arguments import FAR, as_pose, metres, number, radians, vector
from vpframe.hands.conditions import Condition, as_condition, constraint, contact
from vpframe.hands.directions import (
    best_fit,
    direction,
    extent,
    grip,
    held_part,
    held_parts,
    in_front,
    line,
    other_parts,
    top_of,
    who,
)
from vpframe.hands.gripper import Gripper
from vpframe.hands.reach import surface_distances
from vpframe.hands.seat import Seat
from vpframe.hands.segment import MotionSegment, Outcome
from vpframe.scene.boxes import half_size
from vpframe.scene.subassembly import parts_named

T = TypeVar("T")
Generating = Generator[MotionSegment, Outcome, T]
"""generator of motion segments with a return value"""
Verb = Generating[Outcome]

# ---- motion


def approach(hand: Gripper, part: str, surface: int | None, duration: float | None) -> Verb:
    """Move to the nearest point of a part, or of one of its surfaces: `Hand.approach`."""
    if hand.held is not None:
        raise TaskError(f"{hand.name} holds {hand.load}; only an empty hand approaches, use move_to")
    group = hand.session.group(part)
    if surface is not None and len(group) > 1:
        raise TaskError(f"{hand.name}.approach({part!r}, surface={surface}): {part} has {len(group)} parts; name one")
    bodies = [hand.session.scene[name] for name in group]
    reached = [surface_distances(body.mesh, body.pose, hand.pose.translation) for body in bodies]
    distances, points = min(reached, key=lambda found: float(found[0].min()))
    if surface is not None and surface not in range(len(distances)):
        raise TaskError(f"{part} has no surface {surface!r}; it has 0 … {len(distances) - 1}")
    goal = points[int(np.argmin(distances)) if surface is None else surface]
    path = _straight(hand, pin.SE3(hand.pose.rotation, goal), duration, None)
    return (yield MotionSegment(f"{hand.name}.approach({part!r})", path))


def grab(hand: Gripper, part: str, surface: int | None, carried: tuple[str, ...]) -> Verb:
    """Grab a part or subassembly, after approaching it if necessary: `Hand.grab`."""
    session, scene = hand.session, hand.session.scene
    if hand.held is not None:
        raise TaskError(f"{hand.name} already holds {hand.load}; release it before grabbing {part}")
    meant = parts_named(scene.names, part)
    along = [name for given in carried for name in parts_named(scene.names, given)]
    if len({*meant, *along}) != len(meant) + len(along):
        raise TaskError(f"{hand.name}.grab({part!r}, carry={list(carried)}): name each part that comes along once")
    if surface is not None and len(meant) > 1:
        raise TaskError(f"{hand.name}.grab({part!r}, surface={surface}): {part} has {len(meant)} parts; name one")
    for name in (*meant, *along):
        if scene[name].fixed:
            raise TaskError(f"{name} is fixed in the scene; set part.fixed = False before grabbing it")
        holder = session.holder(name)
        if holder is not None:
            raise TaskError(f"{name} is already held by {holder.name}")

    def distance(name: str) -> float:
        return float(surface_distances(scene[name].mesh, scene[name].pose, hand.pose.translation)[0].min())

    nearest = sorted(meant, key=distance) if len(meant) > 1 else meant
    held = nearest[0]
    if hand.access is not None:
        held, surface, there = to_grab(
            session, hand.access, [scene[n] for n in nearest], surface, hand.pose.translation
        )
        path = _straight(hand, pin.SE3(hand.pose.rotation, there), None, None)
        yield MotionSegment(f"{hand.name}.approach({held!r})", path)
    elif not hand.touched(held) or surface is not None:
        yield from approach(hand, held, surface, None)
    rest = tuple(name for name in meant if name != held)
    named = "" if part == held else part
    hand.take(held, surface, (*rest, *along), named)
    return _outcome(hand, f"holds {hand.holding(named)}")


def release(hand: Gripper) -> Verb:
    """Release the held part: `Hand.release`."""
    hand.let_go()
    return _outcome(hand, "released")
    yield  # pragma: no cover - makes this a generator, as all verbs are


def move_to(
    hand: Gripper, pose: pin.SE3 | ArrayLike, duration: float | None, until: Condition | str | None, required: bool
) -> Verb:
    """Move straight to a world pose: `Hand.move_to`."""
    goal = as_pose(pose, hand.subject)
    _in_metres(hand, goal.translation - hand.subject.translation, "move_to")
    where = ", ".join(f"{x:.1f}" for x in np.round(1e3 * goal.translation, 1) + 0.0)
    path = _straight(hand, goal, duration, None)
    return (yield MotionSegment(f"{who(hand)}.move_to([{where}] mm)", path, as_condition(until), required))


def move_by(
    hand: Gripper, shift: ArrayLike, duration: float | None, until: Condition | str | None, required: bool
) -> Verb:
    """Move straight by a vector (3,), m, without rotation: `Hand.move_by`."""
    by = vector(shift, "move_by")
    _in_metres(hand, by, "move_by")
    where = ", ".join(f"{x:.1f}" for x in np.round(1e3 * by, 1) + 0.0)
    path = _straight(hand, paths.lifted(hand.subject, by), duration, None)
    return (yield MotionSegment(f"{who(hand)}.move_by([{where}] mm)", path, as_condition(until), required))


def follow(
    hand: Gripper,
    path: paths.Path | str | FilePath | Sequence[pin.SE3 | ArrayLike],
    until: Condition | str | None,
    required: bool,
) -> Verb:
    """Follow a path or track, after moving to its start: `Hand.follow`."""
    way: paths.Path
    if isinstance(path, str | FilePath):
        name, way = str(path), paths.read_track(path)
    elif isinstance(path, Sequence | np.ndarray):
        poses = [as_pose(pose, hand.subject) for pose in path]
        for pose in poses:
            _in_metres(hand, pose.translation - hand.subject.translation, "follow")
        name, way = f"{len(poses)} poses", paths.Spline(poses, hand.speed, hand.turn_speed)
    elif hasattr(path, "pose") and hasattr(path, "duration"):
        name, way = type(path).__name__, path
    else:
        raise TaskError(f"{who(hand)}.follow({path!r}): give a path, the name of a track file, or a list of poses")
    number(way.duration, f"{who(hand)}.follow({name}): duration", least=0.0)
    start, here = way.pose(0.0), hand.subject
    if np.linalg.norm(start.translation - here.translation) > hand.slack or not start.isApprox(here, 1e-6):
        yield from move_to(hand, start, None, None, True)
    return (yield MotionSegment(f"{who(hand)}.follow({name})", way, as_condition(until), required))


def drag(hand: Gripper, poses: Iterable[pin.SE3 | ArrayLike]) -> Verb:
    """Follow target poses, one for each step, as near as possible: `Hand.drag`."""
    outcome = _outcome(hand, "went nowhere")
    for pose in poses:
        goal = as_pose(pose, hand.subject)
        _in_metres(hand, goal.translation - hand.subject.translation, "drag")
        path = paths.Resting(goal, hand.session.dt)
        outcome = yield MotionSegment(f"{who(hand)}.drag()", path, None, False)
    return outcome


def slide(
    hand: Gripper,
    along: str | ArrayLike,
    distance: float | None,
    until: Condition | str | None,
    speed: float | None,
    required: bool,
    verb: str = "slide",
    outward: bool = False,
) -> Verb:
    """Slide along a direction for a distance (m) or until a condition holds: `Hand.slide`."""
    end = as_condition(until)
    if distance is None and end is None:
        raise TaskError(f"{hand.name}.{verb} needs a distance or until=a condition")
    far = _scene_size(hand) if distance is None else number(distance, f"{hand.name}.{verb}: distance")
    if distance is not None:
        _in_metres(hand, far, f"{verb}: distance={distance!r}")
    pace = 0.4 * hand.speed if speed is None else number(speed, f"{hand.name}.{verb}: speed", above=0.0)
    way = direction(hand, along, outward)
    goal = paths.lifted(hand.subject, far * way)
    path = _straight(hand, goal, None, pace, eased=distance is not None)
    how = f"{along if isinstance(along, str) else np.round(way, 3).tolist()}"
    if distance is not None:
        how += f", {distance * 1e3:g} mm"
    if end is not None:
        how += f", until {end}"
    return (yield MotionSegment(f"{who(hand)}.{verb}({how})", path, end, required))


def pull(
    hand: Gripper,
    along: str | ArrayLike,
    distance: float | None,
    until: Condition | str | None,
    speed: float | None,
    required: bool,
) -> Verb:
    """Slide with "axis" pointing away from the partner: `Hand.pull`."""
    return (
        yield from slide(
            hand, along, distance, None if distance is not None else until, speed, required, "pull", outward=True
        )
    )


def turn(
    hand: Gripper,
    angle: float,
    about: str | ArrayLike | tuple[ArrayLike, ArrayLike],
    until: Condition | str | None,
    duration: float | None,
    required: bool,
) -> Verb:
    """Turn by an angle (rad) about an axis or line: `Hand.turn`."""
    angle = radians(number(angle, f"{who(hand)}.turn: angle"), f"{who(hand)}.turn: angle")
    origin, axis = line(hand, about)
    seconds = abs(angle) / hand.turn_speed if duration is None else duration
    path = paths.Turning(hand.subject, origin, axis, angle, _seconds(hand, seconds))
    end = as_condition(until)
    text = f"{who(hand)}.turn({np.degrees(angle):g}°" + (f", until {end})" if end else ")")
    return (yield MotionSegment(text, path, end, required))


def wait(hand: Gripper, seconds: float | None, until: Condition | str | None) -> Verb:
    """Wait for a time (s) or until a condition holds: `Hand.wait`."""
    end = as_condition(until)
    if seconds is not None:
        seconds = number(seconds, f"{hand.name}.wait: seconds", least=0.0)
    elif end is None:
        raise TaskError(f"{hand.name}.wait needs seconds or until=a condition")
    path = paths.Resting(hand.subject, _seconds(hand, 60.0 if seconds is None else seconds))
    return (yield MotionSegment(f"{hand.name}.wait({end or f'{seconds:g} s'})", path, end))


# ---- assembly and disassembly


def insert(
    hand: Gripper,
    into: str,
    until: Condition | str | None,
    speed: float | None,
    gap: float,
    required: bool,
    depth: float | None = None,
) -> Verb:
    """Align in front of the best fitting bore of a part, then slide in: `Hand.insert`."""
    parts, targets = held_parts(hand, "insert"), other_parts(hand, "insert", into)
    gap = number(gap, f"{who(hand)}.insert: gap", least=0.0)
    _in_metres(hand, gap, f"insert: gap={gap!r}")
    if depth is not None:
        depth = number(depth, f"{who(hand)}.insert: depth", above=0.0)
        _in_metres(hand, depth, f"insert: depth={depth!r}")
    fit = best_fit(parts, targets, hand.session.tolerance, (hand.holding(), into))
    entry = in_front(parts, fit, gap)
    yield from move_to(hand, entry.aligned * fit[0].pose.actInv(hand.subject), None, None, True)
    verb = f"insert({into!r})"
    if depth is not None:
        return (yield from slide(hand, entry.way, entry.tip + depth, until, speed, required, verb))
    if until is not None:
        return (yield from slide(hand, entry.way, None, until, speed, required, verb))
    seat = Seat(hand, entry)
    outcome = yield from slide(hand, entry.way, seat.farthest, seat.condition, speed, False, verb)
    return seat.judged(outcome, required, f"{who(hand)}.{verb}")


def screw(
    hand: Gripper, turns: float | None, pitch: float | None, until: Condition | str | None, rate: float, required: bool
) -> Verb:
    """Screw in by turns or until a condition holds, at `rate` turns a second: `Hand.screw`."""
    end = as_condition(until) or (None if turns else constraint("against"))
    return (yield from _screw(hand, turns, pitch, end, rate, required, "screw"))


def unscrew(
    hand: Gripper, turns: float | None, pitch: float | None, until: Condition | str | None, rate: float, required: bool
) -> Verb:
    """Unscrew by turns or until a condition holds, at `rate` turns a second: `Hand.unscrew`."""
    end = as_condition(until) or (None if turns else as_condition("free"))
    return (yield from _screw(hand, turns, pitch, end, rate, required, "unscrew"))


def _screw(
    hand: Gripper,
    turns: float | None,
    pitch: float | None,
    end: Condition | None,
    rate: float,
    required: bool,
    verb: str,
) -> Verb:
    if isinstance(turns, str | Sequence):
        raise TaskError(f"{who(hand)}.{verb}({turns!r}): the first argument is a number of turns; give names as parts=")
    if pitch is None and hand.session.pitch_of(held_part(hand, verb).name) is None:
        # a thread drawn as a plain cylinder is offered only while the hand rests
        yield MotionSegment(f"{who(hand)}.{verb}()", paths.Resting(hand.subject, hand.session.dt))
    lead = _lead(hand, pitch, verb)
    rate = number(rate, f"{who(hand)}.{verb}: rate", above=0.0)
    if turns is not None:
        turns = number(turns, f"{who(hand)}.{verb}: turns", above=0.0)
    axis = direction(hand, "axis", outward=verb == "unscrew")
    origin, _ = line(hand, "axis")
    if hand.access is not None:
        outward = axis if verb == "unscrew" else -axis
        met = to_turn(hand.session, hand.access, grip(hand), origin, outward)
        if met:
            raise TaskError(f"{who(hand)}.{verb}: {refused(hand.access, held_part(hand, verb).name, met)}")
    n = _scene_size(hand) / abs(lead) if turns is None else turns
    # positive turns about a direction advance along it in a right-hand thread, against it in a left-hand one
    angle = np.copysign(2.0 * np.pi * n, lead)
    path = paths.Turning(
        hand.subject, origin, axis, angle, _seconds(hand, n / rate), pitch=lead, eased=turns is not None
    )
    how = f"{turns:g} turns" if turns is not None else f"until {end}"
    return (yield MotionSegment(f"{who(hand)}.{verb}({how})", path, end, required))


def _lead(hand: Gripper, pitch: float | None, verb: str) -> float:
    """Return the pitch, m a turn, negative for a left-hand thread: the given one, else that of the part's thread."""
    part = held_part(hand, verb).name
    if pitch is not None:
        lead = number(pitch, f"{who(hand)}.{verb}: pitch")
        if lead == 0.0:
            raise TaskError(f"{who(hand)}.{verb}: pitch=0; give metres a turn, negative for a left-hand thread")
        size = 2.0 * hand.session.half_size(part)
        metres(lead, f"{who(hand)}.{verb}: pitch={pitch!r}", part, size, FAR * size)
        return lead
    known = hand.session.pitch_of(part)
    if known is None:
        raise TaskError(
            f"{who(hand)}.{verb}: no recognised thread holds {part}; "
            f"give pitch= in metres a turn, or declare it with session.thread({part!r}, pitch)"
        )
    return known


def place(hand: Gripper, on: str, at: ArrayLike | None, height: float, let_go: bool) -> Verb:
    """Put down on the highest flat top of a part and release: `Hand.place`."""
    parts, targets = held_parts(hand, "place"), other_parts(hand, "place", on)
    height = number(height, f"{who(hand)}.place: height", least=0.0)
    _in_metres(hand, height, f"place: height={height!r}")
    top, middle = top_of(targets, on)
    try:
        over = middle if at is None else np.asarray(at, dtype=np.float64)
    except (TypeError, ValueError):
        over = np.empty(0)
    if over.shape != (2,) or not np.isfinite(over).all():
        raise TaskError(f"place(on={on!r}, at={at!r}): at is two finite numbers, x and y in metres")
    low, mid = extent(parts)
    above = np.array([over[0] - mid[0], over[1] - mid[1], top + height - low])
    highest = max(above[2], 0.0)
    yield from move_by(hand, (0.0, 0.0, highest), None, None, True)
    yield from move_by(hand, (above[0], above[1], 0.0), None, None, True)
    down = constraint("against", other=on) | contact
    outcome = yield from slide(hand, "down", None, down, None, True, f"place({on!r})")
    if let_go:
        yield from release(hand)
    return outcome


def snap(hand: Gripper, kind: str | None) -> Verb:
    """Accept the best candidate within the assist's reach: `Hand.snap`."""
    part = held_part(hand, "snap").name
    session = hand.session
    if hand.assist.snap <= 0.0:
        raise TaskError(f"{hand.name}.snap(): set the reach first, hand.assist = Assist(snap=0.003)")
    settle = paths.Resting(hand.subject, 2.0 * session.dt)
    yield MotionSegment(f"{hand.name}.snap()", settle, None, False)  # a step, so that the candidates are up to date
    offers = [c for c in session.candidates if part in c.parts and kind in (None, c.kind)]
    if not offers:
        return _outcome(hand, f"nothing{f' {kind}' if kind else ''} to snap to within reach", done=False)
    session.accept(offers[0])
    yield MotionSegment(
        f"{hand.name}.snap({offers[0].kind})", paths.Resting(hand.subject, 2.0 * session.dt), None, False
    )
    return _outcome(hand, f"snapped: {offers[0].kind}")


def _outcome(hand: Gripper, reason: str, done: bool = True) -> Outcome:
    return Outcome(done, reason, hand.session.time)


def _straight(
    hand: Gripper, goal: pin.SE3, duration: float | None, speed: float | None, eased: bool = True
) -> paths.Straight:
    start = hand.subject
    if duration is None:
        far = float(np.linalg.norm(goal.translation - start.translation))
        turned = float(np.linalg.norm(pin.log3(start.rotation.T @ goal.rotation)))
        duration = max(far / (speed or hand.speed), turned / hand.turn_speed)
    return paths.Straight(pin.SE3(start), goal, _seconds(hand, duration), eased)


def _in_metres(hand: Gripper, way: ArrayLike, what: str) -> None:
    """Refuse a motion (m, or (3,) m) that must be meant in millimetres; a way back to the scene is always allowed."""
    low, high = hand.session.bounds
    astray = float(np.linalg.norm(hand.subject.translation - 0.5 * (low + high)))
    size = float(np.linalg.norm(high - low))
    metres(float(np.linalg.norm(way)), f"{who(hand)}.{what}", "the scene", size, max(1.0, FAR * size + astray))


def _seconds(hand: Gripper, duration: float) -> float:
    return max(number(duration, f"{hand.name}: duration", least=0.0), hand.session.dt)


def _scene_size(hand: Gripper) -> float:
    return 2.0 * max(half_size(p.mesh) for p in hand.session.scene.parts)
