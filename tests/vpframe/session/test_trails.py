"""A long run needs no more memory than a short one, and loses nothing of what is asked of it afterwards."""

import gc
import tempfile
import tracemalloc
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vpframe.bench_scene import scene
from vpframe.errors import OutputError
from vpframe.hands.paths import Straight
from vpframe.hands.segment import MotionSegment
from vpframe.session import rules, series, trails
from vpframe.session.session import Session
from vpframe.session.trails import Trails, bends


def allocated() -> int:
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@pytest.mark.slow
def test_memory_is_flat_over_the_steps_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two parts move at every step; the bounded stores are made small, so that they are full before it is measured."""
    monkeypatch.setattr(trails, "ROWS", 256)
    monkeypatch.setattr(series, "LIMIT", 64)
    with Session(scene(), rule=rules.leave_all, clearance=True) as session:
        session.log.history.limit = 32
        hand = session.hand(at=(0.09, 0.07, 0.05))
        hand.grab("cube", carry="peg")
        begin = session.scene["cube"].pose
        end = pin.SE3(np.eye(3), begin.translation + np.array([0.0, 0.0, 1.0]))
        hand.start(MotionSegment("on and on", Straight(begin, end, 2000 * session.dt)))
        tracemalloc.start()
        try:
            while session.step_count < 256:
                session.step()
            before, began = allocated(), session.step_count
            while session.step_count < began + 1024:
                session.step()
            grown = allocated() - before
        finally:
            tracemalloc.stop()
        assert grown < 1024 * 2 * 16, "16 bytes for each step of each part"
        trail = session.trail("peg")
        assert [step for step, _ in trail] == list(range(trail[0][0], session.step_count + 1))[: len(trail)]
        assert len(trail) > 1200
        heights = [pose.translation[2] for _, pose in trail]
        assert all(b >= a for a, b in pairwise(heights))
        assert trail[-1][1] == session.scene["peg"].pose


def packed(pose: pin.SE3) -> np.ndarray:
    return np.append(pose.rotation.ravel(), pose.translation)[None]


def test_parts_that_move_together_are_kept_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one by one, over the end of a block and back to the step before."""
    monkeypatch.setattr(trails, "ROWS", 100)
    rng, one, many = np.random.default_rng(3), Trails(), Trails()
    for step in range(60):
        poses = [pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(7)]
        many.add(step, range(7), np.concatenate([packed(pose) for pose in poses[::-1]]))
        many.rewind(step - 1)
        many.add(step, range(7), np.concatenate([packed(pose) for pose in poses]))
        for part, pose in enumerate(poses):
            one.add(step, [part], packed(pose))
    for part in range(7):
        expected = [(step, pose.homogeneous.tobytes()) for step, pose in one.of(part)]
        assert [(step, pose.homogeneous.tobytes()) for step, pose in many.of(part)] == expected


def test_trails_keep_every_pose_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trails, "ROWS", 100)
    rng, kept, known = np.random.default_rng(2), Trails(), {0: [], 1: [], 2: []}
    for step in range(350):
        for part in (0, 1, 2)[: 1 + step % 3]:
            pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
            kept.add(step, [part], packed(pose))
            known[part].append((step, pose.homogeneous.tobytes()))
        if step in (10, 200, 349):
            for part, expected in known.items():
                assert [(s, p.homogeneous.tobytes()) for s, p in kept.of(part)] == expected


@given(st.integers(0, 10**6), st.integers(1, 12), st.sampled_from([1e-6, 1e-2, 0.3]))
@settings(max_examples=50, deadline=None)
def test_bends_keep_a_polyline_within_a_distance_of_itself(seed: int, n: int, within: float) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(n, 2, 3)), axis=0)
    straight = np.linspace(points[:-1], points[1:], 4, endpoint=False, axis=1).reshape(-1, 2, 3) if n > 1 else points
    line = np.concatenate([straight, points[-1:]])  # points of straight pieces are no bends
    kept = bends(line, within)
    assert kept == sorted(set(kept)) and all(0 < k < len(line) - 1 for k in kept)
    for a, b in pairwise([0, *kept, len(line) - 1]):
        chord = line[b] - line[a]
        for k in range(a + 1, b):
            s = np.clip(((line[k] - line[a]) * chord).sum(1) / np.maximum((chord * chord).sum(1), 1e-300), 0.0, 1.0)
            assert np.linalg.norm(line[k] - line[a] - s[:, None] * chord, axis=1).max() <= within
    if within == 1e-6 and n > 1:
        assert kept == list(range(4, len(line) - 1, 4))


def test_a_trail_that_could_not_be_kept_is_said_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trails, "ROWS", 10)

    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    kept = Trails()
    for step in range(30):
        kept.add(step, [0], packed(pin.SE3.Identity()))
    with pytest.raises(OutputError, match="cannot be written: No space left on device"):
        kept.of(0)
