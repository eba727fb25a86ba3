"""Bounding boxes of parts, at home and placed."""

import numpy as np
import pinocchio as pin
import pytest

from vpframe.scene import boxes
from vpframe.scene import modelling as m


def test_boxes_hold_what_they_are_of_and_touch_it() -> None:
    turned = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.9])), np.array([0.1, 0.2, 0.3]))
    scene = m.scene({"block": (m.box(0.03, 0.02, 0.01), turned), "pin": m.cylinder(0.005, 0.04)})
    block = scene["block"]
    low, high = boxes.box_of(block.mesh)
    assert low == pytest.approx([0, 0, 0]) and high == pytest.approx([0.03, 0.02, 0.01])
    assert boxes.middle(block.mesh) == pytest.approx([0.015, 0.01, 0.005])
    assert boxes.half_size(block.mesh) == pytest.approx(np.sqrt(14.0) / 2 * 0.01)
    placed = boxes.placed_corners(block, block.pose)  # of a box, the corners are its vertices
    low, high = boxes.bounds(scene)
    assert high == pytest.approx(placed.max(axis=0))
    assert low == pytest.approx([-0.005, -0.005, 0.0], abs=1e-5)
    assert boxes.above(scene)[:2] == pytest.approx((low + high)[:2] / 2) and boxes.above(scene)[2] > high[2]
