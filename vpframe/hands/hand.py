"""`Hand`: what a script holds parts with. Its verbs read like the task; each runs the session until it is done."""

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

    def drag(self, poses: Iterable[pin.SE3 | ArrayLike]) -> Outcome:
        """Ask for one pose (as of `move_to`) after another, each for one step, as a person's mouse does.

        The held part goes as near to each as its constraints and solid parts allow; nothing that stops it is an error.
        Poses are taken from `poses` as they are needed.
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
        depth: float | None = None,
    ) -> Outcome:
        """Put the best fitting shaft of what is held into its bore in `into`: align in front of it, then slide in.

        depth: m that its tip goes past the mouth of the bore. until: as of `slide`. With neither it goes on until it is
        seated, on whatever part, or until nothing more is gained: the shaft would leave the bore again.
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
        """Screw in, `rate` turns a second, by `turns` or until the condition (by default until against something).

        The thread is the one that holds the part, or `pitch` (m a turn): negative for a left-hand thread. parts:
        `refit` a list of screws instead of turning what is held.
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
        """Unscrew by `turns` (or until the condition; by default until free): `screw`, the other way.

        parts: `remove` a list of screws, each threaded or of that `pitch`, instead of turning what is held.
        """
        if parts:
            self._alone("unscrew", turns=turns, until=until)
            return self._do(service.remove(self, parts, None, pitch, "unscrew"))
        return self._do(verbs.unscrew(self, turns, pitch, until, rate, required))

    def remove(self, parts: str | Sequence[str], along: str | ArrayLike | None = None) -> Outcome:
        """Take parts and subassemblies out, one after another, and lay them in a row beside the scene.

        Each is grabbed, unscrewed if it is threaded, pulled until it is clear of all others, and released. along: as of
        `pull`; by default the axis that holds it, else away from what it stands against, else up, and where it does not
        come out so, the way that `vpframe.planning` finds.

        Raises
        ------
        TaskError: one of them does not come out: which, how many did, and what stopped it.
        """
        return self._do(service.remove(self, parts, along, None, "remove"))

    def refit(self, parts: str | Sequence[str]) -> Outcome:
        """Put parts and subassemblies back where the session began, each the way it came, the last one out first."""
        return self._do(service.refit(self, parts, "refit"))

    def exchange(self, old: str, new: str, along: str | ArrayLike | None = None) -> Outcome:
        """Take `old` out (as `remove`) and put `new` in its place, frame on frame, the way `old` came out."""
        return self._do(service.exchange(self, old, new, along))

    def _alone(self, verb: str, **given: object) -> None:
        """Refuse what a list of parts cannot be given as well."""
        for name in (name for name, value in given.items() if value is not None):
            raise TaskError(
                f"{self.name}.{verb}: {name}= is of the part in the hand; leave it out, or leave out parts="
            )

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
