"""Parts that came to rest by themselves are offered the mates that they lie in, as parts that a hand brought are."""

import numpy as np
import pinocchio as pin
import pytest

from physics import Behaviour, Elastic, Friction, Gravity, SpringHand, WorldError
from tests.vpframe.bench_scene import at
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session.rules import leave_all
from vpframe.session.session import Session


def over_a_floor(count: int, apart: float = 0.05) -> Scene:
    """A floor and boxes above it, in rows of four."""
    floor = modelling.shape(modelling.box(1.0, 1.0, 0.05).translated(-0.2, -0.2, -0.05), name="floor")
    box = modelling.shape(modelling.box(0.03, 0.03, 0.02), name="box")
    boxes = [Part(f"box_{k}", box, at(apart * (k % 4), apart * (k // 4), 0.004)) for k in range(count)]
    return Scene([Part("floor", floor, at(0.0, 0.0, 0.0), fixed=True), *boxes])


def fallen(session: Session, seconds: float = 1.0) -> None:
    for name in session.scene.names[1:]:
        session.behave(name, Gravity(), Friction(0.5), Elastic(0.0))
    session.run(seconds)


def test_a_fallen_box_is_offered_the_floor_and_no_rule_takes_it() -> None:
    with Session(over_a_floor(1)) as session:
        fallen(session)
        kinds = [e.kind for e in session.events]
        assert kinds.index("landed") < kinds.index("recognised")
        assert "accepted" not in kinds, "nobody brought it there"
        (offer,) = session.candidates
        assert (offer.kind, set(offer.parts)) == ("against", {"floor", "box_0"})
        assert set(session.touching("box_0")) == {"floor"}
        resting = session.scene["box_0"].pose
        session.accept(offer)
        session.run(0.5)
        assert [c.id for c in session.constraints] == [offer.id]
        assert session.freedom("box_0") == 3
        assert np.linalg.norm(pin.log6(resting.actInv(session.scene["box_0"].pose)).vector) < 1e-6


def test_the_offer_is_withdrawn_when_the_part_is_taken_away() -> None:
    with Session(over_a_floor(1)) as session:
        fallen(session)
        (offer,) = session.candidates
        hand = session.hand()
        hand.grab("box_0")
        hand.move_by((0.0, 0.0, 0.1))
        assert offer.id not in [c.id for c in session.candidates]
        assert "withdrawn" in [e.kind for e in session.events]


@pytest.mark.parametrize("count", [12])
def test_many_that_land_make_one_offer_each(count: int) -> None:
    with Session(over_a_floor(count)) as session:
        fallen(session)
        recognised = [e.parts for e in session.events if e.kind == "recognised"]
        assert len(recognised) == len(set(recognised)) == count, "one a box, and none flickers"
        assert len(session.candidates) == count


@pytest.mark.parametrize(("bears", "holds"), [(500.0, True), (5.0, False)])
def test_a_constraint_that_bears_so_much_is_broken_by_a_spring_that_pulls_harder(bears: float, holds: bool) -> None:
    with Session(over_a_floor(1), rule=leave_all) as session:
        fallen(session)
        session.accept(session.candidates[0], break_distance=1.0, break_force=bears)
        hand = session.hand()
        hand.spring = SpringHand(pin.SE3.Identity(), stiffness=2000.0, force=100.0)
        hand.grab("box_0")
        hand.move_by((0.0, 0.0, 0.025), required=False)  # a light box feels no more than m/h²: 13 N
        session.run(0.3)
        assert bool(session.constraints) == holds
        removed = [e.text for e in session.events if e.kind == "removed"]
        assert removed == [] if holds else "more than 5 N" in removed[0]
        assert session.scene["box_0"].pose.translation[2] < 1e-3 if holds else session.touching("box_0") == {}


class Pushed(Behaviour):
    def wrench(self, view: object) -> list[float]:
        return [0.0, 0.0, 1e20, 0.0, 0.0, 0.0]


def test_a_wrench_beyond_all_measure_names_part_value_and_mend_and_changes_nothing() -> None:
    with Session(over_a_floor(2)) as session:
        session.behave("box_0", Pushed())
        session.behave("box_1", Gravity())
        before = [part.pose.homogeneous.tobytes() for part in session.scene.parts]
        with pytest.raises(
            WorldError, match=r"^box_0: its motion cannot be followed .*1e\+20 N.*; give less force"
        ) as told:
            session.step()
        assert "\n" not in str(told.value)
        assert session.step_count == 0
        assert [part.pose.homogeneous.tobytes() for part in session.scene.parts] == before
