"""Hard cases: extreme masses and sizes, fast spin, edges and vertices, jams, deep starts, singular loops."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, cylinder_mesh, plate_with_hole, room, tube_mesh

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Sphere
from physics import Body, Elastic, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import energy


@pytest.mark.parametrize("heavy_above", [True, False])
def test_mass_ratio_of_a_million(heavy_above):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    masses = (1e-3, 1e3) if heavy_above else (1e3, 1e-3)
    ids = [manager.add(mesh, at(z=0.05 + 0.1 * k)) for k in range(2)]
    for i, mass in zip(ids, masses, strict=True):
        world.add(i, Body.box([0.1] * 3, mass), [Gravity(), Friction(0.5), Sleeping(False)])
    for _ in range(200):
        world.step(0.01)
    for k, i in enumerate(ids):
        assert world.pose(i).translation == pytest.approx([0, 0, 0.05 + 0.1 * k], abs=1e-9)


@pytest.mark.parametrize("size", [1e-4, 1e3])
def test_tiny_and_huge_parts_come_to_rest(size):
    manager, _ = room(40 * size, 2 * size)
    mesh = box_mesh(size, size, size)
    box = manager.add(mesh, at(z=0.8 * size, turn=(0.1, 0.2, 0.3)))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    scale = np.sqrt(size / G)
    for _ in range(400):
        world.step(0.05 * scale)
    assert world.pose(box).translation[2] == pytest.approx(0.5 * size, abs=1e-6 * size)
    assert np.abs(world.velocity(box)[:3]).max() < 1e-6 * size / scale


@pytest.mark.parametrize(("restitution", "friction", "slack"), [(0.3, 0.5, 1e-12), (0.3, 0.0, 1e-4), (0.0, 0.5, 1e-4)])
@pytest.mark.parametrize("turn", [(0, np.pi / 4, 0), (np.arctan(np.sqrt(2.0)), np.pi / 4, 0)])
def test_landing_on_an_edge_or_a_vertex_never_gains_energy(turn, restitution, friction, slack):
    """But for what turning about a corner that slides costs in steps of 10 ms (`slack`, 1)."""
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.3, turn=turn))
    world = World(manager)
    body = Body.from_mesh(mesh, 1000.0)
    world.add(box, body, [Gravity(), Friction(friction), Elastic(restitution), Sleeping(False)])
    last = energy(world, box, body)
    worst = 0.0
    for _ in range(200):
        world.step(0.01)
        now = energy(world, box, body)
        worst = max(worst, now - last)
        last = now
        rotation = world.pose(box).rotation
        lowest = (world.pose(box).translation + mesh.vertices @ rotation.T)[:, 2].min()
        assert lowest > -1e-9
    assert worst < slack * G * 0.3


def test_edge_on_edge():
    """A bar across another, both on their long edges: four crossings of edges never pass."""
    manager, _ = room()
    below = manager.add(box_mesh(1.0, 0.1, 0.1), at(z=0.5, turn=(np.pi / 4, 0, 0)), movable=False)
    mesh = box_mesh(0.1, 1.0, 0.1)
    above = manager.add(mesh, at(z=0.5 + 0.1 * np.sqrt(2) + 0.05, turn=(0, np.pi / 4, 0)))
    world = World(manager)
    world.add(below, None, [Friction(0.8)])
    world.add(above, Body.from_mesh(mesh, 1000.0), [Gravity(), Sleeping(False)])
    for _ in range(30):
        world.step(0.01)
    assert world.pose(above).translation[2] == pytest.approx(0.5 + 0.1 * np.sqrt(2), abs=1e-9)


def test_wedge_jams():
    """A box in a V of 90°: twelve contacts for six freedoms, and it stays where it was put."""
    manager = CollisionManager()
    for s in (-1, 1):
        turn = pin.exp3(np.array([0, s * np.pi / 4, 0]))
        manager.add(box_mesh(1, 1, 0.2), pin.SE3(turn, turn @ [-s * 0.5, 0, -0.1]), movable=False)
    mesh = box_mesh(0.2, 0.2, 0.2)
    box = manager.add(mesh, at(z=0.1 * np.sqrt(2), turn=(0, np.pi / 4, 0)))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.9), Sleeping(False)])
    start = world.pose(box).translation
    for _ in range(100):
        world.step(0.01)
    assert np.abs(world.pose(box).translation - start).max() < 1e-10


@pytest.mark.parametrize("speed", [10.0, 300.0])
def test_nothing_thin_is_passed_at_any_speed(speed):
    """A 5 mm ball against a 1 mm plate, up to 3 m a step."""
    manager = CollisionManager()
    manager.add(box_mesh(0.5, 0.5, 0.001), at(), movable=False)
    mesh = ball_mesh(0.0025, 4)
    ball = manager.add(mesh, at(z=0.7))
    world = World(manager)
    world.add(ball, Body.sphere(0.0025, 1e-3), [Elastic(1.0)], {0: Sphere(np.zeros(3), 0.0025)},
              velocity=[0, 0, -speed, 0, 0, 0])  # fmt: skip
    while world.time < 1.0 / speed:
        world.step(0.01)
    assert world.velocity(ball)[2] == pytest.approx(speed, rel=1e-12)
    travelled = 0.7 - 0.0005 - 0.0025
    assert world.pose(ball).translation[2] == pytest.approx(0.003 + speed * world.time - travelled, abs=1e-9)


@pytest.mark.parametrize("dt", [0.01, 0.001])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_plate_shot_at_a_sheet_at_a_kilometre_a_second(turn, dt):
    """Both 0.1 mm thin, up to 10 m a step: what counts is how far they are from one another, not how thin they are."""
    manager = CollisionManager()
    manager.add(box_mesh(0.5, 0.5, 1e-4), at(), movable=False)
    mesh = box_mesh(0.02, 0.02, 1e-4)
    plate = manager.add(mesh, at(z=0.7, turn=(0, turn, 0)))
    world = World(manager)
    world.add(plate, Body.from_mesh(mesh, 7850.0), [Elastic(1.0), Friction(0.0)], velocity=[0, 0, -1e3, 0, 0, 0])
    first = world.energy(plate)
    while world.time < 1.5e-3:
        world.step(dt)
        assert (world.pose(plate).translation + mesh.vertices @ world.pose(plate).rotation.T)[:, 2].min() > 0.0
    assert world.velocity(plate)[2] > 500.0
    assert world.energy(plate) == pytest.approx(first, rel=1e-12)


@pytest.mark.parametrize("clearance", [5e-5, 5e-6])
def test_a_peg_falls_into_its_hole_and_stays(clearance):
    radius, length, plate = 0.004, 0.03, 0.02
    manager, _ = room(0.2)
    hole = manager.add(plate_with_hole(0.04, plate, radius + clearance), at(z=plate / 2), movable=False)
    mesh = cylinder_mesh(radius, length)
    peg = manager.add(mesh, at(x=0.3 * clearance, z=plate + 0.004 + length / 2))
    world = World(manager)
    world.add(hole, None, [], {0: Cylinder(np.zeros(3), [0, 0, 1], radius + clearance)})
    world.add(
        peg, Body.from_mesh(mesh, 7850.0), [Gravity(), Friction(0.1)], {0: Cylinder(np.zeros(3), [0, 0, 1], radius)}
    )
    off = 0.0
    for _ in range(60):
        world.step(0.01)
        off = max(off, float(np.hypot(*world.pose(peg).translation[:2])))
    assert world.pose(peg).translation[2] == pytest.approx(length / 2, abs=1e-9)
    assert off < clearance * (1 + 1e-6)


@pytest.mark.parametrize("known", ["both", "shaft", "ring", "neither"])
def test_a_ring_on_a_longer_shaft_is_carried_by_it(known):
    """No rim of the shaft is in the bore: it is the bore's ends that touch. 0.5 mm of play, in steps of twice that."""
    manager, _ = room()
    shaft = manager.add(cylinder_mesh(0.005, 0.2, 48), at(z=0.2))
    mesh = tube_mesh(0.0055, 0.01, 0.05, 48)
    ring = manager.add(mesh, at(z=0.025))
    world = World(manager)
    sides = [Cylinder(np.zeros(3), [0, 0, 1], r) for r in (0.005, 0.0055, 0.01)]
    pin_shape = {0: sides[0]} if known in ("both", "shaft") else {}
    ring_shape = {0: sides[1], 1: sides[2]} if known in ("both", "ring") else {}
    world.add(shaft, Body.from_mesh(manager.mesh(shaft), 7850.0), [], pin_shape)
    world.add(ring, Body.from_mesh(mesh, 7850.0), [Gravity(), Friction(0.1)], ring_shape)
    for k in range(30):
        world.hold(shaft, at(x=0.001 * k, z=0.1))
        world.step(0.01)
        off = world.pose(ring).translation - world.pose(shaft).translation
        assert np.hypot(*off[:2]) < 0.0005 * 1.003  # for the chords of 48
    assert world.pose(ring).translation[2] == pytest.approx(0.025, abs=1e-6)
    assert world.pose(ring).translation[0] > 0.02


@pytest.mark.parametrize(
    ("count", "steps", "within"),
    [(3, 1000, 3e-10), pytest.param(2, 1_000_000, 1e-6, marks=pytest.mark.slow)],
)
def test_resting_stack_does_not_creep(count, steps, within):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(x=0.01 * k, z=0.05 + 0.1 * k)) for k in range(count)]
    for i in ids:
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    for _ in range(steps):
        world.step(0.01)
    for k, i in enumerate(ids):
        assert world.pose(i).translation == pytest.approx([0.01 * k, 0, 0.05 + 0.1 * k], abs=within)
