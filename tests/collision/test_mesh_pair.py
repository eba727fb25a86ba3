"""A prepared pair answers at every pose as `colliding_surfaces` does, of the enabled surfaces."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, colliding_surfaces, intersect_at, prepare_pair
from tests.collision import shapes


def poses(rng: np.random.Generator, n: int, spread: float) -> list[pin.SE3]:
    return [
        pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), spread * rng.normal(size=3))
        for _ in range(n)
    ]


@pytest.mark.parametrize("share", [None, 0.5, 0.0])
def test_every_pose_as_the_single_query(share: float | None) -> None:
    rng = np.random.default_rng(7)
    a, b = shapes.box((1.0, 1.0, 1.0)), shapes.soup(60, 6, 3)
    enabled = None if share is None else rng.random((a.n_surfaces, b.n_surfaces)) < share
    at = poses(rng, 300, 1.0)
    truth = []
    for pose in at:
        pairs = colliding_surfaces(a, b, pose)
        truth.append(bool(len(pairs) if enabled is None else enabled[pairs[:, 0], pairs[:, 1]].any()))
    rows = np.array([[*pose.rotation.ravel(), *pose.translation] for pose in at])
    pair = prepare_pair(a, b, None if enabled is None else enabled.astype(np.uint8))
    assert intersect_at(pair, rows).tolist() == truth
    assert share == 0.0 or 30 < sum(truth) < 270


def test_a_mask_of_another_shape_is_refused() -> None:
    with pytest.raises(CollisionError, match="surfaces"):
        prepare_pair(shapes.box((1.0, 1.0, 1.0)), shapes.soup(60, 6, 3), np.ones((2, 2), np.uint8))
