"""The world from outside: what falls, rests, slides, bounces, floats and sleeps, against closed forms."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Sphere
from physics import (
    BehaviourError,
    Body,
    Buoyancy,
    Drag,
    Elastic,
    Friction,
    Gravity,
    Sleeping,
    Solidity,
    World,
    WorldError,
)
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import dropped_box, goes_on_alike, run


def test_free_fall_is_exact():
    world, box = dropped_box(1.0, velocity=[0.1, 0, 0.5, 0, 0, 0])
    for _ in range(30):
        world.step(0.01)
    assert world.pose(box).translation == pytest.approx([0.03, 0, 1.0 + 0.15 - 0.5 * G * 0.09], abs=1e-14)


def test_a_box_falls_until_it_stops_on_the_floor_and_sleeps():
    world, box = dropped_box()
    for _ in range(120):
        world.step(0.01)
    assert world.pose(box).translation == pytest.approx([0, 0, 0.05], abs=1e-12)
    assert world.awake == ()
    assert world.pose(box).isApprox(world.collision.pose(box))


@pytest.mark.parametrize("dt", [0.001, 0.01])
@pytest.mark.parametrize("e", [1.0, 0.8])
def test_twenty_bounces(dt, e):
    """The apex after 20 bounces is e⁴⁰ of the first, to 1e-9 of it."""
    if dt == 0.001 and e == 1.0:
        pytest.skip("the coarse step is the harder one")
    manager, _ = room()
    mesh = ball_mesh(0.05, 6)
    ball = manager.add(mesh, at(z=1.05))
    world = World(manager)
    world.add(ball, Body.sphere(0.05, 1.0), [Gravity(), Elastic(e)], {0: Sphere(np.zeros(3), 0.05)})
    impact = np.sqrt(2.0 / G) * (1.0 + 2.0 * np.cumsum(e ** np.arange(1, 21)))  # times of bounces 2 … 21
    while world.time < impact[18]:  # that is the twentieth
        world.step(dt)
    bounces = 1 + int((impact < world.time).sum())
    v = world.velocity(ball)[2]
    apex = world.pose(ball).translation[2] - 0.05 + v * v / (2 * G)
    assert bounces >= 20
    assert apex == pytest.approx(e ** (2 * bounces), rel=1e-9)


@pytest.mark.parametrize("mu", [0.3, 0.5])
def test_sliding_on_a_slope(mu):
    tilt = np.pi / 6
    manager = CollisionManager()
    slope = pin.exp3(np.array([0, tilt, 0]))
    manager.add(box_mesh(20, 4, 0.2), pin.SE3(slope, slope @ [0, 0, -0.1]), movable=False)
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, pin.SE3(slope, slope @ [0, 0, 0.05]))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(mu)])
    for _ in range(100):
        world.step(0.01)
    way = slope.T @ world.pose(box).translation - [0, 0, 0.05]
    assert way == pytest.approx([0.5 * G * (np.sin(tilt) - mu * np.cos(tilt)), 0, 0], abs=1e-12)


def test_sticking_does_not_creep():
    tilt = np.pi / 6
    manager = CollisionManager()
    slope = pin.exp3(np.array([0, tilt, 0]))
    manager.add(box_mesh(20, 4, 0.2), pin.SE3(slope, slope @ [0, 0, -0.1]), movable=False)
    mesh = box_mesh(0.1, 0.1, 0.1)
    start = pin.SE3(slope, slope @ [0, 0, 0.05])
    box = manager.add(mesh, start)
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.6), Sleeping(False)])
    for _ in range(300):
        world.step(0.01)
    assert np.abs(world.pose(box).translation - start.translation).max() < 1e-12


def test_stack_of_ten_does_not_sag():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    boxes = [manager.add(mesh, at(z=0.05 + 0.1 * k)) for k in range(10)]
    for box in boxes:
        world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    for _ in range(300):
        world.step(0.01)
    heights = [world.pose(box).translation for box in boxes]
    assert np.abs(np.array(heights) - [[0, 0, 0.05 + 0.1 * k] for k in range(10)]).max() < 1e-8


def test_balloon_rises_at_terminal_speed_and_rests_under_the_ceiling():
    manager, _ = room()
    ceiling = manager.add(box_mesh(4, 4, 0.2, "ceiling"), at(z=10.1), movable=False)
    mesh = ball_mesh(0.15, 6)
    balloon = manager.add(mesh, at(z=0.2))
    world = World(manager)
    area = np.pi * 0.15**2
    behaviours = [Gravity(), Buoyancy(), Drag(area=area), Friction(0.5)]
    body = Body.sphere(0.15, 0.008)
    world.add(balloon, body, behaviours, {0: Sphere(np.zeros(3), 0.15)})
    lift = (1.204 * body.volume - 0.008) * G
    fastest = 0.0
    for _ in range(800):
        world.step(0.01)
        fastest = max(fastest, world.velocity(balloon)[2])
    assert fastest == pytest.approx(np.sqrt(lift / (0.5 * 1.204 * 0.47 * area)), rel=1e-6)
    assert world.pose(balloon).translation[2] == pytest.approx(10.0 - 0.15, abs=1e-9)
    assert np.abs(world.velocity(balloon)).max() < 1e-9
    assert world.touches(balloon)[0].other == ceiling or world.awake == ()


def test_without_solidity_it_falls_through():
    world, box = dropped_box(0.3, [Solidity(False)])
    for _ in range(100):
        world.step(0.01)
    assert world.pose(box).translation[2] == pytest.approx(0.3 - 0.5 * G, abs=1e-9)


def test_state_and_restore_give_the_same_future():
    world, _ = dropped_box(0.4, [Elastic(0.4), Friction(0.3)], velocity=[0.5, 0.1, 0, 3, 2, 1])
    run(world, 0.4)
    goes_on_alike(world, 40)


def test_bad_input_is_named():
    world, box = dropped_box()
    with pytest.raises(BehaviourError, match="restitution"):
        Elastic(1.2)
    with pytest.raises(BehaviourError, match="coefficient"):
        Friction(-0.1)
    with pytest.raises(WorldError, match="dt"):
        world.step(0.0)
    with pytest.raises(WorldError, match="77"):
        world.add(77, Body.sphere(0.1, 1.0))
    with pytest.raises(WorldError, match="velocity"):
        world.set_velocity(box, [np.nan] * 6)
    with pytest.raises(WorldError, match="integrator"):
        World(CollisionManager(), integrator="leapfrog")


def test_gravity_of_the_world_acts_on_what_is_free_and_says_nothing_else():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    plain, light, own, held = (manager.add(mesh, at(x=k, z=6.0)) for k in range(4))
    world = World(manager, gravity=(0.0, 0.0, -1.5))
    body = Body.from_mesh(mesh, 1000.0)
    world.add(plain, body)
    world.add(light, body, [Gravity((0.0, 0.0, 0.0))])
    world.add(own, body, [Gravity()])
    world.add(held, body)
    world.hold(held, world.pose(held))
    for _ in range(10):
        world.step(0.1)
    fallen = [6.0 - world.pose(i).translation[2] for i in (plain, light, own, held)]
    assert fallen == pytest.approx([0.75, 0.0, 0.5 * G, 0.0], abs=1e-12)
    assert world.wrench(held)[2] == pytest.approx(1.5 * body.mass, rel=1e-12)
    world.gravity = (0.0, 0.0, 0.0)
    before = world.velocities
    world.step(0.1)
    assert (world.velocities[[plain, light]] == before[[plain, light]]).all()
    assert world.velocities[own, 2] == pytest.approx(before[own, 2] - 0.1 * G)
    with pytest.raises(WorldError, match="gravity is 'down'"):
        world.gravity = "down"
