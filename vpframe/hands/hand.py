"""`Hand`: what a script holds parts with. Its verbs read like the task; each runs the session until it is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.hands import verbs
from vpframe.hands.conditions import Condition
from vpframe.hands.gripper import Gripper
from vpframe.hands.paths import Path
from vpframe.hands.segment import Outcome


class Hand(Gripper):
    """One hand. Make it with `session.hand()`.

    A hand is a point in space with a reach: it grabs a part when a surface of the part is within `reach` of it. While
    it holds a part, the part goes to the nearest pose to the wanted one that its constraints and the solid parts around
    it allow.
    """

    def approach(self, part: str, surface: int | None = None, duration: float | None = None) -> Outcome:
        """Go to the nearest point of a part (of one of its surfaces)."""
        return self._do(verbs.approach(self, part, surface, duration))

    def grab(self, part: str, surface: int | None = None, carry: str | Sequence[str] = ()) -> Outcome:
        """Take a part that the hand touches; go there first if it does not. `carry` names parts that come along.

        Names are paths in the product tree, or the end of one. Of a subassembly the part nearest to the hand is held,
        and the others are carried: all of them move as one rigid body.

        Raises
        ------
        UnknownPartError: with near matches. TaskError: the name is not of one thing alone, a part of it is fixed or
        held by another hand, or this hand is not empty.
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

    def _do(self, verb: verbs.Verb) -> Outcome:
        outcome: Outcome = self.session.perform(self, verb)
        return outcome
