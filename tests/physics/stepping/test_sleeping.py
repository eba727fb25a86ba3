"""Sleep and wake."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Sphere
from physics import Body, Elastic, Friction, Gravity, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import dropped_box, run


def test_a_support_that_is_removed_lets_fall_what_slept_on_it():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(z=0.05 + 0.1 * k)) for k in range(2)]
    for i in ids:
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
    run(world, 0.7)
    assert world.awake == ()
    world.remove(ids[0])
    manager.remove(ids[0])
    run(world, 1.0)
    assert world.pose(ids[1]).translation == pytest.approx([0, 0, 0.05], abs=1e-9)


def test_a_sleeper_wakes_when_something_comes():
    world, box = dropped_box(0.05)
    for _ in range(80):
        world.step(0.01)
    assert world.awake == ()
    other = world.collision.add(box_mesh(0.1, 0.1, 0.1), at(x=0.02, z=0.3))
    world.add(other, Body.box([0.1] * 3, 1.0), [Gravity()])
    woken = []
    for _ in range(30):
        world.step(0.01)
        woken.append(box in world.awake)
    assert not woken[0] and any(woken)
    assert world.pose(other).translation[2] == pytest.approx(0.15, abs=1e-6)


def test_changed_gravity_wakes_what_sleeps():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.05))
    world = World(manager, gravity=(0.0, 0.0, -G))
    world.add(box, Body.from_mesh(mesh, 1000.0))
    for _ in range(60):
        world.step(0.01)
    assert world.awake == ()
    world.gravity = (0.0, 0.0, 1.0)
    world.step(0.01)
    assert world.pose(box).translation[2] > 0.05


def test_a_blow_passes_through_sleepers_within_the_step():
    manager = CollisionManager()
    world = World(manager)
    radius = 0.02
    ids = []
    for k in range(5):
        i = manager.add(ball_mesh(radius, 4), at(x=2 * radius * k - (1.0 if k == 0 else 0.0)))
        world.add(i, Body.sphere(radius, 0.1), [Elastic(1.0), Friction(0.0)], {0: Sphere(np.zeros(3), radius)},
                  velocity=[1.0 if k == 0 else 0.0, 0, 0, 0, 0, 0])  # fmt: skip
        ids.append(i)
    while world.time < 0.9:
        world.step(0.01)
    assert world.awake == (ids[0],)
    while world.time < 1.02:
        world.step(0.01)
    assert [world.velocity(i)[0] for i in ids] == pytest.approx([0, 0, 0, 0, 1], abs=1e-12)


def test_idle_parts_sleep_and_cost_no_islands():
    manager, _ = room(20.0)
    world = World(manager)
    mesh = box_mesh(0.1, 0.1, 0.1)
    for k in range(100):
        i = manager.add(mesh, at(x=0.2 * (k % 10) - 1, y=0.2 * (k // 10) - 1, z=0.05))
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity()])
    for _ in range(60):
        world.step(0.01)
    assert world.awake == ()
    poses = {i: p.homogeneous for i, p in world.poses.items()}
    world.step(0.01)
    assert all(np.array_equal(p.homogeneous, poses[i]) for i, p in world.poses.items())


@pytest.mark.parametrize("by_hand", [True, False])
def test_what_is_held_still_lets_its_neighbours_sleep(by_hand):
    """Also with a rotation that a quaternion does not give back to the bit."""
    world, boxes = None, []
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.7123), np.array([0.0, 0.0, 0.05]))
    held = manager.add(mesh, turned)
    for i, z in ((held, None), (manager.add(mesh, at(z=0.15)), 0.15)):
        if by_hand or z is not None:
            world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
        boxes.append(i)
    for _ in range(100):
        if by_hand:
            world.hold(held, turned)
        else:
            world.set_pose(held, turned)
        world.step(0.01)
    assert world.awake == ()
    (world.hold if by_hand else world.set_pose)(held, pin.SE3(turned.rotation, np.array([0.001, 0.0, 0.05])))
    world.step(0.01)
    assert world.awake == (boxes[1],)
