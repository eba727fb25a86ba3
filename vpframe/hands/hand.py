"""`Hand`: the hand of a session, with verbs for lists of parts: remove them and lay them beside the scene, refit them
along their trails, exchange them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.errors import TaskError
from vpframe.hands import paths, service
from vpframe.hands.access import MOST_NAMED
from vpframe.hands.conditions import as_condition
from vpframe.hands.directions import way_out
from vpframe.hands.insert import Fitter
from vpframe.hands.segment import Condition, Steps, Verb, steps, verb
from vpframe.hands.service import Names, Vector
from vpframe.scene.subassembly import listed

SEARCH = 30.0
"""time limit of planning for a part that cannot be removed straight, s"""


class Hand(Fitter):
    """A hand, created by `session.hand()`; each verb runs the session until the motion has ended.

    A hand is a point in space: it can grab a part with a surface within `reach`. The held part moves to the pose
    nearest to its target that its constraints and solid parts allow.
    """

    @verb
    def screw(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
        parts: Names = (),
    ) -> Verb:
        """Screw in at `rate` turns a second, by `turns` or until the condition holds (default: an against constraint).

        pitch: m a turn, negative for a left-hand thread; by default that of the thread on the part. parts: `refit` a
        list of screws instead of turning the held part.
        """
        if not parts:
            return (yield from self._screw("screw", turns, pitch, until, rate, required))
        self._check_alone("screw", turns=turns, pitch=pitch, until=until)
        return (yield from self._refit(parts, "screw"))

    @verb
    def unscrew(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
        parts: Names = (),
    ) -> Verb:
        """Unscrew by `turns` or until the condition holds (default: free): `screw` in reverse.

        parts: `remove` a list of screws, each threaded or of that `pitch`, instead of turning the held part.
        """
        if not parts:
            return (yield from self._screw("unscrew", turns, pitch, until, rate, required))
        self._check_alone("unscrew", turns=turns, until=until)
        return (yield from self._remove(parts, None, pitch, "unscrew"))

    @verb
    def press_out(
        self,
        distance: float | None = None,
        until: Condition | str | None = "free",
        speed: float | None = None,
        required: bool = True,
    ) -> Verb:
        """Press the held part out of the press fit that holds it, by `distance` m or until it is free.

        The force is not computed.

        Raises
        ------
        TaskError: no press fit holds it.
        """
        self.body("press_out")
        held = [overlap for overlap in self.session.held_by(*self.parts) if overlap.meaning.kind != "thread"]
        pressed = [mate for mate in self.mates() if mate.press > 0.0]
        if not (held or pressed):
            raise TaskError(f"{self.title}.press_out: no press fit holds {self.load}; use pull, unscrew or remove")
        begun = np.array(self.subject.translation)
        end = as_condition(until) if distance is None else None
        outcome = yield from self._slide("press_out", self._way("axis", outward=True), distance, end, speed, required)
        return self._with_effort(outcome, held, begun)

    @verb
    def remove(self, parts: Names, along: str | ArrayLike | None = None) -> Verb:
        """Remove parts and subassemblies one after another and lay them in a row beside the scene.

        Each is grabbed, unscrewed if threaded, pulled clear of all others, and released; a subassembly as one, unless
        all of its parts are threaded, or are no longer to each other as they were at first. along: as in `pull`; by
        default the axis of its fit, else away from its against contacts, else up, and if that fails the path that
        `vpframe.planning` finds.

        Raises
        ------
        TaskError: a part cannot be removed; names the part, its number and the obstacle. The part stays in the hand,
            where it stopped.
        """
        return (yield from self._remove(parts, along, None, "remove"))

    @verb
    def refit(self, parts: Names) -> Verb:
        """Return parts and subassemblies to their initial poses along their own trails, the last one removed first."""
        return (yield from self._refit(parts, "refit"))

    @verb
    def exchange(self, old: str, new: str, along: str | ArrayLike | None = None) -> Verb:
        """Remove `old` (as `remove` does) and put `new` in its place, frame on frame, along the trail of `old`."""
        session, scene = self.session, self.scene
        service.items_of(self, [old, new], "exchange")
        lead, first = session.group(old)[0], session.group(new)[0]
        try:
            begun = pin.SE3(scene[lead].pose)
            step = session.trail(lead)[-1][0]
            way, far = yield from self._take_out(old, along, None)
            out = [begun, *(pose for when, pose in session.trail(lead) if when > step)]
            yield from self._lay_aside(way, far)
            self.let_go()
            yield from steps(self.grab, new)
            assert self.held is not None
            seat = scene[first].pose.actInv(scene[self.held].pose)
            back = [pose * seat for pose in out[::-1]]
            across = back[0].translation - self.subject.translation
            across -= (across @ way) * way
            if across.any():
                yield from self._free_move(service.clear(self, way, across / np.linalg.norm(across)) * way)
            over = max(float((self.subject.translation - back[0].translation) @ way), 0.0)
            yield from steps(self.move_to, paths.lifted(back[0], over * way))
            yield from steps(self.move_to, back[0])
            yield from steps(self.follow, service.track(self, back))
        except TaskError as error:
            raise TaskError(f"{self.name}.exchange({old!r}, {new!r}): {error}") from None
        self.let_go()
        return self.outcome(f"{new} is where {old} was")

    def _check_alone(self, verb: str, **given: object) -> None:
        """Raise TaskError for arguments that cannot be combined with `parts`."""
        for name in (name for name, value in given.items() if value is not None):
            raise TaskError(
                f"{self.name}.{verb}: {name}= is of the part in the hand; leave it out, or leave out parts="
            )

    def _remove(self, parts: Names, along: str | ArrayLike | None, pitch: float | None, verb: str) -> Verb:
        """Remove each part, unscrewing threaded ones, and lay it beside the scene."""
        items = tuple(unit for name in service.items_of(self, parts, verb) for unit in service.units(self, name, pitch))
        if self.held is not None:
            raise TaskError(f"{self.name}.{verb}: {self.name} holds {self.load}; release it first")
        if verb == "unscrew":
            service.check_threads(self, items, pitch, verb)
        for done, name in enumerate(items):
            try:
                way, out = yield from self._take_out(name, along, pitch)
                yield from self._lay_aside(way, out)
            except TaskError as error:
                raise service.failed_at(self, verb, items, done, error) from None
            self.let_go()
        return self.outcome(f"{verb}: {service.by_kind(self, items)} out")

    def _refit(self, parts: Names, verb: str) -> Verb:
        """Return each part to its initial pose along its trail, the last one removed first."""
        items = service.away(self, parts, verb)
        if verb == "screw":
            service.check_threads(self, items, None, verb)
        order = service.last_removed_first(self, items, verb)
        for done, name in enumerate(order):
            try:
                yield from steps(self.grab, name)
                yield from steps(self.follow, service.track(self, service.since_home(self, self.parts[0])[::-1]))
            except TaskError as error:
                raise service.failed_at(self, verb, order, done, error) from None
            self.let_go()
        return self.outcome(f"{verb}: {service.by_kind(self, items)} back")

    def _take_out(self, name: str, along: str | ArrayLike | None, pitch: float | None) -> Steps[tuple[Vector, float]]:
        """Grab a part, unscrew it if threaded, and pull it clear of all others; return direction and travel, m.

        Without `along`, a part that cannot be pulled straight goes back and follows a planned path.
        """
        yield from steps(self.grab, name)
        way = way_out(self, along)
        if pitch is not None or self.session.pitch_of(name) is not None:
            yield from self._screw("unscrew", pitch=pitch)
        out, begun = service.clear(self, way, service.side(self, way)), pin.SE3(self.subject)
        try:
            yield from steps(self.pull, way, out)
        except TaskError as error:
            if along is not None:
                raise
            yield from steps(self.move_to, begun)
            return (yield from self._planned(name, error))
        return way, out

    def _planned(self, name: str, straight: TaskError) -> Steps[tuple[Vector, float]]:
        """Remove a part along a planned path, whose end is straight; TaskError, after the error `straight`, if none."""
        found = self.session.plan_removal(self.session.group(name), SEARCH)
        if not found:
            by = f" by {listed(found.blockers[:MOST_NAMED])}" if found.blockers else ""
            how = f"none was found in {SEARCH:g} s" if found.verdict == "not found" else f"it is {found.verdict}{by}"
            raise TaskError(f"{straight}; no other way out: {how}") from None
        track, begun, way = found.tracks[self.held], self.subject.translation, found.way.direction
        yield from steps(self.follow, paths.Track(track.times, track.poses))
        return way, max(float((self.subject.translation - begun) @ way), 0.0)

    def _lay_aside(self, way: Vector, back: float) -> Steps[None]:
        """Move the held part sideways past all others, then back by `back` m against `way`, above what lies there."""
        aside = service.side(self, way)
        yield from self._free_move(service.clear(self, aside) * aside)
        yield from self._free_move(-back * way)

    def _free_move(self, shift: Vector) -> Verb:
        """Move through free space at twice the usual speed."""
        return (yield from steps(self.move_by, shift, 0.5 * float(np.linalg.norm(shift)) / self.speed))
