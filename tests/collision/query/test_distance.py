"""Contacts and clearance against brute force over all pairs of triangles, closed forms, and the exact verdict."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from collision import CollisionError, CollisionManager, SurfaceMesh, colliding_surfaces
from collision.query.distance import clearance_at, contacts_at
from collision.triangle.distance import closest_features
from tests.collision.brute_force import box, random_soup, triangle_distances

Array = NDArray[np.float64]


def surface_distances(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose: pin.SE3) -> Array:
    """(ka, kb) least distance of every pair of surfaces, from all triangle pairs; 0 where the exact verdict says so."""
    a = mesh_a.vertices[mesh_a.triangles]
    b = (mesh_b.vertices @ pose.rotation.T + pose.translation)[mesh_b.triangles]
    d = triangle_distances(a, b)
    out = np.full((mesh_a.n_surfaces, mesh_b.n_surfaces), np.inf)
    for s in range(mesh_a.n_surfaces):
        for t in range(mesh_b.n_surfaces):
            out[s, t] = d[np.ix_(mesh_a.triangles_of(s), mesh_b.triangles_of(t))].min()
    for s, t in colliding_surfaces(mesh_a, mesh_b, pose, method="brute"):
        out[s, t] = 0.0
    return out


@pytest.mark.parametrize("seed", range(12))
def test_contacts_are_those_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_soup(rng, 60, 5), random_soup(rng, 40, 4)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * 1.2)
    truth = surface_distances(a, b, pose)
    for within in (0.0, float(np.median(truth)), np.inf):
        rows = contacts_at(a, b, pose, within)
        pairs = np.stack([rows["surface_a"], rows["surface_b"]], axis=1)
        assert pairs.tolist() == np.argwhere(truth <= within * (1 + 1e-12)).tolist()
        expected = truth[pairs[:, 0], pairs[:, 1]]
        np.testing.assert_allclose(rows["distance"], expected, rtol=1e-12, atol=1e-15)
        gap = np.linalg.norm(rows["point_a"] - rows["point_b"], axis=1)
        np.testing.assert_allclose(gap, rows["distance"], rtol=1e-9, atol=1e-15)
    row = clearance_at(a, b, pose)
    assert len(row) == 1
    np.testing.assert_allclose(row["distance"], truth.min(), rtol=1e-12, atol=1e-15)


def test_witnesses_lie_on_their_triangles() -> None:
    rng = np.random.default_rng(7)
    a, b = random_soup(rng, 80, 6), random_soup(rng, 80, 6)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([0.3, 0.1, 0.0]))
    rows = contacts_at(a, b, pose, np.inf)
    assert len(rows) == 36
    assert (rows["distance"] == 0).any()
    moved = b.vertices @ pose.rotation.T + pose.translation
    for row in rows:
        for point, vertices, mesh, which in (("point_a", a.vertices, a, "a"), ("point_b", moved, b, "b")):
            triangle = row["triangle_" + which]
            assert mesh.surface_of_triangle[triangle] == row["surface_" + which]
            speck = np.repeat(row[point][None], 3, axis=0)[None]
            assert triangle_distances(speck, vertices[mesh.triangles[[triangle]]])[0, 0] < 1e-12


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-6, 0.25])
def test_distance_of_parallel_faces(gap: float) -> None:
    world = CollisionManager()
    i = world.add(box(1.0, 1.0, 1.0), pin.SE3.Identity())
    j = world.add(box(1.0, 1.0, 1.0), pin.SE3(np.eye(3), np.array([0.2, 0.3, 1.0 + gap])))
    row = world.clearance(i, j)
    assert row["distance"][0] == pytest.approx(gap, rel=1e-12, abs=4e-16)
    assert (row["distance"][0] == 0.0) == (len(world.colliding_surfaces()) > 0)
    touching = world.contacts(gap + 1e-12)
    assert (5, 4) in [(row["surface_a"], row["surface_b"]) for row in touching]


def test_zero_if_and_only_if_the_exact_verdict_says_so() -> None:
    rng = np.random.default_rng(3)
    mesh = box(1.0, 1.0, 1.0)
    for _ in range(60):
        turned = pin.exp3(np.array([0.0, 0.0, rng.integers(0, 8) * np.pi / 4]))
        pose = pin.SE3(turned, np.array([*rng.integers(-3, 4, 2) * 0.5, rng.choice([-1.0, 0.0, 0.5, 1.0])]))
        rows = contacts_at(mesh, mesh, pose, 10.0)
        zero = rows[rows["distance"] == 0.0]
        met = np.stack([zero["surface_a"], zero["surface_b"]], axis=1)
        assert met.tolist() == colliding_surfaces(mesh, mesh, pose, method="brute").tolist()


coordinate = st.sampled_from([-1.0, -0.5, 0.0, 1e-9, 0.5, 0.5 + 1e-12, 1.0, 3.0])
corner = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=300, deadline=None)
@given(st.tuples(corner, corner, corner, corner, corner, corner))
def test_features_of_degenerate_and_aligned_triangles(corners: tuple[tuple[float, float, float], ...]) -> None:
    d2, x, y = closest_features(*corners)
    truth = triangle_distances(np.array([corners[:3]]), np.array([corners[3:]]), crossing=False)[0, 0]
    assert np.sqrt(d2) == pytest.approx(truth, rel=1e-9, abs=1e-12)
    assert np.linalg.norm(np.subtract(x, y)) == pytest.approx(np.sqrt(d2), rel=1e-9, abs=1e-15)


def test_world_frame_filters_and_ignored_pairs() -> None:
    world = CollisionManager()
    poses = [pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([5.0, 0, 0])) for _ in range(3)]
    for k, pose in enumerate(poses):
        world.add(box(1.0, 1.0, 1.0), pose * pin.SE3(np.eye(3), np.array([0, 0, 1.01 * k])), movable=k > 0)
    rows = world.contacts(0.02)
    assert {(r["object_a"], r["object_b"]) for r in rows} == {(0, 1), (1, 2)}
    faces = rows[(rows["object_a"] == 0) & (rows["surface_a"] == 5) & (rows["surface_b"] == 4)]
    assert faces["distance"][0] == pytest.approx(0.01)
    normal = poses[0].rotation[:, 2]
    np.testing.assert_allclose(faces["point_b"][0] - faces["point_a"][0], 0.01 * normal, atol=1e-12)
    assert {r["object_b"] for r in world.contacts(0.02, [2])} == {2}
    world.ignore_surfaces(1, [4], 0, [5])
    left = {(int(r["surface_a"]), int(r["surface_b"])) for r in world.contacts(0.011, [0])}
    assert (5, 4) not in left and (5, 0) in left
    world.ignore(1, 2)
    assert {(r["object_a"], r["object_b"]) for r in world.contacts(0.011)} == {(0, 1)}
    assert world.clearance(2, 1)["object_a"][0] == 1
    with pytest.raises(CollisionError, match="within"):
        world.contacts(float("nan"))


def test_clearance_between_two_surfaces() -> None:
    world = CollisionManager()
    i = world.add(box(1.0, 1.0, 1.0), pin.SE3.Identity())
    j = world.add(box(1.0, 1.0, 1.0), pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.5])))
    assert world.clearance(i, j, 4, 5)["distance"][0] == pytest.approx(2.5)
    assert world.clearance(j, i, 5, 4)["distance"][0] == pytest.approx(2.5)
    assert world.clearance(i, j, 5, 4)["distance"][0] == pytest.approx(0.5)
    with pytest.raises(CollisionError, match="surface 9"):
        world.clearance(i, j, 9, 0)
