"""Inside and outside against closed forms, on closed, hollow and open meshes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, SurfaceMesh
from collision.containment import inside, is_closed, signed_distances
from tests.collision.reference import box, sphere, turned


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


def test_an_open_mesh_contains_nothing() -> None:
    world = CollisionManager()
    cup = world.add(without_lid(), at(0))
    ball = world.add(sphere(0.2), at(0))
    assert not is_closed(without_lid())
    assert not world.contains(cup, ball)
    assert not inside(without_lid(), [[0.0, 0.0, -0.4]])[0]


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
