"""Verbs for lists of parts: remove them and lay them beside the scene, refit them along their trails, exchange them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe import services
from vpframe.errors import TaskError
from vpframe.hands import paths, verbs
from vpframe.hands.access import MOST_NAMED
from vpframe.hands.directions import grip, spans, way_out
from vpframe.hands.gripper import Gripper
from vpframe.hands.segment import Outcome
from vpframe.scene.scene import Part
from vpframe.scene.subassembly import listed

Vector = NDArray[np.float64]
Leg = tuple[Vector, float]
Names = str | Sequence[str]

SEARCH = 30.0
"""time limit of planning for a part that cannot be removed straight, s"""
ROOM = 0.01
"""distance between a removed part and all others, m"""
PASSING = 2e-3
"""distance at which a removed part passes others on its way aside, m"""
HOME = 1e-6
"""deviation (m and rad) within which a part is at its initial pose"""


def remove(hand: Gripper, parts: Names, along: str | ArrayLike | None, pitch: float | None, verb: str) -> verbs.Verb:
    """Remove each part, unscrewing threaded ones, and lay it beside the scene: `Hand.remove`."""
    items = tuple(unit for name in _items(hand, parts, verb) for unit in _units(hand, name, pitch))
    if hand.held is not None:
        raise TaskError(f"{hand.name}.{verb}: {hand.name} holds {hand.load}; release it first")
    if verb == "unscrew":
        for name in items:
            _lead(hand, name, pitch, verb)
    for done, name in enumerate(items):
        try:
            way, out = yield from _take_out(hand, name, along, pitch)
            yield from _lay_aside(hand, way, out)
        except TaskError as error:
            raise _at(hand, verb, items, done, error) from None
        yield from verbs.release(hand)
    return _done(hand, f"{verb}: {_by_kind(hand, items)} out")


def refit(hand: Gripper, parts: Names, verb: str) -> verbs.Verb:
    """Return each part to its initial pose along its trail, the last one removed first: `Hand.refit`."""
    items: tuple[str, ...] = ()
    for name in _items(hand, parts, verb):
        units = _units(hand, name)
        items += tuple(unit for unit in units if not _is_home(hand, hand.session.group(unit)[0])) or units
    leads = {name: hand.session.group(name)[0] for name in items}
    if verb == "screw":
        for name in items:
            _lead(hand, name, None, verb)
    for name, lead in leads.items():
        if len(hand.session.trail(lead)) < 2 or _is_home(hand, lead):
            raise TaskError(f"{hand.name}.{verb}: {name} is at its initial pose; remove it first")
    order = sorted(items, key=lambda name: -hand.session.trail(leads[name])[-1][0])
    for done, name in enumerate(order):
        try:
            yield from verbs.grab(hand, name, None, ())
            assert hand.held is not None
            back = _since_home(hand, hand.held)[::-1]
            yield from verbs.follow(hand, _track(hand, back), None, True)
        except TaskError as error:
            raise _at(hand, verb, order, done, error) from None
        yield from verbs.release(hand)
    return _done(hand, f"{verb}: {_by_kind(hand, items)} back")


def exchange(hand: Gripper, old: str, new: str, along: str | ArrayLike | None) -> verbs.Verb:
    """Remove `old` and put `new` in its place along the trail of `old`: `Hand.exchange`."""
    session = hand.session
    _items(hand, [old, new], "exchange")
    lead, first = session.group(old)[0], session.group(new)[0]
    try:
        begun = pin.SE3(session.scene[lead].pose)
        step = session.trail(lead)[-1][0]
        way, far = yield from _take_out(hand, old, along, None)
        out = [begun, *(pose for when, pose in session.trail(lead) if when > step)]
        yield from _lay_aside(hand, way, far)
        yield from verbs.release(hand)
        yield from verbs.grab(hand, new, None, ())
        assert hand.held is not None
        seat = session.scene[first].pose.actInv(session.scene[hand.held].pose)
        back = [pose * seat for pose in out[::-1]]
        across = back[0].translation - hand.subject.translation
        across -= (across @ way) * way
        if across.any():
            yield from _straight(hand, _clear(hand, way, across / np.linalg.norm(across)) * way)
        over = max(float((hand.subject.translation - back[0].translation) @ way), 0.0)
        yield from verbs.move_to(hand, paths.lifted(back[0], over * way), None, None, True)
        yield from verbs.move_to(hand, back[0], None, None, True)
        yield from verbs.follow(hand, _track(hand, back), None, True)
    except TaskError as error:
        raise TaskError(f"{hand.name}.exchange({old!r}, {new!r}): {error}") from None
    yield from verbs.release(hand)
    return _done(hand, f"{new} is where {old} was")


def _items(hand: Gripper, parts: Names, verb: str) -> tuple[str, ...]:
    """Check a list of parts and subassemblies; raise TaskError if it is empty, or names a part twice or a fixed one."""
    if not isinstance(parts, str) and not (isinstance(parts, Sequence) and all(isinstance(n, str) for n in parts)):
        raise TaskError(f"{hand.name}.{verb}({parts!r}): give the name of a part, or a list of names")
    items = (parts,) if isinstance(parts, str) else tuple(parts)
    if not items:
        raise TaskError(f"{hand.name}.{verb}: the list of parts is empty; name at least one")
    seen: set[str] = set()
    for name in items:
        group = hand.session.group(name)
        if not seen.isdisjoint(group):
            raise TaskError(f"{hand.name}.{verb}: {name} is named twice; name each part once")
        for fixed in (n for n in group if hand.session.scene[n].fixed):
            raise TaskError(f"{hand.name}.{verb}: {fixed} is fixed in the scene; set part.fixed = False before")
        seen.update(group)
    return items


def _units(hand: Gripper, name: str, pitch: float | None = None) -> tuple[str, ...]:
    """Return what is removed or refitted as one: a part, a subassembly, or the parts of one that is but fasteners, or
    whose parts are no longer to each other as they were at first."""
    session, group = hand.session, hand.session.group(name)
    if len(group) == 1:
        return (name,)
    first = [session.trail(part)[0][1] for part in group]
    apart = max(
        paths.apart(first[0].actInv(begun), session.scene[group[0]].pose.actInv(session.scene[part].pose))
        for begun, part in zip(first, group, strict=True)
    )
    fasteners = all(pitch is not None or session.pitch_of(part) is not None for part in group)
    return group if fasteners or apart > HOME else (name,)


def _lead(hand: Gripper, name: str, pitch: float | None, verb: str) -> None:
    if pitch is None and hand.session.pitch_of(name) is None:
        raise TaskError(
            f"{hand.name}.{verb}: no recognised thread holds {name}; declare it with "
            f"session.thread({name!r}, pitch), or use {'remove' if verb == 'unscrew' else 'refit'}"
        )


def _take_out(hand: Gripper, name: str, along: str | ArrayLike | None, pitch: float | None) -> verbs.Generating[Leg]:
    """Grab a part, unscrew it if threaded, and pull it clear of all others; return direction and travel, m.

    Without `along`, a part that cannot be pulled straight goes back and follows a planned path.
    """
    yield from verbs.grab(hand, name, None, ())
    way = way_out(hand, along)
    if pitch is not None or hand.session.pitch_of(name) is not None:
        yield from verbs.unscrew(hand, None, pitch, None, 2.0, True)
    out, begun = _clear(hand, way, _side(hand, way)), pin.SE3(hand.subject)
    try:
        yield from verbs.slide(hand, way, out, None, None, True, "pull")
    except TaskError as error:
        if along is not None:
            raise
        yield from verbs.move_to(hand, begun, None, None, True)
        return (yield from _planned(hand, name, error))
    return way, out


def _planned(hand: Gripper, name: str, straight: TaskError) -> verbs.Generating[Leg]:
    """Remove a part along a planned path, whose end is straight; TaskError, after the error `straight`, if none."""
    assert hand.held is not None
    found = services.call(
        "removal", hand.session.scene, hand.session.group(name), budget=SEARCH, threads=hand.session.threads
    )
    if not found:
        by = f" by {listed(found.blockers[:MOST_NAMED])}" if found.blockers else ""
        how = f"none was found in {SEARCH:g} s" if found.verdict == "not found" else f"it is {found.verdict}{by}"
        raise TaskError(f"{straight}; no other way out: {how}") from None
    assert found.way is not None
    track, begun = found.tracks[hand.held], hand.subject.translation
    yield from verbs.follow(hand, paths.Track(track.times, track.poses), None, True)
    return found.way.direction, max(float((hand.subject.translation - begun) @ found.way.direction), 0.0)


def _lay_aside(hand: Gripper, way: Vector, back: float) -> verbs.Generating[None]:
    """Move the held part sideways past all others, then back by `back` m against `way`, above what lies there."""
    aside = _side(hand, way)
    yield from _straight(hand, _clear(hand, aside) * aside)
    yield from _straight(hand, -back * way)


def _side(hand: Gripper, way: Vector) -> Vector:
    """Return a direction (3,), unit, world, across `way`: the first axis along which little extra travel is needed."""
    first = int(np.argmin(np.abs(way)))
    axes = [sign * np.eye(3)[(first + k) % 3] for sign in (1.0, -1.0) for k in range(3)]
    sides = [aside - (aside @ way) * way for aside in axes if abs(aside @ way) < 0.8]
    sides = [aside / np.linalg.norm(aside) for aside in sides]
    out = [_clear(hand, way, aside) for aside in sides]
    return next(aside for aside, far in zip(sides, out, strict=True) if far <= 2.0 * min(out) + ROOM)


def _clear(hand: Gripper, way: Vector, aside: Vector | None = None) -> float:
    """Travel (m) along `way` (3,) until the held parts are clear of all others; 0 if they are.

    aside: (3,) unit, across `way`: consider only parts that would be hit on a later motion along `aside`.
    """
    mine = grip(hand)
    held = [hand.session.scene[name] for name in mine]
    others: list[Part] = [part for part in hand.session.scene.parts if part.name not in mine]
    if aside is not None:
        across = np.cross(way, aside)
        low, high = spans(held, across)
        behind = spans(held, aside)[0]

        def met(part: Part) -> bool:
            least, most = spans([part], across)
            return least < high + PASSING and most > low - PASSING and spans([part], aside)[1] > behind - PASSING

        others = [part for part in others if met(part)]
    if not others:
        return 0.0
    return max(spans(others, way)[1] + ROOM - spans(held, way)[0], 0.0)


def _straight(hand: Gripper, shift: Vector) -> verbs.Verb:
    """Move through free space at twice the usual speed."""
    far = float(np.linalg.norm(shift))
    return (yield from verbs.move_by(hand, shift, 0.5 * far / hand.speed, None, True))


def _is_home(hand: Gripper, part: str) -> bool:
    return paths.apart(hand.session.trail(part)[0][1], hand.session.scene[part].pose) < HOME


def _since_home(hand: Gripper, part: str) -> list[pin.SE3]:
    """Return the poses of a part since it was last at its initial pose."""
    poses = [pose for _, pose in hand.session.trail(part)]
    last = max(k for k, pose in enumerate(poses) if paths.apart(poses[0], pose) < HOME)
    return [poses[0], *poses[last + 1 :]]


def _track(hand: Gripper, poses: Sequence[pin.SE3]) -> paths.Track:
    return paths.Track(hand.session.dt * np.arange(len(poses), dtype=np.float64), poses)


def _by_kind(hand: Gripper, items: Sequence[str]) -> str:
    """List names, grouped by shape: "cover, 4 like M3_1"."""
    kinds: dict[int, list[str]] = {}
    for name in items:
        group = hand.session.group(name)
        kinds.setdefault(id(hand.session.scene[group[0]].shape) if len(group) == 1 else id(group), []).append(name)
    return listed([f"{len(n)} like {n[0]}" if len(n) > 1 else n[0] for n in kinds.values()])


def _at(hand: Gripper, verb: str, items: Sequence[str], done: int, error: TaskError) -> TaskError:
    so_far = f", after {_by_kind(hand, items[:done])}" if done else ""
    return TaskError(f"{hand.name}.{verb}: {items[done]}, {done + 1} of {len(items)}{so_far}: {error}")


def _done(hand: Gripper, reason: str) -> Outcome:
    return Outcome(True, reason, hand.session.time)
