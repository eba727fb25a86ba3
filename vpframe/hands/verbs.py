"""`Mover`: the verbs with which a hand grabs, releases and moves a part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.errors import TaskError
from vpframe.hands import paths
from vpframe.hands.access import Access, refused, to_grab, to_turn
from vpframe.hands.arguments import FAR, as_pose, metres, number, radians, vector
from vpframe.hands.conditions import as_condition, constraint, contact
from vpframe.hands.directions import direction, line, top_of
from vpframe.hands.gripper import Gripper
from vpframe.hands.reach import extent, surface_distances
from vpframe.hands.segment import Condition, MotionSegment, Outcome, Verb, steps, verb
from vpframe.scene.boxes import half_size
from vpframe.scene.subassembly import parts_named

if TYPE_CHECKING:
    from vpframe.scene.scene import Part


class Mover(Gripper):
    """A hand that grabs, releases and moves parts, one at a time or with those that it carries."""

    # ---- grip

    @verb
    def approach(self, part: str, surface: int | None = None, duration: float | None = None) -> Verb:
        """Move to the nearest point of a part (of one of its surfaces)."""
        if self.held is not None:
            raise TaskError(f"{self.name} holds {self.load}; only an empty hand approaches, use move_to")
        group = self.session.group(part)
        if surface is not None and len(group) > 1:
            raise TaskError(
                f"{self.name}.approach({part!r}, surface={surface}): {part} has {len(group)} parts; name one"
            )
        reached = [self._distances(self.scene[name]) for name in group]
        distances, points = min(reached, key=lambda found: float(found[0].min()))
        if surface is not None and surface not in range(len(distances)):
            raise TaskError(f"{part} has no surface {surface!r}; it has 0 … {len(distances) - 1}")
        goal = points[int(np.argmin(distances)) if surface is None else surface]
        path = self._straight(pin.SE3(self.pose.rotation, goal), duration)
        return (yield MotionSegment(f"{self.name}.approach({part!r})", path))

    @verb
    def grab(self, part: str, surface: int | None = None, carry: str | Sequence[str] = ()) -> Verb:
        """Grab a part, after approaching it if necessary. `carry` names parts that move rigidly with it.

        Names are paths in the product tree, or the end of a path. Of a subassembly the part nearest to the hand is held
        and the others are carried.

        Raises
        ------
        UnknownPartError: with near matches. TaskError: the name is ambiguous, a part is fixed or held by another hand,
            or this hand is not empty.
        """
        scene = self.scene
        if self.held is not None:
            raise TaskError(f"{self.name} already holds {self.load}; release it before grabbing {part}")
        carried = [carry] if isinstance(carry, str) else list(carry)
        meant = parts_named(scene.names, part)
        along = [name for given in carried for name in parts_named(scene.names, given)]
        if len({*meant, *along}) != len(meant) + len(along):
            raise TaskError(f"{self.name}.grab({part!r}, carry={carried}): name each part that comes along once")
        if surface is not None and len(meant) > 1:
            raise TaskError(f"{self.name}.grab({part!r}, surface={surface}): {part} has {len(meant)} parts; name one")
        for name in (*meant, *along):
            if scene[name].fixed:
                raise TaskError(f"{name} is fixed in the scene; set part.fixed = False before grabbing it")
            holder = self.session.holder(name)
            if holder is not None:
                raise TaskError(f"{name} is already held by {holder.name}")
        nearest = list(meant)
        if len(meant) > 1:
            nearest.sort(key=lambda name: float(self._distances(scene[name])[0].min()))
        held = nearest[0]
        if self.access is not None:
            access = Access(scene, self.session.tolerance, self.access)
            held, surface, there = to_grab(access, [scene[n] for n in nearest], surface, self.pose.translation)
            path = self._straight(pin.SE3(self.pose.rotation, there))
            yield MotionSegment(f"{self.name}.approach({held!r})", path)
        elif not self.touched(held) or surface is not None:
            yield from steps(self.approach, held, surface)
        rest = (name for name in meant if name != held)
        named = "" if part == held else part
        self.take(held, surface, (*rest, *along), named)
        return self.outcome(f"holds {self.holding(named)}")

    @verb
    def release(self) -> Verb:
        """Release the held part."""
        yield from ()
        self.let_go()
        return self.outcome("released")

    # ---- motion

    @verb
    def move_to(
        self,
        pose: pin.SE3 | ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Verb:
        """Move the held part (or the empty hand) to a world pose: an SE3, a position (3,), or `x y z qx qy qz qw`."""
        goal = as_pose(pose, self.subject)
        self.check_length(goal.translation - self.subject.translation, "move_to")
        return (yield from self._move_to(goal, duration, as_condition(until), required))

    def _move_to(
        self, goal: pin.SE3, duration: float | None = None, until: Condition | None = None, required: bool = True
    ) -> Verb:
        text = f"{self.title}.move_to([{_millimetres(goal.translation)}] mm)"
        return (yield MotionSegment(text, self._straight(goal, duration), until, required))

    @verb
    def move_by(
        self,
        shift: ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Verb:
        """Move by `shift` (3,), m, world axes, without rotation."""
        by = vector(shift, "move_by")
        self.check_length(by, "move_by")
        path = self._straight(paths.lifted(self.subject, by), duration)
        text = f"{self.title}.move_by([{_millimetres(by)}] mm)"
        return (yield MotionSegment(text, path, as_condition(until), required))

    @verb
    def follow(
        self,
        path: paths.Path | str | FilePath | Sequence[pin.SE3 | ArrayLike],
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Verb:
        """Follow a `Path`, a track file (`.csv`, `.json`) of world poses, or a list of poses (a smooth curve at the
        hand's own speeds). The hand moves to the start of the path first."""
        way: paths.Path
        if isinstance(path, str | FilePath):
            name, way = str(path), paths.read_track(path)
        elif isinstance(path, Sequence | np.ndarray):
            poses = [as_pose(pose, self.subject) for pose in path]
            for pose in poses:
                self.check_length(pose.translation - self.subject.translation, "follow")
            name, way = f"{len(poses)} poses", paths.Spline(poses, self.speed, self.turn_speed)
        elif hasattr(path, "pose") and hasattr(path, "duration"):
            name, way = type(path).__name__, path
        else:
            raise TaskError(f"{self.title}.follow({path!r}): give a path, the name of a track file, or a list of poses")
        number(way.duration, f"{self.title}.follow({name}): duration", least=0.0)
        start, here = way.pose(0.0), self.subject
        if np.linalg.norm(start.translation - here.translation) > self.slack or not start.isApprox(here, 1e-6):
            yield from self._move_to(start)
        return (yield MotionSegment(f"{self.title}.follow({name})", way, as_condition(until), required))

    @verb
    def drag(self, poses: Iterable[pin.SE3 | ArrayLike]) -> Verb:
        """Follow a sequence of target poses (as in `move_to`), one for each step, as a mouse gives them.

        The held part moves as near to each as its constraints and solid parts allow; obstacles raise no error. `poses`
        is read lazily.
        """
        outcome = self.outcome("went nowhere")
        for pose in poses:
            goal = as_pose(pose, self.subject)
            self.check_length(goal.translation - self.subject.translation, "drag")
            path = paths.Resting(goal, self.session.dt)
            outcome = yield MotionSegment(f"{self.title}.drag()", path, None, False)
        return outcome

    @verb
    def slide(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = None,
        speed: float | None = None,
        required: bool = True,
    ) -> Verb:
        """Slide `distance` m along a direction: "axis" (of the fit that holds the part, into its partner), "up",
        "down", "x", "-x", … or a vector. Without a distance, slide until the condition holds."""
        return (yield from self._slide("slide", self._way(along), distance, as_condition(until), speed, required))

    @verb
    def pull(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = "free",
        speed: float | None = None,
        required: bool = True,
    ) -> Verb:
        """Slide the part out: "axis" points away from the partner. Constraints break at their break distance."""
        end = as_condition(until) if distance is None else None
        return (yield from self._slide("pull", self._way(along, outward=True), distance, end, speed, required))

    def _way(self, along: str | ArrayLike, outward: bool = False) -> tuple[np.ndarray, str]:
        """Return the direction (3,), unit, world, of `along`, and its text."""
        way = direction(self, along, outward)
        return way, along if isinstance(along, str) else f"{np.round(way, 3).tolist()}"

    def _slide(
        self,
        verb: str,
        along: tuple[np.ndarray, str],
        distance: float | None = None,
        until: Condition | None = None,
        speed: float | None = None,
        required: bool = True,
    ) -> Verb:
        """Slide along a direction for a distance (m) or until a condition holds; `verb` names it in messages."""
        (way, how), far = along, distance
        if far is not None:
            far = self.length(far, verb, "distance")
            how += f", {far * 1e3:g} mm"
        elif until is None:
            raise TaskError(f"{self.name}.{verb} needs a distance or until=a condition")
        if until is not None:
            how += f", until {until.text}"
        pace = 0.4 * self.speed if speed is None else number(speed, f"{self.name}.{verb}: speed", above=0.0)
        here = self.subject
        goal = pin.SE3(here.rotation, here.translation + (self._scene_size() if far is None else far) * way)
        path = self._straight(goal, None, pace, eased=far is not None)
        return (yield MotionSegment(f"{self.title}.{verb}({how})", path, until, required))

    @verb
    def turn(
        self,
        angle: float,
        about: str | ArrayLike | tuple[ArrayLike, ArrayLike] = "axis",
        until: Condition | str | None = None,
        duration: float | None = None,
        required: bool = True,
    ) -> Verb:
        """Turn by `angle` rad about "axis" (of the fit that holds the part), a direction through the part's centre, or
        a line (point, direction)."""
        angle = radians(number(angle, f"{self.title}.turn: angle"), f"{self.title}.turn: angle")
        origin, axis = line(self, about)
        seconds = self._seconds(abs(angle) / self.turn_speed if duration is None else duration)
        path = paths.Turning(self.subject, origin, axis, angle, seconds)
        end = as_condition(until)
        text = f"{self.title}.turn({np.degrees(angle):g}°" + (f", until {end})" if end else ")")
        return (yield MotionSegment(text, path, end, required))

    @verb
    def wait(self, seconds: float | None = None, until: Condition | str | None = None) -> Verb:
        """Wait for a time (s) or until a condition holds (at most `seconds`, default 60)."""
        end = as_condition(until)
        if seconds is not None:
            seconds = number(seconds, f"{self.name}.wait: seconds", least=0.0)
        elif end is None:
            raise TaskError(f"{self.name}.wait needs seconds or until=a condition")
        path = self._resting(60.0 if seconds is None else seconds)
        return (yield MotionSegment(f"{self.name}.wait({end or f'{seconds:g} s'})", path, end))

    # ---- assembly

    @verb
    def place(self, on: str, at: ArrayLike | None = None, height: float = 0.05, release: bool = True) -> Verb:
        """Put the held part down on the highest flat top of `on`, over `at` (x, y) if given, and release it."""
        parts, targets = self.bodies("place"), self.others("place", on)
        height = self.length(height, "place", "height", least=0.0)
        top, over = top_of(targets, on)
        if at is not None:
            try:
                over = np.asarray(at, dtype=np.float64)
            except (TypeError, ValueError):
                over = np.empty(0)
        if over.shape != (2,) or not np.isfinite(over).all():
            raise TaskError(f"place(on={on!r}, at={at!r}): at is two finite numbers, x and y in metres")
        low, mid = extent(parts)
        yield from steps(self.move_by, (0.0, 0.0, max(top + height - low, 0.0)))
        yield from steps(self.move_by, (over[0] - mid[0], over[1] - mid[1], 0.0))
        end = constraint("against", other=on) | contact
        outcome = yield from self._slide(f"place({on!r})", self._way("down"), until=end)
        if release:
            self.let_go()
        return outcome

    @verb
    def snap(self, kind: str | None = None) -> Verb:
        """Accept the best candidate (of that kind) for the held part within the assist's reach."""
        part = self.body("snap").name
        if self.assist.snap <= 0.0:
            raise TaskError(f"{self.name}.snap(): set the reach first, hand.assist = Assist(snap=0.003)")
        rest = self._resting(2.0 * self.session.dt)
        yield MotionSegment(f"{self.name}.snap()", rest, None, False)  # a step, so that the candidates are up to date
        offers = [c for c in self.session.candidates if part in c.parts and kind in (None, c.kind)]
        if not offers:
            return self.outcome(f"nothing{f' {kind}' if kind else ''} to snap to within reach", done=False)
        self.session.accept(offers[0])
        rest = self._resting(2.0 * self.session.dt)
        yield MotionSegment(f"{self.name}.snap({offers[0].kind})", rest, None, False)
        return self.outcome(f"snapped: {offers[0].kind}")

    def _screw(
        self,
        verb: str,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
    ) -> Verb:
        """Screw in or unscrew (`verb`) by turns or until a condition holds, at `rate` turns a second."""
        who, out = self.title, verb == "unscrew"
        end = as_condition(until) or (None if turns else as_condition("free") if out else constraint("against"))
        if isinstance(turns, str | Sequence):
            raise TaskError(f"{who}.{verb}({turns!r}): the first argument is a number of turns; give names as parts=")
        part = self.body(verb)
        if pitch is None and self.session.pitch_of(part.name) is None:
            # a thread drawn as a plain cylinder is offered only while the hand rests
            yield MotionSegment(f"{who}.{verb}()", self._resting(self.session.dt))
        lead = self._lead(part, pitch, verb)
        rate = number(rate, f"{who}.{verb}: rate", above=0.0)
        if turns is not None:
            turns = number(turns, f"{who}.{verb}: turns", above=0.0)
        axis = direction(self, "axis", outward=out)
        origin, _ = line(self, "axis")
        if self.access is not None:
            access = Access(self.scene, self.session.tolerance, self.access, self.parts)
            met = to_turn(access, self.bodies(verb), origin, axis if out else -axis)
            if met:
                raise TaskError(f"{who}.{verb}: {refused(self.access, part.name, met)}")
        n = self._scene_size() / abs(lead) if turns is None else turns
        # positive turns about a direction advance along it in a right-hand thread, against it in a left-hand one
        angle, seconds = np.copysign(2.0 * np.pi * n, lead), self._seconds(n / rate)
        path = paths.Turning(self.subject, origin, axis, angle, seconds, pitch=lead, eased=turns is not None)
        how = f"{turns:g} turns" if turns is not None else f"until {end}"
        held, begun = self.session.held_by(*self.parts), np.array(self.subject.translation)
        outcome = yield MotionSegment(f"{who}.{verb}({how})", path, end, required)
        return self._with_effort(outcome, held, begun, lead)

    def _with_effort(
        self, outcome: Outcome, held: Sequence[Any], begun: np.ndarray, lead: float | None = None
    ) -> Outcome:
        """The outcome with what a workshop wants to know of the overlaps that the motion went through."""
        if not held:
            return outcome
        far = abs(float((self.subject.translation - begun) @ held[0].axis))
        travel = f"{1e3 * far:.4g} mm" if lead is None else f"{far / abs(lead):.4g} turns, {1e3 * far:.4g} mm"
        efforts = dict.fromkeys(overlap.meaning.effort for overlap in held)
        return replace(outcome, reason=f"{outcome.reason}; {travel} ({'; '.join(efforts)})")

    def _lead(self, part: Part, pitch: float | None, verb: str) -> float:
        """Return the pitch, m a turn, negative for a left-hand thread: the given one, else the thread's."""
        if pitch is not None:
            lead = number(pitch, f"{self.title}.{verb}: pitch")
            if lead == 0.0:
                raise TaskError(f"{self.title}.{verb}: pitch=0; give metres a turn, negative for a left-hand thread")
            size = 2.0 * half_size(part.mesh)
            metres(lead, f"{self.title}.{verb}: pitch={pitch!r}", part.name, size, FAR * size)
            return lead
        known: float | None = self.session.pitch_of(part.name)
        if known is None:
            raise TaskError(
                f"{self.title}.{verb}: no recognised thread holds {part.name}; "
                f"give pitch= in metres a turn, or declare it with session.thread({part.name!r}, pitch)"
            )
        return known

    # ---- paths

    def _straight(
        self, goal: pin.SE3, duration: float | None = None, speed: float | None = None, eased: bool = True
    ) -> paths.Straight:
        start = self.subject
        if duration is None:
            far = float(np.linalg.norm(goal.translation - start.translation))
            turned = float(np.linalg.norm(pin.log3(start.rotation.T @ goal.rotation)))
            duration = max(far / (speed or self.speed), turned / self.turn_speed)
        return paths.Straight(pin.SE3(start), goal, self._seconds(duration), eased)

    def _resting(self, duration: float) -> paths.Resting:
        return paths.Resting(self.subject, self._seconds(duration))

    def _seconds(self, duration: float) -> float:
        return max(number(duration, f"{self.name}: duration", least=0.0), self.session.dt)

    def _scene_size(self) -> float:
        return 2.0 * max(half_size(p.mesh) for p in self.scene.parts)

    def _distances(self, part: Part) -> tuple[np.ndarray, np.ndarray]:
        """Distance (k,) of each surface of a part to the hand, m, and the surfaces' nearest points (k, 3), world."""
        return surface_distances(part.mesh, part.pose, self.pose.translation)


def _millimetres(metres: np.ndarray) -> str:
    return ", ".join(f"{x:.1f}" for x in np.round(1e3 * metres, 1) + 0.0)
