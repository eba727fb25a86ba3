"""`Hand`: holds and moves parts; each verb runs the session until the motion has ended."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path as FilePath

import pinocchio as pin
from numpy.typing import ArrayLike

from vpframe.errors import TaskError
from vpframe.hands import service, verbs
from vpframe.hands.conditions import Condition
from vpframe.hands.gripper import Gripper
from vpframe.hands.paths import Path
from vpframe.hands.segment import Outcome


class Hand(Gripper):
    """A hand, created by `session.hand()`.

    A hand is a point in space: it can grab a part with a surface within `reach`. The held part moves to the pose
    nearest to its target that its constraints and solid parts allow.
    """

    def approach(self, part: str, surface: int | None = None, duration: float | None = None) -> Outcome:
        """Move to the nearest point of a part (of one of its surfaces)."""
        return self._do(verbs.approach(self, part, surface, duration))

    def grab(self, part: str, surface: int | None = None, carry: str | Sequence[str] = ()) -> Outcome:
        """Grab a part, after approaching it if necessary. `carry` names parts that move rigidly with it.

        Names are paths in the product tree, or the end of a path. Of a subassembly the part nearest to the hand is held
        and the others are carried.

        Raises
        ------
        UnknownPartError: with near matches. TaskError: the name is ambiguous, a part is fixed or held by another hand,
            or this hand is not empty.
        """
        return self._do(verbs.grab(self, part, surface, (carry,) if isinstance(carry, str) else tuple(carry)))

    def release(self) -> Outcome:
        """Release the held part."""
        return self._do(verbs.release(self))

    def move_to(
        self,
        pose: pin.SE3 | ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Move the held part (or the empty hand) to a world pose: an SE3, a position (3,), or `x y z qx qy qz qw`."""
        return self._do(verbs.move_to(self, pose, duration, until, required))

    def move_by(
        self,
        shift: ArrayLike,
        duration: float | None = None,
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Move by `shift` (3,), m, world axes, without rotation."""
        return self._do(verbs.move_by(self, shift, duration, until, required))

    def follow(
        self,
        path: Path | str | FilePath | Sequence[pin.SE3 | ArrayLike],
        until: Condition | str | None = None,
        required: bool = True,
    ) -> Outcome:
        """Follow a `Path`, a track file (`.csv`, `.json`) of world poses, or a list of poses (a smooth curve at the
        hand's own speeds). The hand moves to the start of the path first."""
        return self._do(verbs.follow(self, path, until, required))

    def drag(self, poses: Iterable[pin.SE3 | ArrayLike]) -> Outcome:
        """Follow a sequence of target poses (as in `move_to`), one for each step, as a mouse gives them.

        The held part moves as near to each as its constraints and solid parts allow; obstacles raise no error. `poses`
        is read lazily.
        """
        return self._do(verbs.drag(self, poses))

    def slide(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = None,
        speed: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Slide `distance` m along a direction: "axis" (of the fit that holds the part, into its partner), "up",
        "down", "x", "-x", … or a vector. Without a distance, slide until the condition holds."""
        return self._do(verbs.slide(self, along, distance, until, speed, required))

    def pull(
        self,
        along: str | ArrayLike = "axis",
        distance: float | None = None,
        until: Condition | str | None = "free",
        speed: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Slide the part out: "axis" points away from the partner. Constraints break at their break distance."""
        return self._do(verbs.pull(self, along, distance, until, speed, required))

    def turn(
        self,
        angle: float,
        about: str | ArrayLike | tuple[ArrayLike, ArrayLike] = "axis",
        until: Condition | str | None = None,
        duration: float | None = None,
        required: bool = True,
    ) -> Outcome:
        """Turn by `angle` rad about "axis" (of the fit that holds the part), a direction through the part's centre, or
        a line (point, direction)."""
        return self._do(verbs.turn(self, angle, about, until, duration, required))

    def insert(
        self,
        into: str,
        until: Condition | str | None = None,
        speed: float | None = None,
        gap: float = 3e-3,
        required: bool = True,
        depth: float | None = None,
    ) -> Outcome:
        """Insert the best fitting shaft of the held parts into its bore in `into`: align in front of it, then slide in.

        depth: travel of the tip past the bore's mouth, m. until: as in `slide`. By default the motion ends when the
        part is seated on any part, or at the largest overlap of shaft and bore.
        """
        return self._do(verbs.insert(self, into, until, speed, gap, required, depth))

    def screw(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
        parts: str | Sequence[str] = (),
    ) -> Outcome:
        """Screw in at `rate` turns a second, by `turns` or until the condition holds (default: an against constraint).

        pitch: m a turn, negative for a left-hand thread; by default that of the thread on the part. parts: `refit` a
        list of screws instead of turning the held part.
        """
        if parts:
            self._alone("screw", turns=turns, pitch=pitch, until=until)
            return self._do(service.refit(self, parts, "screw"))
        return self._do(verbs.screw(self, turns, pitch, until, rate, required))

    def unscrew(
        self,
        turns: float | None = None,
        pitch: float | None = None,
        until: Condition | str | None = None,
        rate: float = 2.0,
        required: bool = True,
        parts: str | Sequence[str] = (),
    ) -> Outcome:
        """Unscrew by `turns` or until the condition holds (default: free): `screw` in reverse.

        parts: `remove` a list of screws, each threaded or of that `pitch`, instead of turning the held part.
        """
        if parts:
            self._alone("unscrew", turns=turns, until=until)
            return self._do(service.remove(self, parts, None, pitch, "unscrew"))
        return self._do(verbs.unscrew(self, turns, pitch, until, rate, required))

    def remove(self, parts: str | Sequence[str], along: str | ArrayLike | None = None) -> Outcome:
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
        return self._do(service.remove(self, parts, along, None, "remove"))

    def refit(self, parts: str | Sequence[str]) -> Outcome:
        """Return parts and subassemblies to their initial poses along their own trails, the last one removed first."""
        return self._do(service.refit(self, parts, "refit"))

    def exchange(self, old: str, new: str, along: str | ArrayLike | None = None) -> Outcome:
        """Remove `old` (as `remove` does) and put `new` in its place, frame on frame, along the trail of `old`."""
        return self._do(service.exchange(self, old, new, along))

    def _alone(self, verb: str, **given: object) -> None:
        """Raise TaskError for arguments that cannot be combined with `parts`."""
        for name in (name for name, value in given.items() if value is not None):
            raise TaskError(
                f"{self.name}.{verb}: {name}= is of the part in the hand; leave it out, or leave out parts="
            )

    def place(self, on: str, at: ArrayLike | None = None, height: float = 0.05, release: bool = True) -> Outcome:
        """Put the held part down on the highest flat top of `on`, over `at` (x, y) if given, and release it."""
        return self._do(verbs.place(self, on, at, height, release))

    def snap(self, kind: str | None = None) -> Outcome:
        """Accept the best candidate (of that kind) for the held part within the assist's reach."""
        return self._do(verbs.snap(self, kind))

    def wait(self, seconds: float | None = None, until: Condition | str | None = None) -> Outcome:
        """Wait for a time (s) or until a condition holds (at most `seconds`, default 60)."""
        return self._do(verbs.wait(self, seconds, until))

    def _do(self, verb: verbs.Verb) -> Outcome:
        outcome: Outcome = self.session.perform(self, verb)
        return outcome
