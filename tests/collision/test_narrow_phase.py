"""What a manager remembers changes no answer: along motions that glide, shake, jump, press and go back."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import CollisionManager, SurfaceMesh, colliding_surfaces
from examples import digger
from tests.collision import shapes


def glide(ends: list[pin.SE3], steps: int) -> list[pin.SE3]:
    """Along screws from end to end."""
    return [
        start * pin.exp6(k / steps * pin.log6(start.actInv(end))) for start, end in pairwise(ends) for k in range(steps)
    ]


def wrong_answers(a: SurfaceMesh, b: SurfaceMesh, poses: list[pin.SE3], method: str = "bvh") -> int:
    """Answers of a manager along the poses that are not those of `method`, asked of each pose alone."""
    manager = CollisionManager()
    manager.add(a, pin.SE3.Identity()), manager.add(b, pin.SE3.Identity())
    wrong = 0
    for pose in poses:
        manager.set_pose(1, pose)
        wrong += not np.array_equal(manager.colliding_surfaces()[:, 1::2], colliding_surfaces(a, b, pose, method))  # type: ignore[arg-type]
    return wrong


def turned(rng: np.random.Generator, spread: float) -> pin.SE3:
    return pin.SE3(pin.Quaternion(*rng.normal(size=4)).normalized().matrix(), spread * rng.normal(size=3))


@pytest.mark.parametrize("steps", [1, 4])
def test_digger_and_shaft(steps: int) -> None:
    for a, b, poses in (
        (digger.link(), digger.arm(), digger.digger_trajectory(150)),
        (digger.shaft(), digger.housing(), digger.shaft_trajectory(150)),
    ):
        assert wrong_answers(a, b, glide(poses + poses[::-3], steps)) == 0


def test_soups_gliding_shaking_and_jumping() -> None:
    """Surfaces that cut through each other, held to the plain algorithm."""
    rng = np.random.default_rng(7)
    wrong = changes = 0
    for seed in range(4):
        a, b = shapes.soup(120, 9, seed, 0.2), shapes.soup(150, 12, 50 + seed, 0.2)
        pose, before = pin.SE3.Identity(), -1
        poses = []
        for k in range(240):
            size = (1e-12, 1e-5, 1e-3)[k // 15 % 3]
            pose = turned(rng, 0.3) if k % 60 == 59 else pose * pin.exp6(size * rng.normal(size=6))
            poses.append(pose)
            n = len(colliding_surfaces(a, b, pose))
            changes += n != before
            before = n
        wrong += wrong_answers(a, b, poses, "oaabb")
    assert wrong == 0 and changes > 40


def test_touching_and_parting_by_rounding() -> None:
    """A box that slides on a box, lifts by less than float32 can tell and presses in again."""
    a, b = shapes.box(cells=12), shapes.box((0.5, 0.5, 0.5), cells=9)
    gaps = [0.0, 1e-16, 1e-12, 1e-9, 1e-8, 3e-8, 1e-7, 1e-6, 1e-4]
    poses = [
        pin.SE3(np.eye(3), np.array([1e-4 * k, 0.0, 0.75 * (1 + side * gaps[k // 5 % len(gaps)])]))
        for side in (1, -1)
        for k in range(150)
    ]
    assert wrong_answers(a, b, poses, "oaabb") == 0
    answers = {len(colliding_surfaces(a, b, pose)) for pose in poses}
    assert 0 in answers and len(answers) > 1


def test_far_from_the_origin_and_small() -> None:
    rng = np.random.default_rng(8)
    base_a, base_b = shapes.wave(16, 3, 1), shapes.wave(14, 2, 2)
    wrong = 0
    for scale, offset in ((1e-6, 0.0), (1e-6, 1.0), (1.0, 1e4), (1e5, 0.0), (1e-3, 1e3)):
        a = SurfaceMesh(base_a.vertices * scale + offset, base_a.triangles, base_a.surface_of_triangle)
        b = SurfaceMesh(base_b.vertices * scale - offset, base_b.triangles, base_b.surface_of_triangle)
        middle = 0.5 * scale * np.array([1, 1, 0])
        for _ in range(4):
            rotation, place = turned(rng, 0.0).rotation, middle + offset + 0.3 * scale * rng.normal(size=3)
            poses = []
            for _ in range(60):
                rotation = rotation @ pin.exp3(1e-4 * rng.normal(size=3))
                place = place + 3e-4 * scale * rng.normal(size=3)
                poses.append(pin.SE3(rotation, place - rotation @ (middle - offset)))
            wrong += wrong_answers(a, b, poses, "oaabb")
    assert wrong == 0


STEPS = st.tuples(*[st.floats(-1, 1)] * 6, st.sampled_from([0.0, 1e-9, 1e-4, 1e-3, 0.05, 1.0]), st.integers(1, 12))


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 5), st.lists(STEPS, min_size=1, max_size=12))
def test_any_walk(seed: int, walk: list[tuple[float, ...]]) -> None:
    a, b = shapes.wave(12, 3, seed), shapes.soup(90, 7, seed, 0.1)
    pose, poses = pin.SE3(np.eye(3), np.array([0.5, 0.5, 0.1])), []
    for *twist, size, repeats in walk:
        for _ in range(int(repeats)):
            pose = pose * pin.exp6(size * np.array(twist))
            pose.rotation = pin.Quaternion(pose.rotation).normalized().matrix()
            poses.append(pose.copy())
    assert wrong_answers(a, b, poses, "oaabb") == 0
