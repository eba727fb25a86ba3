"""Penetration depths of clashes."""

import numpy as np
import pytest

from tests.vpframe.report.runs import log_of
from tests.vpframe.watching import box, place
from vpframe.analysis.clash_status import ClashKey
from vpframe.events import Frame
from vpframe.scene.scene import Part, Scene


def test_depth_is_the_greatest_of_the_steps_kept():
    scene = Scene([Part("a", box((1, 1, 1)), place()), Part("b", box((0.5, 0.5, 0.5)), place(z=0.75))])
    rows = np.array([[0, 5, 1, 0]], np.int32)
    frames = []
    for step in range(101):
        poses = {"a": place(), "b": place(z=0.75 - 0.1 * np.sin(np.pi * step / 100))}
        frames.append(Frame(step, step / 60, poses, rows, (), {}, {}, None, {}))
    from vpframe.report.depth import depths

    log = log_of(frames, scene)
    clash = log.clashes[ClashKey("a", "b", 5, 0)]
    assert clash.steps == 101
    assert len(clash.samples) <= 8
    assert clash.samples[0] is frames[0]
    assert depths(log)[clash.key].depth == pytest.approx(0.1, rel=0.03)


def test_the_depth_of_parts_that_stand_still_is_measured_once(monkeypatch):
    from collision import CollisionManager
    from vpframe.report.depth import depths

    scene = Scene([Part("a", box((1, 1, 1)), place()), Part("b", box((0.5, 0.5, 0.5)), place(z=0.7))])
    rows = np.array([[0, 5, 1, 0], [0, 5, 1, 1]], np.int32)
    heights = [0.7, 0.7, 0.7, 0.72, 0.72, 0.7]
    frames = []
    for step, height in enumerate(heights):
        poses = {"a": scene["a"].pose, "b": place(z=height)}
        frames.append(Frame(step, step / 60, poses, rows[: 1 + (step > 1)], (), {}, {}, None, {}))
    asked = []
    penetrations = CollisionManager.penetrations
    monkeypatch.setattr(
        CollisionManager,
        "penetrations",
        lambda self, *given, **more: asked.append(self.pose(1)) or penetrations(self, *given, **more),
    )
    found = depths(log_of(frames, scene))
    assert [pose.translation[2] for pose in asked] == [0.7, 0.72, 0.7]
    late = ClashKey("a", "b", 5, 1)
    assert found[late].depth == pytest.approx(0.05) and found[late].time == frames[2].time
