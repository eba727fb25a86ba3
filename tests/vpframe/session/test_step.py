"""A step that fails or is interrupted anywhere has changed nothing: the state is that before it, to the bit."""

import random
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import physics
from physics import Behaviour, Elastic, Friction, Gravity, SpringHand
from tests.vpframe.bench_scene import SEAT, at, scene
from tests.vpframe.session.fits import tight_fit
from vpframe.errors import TaskError, VpframeError
from vpframe.events import ConstraintView, Frame, Frames
from vpframe.hands.paths import Straight
from vpframe.hands.segment import MotionSegment
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session import checkpoint, rules, step
from vpframe.session.controls import Controls, Request
from vpframe.session.session import Session
from vpframe.session.state import StateError

OURS = tuple(str(Path(__file__).parents[3] / package) for package in ("collision", "constraints", "physics", "vpframe"))


class Broken(Exception):
    """What was made to happen."""


def put_in(**options: Any) -> Session:
    """The peg on its way into the bore, some steps before it is recognised there."""
    session = Session(scene(), **options)
    hand = session.hand(at=(0.06, 0.0, 0.07))
    hand.speed = 0.1
    hand.grab("peg")
    hand.move_to(SEAT + np.array([0.0001, 0.0, 0.018]))
    down = pin.SE3(hand.subject.rotation, SEAT - np.array([0.0, 0.0, 0.004]))
    hand.start(MotionSegment("down", Straight(pin.SE3(hand.subject), down, 0.2)))
    return session


def falling(*more: Behaviour, **options: Any) -> Session:
    """A ball that falls on a box, a box in a hand's spring, another pushed along by a hand."""
    box = modelling.box(0.06, 0.05, 0.04)
    made = modelling.scene(
        {
            "floor": (modelling.box(1.0, 1.0, 0.1).translated(-0.5, -0.5, -0.1), at(0.0, 0.0, 0.0)),
            "ball": (modelling.sphere(0.02), at(0.0, 0.0, 0.07)),
            "box": (box, at(-0.03, -0.025, 0.0)),
            "hung": (box, at(0.2, 0.0, 0.1)),
            "held": (box, at(-0.3, 0.0, 0.1)),
        },
        deflection=1e-3,
    )
    made["floor"].fixed = True
    session = Session(made, **options)
    for name in ("ball", "box", "hung", "held"):
        session.behave(name, Gravity(), Friction(0.4), Elastic(0.3), *more)
    for name, place, shift in (("hung", (0.2, 0.0, 0.14), 0.05), ("held", (-0.3, 0.0, 0.14), 0.2)):
        hand = session.hand(name, at=place)
        if name == "hung":
            hand.spring = SpringHand(pin.SE3.Identity())
        hand.grab(name)
        goal = pin.SE3(hand.subject.rotation, hand.subject.translation + np.array([shift, 0.0, 0.0]))
        hand.start(MotionSegment("aside", Straight(pin.SE3(hand.subject), goal, 0.2)))
    return session


MAKERS: dict[str, Callable[..., Session]] = {"put in": put_in, "falling": falling}


def told(session: Session) -> list[tuple[Any, ...]]:
    """All events by value."""
    return [(e.step, e.kind, e.parts, e.surfaces, e.text) for e in session.events]


def refused(session: Session, error: type[BaseException]) -> None:
    """A step fails, and leaves everything as it was."""
    before = session.save(), told(session), session.frame, session.trail(session.scene.names[1])
    with pytest.raises(error):
        session.step()
    assert session.save() == before[0]
    assert told(session) == before[1]
    assert session.frame is before[2]
    after = session.trail(session.scene.names[1])
    assert [(k, p.homogeneous.tobytes()) for k, p in after] == [(k, p.homogeneous.tobytes()) for k, p in before[3]]


@contextmanager
def interrupted(after: int) -> Iterator[list[int]]:
    """Ctrl-C at that line of ours; in the list how many there were."""
    lines = [0]

    def line(frame: FrameType, event: str, argument: Any) -> Any:
        if event == "line":
            lines[0] += 1
            if lines[0] == after:
                sys.settrace(None)
                signal.raise_signal(signal.SIGINT)
        return line

    def call(frame: FrameType, event: str, argument: Any) -> Any:
        return line if frame.f_code.co_filename.startswith(OURS) else None

    before, handler = sys.gettrace(), signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.settrace(call)
    try:
        yield lines
    finally:
        sys.settrace(before)
        signal.signal(signal.SIGINT, handler)


@pytest.fixture(autouse=True, scope="module")
def compiled() -> None:
    """Kernels are there before a step is looked at line by line."""
    for maker in MAKERS.values():
        session = maker()
        for _ in range(20):
            session.step()


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_an_interrupt_anywhere_leaves_all_or_nothing(maker: Callable[..., Session]) -> None:
    rng = random.Random(4)
    tried, plain = maker(), maker()
    undone = done = 0
    for _ in range(20):
        with interrupted(-1) as lines:  # how many lines the step has
            plain.step()
        for _ in range(4):
            before, events = tried.save(), told(tried)
            with interrupted(rng.randint(1, lines[0])), suppress(KeyboardInterrupt):
                tried.step()
            if tried.step_count == plain.step_count:  # it came after the step was done, or not at all
                done += 1
                break
            undone += 1
            assert tried.save() == before
            assert told(tried) == events
        else:
            tried.step()
        assert tried.save() == plain.save()
        assert told(tried) == told(plain)
    assert undone > 40
    assert done < undone / 4


@pytest.mark.parametrize("stage", ["commands", "follow", "recognise", "dynamics", "contacts", "advance"])
@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_each_stage_may_fail_at_its_end(
    maker: Callable[..., Session], stage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, plain = maker(), maker()
    for _ in range(6):
        session.step()
        plain.step()
        original = getattr(step, stage)

        def fails(*given: Any, original: Any = original) -> Any:
            original(*given)
            raise Broken

        with monkeypatch.context() as patch:
            patch.setattr(checkpoint if stage == "advance" else step, stage, fails)
            patch.setattr(step, "STAGES", tuple((getattr(step, s.__name__), kind) for s, kind in step.STAGES))
            refused(session, Broken)
        session.step()
        plain.step()
        assert session.save() == plain.save()
        assert told(session) == told(plain)


def test_a_behaviour_that_raises() -> None:
    class Fails(Behaviour):
        broken = False

        def wrench(self, view: Any) -> Any:
            if self.broken:
                raise Broken
            return np.zeros(6)

    fails = Fails()
    session, plain = falling(fails), falling(Fails())
    for _ in range(8):
        session.step()
        plain.step()
        fails.broken = True
        refused(session, physics.BehaviourError)
        fails.broken = False
    assert session.save() == plain.save()
    assert told(session) == told(plain)


def test_a_rule_that_raises_on_the_way() -> None:
    session, plain = put_in(), put_in()
    failed = []

    def rule(candidate: ConstraintView) -> str:
        if candidate.kind not in failed:
            failed.append(candidate.kind)
            raise Broken
        return "accept"

    session.rule = rule
    for _ in range(12):
        plain.step()
        count = len(failed)
        try:
            session.step()
        except Broken:
            assert len(failed) == count + 1
            session.step()
        assert session.save() == plain.save()
    assert "concentric" in failed
    assert told(session) == told(plain)


def test_what_the_script_decided_is_still_to_be_done() -> None:
    def rule(candidate: ConstraintView) -> None:
        return None

    sessions = [put_in(rule=rule), put_in(rule=rule)]
    for session in sessions:
        while not session.candidates:
            session.step()
        session.accept(session.candidates[0])
    session, plain = sessions
    saved = session.save()
    with interrupted(400), pytest.raises(KeyboardInterrupt):
        session.step()
    assert session.save() == saved
    assert len(session.engine.decisions) == 1
    session.step()
    plain.step()
    assert session.constraints and session.save() == plain.save()


def test_a_decision_that_cannot_be_done_fails_one_step_only() -> None:
    def rule(candidate: ConstraintView) -> None:
        return None

    session = put_in(rule=rule)
    while not session.candidates:
        session.step()
    good = session.candidates[0]
    session.refuse(good)
    session.step()
    session.refuse(good)  # it is refused already
    session.accept(good)
    with pytest.raises(TaskError, match="refuse: no candidate has id"):
        session.step()
    assert [d.verb for d in session.engine.decisions] == ["accept"]
    session.step()
    assert [c.id for c in session.constraints] == [good.id]


def test_what_a_person_asked_for_waits_until_it_is_done() -> None:
    class Page(Frames):
        controls = Controls()

    def rule(candidate: ConstraintView) -> None:
        return None

    page = Page()
    session = put_in(rule=rule, observers=[page])
    while not session.candidates:
        session.step()
    page.controls.put(Request("accept", session.candidates[0].id))
    with interrupted(400), pytest.raises(KeyboardInterrupt):
        session.step()
    assert not session.constraints
    session.step()
    assert len(session.constraints) == 1
    assert page.controls.waiting() == ()
    session.step()
    assert len(session.constraints) == 1


def test_an_interrupted_run_resumes_as_if_it_had_not_been(tmp_path: Path) -> None:
    """The journal holds no step that was undone."""
    path, rng = tmp_path / "run.journal", random.Random(1)
    session, plain = falling(checkpoint=path), falling()
    for _ in range(70):
        if rng.random() < 0.3:
            before = session.step_count
            with interrupted(rng.randint(1, 6000)), suppress(KeyboardInterrupt):
                session.step()
            if session.step_count > before:
                plain.step()
                continue
        session.step()
        plain.step()
    assert session.save() == plain.save()
    session.close()
    resumed = falling(checkpoint=path, resume=True)
    assert resumed._journal is not None
    while resumed._journal.replaying:
        resumed.step()
    assert resumed.step_count == 60
    for _ in range(10):
        resumed.step()
    assert resumed.scene["ball"].pose == plain.scene["ball"].pose


def test_reset_begins_anew() -> None:
    for maker in MAKERS.values():
        session, watcher = maker(), Frames()
        plain = Session(session.scene.copy(), observers=[watcher])
        for name in () if maker is put_in else ("ball", "box", "hung", "held"):
            plain.behave(name, Gravity(), Friction(0.4), Elastic(0.3))
        plain.run(0.1)
        home = {name: part.pose for name, part in plain.scene.items()}
        plain.reset()
        assert plain.step_count == 0 and plain.time == 0.0
        plain.run(0.1)
        once, again = watcher.frames[: len(watcher.frames) // 2], watcher.frames[len(watcher.frames) // 2 :]
        assert [f.poses.rows.tobytes() for f in once] == [f.poses.rows.tobytes() for f in again]
        assert all(part.pose == home[name] for name, part in plain.scene.items())


def test_reset_empties_hands_and_undoes_mates() -> None:
    session = put_in()
    for _ in range(10):
        session.step()
    assert session.constraints_of("peg")
    hand = session.hand()
    session.reset()
    assert hand.held is None and not session.constraints_of("peg")
    assert session.scene["peg"].pose == scene()["peg"].pose
    hand.grab("peg")
    assert hand.held == "peg"


def test_a_state_of_another_scene_is_refused() -> None:
    session, other = put_in(), falling()
    saved = session.save()
    for wrong in (other.save(), saved[:-9], b"", saved.replace(b'"State"', b'"Stats"')):
        with pytest.raises(StateError):
            session.restore(wrong)
        assert session.save() == saved


def test_the_pose_of_a_part_in_a_session_is_the_sessions() -> None:
    session = put_in()
    peg = session.scene["peg"]
    there = peg.pose
    there.translation[2] += 1.0  # a copy
    assert peg.pose.translation[2] < 0.5
    with pytest.raises(VpframeError, match=r"^peg is in a session, .* use hand\.move_to\(pose\)"):
        peg.pose = pin.SE3.Identity()
    session.step()
    here = peg.pose
    session.close()
    assert peg.pose == here
    peg.pose = pin.SE3.Identity()
    assert peg.pose == pin.SE3.Identity()


def test_colliding_surfaces_are_those_of_a_query_of_their_own() -> None:
    """Also where they are read off contact rows: a pressed dovetail slides out of its groove and back."""
    housing, key = (modelling.shape(solid) for solid in tight_fit("dovetail", -2e-5))
    pose = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.05])), np.zeros(3))
    made = Scene([Part("housing", housing, pin.SE3.Identity()), Part("key", key, pose)])
    made["housing"].fixed = True
    sizes = set()
    with Session(made, rule=rules.leave_all) as session:
        advanced = session.step

        def checked() -> Frame:
            frame = advanced()
            expected = session.engine.collision.colliding_surfaces()
            assert frame.colliding.tolist() == sorted(expected.tolist())
            sizes.add(len(expected))
            return frame

        session.step = checked  # type: ignore[method-assign]
        hand = session.hand()
        hand.grab("key")
        hand.slide("z", 0.03, speed=0.3)
        hand.slide("z", -0.03, speed=0.3, required=False)
    assert len(sizes) > 1 and 0 in sizes
