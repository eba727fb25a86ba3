"""A part's pose is a rigid motion: what is none is refused in one line when it is set, and when the part is made."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vpframe.errors import TaskError, UnknownPartError, VpframeError
from vpframe.scene import modelling as m
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session

SHAPE = m.shape(m.box(0.1, 0.1, 0.1))
I3, HERE = np.eye(3), np.zeros(3)


def sheared() -> np.ndarray:
    out = np.eye(4)
    out[0, 1] = 1e-3
    return out


WRONG: dict[str, tuple[Any, str]] = {
    "NaN": (pin.SE3(I3, np.array([0.0, np.nan, 0.0])), "must be finite"),
    "infinity": (pin.SE3(I3, np.array([0.0, np.inf, 0.0])), "must be finite"),
    "NaN in the rotation": (pin.SE3(I3 * np.nan, HERE), "must be finite"),
    "mirrored": (pin.SE3(np.diag([1.0, 1.0, -1.0]), HERE), "stretched or mirrored"),
    "scaled": (pin.SE3(1e-3 * I3, HERE), "stretched or mirrored"),
    "a matrix of millimetres": (np.diag([1e3, 1e3, 1e3, 1.0]), "stretched or mirrored"),
    "a sheared matrix": (sheared(), "stretched or mirrored"),
    "a matrix with NaN": (np.full((4, 4), np.nan), "must be finite"),
    "a transposed matrix": (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]), "last row"),
    "a rotation alone": (I3, "give a pinocchio.SE3 or a 4x4 matrix"),
    "a position": ((1.0, 2.0, 3.0), "give a pinocchio.SE3 or a 4x4 matrix"),
    "text": ("above", "give a pinocchio.SE3 or a 4x4 matrix"),
    "nothing": (None, "give a pinocchio.SE3 or a 4x4 matrix"),
}


@pytest.mark.parametrize("given", WRONG)
def test_what_is_no_pose_is_refused_and_the_part_stays(given: str) -> None:
    pose, words = WRONG[given]
    part = Part("box", SHAPE, pin.SE3(I3, np.ones(3)))
    with pytest.raises(VpframeError, match=words) as told:
        part.pose = pose
    assert str(told.value).startswith("box: pose ") and "\n" not in str(told.value)
    assert not isinstance(told.value, TaskError)
    assert part.pose == pin.SE3(I3, np.ones(3))
    with pytest.raises(VpframeError, match=words):
        Part("box", SHAPE, pose)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 6).map(np.array))
def test_a_matrix_of_a_rigid_motion_is_taken_as_one(twist: np.ndarray) -> None:
    pose = pin.exp6(pin.Motion(twist))
    part = Part("box", SHAPE, pin.SE3.Identity())
    for value in (pose, pose.homogeneous, pose.homogeneous.tolist()):
        part.pose = value
        assert isinstance(part.pose, pin.SE3) and part.pose == pose


def test_a_pose_that_is_spoiled_in_place_is_refused_when_a_session_begins() -> None:
    scene = Scene([Part("base", SHAPE, pin.SE3(I3, np.ones(3))), Part("box", SHAPE, pin.SE3.Identity())])
    scene["box"].pose.translation[0] = np.nan
    with pytest.raises(VpframeError, match="box: pose must be finite"), Session(scene) as session:
        session.step()


def test_only_a_word_that_shares_letters_is_proposed() -> None:
    known = ["peg", "shaft", "housing", "head/Fan Rotor 30x30", "screw_1"]
    for name, like in (("pegg", "peg"), ("shfat", "shaft"), ("rotor", "Rotor 30x30"), ("SCREW1", "screw_1")):
        assert f"did you mean '{like}" in (text := str(UnknownPartError(name, known))) or like in text
        assert "did you mean" in text
    for name in ("xyz", "valve", "q", "", "7", "bolt"):
        assert "did you mean" not in str(UnknownPartError(name, known))
