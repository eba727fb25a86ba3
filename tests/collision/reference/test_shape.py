"""Shapes that are no meshes: their answers, their copies, and what is refused."""

import copy
import pickle

import coal
import numpy as np
import pytest

from collision import CollisionError, CollisionManager, SurfaceMesh, colliding_surfaces
from collision.query.containment import inside
from collision.reference.shape import mesh_of_shape
from collision.solid import is_closed
from tests.collision.brute_force import box
from tests.collision.shapes import at


def hull() -> coal.Convex:
    points = np.random.default_rng(0).normal(size=(40, 3)) * 0.2
    model = coal.BVHModelOBBRSS()
    model.beginModel(1, len(points))
    model.addVertices(points)
    model.addTriangles(np.array([[0, 1, 2]]))
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex


SHAPES = {
    "sphere": lambda: coal.Sphere(0.3),
    "box": lambda: coal.Box(0.5, 0.6, 0.6),
    "capsule": lambda: coal.Capsule(0.2, 0.2),
    "cylinder": lambda: coal.Cylinder(0.3, 0.6),
    "cone": lambda: coal.Cone(0.3, 0.6),
    "ellipsoid": lambda: coal.Ellipsoid(0.2, 0.3, 0.3),
    "hull": hull,
    "octree": lambda: coal.makeOctree(np.random.default_rng(0).uniform(-0.25, 0.25, (200, 3)), 0.05),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_collide_and_come_near_as_objects_of_one_surface(name: str) -> None:
    world = CollisionManager()
    shape = world.add_shape(SHAPES[name](), at(0.0))
    i = world.add(box(2.0, 2.0, 0.1, 3), at(0.0))
    assert {tuple(row) for row in world.colliding_surfaces().tolist()} >= {(shape, 0, i, 4), (shape, 0, i, 5)}
    world.set_pose(i, at(0.0, 0.0, -2.05))
    assert not len(world.colliding_surfaces())
    row = world.clearance(shape, i)[0]
    half = 2.0 - row["distance"]
    assert 0.2 < half < 0.8
    assert row["point_b"][2] == pytest.approx(-2.0, abs=1e-6)
    assert row["point_a"][2] == pytest.approx(-half, abs=1e-4)
    assert (row["triangle_a"], row["surface_b"]) == (-1, 5)
    near = world.contacts(float(row["distance"]) + 1e-6)
    assert (0, 5) in near[["surface_a", "surface_b"]].tolist()
    assert len(world.contacts(float(row["distance"]) - 1e-3)) == 0


def test_two_shapes_and_a_sphere_of_known_clearance() -> None:
    world = CollisionManager()
    world.add_shape(coal.Sphere(0.3), at(0.0))
    world.add_shape(coal.Sphere(0.2), at(0.7))
    assert world.clearance(0, 1)["distance"][0] == pytest.approx(0.2, abs=1e-9)
    world.set_pose(1, at(0.49))
    assert world.colliding_surfaces().tolist() == [[0, 0, 1, 0]]


def test_a_height_field_is_a_closed_mesh_with_exact_answers() -> None:
    heights = np.array([[0.1, 0.2, 0.3], [0.1, 0.4, 0.1]])
    mesh = mesh_of_shape(coal.HeightFieldOBBRSS(2.0, 4.0, heights, -1.0))
    assert is_closed(mesh) and mesh.n_surfaces == 1
    inner = [[0.0, 1.99, 0.19], [0.0, -1.99, 0.39], [0.99, 1.99, 0.28], [-0.5, 0.0, -0.9]]
    outer = [[0.0, 1.99, 0.21], [0.0, -1.99, 0.41], [0.99, 1.99, 0.31], [0.0, 0.0, -1.1]]
    assert inside(mesh, inner).all() and not inside(mesh, outer).any()
    world = CollisionManager()
    world.add_shape(coal.HeightFieldOBBRSS(2.0, 2.0, np.full((5, 5), 0.1), -1.0), at(0.0), movable=False)
    i = world.add(box(0.2, 0.2, 0.2), at(0.1, 0.1, 0.19))
    assert {row[3] for row in world.colliding_surfaces().tolist()} == {0, 1, 2, 3}
    world.set_pose(i, at(0.1, 0.1, 0.21))
    assert not len(world.colliding_surfaces())
    assert world.clearance(0, i)["distance"][0] == pytest.approx(0.01)
    ball = world.add_shape(coal.Sphere(0.1), at(-0.5, 0.5, 0.15))
    assert [0, 0, ball, 0] in world.colliding_surfaces([ball]).tolist()


def test_what_coal_cannot_bound_or_a_shape_cannot_answer_is_named() -> None:
    world = CollisionManager()
    with pytest.raises(CollisionError, match="no bounds"):
        world.add_shape(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), at(0.0))
    with pytest.raises(CollisionError, match="not a shape"):
        world.add_shape("ball", at(0.0), name="ball")
    i = world.add_shape(coal.Sphere(0.3), at(0.0))
    j = world.add(SurfaceMesh(box(1, 1, 1).vertices, box(1, 1, 1).triangles), at(0.5))
    with pytest.raises(CollisionError, match="bounds no mesh"):
        world.contains(i, j)
    for method in ("bvh", "oaabb", "brute"):
        with pytest.raises(CollisionError, match="no triangles to test"):
            colliding_surfaces(world.mesh(i), world.mesh(j), at(0.5), method=method)
    assert len(colliding_surfaces(world.mesh(i), world.mesh(j), at(0.5), method="coal")) == 1
    with pytest.raises(CollisionError, match="not swept"):
        world.time_of_impact({i: at(1.0)})


@pytest.mark.parametrize("name", SHAPES)
def test_a_copied_or_pickled_shape_stays_what_it_is(name: str) -> None:
    """In a corner of its bounding box a ball is not; were it its box, the two would collide."""
    mesh = mesh_of_shape(SHAPES[name](), name)
    copies = [copy.copy(mesh), copy.deepcopy(mesh)]
    try:
        copies.append(pickle.loads(pickle.dumps(mesh)))
    except CollisionError as error:
        assert name == "octree" and f"{name}: coal cannot pickle" in str(error) and "\n" not in str(error)
    reach = np.abs(mesh.vertices).max(axis=0)
    for other in copies:
        assert type(other) is type(mesh) and other.name == name
        assert np.array_equal(other.vertices, mesh.vertices)
        for place in (0.5 * reach, 0.97 * reach):
            answers = []
            for one in (mesh, other):
                world = CollisionManager()
                world.add(one, at(0.0))
                world.add(box(0.01, 0.01, 0.01), at(*place))
                answers.append(world.colliding_surfaces().tolist())
            assert answers[0] == answers[1]
    assert len(copies) == (2 if name == "octree" else 3)
