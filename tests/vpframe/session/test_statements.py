"""What a script states acts, is seen, taken back and resumed as an accepted candidate is, or is refused in one line."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import nan, pi
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from constraints.kinds import Line, Point
from tests.vpframe.bench_scene import at
from tests.vpframe.killed_runs import by_value, kill
from vpframe.errors import TaskError, UnknownPartError
from vpframe.events import Frames
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.rules import accept_kinds
from vpframe.session.session import Session
from vpframe.session.statements import ContradictionError

APART = 0.10  # m between the pins: wide enough that the wheels never meet


@cache
def _shapes():
    pegs = m.box(0.4, 0.1, 0.01).translated(-0.1, -0.05, -0.02)
    for x in (0.0, APART):
        pegs = pegs + m.cylinder(0.005, 0.03).translated(x, 0.0, -0.011)
    solids = {
        "base": pegs,
        "small": m.cylinder(0.02, 0.01) - m.cylinder(0.00502, 0.01),
        "large": m.cylinder(0.03, 0.01) - m.cylinder(0.00502, 0.01),
        "bar": m.box(0.1, 0.01, 0.01),
        "plate": m.box(0.06, 0.06, 0.01) - m.cylinder(0.004, 0.01).translated(0.015, 0.015, 0.0)
        - m.cylinder(0.004, 0.01).translated(0.045, 0.045, 0.0),
    }  # fmt: skip
    return {name: m.shape(solid, name=name) for name, solid in solids.items()}


def scene() -> Scene:
    shapes = _shapes()
    flipped = pin.SE3(pin.exp3(np.array([pi, 0.0, 0.0])), np.array([APART, 0.0, 0.011]))
    return Scene(
        [
            Part("base", shapes["base"], at(0.0, 0.0, 0.0), fixed=True),
            Part("small", shapes["small"], at(0.0, 0.0, 0.0)),
            Part("large", shapes["large"], flipped),  # upside down: its axis is directed the other way
            Part("bar", shapes["bar"], at(-0.05, 0.1, 0.0)),
            Part("plate", shapes["plate"], at(0.2, 0.2, 0.1)),
        ]
    )


def opened(**options) -> Session:
    return Session(scene(), rule=accept_kinds("concentric"), **options)


def turned(session: Session, part: str, axis: int = 2) -> float:
    """rad about a world axis since the session began."""
    poses = [pose for _, pose in session.trail(part)]
    return float(sum(pin.log3(b.rotation @ a.rotation.T)[axis] for a, b in pairwise(poses)))


def turn(session: Session, part: str, angle: float) -> None:
    hand = session.hand()
    hand.grab(part)
    hand.turn(angle, about="axis")
    hand.release()


def face(part: Part, normal: tuple[float, float, float]) -> int:
    """The plane face of a part whose normal, in the part's frame, is that."""
    return next(s.index for s in part.surfaces if s.geometry.kind == "plane" and np.allclose(s.geometry.normal, normal))


@pytest.mark.parametrize(
    ("kind", "given", "ratio"),
    [
        ("gear", {"teeth": (20, 30)}, -20 / 30),
        ("gear", {"ratio": 1.5}, -20 / 30),
        ("gear", {"teeth": (20, 30), "sense": -1}, 20 / 30),
        ("belt", {"teeth": (17, 43)}, 17 / 43),
    ],
)
def test_a_turned_wheel_turns_the_other_at_the_ratio(kind: str, given: dict, ratio: float) -> None:
    with opened() as session:
        view = session.constrain(kind, "small", "large", **given)
        session.step()
        assert [c.id for c in session.constraints if c.kind == kind] == [view.id]
        told = [(e.kind, e.data["id"]) for e in session.events if e.data.get("constraint") == kind]
        assert told == [("accepted", view.id), ("satisfied", view.id)]
        assert (session.freedom("small"), session.joint("small")) == (2, "cylindrical")
        turn(session, "small", 2.5)
        small, large = turned(session, "small"), turned(session, "large")
        assert abs(small) == pytest.approx(2.5, abs=1e-6)  # a hand is that exact
        assert abs(large - ratio * small) < 1e-9
        session.remove(view)
        turn(session, "small", 0.5)
        assert turned(session, "large") == large
        assert view.id not in [c.id for c in session.constraints]
        assert session.events[-3].kind in ("removed", "grabbed", "released")
        assert [e.kind for e in session.events if e.data.get("constraint") == kind][-1] == "removed"


def test_a_pinion_moves_its_rack_the_way_their_sides_say() -> None:
    with opened() as session:
        bar = session.scene["bar"]
        session.constrain("rack_and_pinion", "small", ("bar", face(bar, (1.0, 0.0, 0.0))), radius=0.02, teeth=40)
        session.constrain("offset", ("base", face(session.scene["base"], (0.0, 0.0, 1.0))),
                          ("bar", face(bar, (0.0, 0.0, -1.0))), at=0.01)  # fmt: skip
        session.constrain("parallel", ("base", face(session.scene["base"], (1.0, 0.0, 0.0))),
                          ("bar", face(bar, (1.0, 0.0, 0.0))))  # fmt: skip
        session.step()
        before = bar.pose.translation.copy()
        turn(session, "small", 1.0)
        angle = turned(session, "small")
        moved = bar.pose.translation - before
        # the bar lies at +y, where the rim goes towards -x as the pinion turns to the left
        assert moved[0] == pytest.approx(-0.02 * angle, abs=1e-9)
        assert abs(moved[2]) < 1e-9


def test_what_no_hand_holds_goes_to_where_the_statement_holds() -> None:
    with opened() as session:
        plate, base = session.scene["plate"], session.scene["base"]
        up, end = face(base, (0.0, 0.0, 1.0)), face(plate, (1.0, 0.0, 0.0))
        view = session.constrain("angle", ("base", up), ("plate", end), at=pi / 3)
        assert view.kind == "angle"
        session.step()
        normal = plate.pose.rotation @ plate.surfaces[end].geometry.normal
        assert np.arccos(normal[2]) == pytest.approx(pi / 3, abs=1e-9)
        assert base.pose == at(0.0, 0.0, 0.0)


def test_a_weld_carries_the_other_part() -> None:
    with opened() as session:
        session.constrain("fixed", "bar", "plate")
        session.step()
        between = session.scene["bar"].pose.actInv(session.scene["plate"].pose)
        hand = session.hand()
        hand.grab("bar")
        hand.move_by((0.0, 0.03, 0.05))
        after = session.scene["bar"].pose.actInv(session.scene["plate"].pose)
        assert np.abs(after.homogeneous - between.homogeneous).max() < 1e-9
        assert session.scene["plate"].pose.translation[2] == pytest.approx(0.15, abs=1e-6)


def test_a_weld_breaks_where_it_is_told_to() -> None:
    with opened() as session:
        session.scene["plate"].fixed = True
        session.constrain("fixed", "bar", "plate", break_distance=0.01)
        hand = session.hand()
        hand.grab("bar")
        hand.move_by((0.0, 0.0, -0.05), required=False)
        removed = [e.text for e in session.events if e.kind == "removed"]
        assert len(removed) == 1
        assert "more than 10 mm" in removed[0]


def test_screw_of_a_given_pitch() -> None:
    with opened() as session:
        bore = next(s.index for s in session.scene["small"].surfaces if s.orientation == "concave")
        pin_of = [s.index for s in session.scene["base"].surfaces if s.geometry.kind == "cylinder"]
        near = min(pin_of, key=lambda i: abs(session.scene["base"].surfaces[i].geometry.origin[0]))
        session.constrain("screw", ("base", near), ("small", bore), pitch=0.002)
        session.step()
        start = session.scene["small"].pose.translation[2]
        hand = session.hand()
        hand.grab("small")
        hand.turn(pi, about="up", required=False)
        risen = session.scene["small"].pose.translation[2] - start
        assert risen == pytest.approx(0.002 * turned(session, "small") / (2.0 * pi), abs=1e-9)
        assert turned(session, "small") > 1.0
        assert session.joint("small") == "screw"


def test_a_contradiction_is_refused_with_its_amount() -> None:
    with opened() as session:
        base, plate = session.scene["base"], session.scene["plate"]
        ends = (("base", face(base, (0.0, 0.0, 1.0))), ("plate", face(plate, (0.0, 0.0, -1.0))))
        first = session.constrain("offset", *ends, at=0.10)
        with pytest.raises(ContradictionError, match="off by") as caught:  # not in force yet, and it counts
            session.constrain("angle", *ends, at=pi / 2)
        assert caught.value.unit == "rad"
        assert caught.value.off == pytest.approx(pi / 2, abs=1e-6)
        session.step()
        top = ("plate", face(plate, (0.0, 0.0, 1.0)))  # the plate is 10 mm thick: 110 mm up, not 113
        with pytest.raises(ContradictionError, match="cannot hold together") as caught:
            session.constrain("offset", ends[0], top, at=0.113, sense=1)
        assert (caught.value.unit, caught.value.parts) == ("m", ("base", "plate"))
        assert caught.value.off == pytest.approx(0.003, abs=1e-6)
        session.step()
        assert [e.kind for e in session.events if "refused" in e.text] == ["refused", "refused"]
        assert [c.id for c in session.constraints if "plate" in c.parts] == [first.id]
        session.remove(first)
        session.constrain("offset", ends[0], top, at=0.113, sense=1)  # what is taken back no longer counts
        session.step()
        assert plate.pose.translation[2] - 0.003 == pytest.approx(0.1 - 0.01, abs=1e-3)


def test_what_is_recognised_gives_way_to_what_is_stated_and_is_not_offered_anew() -> None:
    with opened() as session:
        base, small = session.scene["base"], session.scene["small"]
        ends = ("base", face(base, (0.0, 0.0, 1.0))), ("small", face(small, (0.0, 0.0, -1.0)))
        view = session.constrain("offset", *ends, at=0.0003)  # so near that it could be against
        session.step()
        session.accept(next(c for c in session.candidates if c.kind == "against" and "small" in c.parts))
        turn(session, "small", 1.0)
        against = [e.kind for e in session.events if e.data.get("constraint") == "against" and "small" in e.parts]
        assert against == ["recognised", "accepted", "refused"]
        assert view.id in [c.id for c in session.constraints]
        assert small.pose.translation[2] - (-0.01) == pytest.approx(0.0003, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (lambda s: s.constrain("gaer", "small", "large", teeth=(1, 2)), "did you mean gear"),
        (lambda s: s.constrain("gear", "small", ("large", 99), teeth=(1, 2)), "large has no surface 99"),
        (lambda s: s.constrain("gear", "small", ("large", "rim"), teeth=(1, 2)), "large has no surface 'rim'"),
        (lambda s: s.constrain("gear", "small", ("large", True), teeth=(1, 2)), "no surface True"),
        (lambda s: s.constrain("gear", "small", 3, teeth=(1, 2)), "3 names no part"),
        (lambda s: s.constrain("gear", "small", "small", teeth=(1, 2)), "both ends are small"),
        (lambda s: s.constrain("gear", "small", "bar", teeth=(1, 2)), "bar has no round surface"),
        (lambda s: s.constrain("gear", "small", "plate", teeth=(1, 2)), "plate has several axes"),
        (lambda s: s.constrain("gear", "small", ("bar", 0), teeth=(1, 2)), "feature b is a plane"),
        (lambda s: s.constrain("gear", "small", "large"), "teeth is missing"),
        (lambda s: s.constrain("gear", "small", "large", ratio=0), "ratio is 0"),
        (lambda s: s.constrain("gear", "small", "large", ratio=nan), "ratio is nan"),
        (lambda s: s.constrain("gear", "small", "large", ratio=-2.0), "ratio is -2.0"),
        (lambda s: s.constrain("gear", "small", "large", ratio=pi), "no ratio of whole numbers"),
        (lambda s: s.constrain("gear", "small", "large", ratio="two"), "ratio is 'two'"),
        (lambda s: s.constrain("gear", "small", "large", teeth=(20, 0)), "two whole numbers"),
        (lambda s: s.constrain("gear", "small", "large", teeth=(20, nan)), "two whole numbers"),
        (lambda s: s.constrain("gear", "small", "large", teeth=20), "two whole numbers"),
        (lambda s: s.constrain("gear", "small", "large", teeth=(1, 2), ratio=2), "say the same"),
        (lambda s: s.constrain("gear", "small", "large", teeth=(1, 2), sense=0), "sense is 0"),
        (lambda s: s.constrain("gear", "small", "large", teeth=(1, 2), pitch=2), "it has no 'pitch'"),
        (lambda s: s.constrain("screw", "small", "large", pitch=nan), "not a finite number"),
        (lambda s: s.constrain("screw", "small", "large", pitch=0.0), "pitch is 0"),
        (lambda s: s.constrain("distance", "small", "large", at=0.1), "which surface of small"),
        (lambda s: s.constrain("angle", ("bar", 0), ("plate", 0), at=4.0), "between 0 and"),
        (lambda s: s.constrain("angle", ("bar", 0), ("plate", 0), at="wide"), "angle between bar and plate"),
        (lambda s: s.constrain("fixed", ("bar", 0), "plate"), "name no surfaces"),
        (lambda s: s.constrain("fixed", "bar", "plate", break_distance=-1.0), "break_distance is -1.0"),
    ],
)
def test_bad_words_are_told_in_one_line(words: Callable[[Session], object], told: str) -> None:
    with opened() as session:
        with pytest.raises(TaskError, match=told) as caught:
            words(session)
        assert "\n" not in str(caught.value)
        session.step()
        assert {c.kind for c in session.constraints} == {"concentric"}


def test_an_unknown_part_is_told_with_those_like_it() -> None:
    with opened() as session, pytest.raises(UnknownPartError, match="did you mean 'large'"):
        session.constrain("gear", "small", "lage", teeth=(1, 2))


def test_parts_that_are_both_fixed_and_a_statement_made_twice() -> None:
    with opened() as session:
        session.scene["bar"].fixed = True
        with pytest.raises(TaskError, match="both fixed"):
            session.constrain("fixed", "base", "bar")
        bore = next(s.index for s in session.scene["plate"].surfaces if s.orientation == "concave")
        session.constrain("concentric", "large", ("plate", bore))
        for _ in range(2):  # before it is in force, and after
            with pytest.raises(TaskError, match="have it already"):
                session.constrain("concentric", "large", ("plate", bore))
            session.step()


def test_geometry_that_no_surface_has() -> None:
    with opened() as session:
        line = Line(np.array([0.0, 0.005, 0.005]), np.array([1.0, 0.0, 0.0]))
        session.constrain("distance", ("bar", line), ("plate", Point(np.zeros(3))), at=0.2)
        session.step()
        bar, plate = session.scene["bar"].pose, session.scene["plate"].pose
        apart = np.cross(plate.translation - bar.act(line.origin), bar.rotation[:, 0])
        assert float(np.linalg.norm(apart)) == pytest.approx(0.2, abs=1e-6)


def task(session: Session) -> None:
    """Gears turned a good way, then uncoupled; a contradiction on the way."""
    hand = session.hand()
    hand.grab("small")
    coupling = session.constrain("gear", "small", "large", teeth=(20, 30))
    hand.turn(1.5, about="axis")
    with pytest.raises(ContradictionError):
        session.constrain("distance", ("small", _bore(session, "small")),
                          ("large", _bore(session, "large")), at=0.2)  # fmt: skip
    hand.turn(0.5, about="axis")
    session.remove(coupling)
    hand.turn(0.3, about="axis")


def _bore(session: Session, part: str) -> int:
    return next(s.index for s in session.scene[part].surfaces if s.orientation == "concave")


@pytest.mark.parametrize("share", [0.75, 0.98])
def test_a_run_with_statements_resumes_to_the_same_future(tmp_path: Path, share: float) -> None:
    whole = Frames()
    with opened(observers=[whole]) as session:
        task(session)
    path = tmp_path / "run.journal"
    kill(opened(checkpoint=path), task, after=round(share * len(whole.frames)))
    again = Frames()
    with opened(observers=[again], checkpoint=path, resume=True) as session:
        assert session._journal is not None
        assert session._journal.replaying
        task(session)
        assert not session._journal.replaying
    assert by_value(again.frames) == by_value(whole.frames)
