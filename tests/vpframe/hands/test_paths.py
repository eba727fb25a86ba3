"""Paths begin and end where they say, keep to their limits, and track files read back what was written."""

import itertools
import json

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vpframe.errors import TaskError
from vpframe.hands import paths


def random_pose(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4)
    return pin.SE3(pin.Quaternion(*(q / np.linalg.norm(q))).toRotationMatrix(), rng.uniform(-1.0, 1.0, 3))


def speeds(path: paths.Path, n: int = 4000) -> tuple[float, float]:
    """Greatest linear and angular speed of a path by finite differences."""
    times = np.linspace(0.0, path.duration, n)
    poses = [path.pose(t) for t in times]
    step = times[1]
    moved = [np.linalg.norm(b.translation - a.translation) / step for a, b in itertools.pairwise(poses)]
    turned = [np.linalg.norm(pin.log3(a.rotation.T @ b.rotation)) / step for a, b in itertools.pairwise(poses)]
    return max(moved), max(turned)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 1.0))
def test_between_moves_the_origin_straight_and_turns_in_proportion(seed: int, s: float) -> None:
    a, b = random_pose(seed), random_pose(seed + 1)
    p = paths.between(a, b, s)
    np.testing.assert_allclose(p.translation, (1 - s) * a.translation + s * b.translation, atol=1e-14)
    whole = np.linalg.norm(pin.log3(a.rotation.T @ b.rotation))
    assert np.linalg.norm(pin.log3(a.rotation.T @ p.rotation)) == pytest.approx(s * whole, abs=1e-6)


@pytest.mark.parametrize("eased", [True, False])
def test_straight_and_turning_begin_and_end_where_they_say(eased: bool) -> None:
    a, b = random_pose(1), random_pose(2)
    straight = paths.Straight(a, b, 2.0, eased)
    assert straight.pose(0.0).isApprox(a, 1e-14)
    assert straight.pose(2.0) == b
    assert straight.pose(9.0) == b
    turning = paths.Turning(a, np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 1.0]), 2 * np.pi, 3.0, 0.002, eased)
    assert turning.pose(0.0).isApprox(a, 1e-14)
    end = turning.pose(3.0)
    np.testing.assert_allclose(end.rotation, a.rotation, atol=1e-12)
    np.testing.assert_allclose(end.translation, a.translation + np.array([0.0, 0.0, 0.002]), atol=1e-12)


def test_turning_keeps_the_distance_to_its_line() -> None:
    a, origin, axis = random_pose(5), np.array([0.3, -0.1, 0.2]), np.array([0.0, 0.6, 0.8])
    path = paths.Turning(a, origin, axis, 1.7, 1.0)
    arms = [np.linalg.norm(np.cross(path.pose(t).translation - origin, axis)) for t in np.linspace(0, 1, 20)]
    np.testing.assert_allclose(arms, arms[0], rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_spline_passes_its_poses_and_uses_its_limits_fully(seed: int) -> None:
    poses = [random_pose(10 * seed + k) for k in range(4)]
    spline = paths.Spline(poses, speed=0.3, turn_speed=1.0)
    moved, turned = speeds(spline)
    assert moved <= 0.3 * 1.01
    assert turned <= 1.0 * 1.01
    assert max(moved / 0.3, turned / 1.0) > 0.97
    times = np.linspace(0.0, spline.duration, 4001)
    track = np.array([spline.pose(t).translation for t in times])
    for p in poses:
        assert np.linalg.norm(track - p.translation, axis=1).min() < 1e-3
    assert spline.pose(0.0).isApprox(poses[0], 1e-9)
    assert spline.pose(spline.duration) == poses[-1]


def test_reversed_runs_backwards() -> None:
    path = paths.Straight(random_pose(1), random_pose(2), 2.0)
    back = paths.Reversed(path)
    assert back.duration == 2.0
    for t in (0.0, 0.3, 1.1, 2.0):
        assert back.pose(t).isApprox(path.pose(2.0 - t), 1e-15)


@pytest.mark.parametrize("suffix", [".csv", ".json"])
def test_a_track_file_gives_the_poses_that_were_written(tmp_path, suffix: str) -> None:
    poses = [random_pose(k) for k in range(5)]
    times = [0.0, 0.5, 0.7, 2.0, 2.5]
    rows = []
    for t, p in zip(times, poses, strict=True):
        q = pin.Quaternion(p.rotation)
        rows.append([t, *p.translation, q.x, q.y, q.z, q.w])
    file = tmp_path / f"track{suffix}"
    if suffix == ".csv":
        lines = ["t,x,y,z,qx,qy,qz,qw", *(",".join(map(repr, map(float, row))) for row in rows)]
        file.write_text("\n".join(lines))
    else:
        file.write_text(
            json.dumps([{"t": r[0], "position": list(r[1:4]), "quaternion": list(map(float, r[4:]))} for r in rows])
        )
    track = paths.read_track(file)
    assert track.duration == 2.5
    for t, p in zip(times, poses, strict=True):
        assert track.pose(t).isApprox(p, 1e-9)
    half = track.pose(0.6)
    np.testing.assert_allclose(half.translation, 0.5 * (poses[1].translation + poses[2].translation), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "t,x,y\n0,0,0\n", "no column z"),
        ("b.csv", "t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,one\n", "row 0"),
        ("c.csv", "t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,0\n1,0,0,0,0,0,0,1\n", "non-zero quaternion"),
        ("d.csv", "t,x,y,z,qx,qy,qz,qw\n1,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1\n", "ascend"),
        ("e.json", "{", "cannot be read"),
        ("f.json", '[{"t": 0}]', "row 0"),
        ("g.json", "[]", "at least two"),
    ],
)
def test_a_bad_track_is_one_line_that_names_the_file(tmp_path, name: str, text: str, words: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(TaskError) as caught:
        paths.read_track(file)
    assert name in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
