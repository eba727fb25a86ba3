"""`Hand`: what a script holds parts with. Its verbs read like the task; each runs the session until it is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.errors import TaskError
from vpframe.hands import verbs
from vpframe.hands.arguments import rigid
from vpframe.hands.assist import Assist
from vpframe.hands.conditions import Condition
from vpframe.hands.paths import Path
from vpframe.hands.reach import surface_distances

if TYPE_CHECKING:
    from physics import SpringHand
    from vpframe.session.session import Session


@dataclass(frozen=True)
class Outcome:
    """How a verb ended."""

    done: bool
    """it arrived, or its `until` came true"""
    reason: str
    """one line: "arrived", the condition that came true, or what stood in the way"""
    time: float
    """s, session time at the end"""

    def __bool__(self) -> bool:
        return self.done


@dataclass(frozen=True, eq=False)
class Stroke:
    """One stretch of motion of a hand: what verbs are made of. `path` moves the held part, or the empty hand."""

    text: str
    path: Path
    until: Condition | None = None
    required: bool = True
    """whether the task fails when the path ends before `until` holds (or, without one, away from its end)"""


class Hand:
    """One hand. Make it with `session.hand()`.

    A hand is a point in space with a reach: it grabs a part when a surface of the part is within `reach` of it.
    While it holds a part, the part goes to the nearest pose to the wanted one that its constraints and the solid
    parts around it allow; the hand may be ahead of it by `give`.
    """

    reach = 0.015
    """m: what is nearer than this to the hand, it touches"""
    give = 0.03
    """m: how far the part may stay behind before a motion is given up as blocked"""
    slack = 1e-3
    """m: how far from its goal a part may end for the motion to count as done (rotations count by the part's size)"""
    speed = 0.25
    """m/s, of motions that name neither duration nor speed"""
    turn_speed = np.pi
    """rad/s, likewise"""

    def __init__(self, session: Session, name: str, pose: pin.SE3) -> None:
        self.session = session
        self.name = name
        self.pose = pose
        """world pose of the hand"""
        self.held: str | None = None
        """name of the part in the hand"""
        self.grip = pin.SE3.Identity()
        """pose of the held part seen from the hand"""
        self.surfaces: tuple[int, ...] = ()
        """surfaces of the held part that the hand touches"""
        self.carried: tuple[str, ...] = ()
        """parts that move with the held one as if glued to it"""
        self.assist = Assist()
        self.spring: SpringHand | None = None
        """set a `physics.SpringHand` to pull parts that have behaviours with limited force instead of carrying them"""
        self.stopped_by: str = ""
        """what keeps the held part from following; empty while it can"""
        self.doing = ""
        """the verb under way, in words"""
        self.stroke: Stroke | None = None
        self.clock = 0.0
        """s along the stroke's path"""
        self.wanted: pin.SE3 | None = None
        """pose asked of the held part (of the empty hand) in this step"""

    # ---- what it moves

    @property
    def subject(self) -> pin.SE3:
        """World pose of the held part, or of the empty hand: what poses in verbs refer to."""
        return self.session.scene[self.held].pose if self.held else self.pose

    def __repr__(self) -> str:
        return f"Hand({self.name!r}, holds {self.held!r})"

    # ---- verbs

    def approach(self, part: str, surface: int | None = None, duration: float | None = None) -> Outcome:
        """Go to the nearest point of a part (of one of its surfaces)."""
        return self._do(verbs.approach(self, part, surface, duration))

    def grab(self, part: str, surface: int | None = None, carry: str | Sequence[str] = ()) -> Outcome:
        """Take a part that the hand touches; go there first if it does not. `carry` names parts that come along.

        Raises
        ------
        UnknownPartError: with near matches. TaskError: it is fixed, another hand holds it, or this hand is not empty.
        """
        return self._do(verbs.grab(self, part, surface, (carry,) if isinstance(carry, str) else tuple(carry)))

    def release(self) -> Outcome:
        """Let go of what is held."""
        return self._do(verbs.release(self))

    def move_to(
        self,
        pose: pin.SE3 | ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Bring the held part (the empty hand) to a world pose: an SE3, a position (3,), or `x y z qx qy qz qw`."""
        return self._do(verbs.move_to(self, pose, duration, until, required))

    def move_by(
        self,
        shift: ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Move by `shift` (3,), metres, world axes, without turning."""
        return self._do(verbs.move_by(self, shift, duration, until, required))

    def follow(
        self,
        path: Path | str | FilePath | Sequence[pin.SE3 | ArrayLike],
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Follow a path: any `Path` value, a track file (`.csv`, `.json`) of world poses, or poses in a list, through
        which it goes smoothly at the hand's own speeds. It goes to where the path begins first."""
        return self._do(verbs.follow(self, path, until, required))

    def slide(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = None,
        speed: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Slide `distance` metres along a direction: "axis" (of the fit that holds the part, into its partner),
        "up", "down", "x", "-x", … or a vector. Without a distance, until the condition holds."""
        return self._do(verbs.slide(self, along, distance, until, speed, required))

    def pull(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = "free",
        speed: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Pull the part out: like `slide`, but "axis" points away from the partner. Breaks what a pull breaks."""
        return self._do(verbs.pull(self, along, distance, until, speed, required))

    def turn(
        self,
        angle: float,
        about: str | ArrayLike | tuple[ArrayLike, ArrayLike] = "axis",
        until: Condition | str | None = None,
        duration: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Turn by `angle` rad about "axis" (of the fit that holds the part), a direction through the part's centre,
        or a line (point, direction)."""
        return self._do(verbs.turn(self, angle, about, until, duration, required))

    def insert(
        self,
        into: str,
        until: Condition | str | None = None,
        speed: float | None = None,
        gap: float = 3e-3,
        required: bool = True,
    ) -> Outcome:
        """Put the held part's shaft into the best fitting bore of `into`: align in front of it, then slide in."""
        return self._do(verbs.insert(self, into, until, speed, gap, required))

    def screw(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
    ) -> Outcome:
        """Screw in, `rate` turns a second, by `turns` or until the condition (by default until against something).

        The thread is the one that holds the part, or `pitch` (m a turn): negative for a left-hand thread.
        """
        return self._do(verbs.screw(self, turns, pitch, until, rate, required))

    def unscrew(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
    ) -> Outcome:
        """Unscrew by `turns` (or until the condition; by default until free): `screw`, the other way."""
        return self._do(verbs.unscrew(self, turns, pitch, until, rate, required))

    def place(self, on: str, at: ArrayLike | None = None, height: float = 0.05, release: bool = True) -> Outcome:
        """Put the held part down on the highest flat top of `on`, over `at` (x, y) if given, and let go."""
        return self._do(verbs.place(self, on, at, height, release))

    def snap(self, kind: str | None = None) -> Outcome:
        """Accept the best candidate within the assist's reach (of that kind) for the held part."""
        return self._do(verbs.snap(self, kind))

    def wait(self, seconds: float | None = None, until: Condition | str | None = None) -> Outcome:
        """Stay, for a time or until a condition holds (for at most `seconds`, 60 if not given)."""
        return self._do(verbs.wait(self, seconds, until))

    # ---- machinery, called by verbs and by the session

    def _do(self, verb: verbs.Verb) -> Outcome:
        return self.session.perform(self, verb)

    def touched(self, part: str) -> tuple[int, ...]:
        """Surfaces of a part that are within reach."""
        body = self.session.scene[part]
        distances, _ = surface_distances(body.mesh, body.pose, self.pose.translation)
        return tuple(int(s) for s in np.flatnonzero(distances <= self.reach))

    def take(self, part: str, surface: int | None, carried: tuple[str, ...]) -> None:
        """Close the hand on a part that it touches."""
        touched = self.touched(part)
        if not touched or (surface is not None and surface not in touched):
            what = part if surface is None else f"surface {surface} of {part}"
            raise TaskError(f"{self.name} does not touch {what} (reach {self.reach * 1e3:g} mm); approach it first")
        self.held, self.surfaces, self.carried = part, touched, carried
        self.grip = self.pose.actInv(self.session.scene[part].pose)
        self.stopped_by = ""
        self.session.note_grab(self)

    def let_go(self) -> None:
        """Open the hand."""
        if self.held is None:
            raise TaskError(f"{self.name} holds nothing; grab a part before releasing it")
        self.session.note_release(self)
        self.held, self.surfaces, self.carried, self.stopped_by = None, (), (), ""

    def start(self, stroke: Stroke) -> None:
        """Begin a stroke at the present pose."""
        self.stroke, self.clock, self.doing, self.stopped_by = stroke, 0.0, stroke.text, ""

    def desire(self, dt: float, rate: float) -> pin.SE3:
        """The pose asked of the subject after `dt` more seconds, at `rate` times the path's own speed."""
        if self.stroke is None:
            self.wanted = pin.SE3(self.subject)
        else:
            self.clock += dt * rate
            aim = rigid(self.stroke.path.pose(self.clock), f"{self.doing}: the path at {self.clock:.3f} s")
            self.wanted = self.assist.shape(self.stroke.path.pose(0.0), aim)
        if self.held is None:
            self.pose = self.wanted
        else:
            self.pose = self.wanted * self.grip.inverse()
        return self.wanted

    def lag(self) -> float:
        """m: how far the subject is from the wanted pose; rotation counts by half the part's size."""
        if self.held is None or self.wanted is None:
            return 0.0
        behind = self.wanted.actInv(self.subject)
        arm = self.session.half_size(self.held)
        return float(np.linalg.norm(behind.translation) + arm * np.linalg.norm(pin.log3(behind.rotation)))

    def judge(self) -> Outcome | None:
        """After a step: how the stroke ended, or None while it goes on."""
        stroke, session = self.stroke, self.session
        if stroke is None:
            return None
        if stroke.until is not None and stroke.until(session, self):
            return self._finish(True, stroke.until.text)
        over = self.clock >= stroke.path.duration - 1e-9 * session.dt
        behind = self.lag()
        if not over and behind <= self.give:
            return None
        if stroke.until is None and behind <= self.slack:
            return self._finish(True, "arrived")
        reason = self._obstacle(behind) if behind > self.slack else f"the way ended before {stroke.until}"
        if stroke.required:
            self._finish(False, reason)
            raise TaskError(f"{stroke.text}: {reason}")
        return self._finish(False, reason)

    def _obstacle(self, behind: float) -> str:
        assert self.held is not None
        held_by = [f"{c.kind} with {_other(c.parts, self.held)}" for c in self.session.constraints_of(self.held)]
        reasons = [f"stopped by {self.stopped_by}"] * bool(self.stopped_by)
        reasons += [f"held by {', '.join(held_by)}"] * bool(held_by)
        why = "; ".join(reasons)
        return f"{self.held} stayed {behind * 1e3:.2f} mm behind" + (f", {why}" if why else "")

    def _finish(self, done: bool, reason: str) -> Outcome:
        self.stroke, self.doing = None, ""
        if self.held is not None:  # the hand comes back to the part it holds
            self.pose = self.subject * self.grip.inverse()
        self.wanted = None
        return Outcome(done, reason, self.session.time)


def _other(parts: Sequence[str], name: str) -> str:
    return parts[1] if parts[0] == name else parts[0]
