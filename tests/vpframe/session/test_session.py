"""Sessions: the loop, what it tells, what it decides, and that it does the same thing twice."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import SEAT, at, scene
from tests.vpframe.killed_runs import by_value, kill
from vpframe.errors import TaskError, UnknownPartError, VpframeError
from vpframe.events import Frames
from vpframe.hands import constraint, freedom
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session


class Watcher(Frames):
    """Counts its beginnings and ends; ends badly when told to."""

    def __init__(self, fail_at: int | None = None) -> None:
        super().__init__()
        self.begun, self.ended, self.fail_at = 0, 0, fail_at

    def begin(self, session) -> None:
        self.begun += 1

    def frame(self, frame) -> None:
        if frame.step == self.fail_at:
            raise RuntimeError("the screen is gone")
        super().frame(frame)

    def end(self) -> None:
        self.ended += 1


def put_in(session: Session) -> None:
    """The peg goes into the bore until its head sits, from a place a little off the axis."""
    hand = session.hand(at=(0.06, 0.0, 0.07))
    hand.speed = 0.1
    hand.grab("peg")
    hand.move_to(SEAT + np.array([0.0001, 0.0, 0.018]))
    hand.slide("down", until=constraint("concentric"))
    hand.slide("down", until=constraint("against"))


def take_out(session: Session) -> None:
    hand = session.hand()
    hand.pull(along="axis", until="free")
    hand.move_by((0.0, 0.0, 0.01))
    hand.release()


def there_and_back(session: Session) -> None:
    put_in(session)
    take_out(session)


def test_in_and_out_again() -> None:
    watcher = Watcher()
    with Session(scene(), observers=[watcher], clearance=True) as session:
        put_in(session)
        session.expect_constraint("concentric", "peg", "block")
        session.expect_constraint("against", "block", "peg")
        session.expect_freedom("peg", 1)
        assert session.joint("peg") == "revolute"
        session.expect_at("peg", SEAT, within=1e-9)
        session.expect_no_clash()
        take_out(session)
        session.expect_freedom("peg", 6)
        session.expect_free("peg")
    freedoms = [f.freedom["peg"] for f in watcher.frames if "peg" in f.freedom]
    changes = [n for i, n in enumerate(freedoms) if i == 0 or n != freedoms[i - 1]]
    assert changes == [6, 2, 1, 2, 6]
    kinds = [e.kind for e in session.events if e.kind in ("grabbed", "accepted", "satisfied", "removed", "released")]
    assert kinds == ["grabbed", *["accepted", "satisfied"] * 2, "removed", "removed", "released"]
    assert (watcher.begun, watcher.ended) == (1, 1)
    assert [f.step for f in watcher.frames[:-1]] == list(range(1, session.step_count + 1))
    told = [e for f in watcher.frames for e in f.events]
    assert told == list(session.events)
    assert watcher.frames[20].clearance > 0.0


def test_the_same_script_gives_the_same_bits() -> None:
    prints = []
    for _ in range(2):
        kept = Frames()
        with Session(scene(), observers=[kept], clearance=True) as session:
            put_in(session)
        prints.append(by_value(kept.frames))
    assert prints[0] == prints[1]


def test_a_constraint_moves_the_part_exactly_and_ends_its_collisions() -> None:
    with Session(scene()) as session:
        put_in(session)
        frame = session.frame
        assert frame is not None
        assert len(frame.colliding) == 0
        assert max(c.residual for c in session.constraints) < 1e-12
        hand = session.hand()
        hand.turn(1.0, about="axis")
        turned = session.scene["peg"].pose
        np.testing.assert_allclose(turned.translation, SEAT, atol=1e-12)
        assert np.linalg.norm(pin.log3(turned.rotation)) == pytest.approx(1.0, abs=1e-9)


def test_nothing_goes_through_anything_at_any_speed() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=(0.09, 0.07, 0.05))
        hand.grab("cube")
        outcome = hand.move_by((0.0, 0.0, -0.5), duration=0.03, required=False)
        assert not outcome
        assert session.scene["cube"].pose.translation[2] > 0.0
        assert session.scene["cube"].pose.translation[2] < 1e-4
        assert "table" in outcome.reason
        assert any(e.kind == "blocked" and "table" in e.parts for e in session.events)
        session.expect_no_clash()


def test_a_move_that_cannot_be_made_fails_with_the_reason() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=(0.09, 0.07, 0.05))
        hand.grab("cube")
        with pytest.raises(TaskError, match=r"move_by.*cube stopped after .* mm.*: table stands in its way"):
            hand.move_by((0.0, 0.0, -0.1))


def test_two_hands_work_at_the_same_time() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        left, right = session.hand("left", at=(0.06, 0.0, 0.07)), session.hand("right", at=(0.09, 0.07, 0.05))
        with session.together():
            left.grab("peg")
            left.move_by((0.0, 0.0, 0.05), duration=1.0)
            right.grab("cube")
            right.move_by((0.0, 0.0, 0.05), duration=0.6)
            right.move_by((0.02, 0.0, 0.0), duration=0.6)
        assert session.time == pytest.approx(1.2, abs=0.25)
        session.expect_at("peg", (0.06, 0.0, 0.10), within=1e-6)
        session.expect_at("cube", (0.10, 0.06, 0.07), within=1e-6)
        with pytest.raises(TaskError, match="already held by left"):
            session.hand("third", at=(0.06, 0.0, 0.12)).grab("peg")


def test_mistakes_are_one_line_that_says_what_to_do() -> None:
    with Session(scene()) as session:
        hand = session.hand()
        with pytest.raises(UnknownPartError, match="did you mean 'peg'"):
            hand.grab("pegg")
        with pytest.raises(TaskError, match="block is fixed"):
            hand.grab("block")
        with pytest.raises(TaskError, match="holds nothing"):
            hand.release()
        with pytest.raises(TaskError, match="needs a distance or until"):
            hand.slide("up")
        with pytest.raises(TaskError, match="the hand is empty"):
            hand.insert("block")
        hand.grab("peg")
        with pytest.raises(TaskError, match="already holds peg"):
            hand.grab("cube")
        with pytest.raises(TaskError, match="no axis to go by"):
            hand.pull(along="axis")
        with pytest.raises(TaskError, match="give 'axis'"):
            hand.slide("sideways", distance=0.1)
        with pytest.raises(TaskError, match="'maybe' is no condition"):
            hand.slide("up", until="maybe")
        with pytest.raises(TaskError, match="expected peg has 2 degrees"):
            session.expect_freedom("peg", 2)
        with pytest.raises(TaskError, match="three finite numbers"):
            hand.move_to((0.0, np.nan, 0.0))
    with pytest.raises(VpframeError, match="closed"):
        session.step()
    with pytest.raises(VpframeError, match="dt"):
        Session(scene(), dt=0.0)
    with pytest.raises(VpframeError, match="no parts"):
        Session(Scene())
    with pytest.raises(VpframeError, match="meshcat"):
        Session(scene(), viewer="window")


def test_an_observer_that_fails_is_ended_and_the_session_goes_on() -> None:
    bad, good = Watcher(fail_at=3), Watcher()
    with Session(scene(), observers=[bad, good]) as session:
        session.run(0.2)
    assert len(bad.frames) == 2
    assert bad.ended == 1
    assert len(good.frames) >= 12
    assert any("Watcher stopped watching" in e.text for e in session.events)


def test_what_happens_after_the_last_step_is_told_too() -> None:
    watcher = Watcher()
    with Session(scene(), observers=[watcher]) as session:
        session.step()
        session.note("the end")
    assert [e.text for e in watcher.frames[-1].events] == ["the end"]


def test_a_run_until_a_condition_ends_with_it_or_at_its_limit() -> None:
    with Session(scene()) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        taken = session.step_count
        assert session.run_until(~freedom(0, "peg"))
        assert session.step_count == taken
        assert not session.run_until(constraint("concentric", part="peg"), limit=0.1)
        assert session.step_count == taken + 6


def test_an_interrupt_ends_the_run_between_two_steps() -> None:
    watcher = Watcher()
    session = Session(scene(), observers=[watcher])
    session.run(0.1)
    session.interrupt()
    with pytest.raises(KeyboardInterrupt):
        session.run(0.1)
    session.close()
    assert len(watcher.frames) == 6
    assert watcher.ended == 1


def test_an_assembly_as_it_stands_is_recognised_before_anything_moves() -> None:
    assembled = scene()
    assembled["peg"].pose = at(*SEAT)
    with Session(assembled) as session:
        session.step()
        kinds = sorted((c.kind, *c.parts) for c in session.constraints)
        assert kinds == [("against", "block", "peg"), ("concentric", "block", "peg")]
        session.expect_freedom("peg", 1)
        session.expect_no_clash()


def test_authorised_pairs_neither_clash_nor_block() -> None:
    tight = scene()
    tight["cube"].pose = at(0.01, 0.01, 0.01)  # inside the block
    with Session(tight, rule=rules.leave_all) as session:
        session.step()
        with pytest.raises(TaskError, match="no clash"):
            session.expect_no_clash()
    with Session(tight, rule=rules.leave_all) as session:
        session.authorise("cube", "block")
        session.step()
        session.expect_no_clash()
        session.hand(at=(0.02, 0.02, 0.04)).grab("cube")
        session.hand().move_by((0.0, 0.0, 0.05))
        session.expect_at("cube", (0.01, 0.01, 0.06), within=1e-9)


@pytest.mark.parametrize("stop", [61, 85, 100])
def test_a_run_cut_off_anywhere_resumes_to_the_same_future(tmp_path, stop: int) -> None:
    whole, resumed = Frames(), Frames()
    with Session(scene(), observers=[whole], clearance=True) as session:
        there_and_back(session)
    path = tmp_path / "run.journal"
    kill(Session(scene(), clearance=True, checkpoint=path), there_and_back, after=stop)
    with Session(scene(), observers=[resumed], clearance=True, checkpoint=path, resume=True) as session:
        replayed = len(session._journal.past)
        there_and_back(session)
    assert 0 < replayed <= stop
    assert by_value(resumed.frames) == by_value(whole.frames)


def test_the_swept_volume_of_a_part_is_of_where_it_was(tmp_path) -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = session.hand(at=(0.09, 0.07, 0.05))
        hand.grab("cube")
        hand.move_by((0.0, -0.12, 0.0))
        swept = session.swept("cube", resolution=0.002)
        np.testing.assert_allclose(swept.vertices.min(0), [0.08, -0.06, 0.02], atol=swept.error)
        np.testing.assert_allclose(swept.vertices.max(0), [0.10, 0.08, 0.04], atol=swept.error)
        assert swept.clashes == ()
        session.sweep("cube")
    folder = session.report(tmp_path / "report")
    assert (folder / "index.html").exists()
    assert any(p.suffix == ".stl" for p in folder.iterdir())


@pytest.mark.parametrize("gap", [0.0011, 0.0015, 0.0019])
def test_two_hands_that_push_two_parts_towards_each_other_stop_where_they_meet(gap: float) -> None:
    cube = modelling.shape(modelling.box(0.02, 0.02, 0.02))
    made = Scene([Part("left", cube, at(0.0, 0.0, 0.0)), Part("right", cube, at(0.02 + gap, 0.0, 0.0))])
    with Session(made, rule=rules.leave_all) as session:
        hands = [session.hand(name, at=(x, 0.0, 0.1)) for name, x in (("l", 0.0), ("r", 0.02))]
        for hand, part in zip(hands, ("left", "right"), strict=True):
            hand.speed = 0.0599  # 1 mm a step, less than the gap, and the other as much
            hand.grab(part)
        with pytest.raises(TaskError, match="short of its target"), session.together():
            hands[0].move_by((0.005, 0.0, 0.0))
            hands[1].move_by((-0.005, 0.0, 0.0))
        between = made["right"].pose.translation[0] - made["left"].pose.translation[0] - 0.02
    assert 0.0 <= between < 1e-4


def test_two_sessions_on_one_scene_do_not_lose_each_other() -> None:
    """The earlier one says so while a later one has the parts, and goes on from its own poses once that is closed."""
    scene = Scene([Part("block", modelling.shape(modelling.box(0.01, 0.01, 0.01)), pin.SE3.Identity())])
    first = Session(scene)
    hand = first.hand()
    hand.grab("block")
    hand.move_by((0.1, 0.0, 0.0))
    with Session(scene) as second:
        other = second.hand()
        other.grab("block")
        other.move_by((0.0, 0.1, 0.0))
        assert np.allclose(scene["block"].pose.translation, (0.1, 0.1, 0.0))
        for use in (first.step, first.show, first.mark, lambda: hand.move_by((0.1, 0.0, 0.0))):
            with pytest.raises(VpframeError, match=r"block is in another session, opened later.*close that"):
                use()
    hand.move_by((0.1, 0.0, 0.0))
    assert np.allclose(scene["block"].pose.translation, (0.2, 0.0, 0.0))
    first.close()
    assert len(first.trail("block")) > 1
    assert np.allclose(scene["block"].pose.translation, (0.2, 0.0, 0.0))
