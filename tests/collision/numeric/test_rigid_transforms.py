"""Rigid transforms of many objects against those of each."""

import numpy as np

from tests.collision.crowds import anywhere


def test_relative_poses_of_many_are_those_of_each() -> None:
    from collision.numeric.rigid_transforms import relative_poses

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Term by term: a library's product may round otherwise."""
        ra, rb = a[:9].reshape(3, 3), b[:9].reshape(3, 3)
        shift = b[9:] - a[9:]
        rotation = ra[0][:, None] * rb[0] + ra[1][:, None] * rb[1] + ra[2][:, None] * rb[2]
        return np.concatenate([rotation.ravel(), ra[0] * shift[0] + ra[1] * shift[1] + ra[2] * shift[2]])

    rng = np.random.default_rng(9)
    poses = np.array([anywhere(rng, 2.0).homogeneous for _ in range(60)])
    packed = np.concatenate([poses[:, :3, :3].reshape(60, 9), poses[:, :3, 3]], axis=1)
    pairs = np.stack([np.arange(30), np.arange(30, 60)], axis=1).astype(np.int32)
    out = np.empty((30, 12))
    relative_poses(packed, pairs, out)
    assert np.array_equal(out, [between(packed[i], packed[j]) for i, j in pairs.tolist()])
    expected = [np.linalg.inv(poses[i]) @ poses[j] for i, j in pairs.tolist()]
    assert np.allclose(out[:, 9:], [e[:3, 3] for e in expected], atol=1e-13)
