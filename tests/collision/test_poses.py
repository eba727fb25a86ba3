"""Poses as callers give them: packed and unpacked, and refused by the same rule as in kernels."""

import numpy as np
import pinocchio as pin
import pytest

from collision import PoseError
from collision.numeric.rigid_transforms import take_poses
from collision.poses import pack, pack_rigid, unpack


def test_a_packed_pose_is_the_same_pose() -> None:
    pose = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.1])), np.array([1.0, 2.0, 3.0]))
    packed = pack(pose, "part")
    assert np.array_equal(packed, pack(pose.homogeneous, "part"))
    assert np.array_equal(packed, pack_rigid(pose))
    assert np.array_equal(unpack(packed).homogeneous, pose.homogeneous)


def test_kernels_accept_the_same_matrices_to_the_bit() -> None:
    """Rotations off by about what is allowed, mirrored ones, and last rows that are not 0 0 0 1."""
    rng = np.random.default_rng(0)
    matrices = np.empty((4000, 4, 4))
    for k in range(len(matrices)):
        pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)).homogeneous
        pose[:3, :3] *= np.sqrt(1.0 + 1e-6 + 1e-15 * rng.normal())
        pose[:3, :3] *= -1.0 if k % 7 == 0 else 1.0
        pose[3, k % 3] = 1e-12 if k % 11 == 0 else 0.0
        matrices[k] = pose
    matrices[5, 0, 3], matrices[6, 1, 1] = np.inf, np.nan
    accepted = 0
    for matrix in matrices:
        bad = take_poses(matrix[None], 1e-6, np.empty((1, 12)))
        try:
            pack(matrix, "part", rigid=1e-6)
        except PoseError:
            assert bad == 0
        else:
            assert bad == -1
            accepted += 1
    assert 500 < accepted < 3500


@pytest.mark.parametrize("given", [np.eye(3), "pose", None, [[1.0, 2.0], [3.0]]])
def test_what_is_no_pose_is_named(given: object) -> None:
    with pytest.raises(PoseError, match=r"lid: a pose is a pinocchio\.SE3 or a 4x4 matrix") as raised:
        pack(given, "lid", 7)
    assert raised.value.object_id == 7
