"""Lists of parts taken out, put back, and exchanged; freedom and messages of what a hand carries."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import at
from tests.vpframe.bolted import FINE, bolted, poses
from vpframe.errors import TaskError, UnknownPartError
from vpframe.hands import constraint
from vpframe.hands import hand as hands
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session


def test_screws_of_a_list_turn_out_by_their_thread_and_in_again() -> None:
    with Session(bolted()) as session:
        for name in ("bolt_1", "bolt_2"):
            session.thread(name, 0.008)
        session.step()
        begun = poses(session)
        hand = session.hand()
        assert hand.unscrew(parts=["bolt_1", "bolt_2"], rate=4.0)
        turned = [pin.log3(pose.rotation)[2] for _, pose in session.trail("bolt_1")]
        assert max(map(abs, turned)) > 1.0
        assert hand.screw(parts=["bolt_1", "bolt_2"])
        for name, pose in begun.items():
            np.testing.assert_allclose(session.scene[name].pose.homogeneous, pose.homogeneous, atol=1e-6)


def test_a_list_that_stops_names_the_part_and_how_many_are_out() -> None:
    with (
        Session(bolted()) as session,
        pytest.raises(TaskError, match=r"remove: cover, 2 of 2, after bolt_1: .*bolt_2"),
    ):
        session.hand().remove(["bolt_1", "cover"], along="up")


@pytest.mark.parametrize("pitch", [None, pytest.param(5e-3, marks=pytest.mark.slow)], ids=["plain", "threaded"])
def test_a_subassembly_of_screws_comes_out_screw_by_screw_and_goes_back(pitch: float | None) -> None:
    """Pulled as one, or turned one by one: however they came out, the subassembly is back where it was."""
    parts = [Part(p.name.replace("lid/bolt", "screws/bolt"), p.shape, p.pose, fixed=p.fixed) for p in bolted().parts]
    with Session(Scene(parts)) as session:
        begun = poses(session)
        hand = session.hand()
        for name in ("screws/bolt_1", "screws/bolt_2") if pitch else ():
            session.thread(name, pitch)
        assert hand.remove(["screws", "cover"] if pitch else ["screws/bolt_1", "screws/bolt_2"])
        if pitch:
            away = [session.scene[f"screws/bolt_{k}"].pose.translation[:2] for k in (1, 2)]
            assert np.linalg.norm(away[0] - away[1] + [0.05, 0.0]) > 1e-3  # no longer beside each other as they were
            assert hand.refit("cover")
        assert hand.refit("screws")
        for name, pose in begun.items():
            assert np.abs(pose.homogeneous - session.scene[name].pose.homogeneous).max() < 1e-6
        assert hand.remove("bolt_2") and hand.refit("screws")  # the other one has not been out
        with pytest.raises(TaskError, match="at its initial pose; remove it first"):
            hand.refit("screws")


def test_a_part_that_a_list_cannot_take_out_stays_in_the_hand_and_the_next_list_says_so() -> None:
    with Session(bolted()) as session:
        hand = session.hand()
        with pytest.raises(TaskError, match=r"hand\.remove: cover, 1 of 1: .*bolt_1.* and .*bolt_2.* hold it; remove"):
            hand.remove("cover", along="up")
        assert hand.held == "lid/cover"
        with pytest.raises(TaskError, match=r"hand\.remove: hand holds lid/cover; release it first"):
            hand.remove("bolt_2")


@pytest.mark.parametrize("way", [(0.0, 0.0, 5e-5), (0.0, 0.0, 4e-3), (0.02, 0.0, 5e-4)])
def test_a_part_is_lifted_off_its_face_by_as_little_as_the_hand_says(way: tuple[float, float, float]) -> None:
    """Less than breaks a mate; resting there it does not fall back, and a motion along the face keeps its mate."""
    cube = Part("cube", m.shape(m.box(0.02, 0.02, 0.02)), at(0.02, 0.04, 0.01))
    with Session(Scene([Part("plate", m.shape(m.box(0.1, 0.1, 0.01)), at(0, 0, 0), fixed=True), cube])) as session:
        hand = session.hand()
        hand.grab("cube")
        assert hand.move_by((0.02, 0.0, 0.0)).reason == "arrived"
        assert [mate.kind for mate in session.constraints_of("cube")] == ["against"]
        assert hand.move_by(way).reason == "arrived"
        session.run(0.2)
        there = np.array([0.04, 0.04, 0.01]) + way
        assert np.abs(session.scene["cube"].pose.translation - there).max() < 1e-9
        assert not session.constraints_of("cube")


@pytest.mark.parametrize("turns", [0.2, 2.0])
def test_a_screw_rises_off_its_seat_by_its_thread_however_little_it_is_turned(turns: float) -> None:
    with Session(bolted()) as session:
        session.thread("bolt_1", 1e-3)
        begun = session.scene["lid/bolt_1"].pose.translation[2]
        hand = session.hand()
        hand.grab("bolt_1")
        for name, sign in (("unscrew", 1.0), ("screw", -1.0)):
            height = session.scene["lid/bolt_1"].pose.translation[2] + sign * turns * 1e-3
            getattr(hand, name)(turns=turns)
            assert session.scene["lid/bolt_1"].pose.translation[2] == pytest.approx(height, abs=2e-6)
        assert session.scene["lid/bolt_1"].pose.translation[2] == pytest.approx(begun, abs=2e-6)
        assert "against" in [mate.kind for mate in session.constraints_of("bolt_1")]


def ledge(shut: bool) -> Scene:
    """A key in a pocket under a ledge: first to the side, then up; `shut`, the side is walled up too."""
    base = m.box(0.1, 0.06, 0.05) - m.box(0.08, 0.04, 0.03).translated(0.01, 0.01, 0.01)
    base = base - m.box(0.04, 0.04, 0.02).translated(0.05, 0.01, 0.035)
    parts = [
        Part("base", m.shape(base), at(0, 0, 0), fixed=True),
        Part("key", m.shape(m.box(0.03, 0.03, 0.02)), at(0.015, 0.015, 0.01)),
    ]
    if shut:
        parts.append(Part("wall", m.shape(m.box(0.005, 0.04, 0.03)), at(0.047, 0.01, 0.01), fixed=True))
    return Scene(parts)


def test_what_does_not_come_out_straight_takes_the_way_that_is_planned_and_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with Session(ledge(shut=False)) as session:
        session.step()
        home = session.scene["key"].pose.copy()
        hand = session.hand()
        with pytest.raises(TaskError, match=r"key stopped after 10\.0 mm: base stands in its way \(face \d+ · plane\)"):
            hand.remove("key", along="up")
        hand.move_to(home)
        hand.release()
        assert hand.remove("key")
        session.expect_free("key")
        assert hand.refit("key")
        session.expect_at("key", home, within=1e-6)
    monkeypatch.setattr(hands, "SEARCH", 1.0)
    with Session(ledge(shut=True)) as session:
        session.step()
        with pytest.raises(TaskError, match=r"remove: key, 1 of 1: .*key stopped after 10.*; no other way out"):
            session.hand().remove("key")


REFUSED = {
    "none": (lambda h: h.remove([]), "the list of parts is empty"),
    "no names": (lambda h: h.remove([3]), "give the name of a part, or a list of names"),
    "twice": (lambda h: h.remove(["bolt_1", "lid"]), "lid is named twice"),
    "fixed": (lambda h: h.remove("base"), "base is fixed"),
    "not moved": (lambda h: h.refit("bolt_1"), "is at its initial pose; remove it first"),
    "no thread": (lambda h: h.unscrew(parts="cover"), "no recognised thread holds cover"),
    "names first": (lambda h: h.unscrew(["bolt_1", "bolt_2"]), "give names as parts="),
    "both": (lambda h: h.unscrew(parts="bolt_1", turns=2), "turns= is of the part in the hand"),
    "with itself": (lambda h: h.exchange("bolt_1", "lid"), "lid is named twice"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_list_that_makes_no_sense_is_refused(case: str) -> None:
    call, words = REFUSED[case]
    with Session(bolted()) as session:
        with pytest.raises(TaskError, match=words):
            call(session.hand())
        with pytest.raises(UnknownPartError, match="bolt_1"):
            session.hand().remove("bolt_9")
        assert session.hand().held is None


# ---- what a hand carries


def nutted() -> Scene:
    """A bolt through a fixed plate's clearance hole, its nut beside it in the plate's plane, on the shank."""
    plate = m.box(0.06, 0.06, 0.01).translated(-0.03, -0.03, -0.01) - m.cylinder(0.00302, 0.01).translated(0, 0, -0.01)
    bolt = m.cylinder(0.003, 0.03).translated(0, 0, -0.005) + m.cylinder(0.006, 0.004).translated(0, 0, 0.025)
    nut = m.cylinder(0.006, 0.004) - m.cylinder(0.00301, 0.004)
    parts = [Part("plate", m.shape(plate, *FINE), at(0, 0, 0), fixed=True)]
    parts += [
        Part("set/bolt", m.shape(bolt, *FINE), at(0, 0, 0)),
        Part("set/nut", m.shape(nut, *FINE), at(0, 0, 0.021)),
    ]
    return Scene(parts)


def test_freedom_is_alone_with_what_is_carried_and_to_each_neighbour() -> None:
    with Session(nutted()) as session:
        session.step()
        assert session.freedom("bolt") == 1  # concentric to plate and nut, against the nut
        assert session.freedom("bolt", carried="nut") == session.freedom("set") == 2
        assert session.joint("set") == "cylindrical"
        assert session.freedom("bolt", to="nut") == 1 and session.freedom("bolt", to="plate") == 2
        assert session.freedom("plate", to="set") == 2 and session.freedom("nut", to="plate") == 6
        session.expect_freedom("bolt", 2, carried=["nut"])
        with pytest.raises(TaskError, match=r"bolt with nut has 3 degrees of freedom to plate .it has 2"):
            session.expect_freedom("bolt", 3, to="plate", carried="nut")
        with pytest.raises(TaskError, match="a part is on both sides"):
            session.freedom("bolt", to="set")


@pytest.mark.parametrize("rule", [rules.accept_all, rules.leave_all], ids=["accept all", "leave all"])
def test_a_pull_ends_when_the_group_is_free_though_it_carries_its_nut(rule) -> None:
    with Session(nutted(), rule=rule) as session:
        hand = session.hand()
        hand.grab("bolt", carry="nut")
        outcome = hand.pull("up", until="free")
        assert outcome and session.scene["set/bolt"].pose.translation[2] < 0.03
        session.expect_free("set")
        session.expect_free("bolt", carried="nut")
        if rule is rules.accept_all:
            with pytest.raises(TaskError, match=r"bolt is free .constrained: "):
                session.expect_free("bolt")
            assert not constraint("concentric")(session, hand)


def test_a_part_is_not_taken_past_the_end_of_a_long_neighbour_that_it_passes_beside() -> None:
    """A rod a metre long hangs 6 mm beside the block's way; it passes the rod by."""
    block = m.shape(m.box(0.02, 0.02, 0.02).translated(-0.01, -0.01, -0.02))
    roof = m.shape(m.box(0.1, 0.1, 0.005).translated(-0.05, -0.05))
    rod = m.shape(m.cylinder(0.002, 1.0).translated(0.0, 0.018, -1.0))
    scene = Scene([Part("block", block, at(0, 0, 0)), Part("roof", roof, at(0, 0, 0)), Part("rod", rod, at(0, 0, 0))])
    with Session(scene) as session:
        assert session.hand().remove("block", along="down")
        heights = [pose.translation[2] for _, pose in session.trail("block")]
        assert min(heights) > -0.1
        assert session.hand().refit("block")
        assert np.linalg.norm(scene["block"].pose.translation) < 1e-6
