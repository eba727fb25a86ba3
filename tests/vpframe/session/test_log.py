"""The log of a session."""

import numpy as np
import pinocchio as pin

from tests.vpframe.report.runs import log_of
from tests.vpframe.watching import pressing_frames, pressing_scene


def test_the_log_keeps_little_of_a_long_run():
    log = log_of(pressing_frames(5000))
    assert sum(1 for _ in log.history) <= log.history.limit + 1
    assert len(log.clearance) == 5000
    assert len(log.freedom["rod"]) == 3


def test_pose_values_in_the_log_do_not_follow_the_scene():
    scene = pressing_scene()
    log = log_of([], scene)
    scene["rod"].pose = pin.SE3(np.eye(3), np.ones(3))
    np.testing.assert_array_equal(log.start["rod"].translation, [0, 0, 0.05])
