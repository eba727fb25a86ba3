"""A session is used by one thread at a time: another one is refused in one clear line, and nothing is lost."""

import threading
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.bench_scene import scene
from vpframe.scene import modelling as m


def inside(session: vp.Session, call: Callable[[], object]) -> str:
    """The error of `call` in another thread while a step of the session runs; empty if there is none."""
    errors: list[str] = []

    def other() -> None:
        try:
            call()
        except vp.VpframeError as error:
            errors.append(str(error))

    def meanwhile(candidate: object) -> str:  # the rule is called in the middle of a step
        if not tried:
            tried.append(True)
            thread = threading.Thread(target=other)
            thread.start()
            thread.join()
        return "accept"

    tried: list[bool] = []
    session.rule = meanwhile
    session.step()
    assert tried
    return errors[0] if errors else ""


@pytest.mark.parametrize("what", ["step", "show", "mark", "reset", "behave", "grab"])
def test_a_thread_that_calls_during_a_step_is_refused(what: str) -> None:
    with vp.Session(seated()) as session:
        calls = {
            "behave": lambda: session.behave("peg", mass=1.0),
            "grab": lambda: session.hand().grab("peg"),
        }
        assert "another thread uses this session" in inside(session, calls.get(what, lambda: getattr(session, what)()))
        assert session.step_count == 1
        session.step()
    assert not session.undecided


def seated() -> vp.Scene:
    """Two cubes, one on the other: a mate is recognised when the session begins."""
    shape = m.shape(m.box(0.02, 0.02, 0.02))
    poses = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (0.0, 0.02)]
    return vp.Scene([vp.Part("base", shape, poses[0], fixed=True), vp.Part("peg", shape, poses[1])])


def test_three_threads_that_step_one_session_get_steps_or_one_clear_error() -> None:
    with vp.Session(scene()) as session:
        session.step()
        errors: list[Exception] = []
        done: list[int] = []

        def run() -> None:
            try:
                for _ in range(30):
                    session.step()
                    done.append(1)
            except Exception as error:
                errors.append(error)

        threads = [threading.Thread(target=run) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert session.step_count == 1 + len(done)
        assert all(isinstance(e, vp.VpframeError) and "another thread" in str(e) for e in errors)


def test_threads_may_take_turns() -> None:
    with vp.Session(scene()) as session:
        for _ in range(3):
            thread = threading.Thread(target=session.step)
            thread.start()
            thread.join()
        assert session.step_count == 3
