"""Hands: a pose that is obeyed, a spring of limited force, and what is felt."""

from __future__ import annotations

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from physics import Body, Friction, Gravity, PhysicsError, SpringHand, World, WorldError
from physics.behaviours import STANDARD_GRAVITY as G


def table(z=0.05):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=z))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
    return world, box


def test_held_at_a_pose_it_goes_there_and_let_go_it_falls():
    world, box = table()
    for k in range(50):
        world.hold(box, at(z=0.05 + 0.01 * (k + 1)))
        world.step(0.01)
    assert world.pose(box).translation == pytest.approx([0, 0, 0.55], abs=1e-12)
    world.hold(box, at(z=0.55))
    world.step(0.01)
    world.let_go(box)
    for _ in range(150):
        world.step(0.01)
    assert world.pose(box).translation == pytest.approx([0, 0, 0.05], abs=1e-9)
    assert world.awake == ()


def test_spring_hand_feels_the_weight():
    world, box = table(0.3)
    world.hold(box, SpringHand(at(z=0.3), stiffness=2000.0, damping=90.0))
    for _ in range(300):
        world.step(0.01)
    assert world.wrench(box)[2] == pytest.approx(G, rel=1e-6)
    assert world.pose(box).translation[2] == pytest.approx(0.3 - G / 2000.0, abs=1e-8)


def test_spring_hand_is_stopped_by_the_floor_and_feels_it():
    world, box = table()
    world.hold(box, SpringHand(at(z=-0.05), stiffness=200.0, force=15.0))
    for _ in range(50):
        world.step(0.01)
    assert world.pose(box).translation[2] == pytest.approx(0.05, abs=1e-9)
    assert world.wrench(box)[2] == pytest.approx(-15.0, rel=1e-9)
    pressed = sum(t.impulse[2] for t in world.touches(box)) / 0.01
    assert pressed == pytest.approx(15.0 + G, rel=1e-6)


def test_too_weak_a_hand_lifts_nothing():
    world, box = table()
    world.hold(box, SpringHand(at(z=0.5), force=5.0))
    for _ in range(50):
        world.step(0.01)
    assert world.pose(box).translation[2] == pytest.approx(0.05, abs=1e-9)


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


def test_what_cannot_be_held():
    world, box = table()
    with pytest.raises(WorldError, match="not held"):
        world.let_go(box)
    with pytest.raises(WorldError, match="static"):
        world.hold(0, at())
    with pytest.raises(PhysicsError, match="stiffness"):
        SpringHand(at(), stiffness=-1.0)
    assert np.isfinite(world.pose(box).homogeneous).all()
