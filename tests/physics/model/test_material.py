"""Materials: friction and restitution of pairs, apart from forces; behaviours of an object come before its material."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Sphere
from physics import DENSITY, MATERIALS, Body, BodyError, Elastic, Friction, Material, Pair, World
from physics.forces.behaviours import STANDARD_GRAVITY as G


def slid(behaviours=(), material=None, floor=None, pairs=None):
    """m a box slides down a slope of 30° in half a second."""
    manager = CollisionManager()
    slope = pin.exp3(np.array([0, np.pi / 6, 0]))
    ground = manager.add(box_mesh(20, 4, 0.2), pin.SE3(slope, slope @ [0, 0, -0.1]), movable=False)
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, pin.SE3(slope, slope @ [0, 0, 0.05]))
    world = World(manager, gravity=(0.0, 0.0, -G), **({} if pairs is None else {"pairs": pairs}))
    world.add(ground, material=floor)
    world.add(box, Body.from_mesh(mesh, 1000.0), behaviours, material=material)
    for _ in range(50):
        world.step(0.01)
    return float((slope.T @ world.pose(box).translation)[0])


def way(mu):
    return 0.125 * G * (np.sin(np.pi / 6) - mu * np.cos(np.pi / 6))


def test_friction_of_a_pair_is_the_tables():
    assert slid(material="copper", floor="steel") == pytest.approx(way(0.36), abs=1e-12)
    assert slid(material="Steel", floor="copper") == pytest.approx(way(0.36), abs=1e-12)


def test_without_a_pair_materials_combine_as_objects_do():
    smooth, rough = Material("smooth", friction=0.1), Material("rough", friction=0.4)
    assert slid(material=smooth, floor=rough) == pytest.approx(way(0.2), abs=1e-12)
    assert slid(material=smooth) == pytest.approx(way(0.1), abs=1e-12)
    slick = Material("steel", friction=0.1)
    assert slid(material=slick, floor=slick) == pytest.approx(way(0.1), abs=1e-12)  # not the default table's
    assert slid(material=smooth, floor=rough, pairs={("rough", "smooth"): Pair(0.3)}) == pytest.approx(
        way(0.3), abs=1e-12
    )


def test_a_behaviour_comes_before_the_material():
    assert slid([Friction(0.25)], material="copper", floor="steel") == pytest.approx(way(0.25), abs=1e-12)


@pytest.mark.parametrize(
    "behaviours, material, e",
    [
        ([], Material("a", restitution=0.5), 0.5),
        ([], Material("b", restitution=0.5), 0.9),
        ([Elastic(0.3)], Material("b", restitution=0.5), 0.3),
        ([], Material("b", restitution=0.5, law="poisson"), 0.9),
    ],
)
def test_restitution_by_material_pair_and_behaviour(behaviours, material, e):
    manager, floor = room()
    mesh = ball_mesh(0.05, 6)
    ball = manager.add(mesh, at(z=0.55))
    world = World(manager, gravity=(0.0, 0.0, -G), pairs={("b", "floor"): Pair(restitution=0.9)})
    world.add(floor, material=Material("floor"))
    world.add(ball, Body.sphere(0.05, 1.0), behaviours, {0: Sphere(np.zeros(3), 0.05)}, material=material)
    while world.velocity(ball)[2] <= 0.0:
        world.step(0.01)
    v = world.velocity(ball)[2] + G * (world.time - np.sqrt(1.0 / G))
    assert v == pytest.approx(e * np.sqrt(G), rel=1e-9)


def test_a_material_gives_the_density():
    assert DENSITY["steel"] == MATERIALS["steel"].density == 7850.0
    assert Body.from_mesh(box_mesh(0.1, 0.1, 0.1), Material("cork", density=240.0)).mass == pytest.approx(0.24)


@pytest.mark.parametrize(
    "field, value", [("friction", -0.1), ("friction", np.nan), ("restitution", 1.1), ("density", 0.0), ("law", "hooke")]
)
def test_bad_materials_are_named(field, value):
    with pytest.raises(BodyError, match=field):
        Material("wax", **{field: value})
    if field in ("friction", "restitution"):
        with pytest.raises(BodyError, match=field):
            Pair(**{field: value})


def test_unknown_materials_are_named():
    manager, floor = room()
    with pytest.raises(BodyError, match="no material 'unobtainium'; there are: steel"):
        World(manager).add(floor, material="unobtainium")
    with pytest.raises(BodyError, match="density"):
        Body.from_mesh(box_mesh(1, 1, 1), Material("dust"))
