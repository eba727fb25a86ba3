"""Pushes deepen nothing."""

import numpy as np
import pinocchio as pin

from tests.vpframe.planning import cases
from tests.vpframe.planning.measured import deepest_beyond
from vpframe.planning import ways
from vpframe.planning.assembly import Assembly, Budget
from vpframe.planning.pushes import Pushes
from vpframe.planning.verdict import Removal
from vpframe.scene.modelling import box
from vpframe.scene.modelling import scene as scene_of

LONG = 600.0


PRESSED = 1e-11


def test_pushes_in_a_turned_frame_deepen_nothing_but_for_rounding():
    cube = box(0.01, 0.01, 0.01), cases.at(0.02, 0.02, 0.01)
    scene, random = scene_of({"plate": box(0.05, 0.05, 0.01), "cube": cube}), np.random.default_rng(0)
    turn = pin.SE3(pin.exp3(np.array([0.4, 1.1, -0.7])), np.zeros(3))
    for part in scene.parts:
        part.pose = turn * part.pose
    pushes = Pushes(Assembly(scene), (1,), (0,), Budget(LONG))
    for _ in range(60):
        start = pushes.nodes[random.integers(len(pushes.nodes))].at
        twist = pin.exp6(random.normal(size=6) * ([2e-3] * 3 + [0.1] * 3))
        around = cases.at(*pushes.center)
        reached, stop = pushes.push(start, start * around * twist * around.inverse())
        pushes.add(0, [reached], stop)
    assert sum(node.normals.size > 0 for node in pushes.nodes) > 20  # it was stopped
    for node in pushes.nodes:
        way = ways.RemovalPath("free", ways.AXES[0], (node.at, node.at))
        assert deepest_beyond(scene, Removal(("cube",), "removable", way), poses=1) <= PRESSED
