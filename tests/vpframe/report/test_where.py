"""The place of the least clearance."""

import numpy as np
import pytest

from tests.vpframe.report.runs import log_of
from tests.vpframe.watching import box, place
from vpframe.events import Frame
from vpframe.report.where import least_gap
from vpframe.scene.scene import Part, Scene


def test_the_least_clearance_is_placed_between_the_surfaces_that_were_nearest():
    scene = Scene(
        [Part("floor", box((1, 1, 0.1)), place(z=-0.05)), Part("wall", box((0.1, 1, 1)), place(x=-0.55, z=0.5)),
         Part("cube", box((0.2, 0.2, 0.2)), place())]
    )  # fmt: skip
    frames = []
    for step, (x, z) in enumerate([(0.0, 0.5), (-0.36, 0.5), (0.0, 0.125)]):
        poses = {"floor": scene["floor"].pose, "wall": scene["wall"].pose, "cube": place(x, 0.0, z)}
        clearance = min(x - 0.1 + 0.5, z - 0.1)
        colliding = np.empty((0, 4), np.int32)
        frames.append(Frame(step, step / 60, poses, colliding, (), {"cube": 6}, {}, clearance, {}, ("cube",)))
    gap = least_gap(log_of(frames, scene))
    assert gap is not None
    assert gap.parts == ("floor", "cube")
    assert gap.surfaces[0] == 5  # of the cube, any surface that has the nearest point
    assert np.linalg.norm(gap.points[1] - gap.points[0]) == pytest.approx(0.025)
    assert gap.points[0][2] == pytest.approx(0.0, abs=1e-12)
    assert least_gap(log_of(frames[:2], scene)).parts == ("wall", "cube")
    assert least_gap(log_of([], scene)) is None
