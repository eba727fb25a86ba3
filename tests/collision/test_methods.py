"""`colliding_surfaces`: every method against integer arithmetic, and against one another."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionError, CollisionManager, MeshError, PoseError, SurfaceMesh, colliding_surfaces
from collision.methods import METHODS, examine
from tests.collision import exact, shapes

OWN = [method for method in METHODS if method != "coal"]


def moved(mesh: SurfaceMesh, pose: pin.SE3) -> np.ndarray:
    """The vertices as they are tested: x·r0 + y·r1 + z·r2 + t, in this order, in float64."""
    r, t = pose.rotation, pose.translation
    x, y, z = mesh.vertices.T
    return np.stack([r[i, 0] * x + r[i, 1] * y + r[i, 2] * z + t[i] for i in range(3)], 1)


def truth(a: SurfaceMesh, b: SurfaceMesh, pose: pin.SE3) -> list[list[int]]:
    corners_a, corners_b = a.vertices[a.triangles], moved(b, pose)[b.triangles]
    low_a, high_a, low_b, high_b = corners_a.min(1), corners_a.max(1), corners_b.min(1), corners_b.max(1)
    found = set()
    for i in range(a.n_triangles):
        for j in np.flatnonzero((low_a[i] <= high_b).all(1) & (low_b <= high_a[i]).all(1)):
            pair = int(a.surface_of_triangle[i]), int(b.surface_of_triangle[j])
            if pair not in found and exact.triangles_meet(np.concatenate([corners_a[i], corners_b[j]])):
                found.add(pair)
    return [list(pair) for pair in sorted(found)]


def random_pose(rng: np.random.Generator, spread: float) -> pin.SE3:
    q = pin.Quaternion(*(rng.normal(size=4))).normalized()
    return pin.SE3(q.matrix(), spread * rng.normal(size=3))


def test_soups_against_integers() -> None:
    rng = np.random.default_rng(1)
    sizes = []
    for seed in range(40):
        a, b = shapes.soup(30, 5, seed), shapes.soup(40, 7, 100 + seed)
        pose = random_pose(rng, 0.4)
        expected = truth(a, b, pose)
        sizes.append(len(expected))
        for method in OWN:
            found = colliding_surfaces(a, b, pose, method)
            assert found.dtype == np.int32 and found.tolist() == expected, method
    assert sizes.count(0) > 3 and sum(sizes) > 50


def test_touching_boxes_against_integers() -> None:
    a, b = shapes.box(cells=2), shapes.box((0.5, 0.5, 0.5), cells=1)
    turn = pin.utils.rotate("z", np.pi / 4)
    for rotation in (np.eye(3), turn):
        for place in ((0.75, 0, 0), (0.75, 0.75, 0), (0.75, 0.75, 0.75), (0.75, 0.25, 0), (0, 0, 0.75), (0, 0, 0)):
            for gap in (0.0, 1e-16, -1e-16, 1e-9):
                pose = pin.SE3(rotation, np.array(place) * (1 + gap))
                expected = truth(a, b, pose)
                for method in OWN:
                    assert colliding_surfaces(a, b, pose, method).tolist() == expected


def test_methods_agree_on_larger_meshes() -> None:
    rng = np.random.default_rng(2)
    a, b = shapes.wave(24, 4, 1), shapes.wave(20, 3, 2)
    hits = 0
    for k in range(60):
        pose = random_pose(rng, 0.3) if k % 2 else pin.SE3(np.eye(3), np.array([0, 0, 0.15]) * rng.normal())
        answers = [colliding_surfaces(a, b, pose, method).tolist() for method in OWN]
        assert all(answer == answers[0] for answer in answers)
        assert answers[0] == sorted(answers[0])
        hits += len(answers[0])
    assert hits > 200


def test_memory_changes_no_answer() -> None:
    rng = np.random.default_rng(3)
    a, b = shapes.wave(24, 4, 1), shapes.wave(20, 3, 2)
    manager = CollisionManager()
    manager.add(a, pin.SE3.Identity()), manager.add(b, pin.SE3.Identity())
    pose = pin.SE3.Identity()
    afresh = 0
    for step in range(120):
        pose = random_pose(rng, 0.3) if step % 30 == 0 else pose * pin.exp6(0.01 * rng.normal(size=6))
        manager.set_pose(1, pose)
        assert np.array_equal(manager.colliding_surfaces()[:, 1::2], colliding_surfaces(a, b, pose, "oaabb"))
        afresh += examine(a, b, pose, "bvh")[1].triangle_box_tests
    assert 0 < manager.statistics.triangle_box_tests < afresh
    with pytest.raises(PoseError, match="not a rigid motion"):
        manager.set_pose(1, np.diag([2.0, 1.0, 1.0, 1.0]))


def test_far_from_the_origin_and_small() -> None:
    rng = np.random.default_rng(4)
    base_a, base_b = shapes.wave(10, 2, 1), shapes.wave(8, 2, 2)
    hits = 0
    for scale, offset in ((1e-6, 0.0), (1e-6, 1.0), (1.0, 1e6), (1e6, 1e6), (1e-3, 1e3)):
        a = SurfaceMesh(base_a.vertices * scale + offset, base_a.triangles, base_a.surface_of_triangle)
        b = SurfaceMesh(base_b.vertices * scale - offset, base_b.triangles, base_b.surface_of_triangle)
        for _ in range(20):
            rotation = random_pose(rng, 0.0).rotation
            middle = 0.5 * scale * np.array([1, 1, 0])
            place = middle + offset + 0.2 * scale * rng.normal(size=3)
            pose = pin.SE3(rotation, place - rotation @ (middle - offset))
            answers = [colliding_surfaces(a, b, pose, method).tolist() for method in OWN]
            assert all(answer == answers[0] for answer in answers)
            hits += len(answers[0])
    assert hits > 200


def test_surfaces_of_many_sizes_and_numbers() -> None:
    """Trees of one level and of four, of a surface and of hundreds."""
    rng = np.random.default_rng(5)
    meshes = [shapes.soup(1, 1, 1, 2.0), shapes.soup(9, 9, 2, 1.0), shapes.soup(700, 300, 3), shapes.wave(50, 1, 4)]
    hits = 0
    for a in meshes:
        for b in meshes:
            for _ in range(3):
                pose = random_pose(rng, 0.4)
                answers = [colliding_surfaces(a, b, pose, method).tolist() for method in ("bvh", "oaabb")]
                assert answers[0] == answers[1]
                hits += len(answers[0])
    assert hits > 1000


def test_coordinates_beyond_float32_are_refused() -> None:
    mesh = SurfaceMesh([[0, 0, 0], [1e31, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="galaxy")
    with pytest.raises(MeshError, match=r"galaxy.*largest allowed"):
        colliding_surfaces(mesh, mesh, pin.SE3.Identity())


def test_swapping_the_meshes_swaps_the_answer() -> None:
    a, b = shapes.soup(60, 6, 3), shapes.soup(60, 6, 4)
    pose = pin.SE3(np.eye(3), np.array([0.25, 0.5, 0.125]))  # exact both ways
    there = {tuple(p) for p in colliding_surfaces(a, b, pose).tolist()}
    back = {(j, i) for i, j in colliding_surfaces(b, a, pose.inverse()).tolist()}
    assert len(there) > 5
    # the two move different meshes, so near misses may differ by rounding; with this pose nothing is that near
    assert there == back


@pytest.mark.parametrize("method", OWN)
def test_bad_poses_are_named(method: str) -> None:
    a = shapes.box(name="cover")
    nan = pin.SE3(np.eye(3), np.array([0, np.nan, 0]))
    with pytest.raises(PoseError, match=r"cover.*finite"):
        colliding_surfaces(a, a, nan, method)  # type: ignore[arg-type]
    scaled = np.diag([1.1, 1.1, 1.1, 1.0])
    with pytest.raises(PoseError, match="not a rigid motion"):
        colliding_surfaces(a, a, scaled, method)  # type: ignore[arg-type]
    with pytest.raises(PoseError, match="not a rigid motion"):
        colliding_surfaces(a, a, np.diag([1.0, 1.0, -1.0, 1.0]), method)  # type: ignore[arg-type]
    with pytest.raises(PoseError, match="4x4"):
        colliding_surfaces(a, a, np.eye(3), method)  # type: ignore[arg-type]


def test_an_unknown_method_is_named() -> None:
    a = shapes.box()
    with pytest.raises(CollisionError, match=r"'fast'.*bvh, oaabb, brute, coal"):
        colliding_surfaces(a, a, pin.SE3.Identity(), "fast")  # type: ignore[arg-type]


FORK = """
import os, signal
import numpy as np
from collision import CollisionManager
from tests.collision.shapes import box
world = CollisionManager()
for k in range(20):
    world.add(box(), np.array([[1, 0, 0, 0.9 * k], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float))
expected = world.colliding_surfaces().tolist()  # of so many pairs that two threads share them
child = os.fork()
for k in range(20):
    world.set_pose(k, world.pose(k))
if child == 0:
    signal.alarm(20)  # hanging, it ends by the signal
    os._exit(0 if world.colliding_surfaces().tolist() == expected else 1)
assert world.colliding_surfaces().tolist() == expected
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_a_forked_child_answers_as_its_parent() -> None:
    done = subprocess.run([sys.executable, "-c", FORK], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.strip() == "0", done.stderr
