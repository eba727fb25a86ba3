"""Bodies that hands and scripted paths move."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh

from collision import CollisionManager
from physics import Body, Friction, Gravity, ScriptedPath, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import dropped_box, hinge, table


def test_scripted_path_pushes_others():
    world, box = dropped_box(0.05, [Friction(0.3)])
    pusher = world.collision.add(box_mesh(0.1, 0.1, 0.1), at(x=-0.2, z=0.06))
    path = [(0.0, at(x=-0.2, z=0.06)), (1.0, at(x=0.1, z=0.06))]
    world.add(pusher, Body.box([0.1] * 3, 1.0), [ScriptedPath(path)])
    for _ in range(100):
        world.step(0.01)
    assert world.pose(pusher).isApprox(path[1][1], 1e-12)
    assert world.pose(box).translation == pytest.approx([0.2, 0, 0.05], abs=1e-6)


def test_a_held_part_carries_what_lies_on_it():
    world, box = table()
    mesh = box_mesh(0.05, 0.05, 0.05)
    rider = world.collision.add(mesh, at(z=0.125))
    world.add(rider, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.8)])
    for k in range(100):
        world.hold(box, at(x=0.002 * (k + 1), z=0.05 + 0.001 * (k + 1)))
        world.step(0.01)
    assert world.pose(rider).translation[2] == pytest.approx(0.125 + 0.1, abs=1e-6)
    assert world.pose(rider).translation[0] > 0.15


def test_held_wrench_of_a_still_carry_is_the_weight():
    world, box = table(0.3)
    for _ in range(5):
        world.hold(box, at(z=0.3))
        world.step(0.01)
    assert world.wrench(box)[:3] == pytest.approx([0, 0, G], rel=1e-9)


def test_a_joint_to_what_is_carried_follows_its_speed():
    """A rod hinged at its end on a block that starts off at 1 m/s turns at 3 v / 2 l."""
    manager = CollisionManager()
    block, mesh = box_mesh(0.02, 0.02, 0.02), box_mesh(0.2, 0.002, 0.002)
    a, rod = manager.add(block, at()), manager.add(mesh, at(x=0.1))
    manager.ignore(a, rod)
    world = World(manager)
    world.add(a, Body.from_mesh(block, 1000.0), [ScriptedPath(lambda t: at(z=t))])
    world.add(rod, Body.from_mesh(mesh, 1000.0), [])
    joints = hinge(a, rod, np.zeros(3), np.array([-0.1, 0.0, 0.0]))
    world.set_joints(joints)
    for _ in range(100):
        world.step(1e-4)
    assert world.velocity(rod)[4] == pytest.approx(1.5 / 0.2, rel=2e-3)
    assert np.abs(joints[0].residual(world.pose(a), world.pose(rod))).max() < 1e-12
