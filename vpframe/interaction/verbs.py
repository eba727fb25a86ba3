"""What hands do: each verb is a generator of strokes, so that several hands can be at work in the same steps.

A verb yields `Stroke`s and is sent the `Outcome` of each; it returns the outcome of the whole. Everything a verb
decides, it decides from the scene as it stands when the stroke begins.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints.features import Feature
from constraints.geometry import Cylinder, Plane
from vpframe.errors import TaskError, UnknownPartError
from vpframe.interaction import paths
from vpframe.interaction.conditions import Condition, as_condition, constraint, contact
from vpframe.interaction.reach import half_size, surface_distances

if TYPE_CHECKING:
    from vpframe.events import ConstraintView
    from vpframe.interaction.hand import Hand, Outcome, Stroke
    from vpframe.scene import Part

Vector = NDArray[np.float64]
Verb = Generator["Stroke", "Outcome", "Outcome"]

_DIRECTIONS = {
    "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0), "z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
_AXIAL = ("concentric", "screw", "conical fit", "toroidal fit", "spherical fit")
"""kinds whose line is "the axis", the plainest first"""


# ---- motion


def approach(hand: Hand, part: str, surface: int | None, duration: float | None) -> Verb:
    """To the nearest point of a part, or of one of its surfaces: `Hand.approach`."""
    from vpframe.interaction.hand import Stroke

    if hand.held is not None:
        raise TaskError(f"{hand.name} holds {hand.held}; only an empty hand approaches, use move_to")
    body = hand.session.scene[part]
    distances, points = surface_distances(body.mesh, body.pose, hand.pose.translation)
    if surface is not None and not 0 <= surface < len(distances):
        raise TaskError(f"{part} has no surface {surface}; it has 0 … {len(distances) - 1}")
    goal = points[int(np.argmin(distances)) if surface is None else surface]
    path = _straight(hand, pin.SE3(hand.pose.rotation, goal), duration, None)
    return (yield Stroke(f"{hand.name}.approach({part!r})", path))


def grab(hand: Hand, part: str, surface: int | None, carried: tuple[str, ...]) -> Verb:
    """Take a part that the hand touches, after going there if need be: `Hand.grab`."""
    session = hand.session
    if hand.held is not None:
        raise TaskError(f"{hand.name} already holds {hand.held}; release it before grabbing {part}")
    if len({part, *carried}) != 1 + len(carried):
        raise TaskError(f"{hand.name}.grab({part!r}, carry={list(carried)}): name each part that comes along once")
    for name in (part, *carried):
        if session.scene[name].fixed:
            raise TaskError(f"{name} is fixed in the scene; set part.fixed = False before grabbing it")
        holder = session.holder(name)
        if holder is not None:
            raise TaskError(f"{name} is already held by {holder.name}")
    if not hand.touched(part) or surface is not None:
        yield from approach(hand, part, surface, None)
    hand.take(part, surface, carried)
    return _outcome(hand, f"holds {part}")


def release(hand: Hand) -> Verb:
    """Let go of what is held: `Hand.release`."""
    hand.let_go()
    return _outcome(hand, "released")
    yield  # pragma: no cover - makes this a generator, as all verbs are


def move_to(
    hand: Hand, pose: pin.SE3 | ArrayLike, duration: float | None, until: Condition | str | None, required: bool
) -> Verb:
    """Straight to a world pose: `Hand.move_to`."""
    from vpframe.interaction.hand import Stroke, as_pose

    goal = as_pose(pose, hand.subject)
    where = ", ".join(f"{x * 1e3:.1f}" for x in goal.translation)
    path = _straight(hand, goal, duration, None)
    return (yield Stroke(f"{_who(hand)}.move_to([{where}] mm)", path, as_condition(until), required))


def move_by(
    hand: Hand, shift: ArrayLike, duration: float | None, until: Condition | str | None, required: bool
) -> Verb:
    """Straight by a vector (3,), m, without turning: `Hand.move_by`."""
    from vpframe.interaction.hand import Stroke

    by = _vector(shift, "move_by")
    where = ", ".join(f"{x * 1e3:.1f}" for x in by)
    path = _straight(hand, paths.lifted(hand.subject, by), duration, None)
    return (yield Stroke(f"{_who(hand)}.move_by([{where}] mm)", path, as_condition(until), required))


def follow(hand: Hand, path: paths.Path | str | FilePath, until: Condition | str | None, required: bool) -> Verb:
    """Along a path or track, from where it begins: `Hand.follow`."""
    from vpframe.interaction.hand import Stroke

    name = str(path) if isinstance(path, str | FilePath) else type(path).__name__
    way: paths.Path = paths.read_track(path) if isinstance(path, str | FilePath) else path
    start, here = way.pose(0.0), hand.subject
    if np.linalg.norm(start.translation - here.translation) > hand.slack or not start.isApprox(here, 1e-6):
        yield from move_to(hand, start, None, None, True)
    return (yield Stroke(f"{_who(hand)}.follow({name})", way, as_condition(until), required))


def slide(
    hand: Hand,
    along: str | ArrayLike,
    distance: float | None,
    until: Condition | str | None,
    speed: float | None,
    required: bool,
    verb: str = "slide",
    outward: bool = False,
) -> Verb:
    """Along a direction, for a distance (m) or until a condition holds: `Hand.slide`."""
    from vpframe.interaction.hand import Stroke

    end = as_condition(until)
    if distance is None and end is None:
        raise TaskError(f"{hand.name}.{verb} needs a distance or until=a condition")
    way = direction(hand, along, outward)
    far = _scene_size(hand) if distance is None else float(distance)
    goal = paths.lifted(hand.subject, far * way)
    path = _straight(hand, goal, None, speed or 0.4 * hand.speed, eased=distance is not None)
    how = f"{along if isinstance(along, str) else np.round(way, 3).tolist()}"
    if distance is not None:
        how += f", {distance * 1e3:g} mm"
    if end is not None:
        how += f", until {end}"
    return (yield Stroke(f"{_who(hand)}.{verb}({how})", path, end, required))


def pull(
    hand: Hand,
    along: str | ArrayLike,
    distance: float | None,
    until: Condition | str | None,
    speed: float | None,
    required: bool,
) -> Verb:
    """Like `slide`, with "axis" pointing away from the partner: `Hand.pull`."""
    return (yield from slide(hand, along, distance, None if distance else until, speed, required, "pull", outward=True))


def turn(
    hand: Hand,
    angle: float,
    about: str | ArrayLike | tuple[ArrayLike, ArrayLike],
    until: Condition | str | None,
    duration: float | None,
    required: bool,
) -> Verb:
    """By an angle (rad) about an axis or line: `Hand.turn`."""
    from vpframe.interaction.hand import Stroke

    origin, axis = line(hand, about)
    seconds = abs(angle) / hand.turn_speed if duration is None else duration
    path = paths.Turning(hand.subject, origin, axis, float(angle), _seconds(hand, seconds))
    end = as_condition(until)
    text = f"{_who(hand)}.turn({np.degrees(angle):g}°" + (f", until {end})" if end else ")")
    return (yield Stroke(text, path, end, required))


def wait(hand: Hand, seconds: float | None, until: Condition | str | None) -> Verb:
    """Stay, for a time (s) or until a condition holds: `Hand.wait`."""
    from vpframe.interaction.hand import Stroke

    end = as_condition(until)
    if seconds is None and end is None:
        raise TaskError(f"{hand.name}.wait needs seconds or until=a condition")
    path = paths.Resting(hand.subject, _seconds(hand, 60.0 if seconds is None else seconds))
    return (yield Stroke(f"{hand.name}.wait({end or f'{seconds:g} s'})", path, end))


# ---- putting together, taking apart


def insert(
    hand: Hand, into: str, until: Condition | str | None, speed: float | None, gap: float, required: bool
) -> Verb:
    """In front of the best fitting bore of a part, then in: `Hand.insert`."""
    part, target = _held(hand, "insert"), hand.session.scene[into]
    shaft, bore = best_fit(part, target, hand.session.tolerance.clearance)
    way, aligned = in_front(part, target, shaft, bore, gap)
    yield from move_to(hand, aligned, None, None, True)
    end = as_condition(until) or constraint("against", other=into)
    return (yield from slide(hand, way, None, end, speed, required, f"insert({into!r})"))


def screw(
    hand: Hand, turns: float | None, pitch: float | None, until: Condition | str | None, rate: float, required: bool
) -> Verb:
    """In by turns or until a condition holds, at `rate` turns a second: `Hand.screw`."""
    end = as_condition(until) or (None if turns else constraint("against"))
    return (yield from _screw(hand, turns, pitch, end, rate, required, "screw"))


def unscrew(
    hand: Hand, turns: float | None, pitch: float | None, until: Condition | str | None, rate: float, required: bool
) -> Verb:
    """Out by turns or until a condition holds, at `rate` turns a second: `Hand.unscrew`."""
    end = as_condition(until) or (None if turns else as_condition("free"))
    return (yield from _screw(hand, turns, pitch, end, rate, required, "unscrew"))


def _screw(
    hand: Hand, turns: float | None, pitch: float | None, end: Condition | None, rate: float, required: bool, verb: str
) -> Verb:
    from vpframe.interaction.hand import Stroke

    lead = _lead(hand, pitch, verb)
    if not (np.isfinite(rate) and rate > 0.0):
        raise TaskError(f"{_who(hand)}.{verb}: rate={rate!r}; give a positive number of turns a second")
    if turns is not None and not (np.isfinite(turns) and turns > 0.0):
        raise TaskError(f"{_who(hand)}.{verb}: turns={turns!r}; give a positive number, the other verb turns back")
    axis = direction(hand, "axis", outward=verb == "unscrew")
    origin, _ = line(hand, "axis")
    n = _scene_size(hand) / abs(lead) if turns is None else float(turns)
    # positive turns about a direction advance along it in a right-hand thread, against it in a left-hand one
    angle = np.copysign(2.0 * np.pi * n, lead)
    path = paths.Turning(
        hand.subject, origin, axis, angle, _seconds(hand, n / rate), pitch=lead, eased=turns is not None
    )
    how = f"{turns:g} turns" if turns is not None else f"until {end}"
    return (yield Stroke(f"{_who(hand)}.{verb}({how})", path, end, required))


def _lead(hand: Hand, pitch: float | None, verb: str) -> float:
    """m a turn, negative for a left-hand thread: as the script says, else as the thread is that holds the part."""
    if pitch is not None:
        if not np.isfinite(pitch) or pitch == 0.0:
            raise TaskError(
                f"{_who(hand)}.{verb}: pitch={pitch!r}; give metres a turn, negative for a left-hand thread"
            )
        return float(pitch)
    part = _held(hand, verb).name
    known = hand.session.pitch_of(part)
    if known is None:
        raise TaskError(
            f"{_who(hand)}.{verb}: no thread holds {part} that is real geometry; "
            f"give pitch= in metres a turn, or say so with session.thread({part!r}, pitch)"
        )
    return known


def place(hand: Hand, on: str, at: ArrayLike | None, height: float, let_go: bool) -> Verb:
    """Down on the highest flat top of a part, and let go: `Hand.place`."""
    part, target = _held(hand, "place"), hand.session.scene[on]
    top, middle = top_of(target)
    over = middle if at is None else np.asarray(at, dtype=np.float64)
    if over.shape != (2,) or not np.isfinite(over).all():
        raise TaskError(f"place(on={on!r}, at={at!r}): at is two finite numbers, x and y in metres")
    low, mid = _extent(part, part.pose)
    above = np.array([over[0] - mid[0], over[1] - mid[1], top + height - low])
    highest = max(above[2], 0.0)
    yield from move_by(hand, (0.0, 0.0, highest), None, None, True)
    yield from move_by(hand, (above[0], above[1], 0.0), None, None, True)
    down = constraint("against", other=on) | contact
    outcome = yield from slide(hand, "down", None, down, None, True, f"place({on!r})")
    if let_go:
        yield from release(hand)
    return outcome


def snap(hand: Hand, kind: str | None) -> Verb:
    """Accept the best candidate within the assist's reach: `Hand.snap`."""
    from vpframe.interaction.hand import Stroke

    part = _held(hand, "snap").name
    session = hand.session
    if hand.assist.snap <= 0.0:
        raise TaskError(f"{hand.name}.snap(): set the reach first, hand.assist = Assist(snap=0.003)")
    settle = paths.Resting(hand.subject, 2.0 * session.dt)
    yield Stroke(f"{hand.name}.snap()", settle, None, False)  # a step, so that candidates are those of here and now
    offers = [c for c in session.candidates if part in c.parts and kind in (None, c.kind)]
    if not offers:
        return _outcome(hand, f"nothing{f' {kind}' if kind else ''} to snap to within reach", done=False)
    session.accept(offers[0])
    yield Stroke(f"{hand.name}.snap({offers[0].kind})", paths.Resting(hand.subject, 2.0 * session.dt), None, False)
    return _outcome(hand, f"snapped: {offers[0].kind}")


# ---- what verbs ask of the scene


def direction(hand: Hand, along: str | ArrayLike, outward: bool) -> Vector:
    """(3,) unit, world: what a script means by "axis", "up", "-x" or a vector."""
    if not isinstance(along, str):
        v = _vector(along, "along")
        if not np.linalg.norm(v) > 0.0:
            raise TaskError("along is the zero vector; give a direction")
        return v / np.linalg.norm(v)
    if along in _DIRECTIONS:
        return np.array(_DIRECTIONS[along])
    if along != "axis":
        raise TaskError(f"along={along!r}: give 'axis', one of {', '.join(_DIRECTIONS)}, or a vector of three numbers")
    part = _held(hand, "along='axis'")
    fit = _axial(hand, part.name)
    axis = np.array(fit.direction)
    partner = fit.parts[1] if fit.parts[0] == part.name else fit.parts[0]
    sign = _out_sign(hand, part, partner, axis)
    return axis * (sign if outward else -sign)


def _out_sign(hand: Hand, part: Part, partner: str, axis: Vector) -> float:
    """+1 if the part leaves along +axis: away from what it stands against, else away from the partner's middle."""
    resting = [
        c for c in hand.session.constraints_of(part.name) if c.kind == "against" and abs(c.direction @ axis) > 0.9
    ]
    for c in sorted(resting, key=lambda c: partner not in c.parts):
        # an against's direction is the normal of its first part's plane, which points at the second part
        leaving = -c.direction if c.parts[0] == part.name else c.direction
        return 1.0 if leaving @ axis > 0.0 else -1.0
    other = hand.session.scene[partner]
    return 1.0 if (_middle(part) - _middle(other)) @ axis >= 0.0 else -1.0


def line(hand: Hand, about: str | ArrayLike | tuple[ArrayLike, ArrayLike]) -> tuple[Vector, Vector]:
    """(origin, unit direction), world, of what a script means by `about`."""
    if isinstance(about, tuple) and len(about) == 2:
        return _vector(about[0], "about"), direction(hand, about[1], outward=True)
    if isinstance(about, str) and about == "axis":
        fit = _axial(hand, _held(hand, "about='axis'").name)
        return np.array(fit.origin), np.array(fit.direction)
    where = _middle(hand.session.scene[hand.held]) if hand.held else np.array(hand.pose.translation)
    return where, direction(hand, about, outward=True)  # type: ignore[arg-type]


def _axial(hand: Hand, part: str) -> ConstraintView:
    fits = [c for c in hand.session.constraints_of(part) if c.kind in _AXIAL]
    if not fits:
        have = ", ".join(c.kind for c in hand.session.constraints_of(part)) or "none"
        raise TaskError(f"{part} has no axis to go by: no concentric fit holds it (its constraints: {have})")
    return min(fits, key=lambda c: (_AXIAL.index(c.kind), c.id))


def best_fit(part: Part, target: Part, clearance: float) -> tuple[Feature, Feature]:
    """The shaft of `part` and the bore of `target` (or the other way round: a ring over a pin) that fit best.

    Radii within `clearance`; of those the largest shared surface; of equal ones (within 1 %) the nearest.
    """

    def cylinders(of: Part, sense: int) -> list[Feature]:
        return [f for f in of.features if isinstance(f.geometry, Cylinder) and f.sense == sense]

    pairs = [(s, b) for s in cylinders(part, 1) for b in cylinders(target, -1)]
    pairs += [(s, b) for s in cylinders(part, -1) for b in cylinders(target, 1)]
    fits = [(s, b) for s, b in pairs if abs(_radius(s) - _radius(b)) <= clearance]
    if not fits:
        raise TaskError(
            f"nothing of {part.name} fits into {target.name}: no shaft and bore with radii within "
            f"{clearance * 1e3:g} mm (Tolerance.clearance)"
        )
    largest = max(min(s.area, b.area) for s, b in fits)
    return min((f for f in fits if min(f[0].area, f[1].area) > 0.99 * largest), key=lambda f: _aside(part, target, *f))


def _aside(part: Part, target: Part, shaft: Feature, bore: Feature) -> float:
    """m: how far the middle of the shaft is from the axis of the bore."""
    assert isinstance(bore.geometry, Cylinder)
    to = target.pose.actInv(part.pose.act(shaft.samples.mean(0))) - bore.geometry.origin
    return float(np.linalg.norm(np.cross(to, bore.geometry.axis)))


def in_front(part: Part, target: Part, shaft: Feature, bore: Feature, gap: float) -> tuple[Vector, pin.SE3]:
    """The way in (3,) and the pose in which `part` stands on the bore's axis, `gap` before the nearest of its mouth.

    The part comes in by the side it is on, and keeps its heading as far as the axis allows.
    """
    assert isinstance(shaft.geometry, Cylinder) and isinstance(bore.geometry, Cylinder)
    axis = target.pose.rotation @ bore.geometry.axis
    mouth = target.pose.act(bore.samples.mean(0))
    here = part.pose.act(shaft.samples.mean(0))
    way = axis if (mouth - here) @ axis >= 0.0 else -axis
    own = part.pose.rotation @ shaft.geometry.axis
    if own @ way < 0.0:
        own = -own
    turn = pin.Quaternion.FromTwoVectors(own, way).toRotationMatrix()
    rotation = turn @ part.pose.rotation
    on_axis = target.pose.act(np.array(bore.geometry.origin))
    point = rotation @ shaft.geometry.origin
    shift = on_axis - point
    vertices = part.mesh.vertices[np.unique(part.mesh.triangles)] @ rotation.T + shift
    lead = float((vertices @ way).max())
    entry = float((bore.samples @ target.pose.rotation.T @ way).min() + target.pose.translation @ way)
    return way, pin.SE3(rotation, shift + (entry - gap - lead) * way)


def top_of(part: Part) -> tuple[float, Vector]:
    """Height (m, world z) and middle (x, y) of the largest upward plane of a part."""
    flat = []
    for feature in part.features:
        if isinstance(feature.geometry, Plane) and (part.pose.rotation @ feature.geometry.normal)[2] > 0.999:
            points = feature.samples @ part.pose.rotation.T + part.pose.translation
            flat.append((feature.area, float(points[:, 2].mean()), 0.5 * (points.min(0) + points.max(0))[:2]))
    if not flat:
        raise TaskError(f"{part.name} has no flat top to place anything on")
    _, height, middle = max(flat, key=lambda f: f[0])
    return height, middle


def _radius(feature: Feature) -> float:
    assert isinstance(feature.geometry, Cylinder)
    return feature.geometry.radius


def _held(hand: Hand, verb: str) -> Part:
    if hand.held is None:
        raise TaskError(f"{hand.name}.{verb}: the hand is empty; grab a part first")
    return hand.session.scene[hand.held]


def _who(hand: Hand) -> str:
    return f"{hand.name}[{hand.held}]" if hand.held else hand.name


def _outcome(hand: Hand, reason: str, done: bool = True) -> Outcome:
    from vpframe.interaction.hand import Outcome

    return Outcome(done, reason, hand.session.time)


def _straight(
    hand: Hand, goal: pin.SE3, duration: float | None, speed: float | None, eased: bool = True
) -> paths.Straight:
    start = hand.subject
    if duration is None:
        far = float(np.linalg.norm(goal.translation - start.translation))
        turned = float(np.linalg.norm(pin.log3(start.rotation.T @ goal.rotation)))
        duration = max(far / (speed or hand.speed), turned / hand.turn_speed)
    return paths.Straight(pin.SE3(start), goal, _seconds(hand, duration), eased)


def _seconds(hand: Hand, duration: float) -> float:
    if not (np.isfinite(duration) and duration >= 0.0):
        raise TaskError(f"{hand.name}: a motion of {duration} s; durations are finite and not negative")
    return max(float(duration), hand.session.dt)


def _scene_size(hand: Hand) -> float:
    return 2.0 * max(half_size(p.mesh) for p in hand.session.scene.parts)


def _extent(part: Part, pose: pin.SE3) -> tuple[float, Vector]:
    """Lowest z and middle (3,) of the part's bounding box, world."""
    points = part.mesh.vertices[np.unique(part.mesh.triangles)] @ pose.rotation.T + pose.translation
    return float(points[:, 2].min()), 0.5 * (points.min(0) + points.max(0))


def _middle(part: Part) -> Vector:
    return _extent(part, part.pose)[1]


def _vector(value: ArrayLike, what: str) -> Vector:
    v = np.asarray(value, dtype=np.float64)
    if v.shape != (3,) or not np.isfinite(v).all():
        raise TaskError(f"{what} takes three finite numbers; got {value!r}")
    return v


__all__ = [
    "UnknownPartError", "Verb", "approach", "best_fit", "direction", "follow", "grab", "in_front", "insert", "line",
    "move_by", "move_to", "place", "pull", "release", "screw", "slide", "snap", "top_of", "turn", "unscrew", "wait",
]  # fmt: skip
