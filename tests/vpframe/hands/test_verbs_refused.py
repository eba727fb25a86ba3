"""Verbs asked for what cannot be: one clear line of a typed error, and the hand is of use afterwards."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import at, scene
from vpframe.errors import TaskError, VpframeError
from vpframe.hands import Assist, Resting, Reversed, Spline, Straight, Track, Turning, clearance
from vpframe.session import rules
from vpframe.session.session import Session

NAN = float("nan")
HERE, THERE = at(0.06, 0.0, 0.05), at(0.06, 0.0, 0.10)
LOST = pin.SE3(np.eye(3), np.array([0.0, NAN, 0.0]))
MIRRORED = pin.SE3(np.diag([1.0, 1.0, -1.0]), np.array([0.0, 0.0, 0.1]))
STRETCHED = pin.SE3(2.0 * np.eye(3), np.array([0.0, 0.0, 0.1]))


class Wanders:
    """A path of a user's own that loses its way."""

    duration = 0.5

    def pose(self, t: float) -> pin.SE3:
        return HERE if t < 0.2 else LOST


class Endless:
    duration = NAN

    def pose(self, t: float) -> pin.SE3:
        return HERE


HOLDING = {
    "grab when it holds": (lambda h: h.grab("cube"), "already holds peg"),
    "approach when it holds": (lambda h: h.approach("cube"), "use move_to"),
    "no axis": (lambda h: h.pull(), "no axis to go by"),
    "no thread": (lambda h: h.unscrew(), "no recognised thread holds peg"),
    "no direction": (lambda h: h.slide("north", 0.1), "along='north'"),
    "no length of direction": (lambda h: h.slide((0, 0, 0), 0.1), "zero vector"),
    "no end": (lambda h: h.slide("up"), "needs a distance or until="),
    "distance is text": (lambda h: h.pull("up", "10mm"), "distance='10mm'; give a number"),
    "distance is no number": (lambda h: h.pull("up", NAN), "distance=nan"),
    "speed is nought": (lambda h: h.slide("up", 0.1, speed=0.0), "speed=0.0; give a finite number more than 0"),
    "speed is less": (lambda h: h.slide("up", 0.1, speed=-1.0), "speed=-1.0"),
    "duration is text": (lambda h: h.move_to((0, 0, 0.1), duration="2"), "duration='2'"),
    "duration is less": (lambda h: h.move_to((0, 0, 0.1), duration=-1.0), "duration=-1.0"),
    "until is a word": (lambda h: h.slide("up", until="now"), "until='now' is no condition"),
    "until is half a condition": (lambda h: h.slide("up", until=clearance), "is no condition"),
    "until names no part": (lambda h: h.slide("up", until=clearance("blok") < 0.001), "did you mean 'block'"),
    "pose is a name": (lambda h: h.move_to("block"), "'block' is no pose"),
    "pose is no number": (lambda h: h.move_to((0.0, NAN, 0.0)), "three finite numbers"),
    "pose is not finite": (lambda h: h.move_to(LOST), "must be finite"),
    "pose is mirrored": (lambda h: h.move_to(MIRRORED), "stretched or mirrored"),
    "pose is stretched": (lambda h: h.move_to(STRETCHED), "stretched or mirrored"),
    "angle is text": (lambda h: h.turn("90", "z"), "angle='90'"),
    "angle is no number": (lambda h: h.turn(NAN, "z"), "angle=nan"),
    "wait for nothing": (lambda h: h.wait(), "needs seconds or until="),
    "wait less": (lambda h: h.wait(-1.0), "seconds=-1.0"),
    "insert into itself": (lambda h: h.insert("peg"), "that is the part in the hand"),
    "insert where nothing fits": (lambda h: h.insert("cube"), "nothing of peg fits into cube"),
    "gap is less": (lambda h: h.insert("block", gap=-1.0), "gap=-1.0"),
    "place on what is not there": (lambda h: h.place("bench"), "no part 'bench'"),
    "place on itself": (lambda h: h.place("peg"), "that is the part in the hand"),
    "place nowhere": (lambda h: h.place("table", at=(NAN, 0.0)), "two finite numbers"),
    "place at a word": (lambda h: h.place("table", at="left"), "two finite numbers"),
    "height is less": (lambda h: h.place("table", height=-0.1), "height=-0.1"),
    "follow nothing": (lambda h: h.follow(None), "give a path"),
    "follow no poses": (lambda h: h.follow([]), "two poses or more; 0 given"),
    "follow no file": (lambda h: h.follow("none.csv"), "cannot be read"),
    "follow a path without end": (lambda h: h.follow(Endless()), "duration=nan"),
    "follow a path that is lost": (lambda h: h.follow(Wanders()), r"the path at 0\.\d+ s must be finite"),
    "spline of one": (lambda h: h.follow(Spline([HERE])), "two poses or more"),
    "spline of equals": (lambda h: h.follow(Spline([HERE, HERE])), "are the same; drop one"),
    "spline of nothing": (lambda h: h.follow(Spline([HERE, LOST])), "pose 1 of a spline must be finite"),
    "spline without limit": (lambda h: h.follow(Spline([HERE, THERE], speed=np.inf)), "speed=inf"),
    "straight less than no time": (lambda h: h.follow(Straight(HERE, THERE, -1.0)), "Straight: duration=-1.0"),
    "straight for ever": (lambda h: h.follow(Straight(HERE, THERE, NAN)), "Straight: duration=nan"),
    "straight to nowhere": (lambda h: h.follow(Straight(HERE, LOST, 1.0)), "Straight: end must be finite"),
    "turning about nothing": (
        lambda h: h.follow(Turning(HERE, np.zeros(3), np.zeros(3), 1.0, 1.0)),
        "Turning: axis is the zero vector",
    ),
    "resting for ever": (lambda h: h.follow(Resting(HERE, NAN)), "Resting: duration=nan"),
    "track to nowhere": (lambda h: h.follow(Track(np.array([0.0, 1.0]), [HERE, LOST])), "pose 1 of a track"),
    "track back in time": (lambda h: h.follow(Track(np.array([0.0, 1.0, 0.5]), [HERE] * 3)), "times must ascend"),
    "snap without reach": (lambda h: h.snap(), "set the reach first"),
    "assist without number": (lambda h: Assist(snap=NAN), "snap=nan"),
    "assist too slow": (lambda h: Assist(slow_to=0.0), "slow_to=0.0"),
    "assist too quick": (lambda h: Assist(slow_to=2.0), "slow_to=2.0"),
    "assist without axis": (lambda h: Assist(lock=None), "letters x, y, z"),
}


@pytest.mark.parametrize("case", HOLDING)
def test_a_hand_that_holds_a_part_says_what_is_wrong_and_goes_on(case: str) -> None:
    ask, message = HOLDING[case]
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=HERE.translation)
        hand.grab("peg")
        with pytest.raises(VpframeError, match=message) as caught:
            ask(hand)
        assert "\n" not in str(caught.value)
        assert hand.held == "peg" and hand.doing == "" and hand.move_by((0.0, 0.0, 0.01))


EMPTY = {
    "no such part": (lambda h: h.grab("pegg"), "did you mean 'peg'"),
    "no name": (lambda h: h.grab(3), "no part 3 in the scene"),
    "no such surface": (lambda h: h.grab("cube", surface=99), "no surface 99; it has 0 … 5"),
    "no surface": (lambda h: h.grab("cube", surface="top"), "no surface 'top'"),
    "fixed": (lambda h: h.grab("block"), "is fixed in the scene"),
    "release": (lambda h: h.release(), "holds nothing"),
    "screw": (lambda h: h.screw(turns=2.0, pitch=1e-3), "the hand is empty"),
    "place": (lambda h: h.place("table"), "the hand is empty"),
    "contact": (lambda h: h.wait(0.2, until="contact"), "no hand holds one"),
}


@pytest.mark.parametrize("case", EMPTY)
def test_an_empty_hand_says_what_is_wrong_and_goes_on(case: str) -> None:
    ask, message = EMPTY[case]
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=HERE.translation)
        with pytest.raises(VpframeError, match=message) as caught:
            ask(hand)
        assert "\n" not in str(caught.value)
        assert hand.held is None and hand.grab("peg")


def test_two_hands_and_one_part() -> None:
    """Whoever comes second is told; a hand that fails leaves both of use; a part goes from hand to hand."""
    with Session(scene(), rule=rules.leave_all) as session:
        left, right = session.hand("left", at=HERE.translation), session.hand("right", at=HERE.translation)
        with pytest.raises(TaskError, match="peg is already held by left"), session.together():
            left.grab("peg")
            right.grab("peg")
        assert left.held == "peg" and right.held is None
        right.grab("cube")
        with pytest.raises(TaskError, match=r"peg stopped after 35\.0 mm"), session.together():
            left.move_by((0.0, 0.0, -0.3))
            right.move_by((0.0, 0.0, 0.3))
        assert left.move_by((0.0, 0.0, 0.01)) and right.move_by((0.0, 0.0, 0.01))
        right.release()
        with session.together():
            left.release()
            right.grab("peg")
        assert right.held == "peg" and left.held is None


def test_what_is_blocked_fails_the_task_with_its_reason_or_says_so() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=HERE.translation)
        hand.grab("peg")
        with pytest.raises(TaskError, match=r"peg stopped after \d+\.\d mm: table stands in its way \(face \d"):
            hand.slide("down", until="free" if session.touching("peg") else clearance > 1.0)
        assert hand.slide("down", 0.1, required=False).reason.startswith("peg stopped after 0.0 mm")
        session.expect_no_clash()


def test_poses_in_a_list_are_followed_smoothly_and_back() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=HERE.translation)
        hand.grab("peg")
        assert hand.follow([HERE, THERE, (0.1, 0.05, 0.1)])
        session.expect_at("peg", (0.1, 0.05, 0.1), within=1e-9)
        assert hand.follow(Reversed(Spline([HERE, THERE, at(0.1, 0.05, 0.1)])))
        session.expect_at("peg", HERE, within=1e-9)
        assert hand.follow(Straight(HERE, THERE, 0.0))
        session.expect_at("peg", THERE, within=1e-9)


@pytest.mark.parametrize("shown", [True, False])
def test_the_hand_slows_down_near_other_parts_and_only_there(shown: bool) -> None:
    with Session(scene(), rule=rules.leave_all, clearance=shown) as session:
        hand = session.hand(at=HERE.translation)
        hand.grab("cube")
        hand.assist = Assist(slow_within=0.005, slow_to=0.25)
        hand.slide("down", until=clearance < 0.001, speed=0.06)
        heights = [pose.translation[2] for _, pose in session.trail("cube")]
        far = [a - b for a, b in pairwise(heights) if a > 0.0065]
        near = [a - b for a, b in pairwise(heights) if a < 0.0045]
        assert np.ptp(far) < 1e-9 and np.ptp(near) < 1e-9
        assert near[0] == pytest.approx(0.25 * far[0], rel=1e-6)
        assert session.frame is not None
        assert (session.frame.clearance is not None) is shown
