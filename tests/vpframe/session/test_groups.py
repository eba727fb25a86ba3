"""What a hand carries is one rigid body: its cost, what it is stopped by, its names, and the same state ever after."""

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from constraints.motion import god_object
from constraints.motion.unknowns import Unknowns
from tests.benchmarks.bench_session import board
from vpframe.errors import TaskError
from vpframe.scene import modelling as m
from vpframe.session import rules


class Counted:
    """Counts what a step asks for."""

    def __init__(self, session: vp.Session, monkeypatch: pytest.MonkeyPatch) -> None:
        self.unknowns: list[int] = []
        self.pairs: list[int] = []
        self.matched = 0
        engine = session.engine
        engine.start()

        class Recorded(god_object.Step):
            def __init__(step, unknowns: Unknowns, *rest: object) -> None:
                self.unknowns.append(unknowns.n)
                super().__init__(unknowns, *rest)  # type: ignore[arg-type]

        monkeypatch.setattr("constraints.motion.motion.Step", Recorded)
        near, matches = engine.collision._near, engine.mates.recogniser.matches

        def counted_near(*args: object) -> object:
            keys = near(*args)  # type: ignore[arg-type]
            self.pairs.append(len(keys))
            return keys

        def counted_matches(*args: object) -> object:
            self.matched += 1
            return matches(*args)  # type: ignore[arg-type]

        monkeypatch.setattr(engine.collision, "_near", counted_near)
        monkeypatch.setattr(engine.mates.recogniser, "matches", counted_matches)


@pytest.mark.parametrize("parts", [2, pytest.param(64, marks=pytest.mark.slow)])
def test_a_board_with_63_components_is_six_unknowns_and_no_pairs(parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with vp.Session(board(parts), rule=rules.accept_all) as session:
        hand = session.hand(at=(0.03, 0.03, 0.02))
        assert hand.grab("board")
        start = {name: part.pose.copy() for name, part in session.scene.items()}
        hand.move_by((0.0, 0.0, 0.05), duration=0.1)
        counted = Counted(session, monkeypatch)
        hand.move_by((0.01, 0.0, 0.02), duration=0.2)
        assert set(counted.unknowns) == {6}
        assert counted.matched == 0 and max(counted.pairs) == 0, "nothing is near but what is carried"
        moved = session.scene["board/plate"].pose * start["board/plate"].inverse()
        assert np.allclose(moved.translation, [0.01, 0.0, 0.07], atol=1e-9)
        for name in session.scene.names[1:]:
            off = session.scene[name].pose.actInv(moved * start[name])
            assert np.abs(pin.log6(off).vector).max() < 1e-12


def test_mates_within_a_group_stay_and_are_there_when_it_is_let_go() -> None:
    with vp.Session(board(4), rule=rules.accept_all) as session:
        hand = session.hand(at=(0.03, 0.03, 0.02))
        session.step()
        before = {(c.parts, c.kind) for c in session.constraints}
        assert len(before) >= 3
        hand.grab("board")
        hand.move_by((0.0, 0.0, 0.05))
        assert {(c.parts, c.kind) for c in session.constraints} == before
        hand.release()
        session.step()
        assert {(c.parts, c.kind) for c in session.constraints} == before
        hand.grab("board/chip_0")
        assert not hand.move_by((0.01, 0.0, 0.0), required=False), "its pins hold it in the board"
        hand.pull((0.0, 0.0, 1.0), 0.02, until=None)
        assert {p for c in session.constraints for p in c.parts} == {"board/plate", "board/chip_1", "board/chip_2"}


def test_what_is_carried_stops_all_that_is_held() -> None:
    """A chip on the board meets a wall: the board, held, is blocked by it; the event names the wall."""
    scene = board(4)
    scene.add(m.scene({"wall": (m.box(0.05, 0.01, 0.1), pin.SE3(np.eye(3), np.array([0.0, 0.2, 0.0])))})["wall"])
    scene["wall"].fixed = True
    with vp.Session(scene, rule=rules.leave_all) as session:
        hand = session.hand(at=(0.03, 0.06, 0.02))
        hand.grab("board")
        assert not hand.move_by((0.0, 0.2, 0.0), required=False)
        assert session.scene["board/plate"].pose.translation[1] == pytest.approx(0.12, abs=1e-4)
        (blocked,) = [e for e in session.events if e.kind == "blocked"]
        assert "wall" in blocked.text


def test_a_step_begins_and_ends_a_group_in_any_order_of_save_and_restore() -> None:
    with vp.Session(board(6), rule=rules.accept_all) as session:
        hand = session.hand(at=(0.03, 0.03, 0.02))
        hand.grab("board")
        hand.move_by((0.0, 0.0, 0.03))
        engine = session.engine
        kept, carried = engine.save(), engine.motion.groups.seats.keys()
        assert len(carried) == 5
        hand.move_by((0.01, 0.0, 0.0))
        there = {name: part.pose.homogeneous.copy() for name, part in session.scene.items()}
        engine.restore(kept)
        assert engine.motion.groups.seats.keys() == carried
        hand.move_by((0.01, 0.0, 0.0))
        assert all((part.pose.homogeneous == there[name]).all() for name, part in session.scene.items())


def test_a_subassembly_is_grabbed_by_its_name_and_the_hand_says_which_parts_that_is() -> None:
    with vp.Session(board(9), rule=rules.leave_all) as session:
        hand = session.hand(at=(0.005, 0.005, 0.02))
        with pytest.raises(TaskError, match="board has 9 parts"):
            hand.grab("board", surface=0)
        with pytest.raises(TaskError, match="once"):
            hand.grab("chip_1", carry="board")
        outcome = hand.grab("board")
        assert hand.held == "board/chip_0" and len(hand.carried) == 8 and hand.load == "board"
        assert outcome.reason.startswith("holds board: board/chip_0, carrying board/plate, board/chip_1")
        assert outcome.reason.endswith("and 2 more")
        (event,) = [e for e in session.events if e.kind == "grabbed"]
        assert event.data["named"] == "board" and len(event.data["carried"]) == 8
        hand.release()
        assert hand.grab("chip_1", carry="plate").reason == "holds chip_1: board/chip_1, carrying board/plate"
