"""Snapping and locked axes."""

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.bench_scene import SEAT, holding, scene
from vpframe.errors import TaskError
from vpframe.hands import Assist, candidate
from vpframe.session import rules
from vpframe.session.session import Session


def test_snap_accepts_the_best_candidate_within_the_assists_reach() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session)
        assert not hand.assist.snap
        with pytest.raises(TaskError, match="set the reach first"):
            hand.snap()
        hand.assist = Assist(snap=0.003)
        hand.move_to(SEAT + np.array([0.0015, 0.0, 0.0165]))
        assert hand.wait(0.5, until=candidate("concentric"))
        outcome = hand.snap("concentric")
        assert outcome.reason == "snapped: concentric"
        np.testing.assert_allclose(session.scene["peg"].pose.translation[:2], 0.0, atol=1e-9)


def test_locks_hold_axes_and_orientation() -> None:
    with Session(scene(), rule=rules.leave_all) as session:
        hand = holding(session)
        begin = session.scene["peg"].pose.copy()
        hand.assist = Assist(lock="xz", hold_orientation=True)
        goal = pin.SE3(pin.exp3(np.array([0.0, 0.3, 0.0])), begin.translation + np.array([0.02, 0.03, 0.04]))
        assert hand.move_to(goal)
        np.testing.assert_allclose(session.scene["peg"].pose.translation - begin.translation, [0, 0.03, 0], atol=1e-9)
        np.testing.assert_allclose(session.scene["peg"].pose.rotation, begin.rotation, atol=1e-12)
    with pytest.raises(TaskError, match="letters x, y, z"):
        Assist(lock="w")
