"""A run with bodies that fall and are let go resumes, in another process as in this one, to the same future."""

import copy
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from physics import Elastic, Friction, Gravity
from tests.vpframe.killed_runs import by_value, kill
from tests.vpframe.session.fits import tight_fit
from vpframe.events import Frames
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene
from vpframe.session import rules
from vpframe.session.session import Session
from vpframe.session.state import CODEC, Decision, StateError


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
    second.restore(first.save())
    for _ in range(60):
        first.step()
        second.step()
        assert first.save() == second.save()
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
    second.restore(first.save())
    for session in (first, second):
        session.hand().slide("z", 0.03, speed=0.3)
    assert first.scene["key"].pose.translation[2] == pytest.approx(0.03, abs=1e-6)
    assert first.save() == second.save()


# ---- states that no session has


def placed() -> Session:
    session = Session(scene(), gravity=(0.0, 0.0, -9.81))
    for name in ("ball", "box"):
        session.behave(name)
    hand = session.hand(at=(0.13, 0.025, 0.1))
    hand.grab("box")
    hand.move_by((0.0, 0.0, 0.08))
    session.run(0.1)
    return session


def numbers(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Every float and every array of floats of a saved value, with its path."""
    if isinstance(value, float | np.floating) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
        if np.size(value):
            yield path, value
    elif is_dataclass(value):
        for field in fields(value):
            yield from numbers(getattr(value, field.name), (*path, field.name))
    elif isinstance(value, dict | list | tuple):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(item, (*path, key))


def put(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    if is_dataclass(value):
        made = copy.copy(value)
        object.__setattr__(made, path[0], put(getattr(value, path[0]), path[1:], new))
        return made
    if isinstance(value, dict):
        return {key: put(item, path[1:], new) if key == path[0] else item for key, item in value.items()}
    return type(value)(put(item, path[1:], new) if k == path[0] else item for k, item in enumerate(value))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_a_saved_state_with_a_number_that_no_session_has_is_refused(bad: float) -> None:
    with placed() as session:
        good = session.save()
        schema, names, data = CODEC.decode(good)
        tried = 0
        for path, value in numbers(data):
            for at in {0, np.size(value) - 1}:
                wrong: Any = bad
                if isinstance(value, np.ndarray):
                    wrong = value.copy()
                    wrong.flat[at] = bad
                with pytest.raises(StateError, match=r"damaged: .+"):
                    session.restore(CODEC.encode((schema, names, put(data, path, wrong))))
                assert session.save() == good
                tried += 1
        assert tried > 30


@pytest.mark.parametrize(
    ("path", "change"),
    [
        (("dynamics", "world", "velocity"), lambda v: v + 1e9),  # faster than light
        (("dynamics", "world", "mass"), lambda v: 2.0 * v),
        (("dynamics", "world", "center"), lambda v: v + 0.01),  # not where its part is
        (("dynamics", "world", "rotation"), lambda v: 1.1 * v),
        (("dynamics", "world", "attitude"), lambda v: 0.5 * v),
        (("dynamics", "world", "poses"), lambda v: v + 0.01),
        (("dynamics", "world", "time"), lambda v: -v),
        (("dynamics", "world", "quiet"), lambda v: v - 9.0),
        (("dynamics", "world", "kind"), lambda v: v + 9),
        (("values", "step"), lambda v: -v),
        (("values", "threads"), lambda v: {1: 0.0}),
        (("values", "decisions"), lambda v: (Decision("undo", 0),)),
        (("poses",), lambda v: v + 1e13 * (np.arange(12) > 8)),
        (("poses",), lambda v: 1.1 * v),
        (("hands", "hand", "clock"), lambda v: -1.0),
        (("hands", "hand", "motion"), lambda v: ("", None, None)),
    ],
)
def test_a_saved_state_that_contradicts_itself_or_the_session_is_refused(path: tuple, change: Any) -> None:
    with placed() as session:
        good = session.save()
        schema, names, data = CODEC.decode(good)
        value: Any = data
        for key in path:
            value = getattr(value, key) if is_dataclass(value) else value[key]
        with pytest.raises(StateError, match=r"damaged: .+") as refused:
            session.restore(CODEC.encode((schema, names, put(data, path, change(value)))))
        assert "\n" not in str(refused.value)
        assert session.save() == good
        session.run(0.05)
