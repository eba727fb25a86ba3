"""The pose of a part that is dragged by a point."""

import numpy as np
import pytest

import vpframe as vp
from vpframe.hands.dragging import along_freedom


@pytest.mark.parametrize(
    ("twists", "to", "expected"),
    [
        (None, (1.0, 2.0, 3.0), (0.9, 2.0, 3.0)),  # a plain shift of the point (0.1, 0, 0)
        ([[0, 0, 1, 0, 0, 0]], (1.0, 2.0, 3.0), (0.0, 0.0, 3.0)),  # prismatic
        ([], (1.0, 2.0, 3.0), (0.0, 0.0, 0.0)),  # rigid
    ],
)
def test_a_dragged_point_goes_as_near_as_its_freedom_allows(twists, to, expected) -> None:
    basis = None if twists is None else np.array(twists, dtype=float).reshape(-1, 6).T
    goal = along_freedom(vp.pose_from([0, 0, 0, 0, 0, 0, 1]), np.array([0.1, 0.0, 0.0]), np.array(to), basis, 0.1)
    assert goal.translation == pytest.approx(expected)
    assert np.allclose(goal.rotation, np.eye(3))


def test_a_dragged_hinge_turns_towards_the_mouse() -> None:
    basis = np.array([[0, 0, 0, 0, 0, 1.0]]).T
    pose = vp.pose_from([0, 0, 0, 0, 0, 0, 1])
    for _ in range(20):  # of a quarter of a radian at most
        pose = along_freedom(pose, np.array([0.1, 0.0, 0.0]), np.array([0.0, 3.0, 1.0]), basis, 0.1)
    assert pose.rotation @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-3)
    assert pose.translation == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
