"""Verbs for lists of parts: taken out in turn and laid beside the scene, put back the way they came, exchanged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vpframe.errors import TaskError
from vpframe.hands import paths, verbs
from vpframe.hands.directions import grip, spans, way_out
from vpframe.hands.gripper import Gripper
from vpframe.hands.segment import Outcome
from vpframe.planning.plan import removal
from vpframe.scene.scene import Part
from vpframe.scene.subassembly import listed

Vector = NDArray[np.float64]
Leg = tuple[Vector, float]
Names = str | Sequence[str]

SEARCH = 30.0
"""s: budget of planning for a part that does not come out straight"""
ROOM = 0.01
"""m between a part that is laid aside and all others"""
HOME = 1e-6
"""m and rad: a part nearer than this to where the session began is there"""


def remove(hand: Gripper, parts: Names, along: str | ArrayLike | None, pitch: float | None, verb: str) -> verbs.Verb:
    """Take each of a list out, unscrewing what is threaded, and lay it beside the scene: `Hand.remove`."""
    items = _items(hand, parts, verb)
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
    """Put each of a list back where the session began, the way it came, the last one out first: `Hand.refit`."""
    items = _items(hand, parts, verb)
    leads = {name: hand.session.group(name)[0] for name in items}
    if verb == "screw":
        for name in items:
            _lead(hand, name, None, verb)
    for name, lead in leads.items():
        if len(hand.session.trail(lead)) < 2 or _is_home(hand, lead):
            raise TaskError(f"{hand.name}.{verb}: {name} is where the session began; remove it first")
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
    """Take `old` out and put `new` in its place, the way it came: `Hand.exchange`."""
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
    """The names of a list, each of a part or subassembly, none twice."""
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


def _lead(hand: Gripper, name: str, pitch: float | None, verb: str) -> None:
    if pitch is None and hand.session.pitch_of(name) is None:
        raise TaskError(
            f"{hand.name}.{verb}: no thread holds {name} that is real geometry; say so with "
            f"session.thread({name!r}, pitch), or use {'remove' if verb == 'unscrew' else 'refit'}"
        )


def _take_out(hand: Gripper, name: str, along: str | ArrayLike | None, pitch: float | None) -> verbs.Generating[Leg]:
    """Grab, unscrew if it is threaded, and out until it is clear of all others; returns its way and how far, m.

    What does not come out straight, where no way is given, goes back and takes the way that planning finds.
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
    """Out along the way that planning finds, which then ends straight; TaskError, with what stopped `straight`."""
    assert hand.held is not None
    found = removal(hand.session.scene, hand.session.group(name), budget=SEARCH, threads=hand.session.threads)
    if not found:
        by = f" by {listed(found.blockers)}" if found.blockers else ""
        raise TaskError(f"{straight}; no other way out: {found.verdict}{by}") from None
    assert found.way is not None
    track, begun = found.tracks[hand.held], hand.subject.translation
    yield from verbs.follow(hand, paths.Track(track.times, track.poses), None, True)
    return found.way.direction, max(float((hand.subject.translation - begun) @ found.way.direction), 0.0)


def _lay_aside(hand: Gripper, way: Vector, back: float) -> verbs.Generating[None]:
    """From where the way to the side is free to beside everything, and `back` m against `way`: over what lies there."""
    aside = _side(hand, way)
    yield from _straight(hand, _clear(hand, aside) * aside)
    yield from _straight(hand, -back * way)


def _side(hand: Gripper, way: Vector) -> Vector:
    """(3,) unit, world, across `way`: the first axis to whose side what is held need not go much farther out."""
    first = int(np.argmin(np.abs(way)))
    axes = [sign * np.eye(3)[(first + k) % 3] for sign in (1.0, -1.0) for k in range(3)]
    sides = [aside - (aside @ way) * way for aside in axes if abs(aside @ way) < 0.8]
    sides = [aside / np.linalg.norm(aside) for aside in sides]
    out = [_clear(hand, way, aside) for aside in sides]
    return next(aside for aside, far in zip(sides, out, strict=True) if far <= 2.0 * min(out) + ROOM)


def _clear(hand: Gripper, way: Vector, aside: Vector | None = None) -> float:
    """m that what is held must go along `way` (3,) to be clear of all others; 0 if it is.

    aside: (3,) unit, across `way`: only to be clear of what it would meet when it goes that way next.
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
            return least < high + ROOM and most > low - ROOM and spans([part], aside)[1] > behind - ROOM

        others = [part for part in others if met(part)]
    if not others:
        return 0.0
    return max(spans(others, way)[1] + ROOM - spans(held, way)[0], 0.0)


def _straight(hand: Gripper, shift: Vector) -> verbs.Verb:
    """Through free space, twice as fast as usual."""
    far = float(np.linalg.norm(shift))
    return (yield from verbs.move_by(hand, shift, 0.5 * far / hand.speed, None, True))


def _is_home(hand: Gripper, part: str) -> bool:
    return _same(hand.session.trail(part)[0][1], hand.session.scene[part].pose)


def _same(a: pin.SE3, b: pin.SE3) -> bool:
    between = a.actInv(b)
    return max(float(np.linalg.norm(between.translation)), float(np.linalg.norm(pin.log3(between.rotation)))) < HOME


def _since_home(hand: Gripper, part: str) -> list[pin.SE3]:
    """The poses of a part since it was last where the session began."""
    poses = [pose for _, pose in hand.session.trail(part)]
    last = max(k for k, pose in enumerate(poses) if _same(poses[0], pose))
    return [poses[0], *poses[last + 1 :]]


def _track(hand: Gripper, poses: Sequence[pin.SE3]) -> paths.Track:
    return paths.Track(hand.session.dt * np.arange(len(poses), dtype=np.float64), poses)


def _by_kind(hand: Gripper, items: Sequence[str]) -> str:
    """The names of a list with those of one shape together: "cover, 4 like M3_1"."""
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
