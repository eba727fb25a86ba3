"""One Ctrl-C ends the run between two steps, or a step that does not end."""

import os
import signal
import threading

import pytest

from physics import Behaviour
from tests.vpframe.bench_scene import scene
from vpframe.session.interrupts import between_steps
from vpframe.session.session import Session


class Endless(Behaviour):
    """Never returns."""

    def wrench(self, view: object) -> None:
        while True:
            pass


def test_one_ctrl_c_ends_a_step_that_does_not_end_and_changes_nothing() -> None:
    with Session(scene()) as session:
        session.run(0.05)
        session.behave("cube", Endless())
        sent = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
        sent.start()
        before = signal.getsignal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), between_steps(session):
            session.step()
        assert signal.getsignal(signal.SIGINT) is before
        assert session.step_count == 3
