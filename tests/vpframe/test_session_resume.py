"""A run with bodies that fall and are let go resumes, in another process as in this one, to the same future."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from physics import Elastic, Friction, Gravity
from vpframe import modelling
from vpframe.events import Frame
from vpframe.scene import Scene
from vpframe.session import Session


class Cut(Exception):
    """The run is killed here."""


class Frames:
    """Keeps frames; kills the run after so many."""

    def __init__(self, stop: int | None = None) -> None:
        self.frames: list[Frame] = []
        self.stop = stop

    def begin(self, session: Session) -> None:
        pass

    def frame(self, frame: Frame) -> None:
        self.frames.append(frame)

    def end(self) -> None:
        pass


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


def seen(frames: list[Frame]) -> list[tuple]:
    """All of each frame that is not a timing, by value."""
    return [
        (
            f.step,
            [(name, pose.homogeneous.tobytes()) for name, pose in sorted(f.poses.items())],
            f.colliding.tobytes(),
            [(c.id, c.kind, c.state, c.parts) for c in f.constraints],
            [(e.kind, e.text) for e in f.events],
        )
        for f in frames
    ]


@pytest.fixture(scope="module")
def whole() -> list[tuple]:
    """The run that nothing cut short."""
    watcher = Frames()
    with Session(scene(), observers=[watcher]) as session:
        task(session)
    assert {"grabbed", "released", "landed"} <= {e.kind for f in watcher.frames for e in f.events}
    return seen(watcher.frames)


def killed(path: Path, stop: int) -> None:
    """A run with a checkpoint that ends without warning."""
    session = Session(scene(), checkpoint=path)
    step = session.step

    def until_cut() -> Frame:
        if session.step_count == stop:
            raise Cut
        return step()

    session.step = until_cut  # type: ignore[method-assign]
    with pytest.raises(Cut):
        task(session)
    assert session._journal is not None
    session._journal.close()


@pytest.mark.parametrize("share", [0.7, 0.95])
def test_a_run_with_physics_resumes_to_the_same_future(tmp_path: Path, whole: list[tuple], share: float) -> None:
    path = tmp_path / "run.journal"
    killed(path, round(share * len(whole)))
    watcher = Frames()
    with Session(scene(), observers=[watcher], checkpoint=path, resume=True) as session:
        assert session._journal is not None
        assert session._journal.replaying
        task(session)
        assert not session._journal.replaying
    assert seen(watcher.frames) == whole


def test_what_a_checkpoint_holds_names_no_object_of_its_process() -> None:
    """The state goes through pickle to another session, whose objects live elsewhere in memory."""
    first, second = Session(scene()), Session(scene())
    for session in (first, second):
        session.behave("ball", Gravity(), Elastic(0.6))
        session.run(0.1)
    second.run(0.3)
    second.engine.restore(pickle.loads(pickle.dumps(first.engine.state())))
    for _ in range(60):
        results = [session.engine.advance([], []) for session in (first, second)]
        one, other = ({n: p.homogeneous.tobytes() for n, p in r.poses.items()} for r in results)
        assert one == other
    assert first.engine.poses[1].translation[2] == second.engine.poses[1].translation[2]
