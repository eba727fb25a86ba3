"""A run with bodies that fall and are let go resumes, in another process as in this one, to the same future."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from physics import Elastic, Friction, Gravity
from tests.vpframe.killed_runs import by_value, kill
from tests.vpframe.session.test_there_and_back import tight_fit
from vpframe.events import Frames
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session


def scene() -> Scene:
    def at(x: float, z: float) -> pin.SE3:
        return pin.SE3(np.eye(3), np.array([x, 0.0, z]))

    made = modelling.scene(
        {
            "floor": (modelling.box(1.0, 1.0, 0.1).translated(-0.5, -0.5, -0.1), at(0.0, 0.0)),
            "ball": (modelling.sphere(0.03), at(-0.2, 0.25)),
            "box": (modelling.box(0.06, 0.05, 0.04), at(0.1, 0.0)),
        },
        deflection=1e-3,
    )
    made["floor"].fixed = True
    return made


def task(session: Session) -> None:
    """A ball bounces while a hand lifts a box, lets it go, and it lands."""
    session.behave("ball", Gravity(), Elastic(0.6), Friction(0.3))
    session.behave("box", Gravity(), Friction(0.5))
    hand = session.hand(at=(0.13, 0.025, 0.1))
    hand.grab("box")
    hand.move_by((0.0, 0.0, 0.08))
    hand.release()
    session.run(1.0)


@pytest.fixture(scope="module")
def whole() -> list[tuple]:
    """The run that nothing cut short."""
    watcher = Frames()
    with Session(scene(), observers=[watcher]) as session:
        task(session)
    assert {"grabbed", "released", "landed"} <= {e.kind for f in watcher.frames for e in f.events}
    return by_value(watcher.frames)


@pytest.mark.parametrize("share", [0.7, 0.95])
def test_a_run_with_physics_resumes_to_the_same_future(tmp_path: Path, whole: list[tuple], share: float) -> None:
    path = tmp_path / "run.journal"
    kill(Session(scene(), checkpoint=path), task, after=round(share * len(whole)))
    watcher = Frames()
    with Session(scene(), observers=[watcher], checkpoint=path, resume=True) as session:
        assert session._journal is not None
        assert session._journal.replaying
        task(session)
        assert not session._journal.replaying
    assert by_value(watcher.frames) == whole


def test_what_a_checkpoint_holds_names_no_object_of_its_process() -> None:
    """The state goes through bytes to another session, whose objects live elsewhere in memory."""
    first, second = Session(scene()), Session(scene())
    for session in (first, second):
        session.behave("ball", Gravity(), Elastic(0.6))
        session.run(0.1)
    second.run(0.3)
    second.state.restore(first.state.save())
    for _ in range(60):
        first.step()
        second.step()
        assert first.state.save() == second.state.save()
    assert first.scene["ball"].pose.translation[2] == second.scene["ball"].pose.translation[2]


def test_how_deep_parts_were_drawn_into_each_other_is_saved() -> None:
    """A dovetail drawn askew slides out also in a session that began with it elsewhere."""
    housing, key = (modelling.shape(solid) for solid in tight_fit("dovetail", -2e-5))

    def drawn(x: float) -> Session:
        pose = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.05])), np.array([x, 0.0, 0.0]))
        made = Scene([Part("housing", housing, pin.SE3.Identity()), Part("key", key, pose)])
        made["housing"].fixed = True
        return Session(made, rule=rules.leave_all)

    first, second = drawn(0.0), drawn(0.2)
    second.step()
    first.hand().grab("key")
    second.state.restore(first.state.save())
    for session in (first, second):
        session.hand().slide("z", 0.03, speed=0.3)
    assert first.scene["key"].pose.translation[2] == pytest.approx(0.03, abs=1e-6)
    assert first.state.save() == second.state.save()
