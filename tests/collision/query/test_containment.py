"""Inside and outside against closed forms, on closed, hollow and open meshes."""

import numpy as np
import pytest

from collision import CollisionManager, SurfaceMesh
from collision.query.containment import inside
from collision.query.signed_distance import signed_distances
from collision.solid import is_closed
from tests.collision.brute_force import box, hollow, sphere, turned, without_lid
from tests.collision.shapes import at


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
