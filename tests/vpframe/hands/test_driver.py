"""Verbs that are run step by step."""

from collections import deque

import pinocchio as pin
import pytest

import vpframe as vp
from vpframe.errors import TaskError
from vpframe.hands.driver import drive
from vpframe.hands.gripper import Gripper
from vpframe.hands.paths import Resting
from vpframe.hands.segment import MotionSegment, Outcome, Verb, steps, verb

HERE = pin.SE3.Identity()


class Nodding(Gripper):
    """A hand with two verbs, one of which uses the other."""

    @verb
    def nod(self, times: int, seconds: float = 0.1) -> Verb:
        """Rest so many times."""
        for n in range(times):
            outcome = yield MotionSegment(f"nod {n}", Resting(HERE, seconds))
            assert outcome.done
        return self.outcome(f"{times} nods")

    @verb
    def bow(self) -> Verb:
        """Nod twice, then rest."""
        nodded = yield from steps(self.nod, 2, seconds=0.2)
        yield MotionSegment("bow", Resting(HERE, 0.1))
        return self.outcome(f"bowed after {nodded.reason}")


class Room:
    """What these verbs use of a session."""

    def __init__(self) -> None:
        self.scene, self.dt, self.time = vp.Scene(), 0.1, 0.0
        self.segments: list[str] = []

    def perform(self, hand: Gripper, generator: Verb) -> Outcome:
        def step() -> None:
            if hand.clock == 0.0 and hand.segment is not None:
                self.segments.append(hand.segment.text)
            hand.desire(self.dt, 1.0)
            self.time += self.dt

        return drive({hand.name: hand}, {hand.name: deque([generator])}, step)[hand.name]


def test_a_verb_runs_the_session_and_is_a_part_of_another_verb() -> None:
    room = Room()
    hand = Nodding(room, "hand", HERE)
    assert hand.nod(1) == Outcome(True, "1 nods", pytest.approx(0.1))
    room.segments.clear()
    assert hand.bow().reason == "bowed after 2 nods"
    assert room.segments == ["nod 0", "nod 1", "bow"]
    with pytest.raises(TypeError, match="unexpected keyword argument 'often'"):
        hand.nod(often=2)


def test_an_error_of_a_step_ends_the_verb_and_the_hand_has_no_segment() -> None:
    room = Room()
    hand = Nodding(room, "hand", HERE)

    def step() -> None:
        raise TaskError("the step failed")

    with pytest.raises(TaskError, match="the step failed"):
        drive({"hand": hand}, {"hand": deque([steps(hand.bow)])}, step)
    assert hand.segment is None and hand.doing == ""
