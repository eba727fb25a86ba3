"""The paper's overlap boxes save box tests."""

import numpy as np
import pinocchio as pin

from collision.methods import examine
from tests.collision import shapes


def test_overlap_boxes_save_box_tests() -> None:
    a, b = shapes.wave(24, 4, 1), shapes.wave(20, 3, 2)
    pose = pin.SE3(np.eye(3), np.array([0.8, 0.3, 0.02]))
    with_clip, without = examine(a, b, pose, "oaabb")[1], examine(a, b, pose, "brute")[1]
    assert with_clip.box_tests < without.box_tests / 2
    assert 0 < with_clip.triangle_tests <= without.triangle_tests
