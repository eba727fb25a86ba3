"""Inside and outside against closed forms, on closed, hollow and open meshes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import CollisionManager, SurfaceMesh
from collision.query.containment import inside
from collision.query.signed_distance import signed_distances
from collision.solid import is_closed
from tests.collision.brute_force import box, sphere, turned, with_slivers


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def without_lid() -> SurfaceMesh:
    mesh = box(1.0, 1.0, 1.0)
    keep = mesh.surface_of_triangle != 5
    return SurfaceMesh(mesh.vertices, mesh.triangles[keep], mesh.surface_of_triangle[keep], name="open box")


def hollow(outer: float, inner: float) -> SurfaceMesh:
    a, b = box(outer, outer, outer), box(inner, inner, inner)
    triangles = np.concatenate([a.triangles, b.triangles[:, ::-1] + len(a.vertices)])
    surface = np.concatenate([a.surface_of_triangle, b.surface_of_triangle + 6])
    return SurfaceMesh(np.concatenate([a.vertices, b.vertices]), triangles, surface, name="hollow box")


def test_winding_number_of_box_points() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (400, 3))
    assert inside(box(1, 1, 1, 3), points).tolist() == (np.abs(points) < 0.5).all(axis=1).tolist()


def test_signed_distance_of_a_box_has_a_closed_form() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-1, 1, (500, 3)), rng.choice([-1.0, -0.75, 0.75, 1.0], (50, 3))])
    q = np.abs(points) - np.array([0.5, 0.4, 0.3])
    truth = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(signed_distances(box(1.0, 0.8, 0.6, 2), points), truth, atol=1e-14)


def test_side_agrees_with_the_winding_number_on_a_concave_part() -> None:
    pipe = turned([(0, 0.5), (0, 1.0), (2, 1.0), (2, 0.5), (0, 0.5)], 17)
    assert is_closed(pipe)
    points = np.random.default_rng(2).uniform(-1.2, 2.2, (500, 3))
    assert (signed_distances(pipe, points) < 0).tolist() == inside(pipe, points).tolist()


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_a_part_wholly_inside_is_contained(scale: float) -> None:
    world = CollisionManager()
    outer = world.add(box(scale, scale, scale), at(3.0))
    inner = world.add(sphere(0.3 * scale), at(3.0))
    assert not len(world.colliding_surfaces())
    assert world.contains(outer, inner)
    assert not world.contains(inner, outer)
    world.set_pose(inner, at(3.0 + 0.3 * scale))  # crosses a face
    assert not world.contains(outer, inner)
    world.set_pose(inner, at(3.0 + 0.95 * scale))  # outside, boxes apart or not
    assert not world.contains(outer, inner)


def test_an_open_mesh_contains_what_it_winds_about() -> None:
    world = CollisionManager()
    cup = world.add(without_lid(), at(0))
    ball = world.add(sphere(0.2), at(0))
    assert not is_closed(without_lid())
    assert world.contains(cup, ball)
    assert not world.contains(ball, cup)
    for z in (0.75, -0.75):
        world.set_pose(ball, at(0, 0, z))
        assert not world.contains(cup, ball)
    assert inside(without_lid(), [[0, 0, -0.4], [0, 0, 0.45], [0, 0, 0.5], [0, 0, 0.6], [0.6, 0, 0]]).tolist() == [
        True, True, False, False, False,
    ]  # fmt: skip


def test_a_sheet_contains_nothing() -> None:
    mesh = box(1.0, 1.0, 1.0)
    sheet = SurfaceMesh(mesh.vertices, mesh.triangles[mesh.surface_of_triangle == 5], name="sheet")
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    assert not inside(sheet, points).any()
    beside = np.abs(points[:, :2]).max(axis=1) > 0.5  # nearest to the rim, where the sheet has no back
    assert (signed_distances(sheet, points[beside]) > 0.0).all()
    over = points[~beside]
    np.testing.assert_allclose(signed_distances(sheet, over), over[:, 2] - 0.5, atol=1e-15)


def many(*meshes: tuple[SurfaceMesh, tuple[float, float, float]]) -> SurfaceMesh:
    """One mesh of several, each moved."""
    vertices, triangles, n = [], [], 0
    for mesh, shift in meshes:
        vertices.append(mesh.vertices + np.array(shift))
        triangles.append(mesh.triangles + n)
        n += len(mesh.vertices)
    return SurfaceMesh(np.concatenate(vertices), np.concatenate(triangles), name="many")


PIPE = turned([(0, 0.5), (0, 1.0), (2, 1.0), (2, 0.5), (0, 0.5)], 17)
WINDING = {
    "pipe": PIPE,
    "hollow": hollow(1.0, 0.6),
    "fine sphere": sphere(0.7, 48),
    "boxes in each other": many((box(1, 1, 1, 4), (0, 0, 0)), (box(1, 1, 1, 4), (0.5, 0.3, 0.1))),
    "without a lid": without_lid(),
    "pipe without a wall": SurfaceMesh(PIPE.vertices, PIPE.triangles[PIPE.surface_of_triangle != 1]),
}


@pytest.mark.parametrize("case", WINDING)
def test_clusters_of_triangles_wind_about_a_point_as_their_triangles_do(case: str) -> None:
    mesh = WINDING[case]
    points = np.random.default_rng(4).uniform(-1.3, 2.2, (600, 3))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]][None] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    dots = [(x * y).sum(axis=2) for x, y in ((a, b), (b, c), (c, a))]
    volume = (a * np.cross(b, c)).sum(axis=2)
    angle = 2.0 * np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    number = angle.sum(axis=1) / (4.0 * np.pi)
    assert inside(mesh, points).tolist() == (number > (0.5 if is_closed(mesh) else 0.51)).tolist()


@pytest.mark.parametrize("shift", [(1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 0.5)])
def test_boxes_that_meet_in_an_edge_or_a_corner_are_two(shift: tuple[float, float, float]) -> None:
    """There pseudonormals of both come together, and tell nothing of either."""
    both = many((box(1, 1, 1, 2), (0, 0, 0)), (box(1, 1, 1, 2), shift))
    points = np.random.default_rng(5).uniform(-1.0, 2.0, (2000, 3))
    in_one = [(np.abs(points - s) < 0.5).all(axis=1) for s in ((0, 0, 0), shift)]
    assert ((signed_distances(both, points) < 0.0) == (in_one[0] | in_one[1])).all()


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), off=st.sampled_from([0.0, 1e-16, 1e-13, 1e-9, 1e-6, 1e-5]))
def test_slivers_and_folds_do_not_turn_inside_out(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    mesh, rotation = with_slivers(rng, off)
    assert is_closed(mesh)
    at_random = rng.uniform(-0.8, 0.8, (300, 3))
    near = np.array([0.5, 0.4, 0.3]) * rng.choice([-1.0, 1.0], (300, 3))
    near[np.arange(300), rng.integers(3, size=300)] *= rng.uniform(-1.0, 1.0, 300)  # on an edge
    points = np.concatenate([at_random, near + rng.normal(size=(300, 3)) * 0.05])
    q = np.abs(points) - np.array([0.5, 0.4, 0.3])
    truth = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(signed_distances(mesh, points @ rotation.T), truth, atol=1e-12 + 2.0 * off)


def test_a_cavity_is_outside() -> None:
    world = CollisionManager()
    shell = world.add(hollow(1.0, 0.6), at(0))
    ball = world.add(sphere(0.05), at(0))
    assert not world.contains(shell, ball)
    world.set_pose(ball, at(0.4))  # in the wall
    assert world.contains(shell, ball)


def test_every_shell_must_be_inside() -> None:
    a, b = box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.1)
    vertices = np.concatenate([a.vertices, b.vertices + np.array([0.8, 0, 0])])
    pair = SurfaceMesh(vertices, np.concatenate([a.triangles, b.triangles + len(a.vertices)]), name="two boxes")
    world = CollisionManager()
    outer = world.add(box(1.0, 1.0, 1.0), at(0))
    both = world.add(pair, at(0))
    assert not world.contains(outer, both)
    world.set_pose(both, at(-0.4))
    assert world.contains(outer, both)
