"""Hands: a pose that is obeyed, a spring of limited force, and what is felt."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh, room

from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Body, Gravity, PhysicsError, SpringHand, World, WorldError
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import goes_on_alike, run, table


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


def test_what_cannot_be_held():
    world, box = table()
    with pytest.raises(WorldError, match="not held"):
        world.let_go(box)
    with pytest.raises(WorldError, match="static"):
        world.hold(0, at())
    with pytest.raises(PhysicsError, match="stiffness"):
        SpringHand(at(), stiffness=-1.0)
    assert np.isfinite(world.pose(box).homogeneous).all()


def cube(side=0.02, density=7850.0):
    """A small steel cube in free space: 63 g."""
    manager, _ = room()
    mesh = box_mesh(side, side, side)
    i = manager.add(mesh, at(z=1.0))
    world = World(manager)
    world.add(i, Body.from_mesh(mesh, density), [Gravity()])
    return world, i


@pytest.mark.parametrize("dt", [1 / 30, 1 / 60, 1 / 250, pytest.param(1e-3, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "gains",
    [
        {"stiffness": 500.0},
        {"stiffness": 1e9, "damping": 1e6, "angular_stiffness": 1e6, "angular_damping": 1e6},
        {"stiffness": 1e9, "damping": 0.0, "angular_stiffness": 1e6, "angular_damping": 0.0},
        {"stiffness": 0.0, "damping": 1e9, "angular_stiffness": 0.0, "angular_damping": 1e9},
    ],
)
def test_no_gain_makes_a_light_part_fly_off(dt, gains):
    world, i = cube()
    turn = pin.SE3(pin.exp3(np.array([0.3, -0.4, 0.5])), np.array([0.05, -0.02, 1.1]))
    far = np.linalg.norm(turn.translation - world.pose(i).translation)
    world.hold(i, SpringHand(turn, force=1e12, torque=1e12, **gains))
    for _ in range(round(2.0 / dt)):
        world.step(dt)
        if gains.get("stiffness"):
            assert np.linalg.norm(world.pose(i).translation - turn.translation) < 1.01 * far + G * dt**2
        assert np.linalg.norm(world.velocity(i)) < 1e3
    if gains.get("stiffness") and gains.get("damping", 1.0):
        # what is left is the droop under its weight of the spring that the step can follow
        mass = 0.02**3 * 7850.0
        droop = mass * G / min(gains["stiffness"], mass / dt**2)
        assert world.pose(i).translation == pytest.approx(turn.translation - [0, 0, droop], abs=1e-6)
        assert np.linalg.norm(world.velocity(i)[:3]) < 1e-6


def test_gains_that_a_step_follows_are_the_hands_own():
    world, i = cube(side=0.1, density=1000.0)
    world.hold(i, SpringHand(at(z=1.0), stiffness=400.0, damping=20.0))
    for _ in range(600):
        world.step(0.01)
    assert world.pose(i).translation[2] == pytest.approx(1.0 - G / 400.0, abs=1e-8)


def hinged():
    """The cube on an arm of 0.3 m about a fixed axis; world, cube, hub and the joints."""
    world, i = cube()
    hub = world.collision.add(box_mesh(0.01, 0.01, 0.01), at(x=0.3, z=1.0), movable=False)
    axis = np.array([0.0, 1.0, 0.0])
    hinge = [
        Concentric((hub, i), (Cylinder(np.zeros(3), axis, 0.002), Cylinder(np.array([0.3, 0, 0]), axis, 0.002))),
        Coplanar((hub, i), (Plane(np.zeros(3), axis), Plane(np.array([0.3, 0, 0]), axis))),
    ]
    world.set_joints(hinge)
    return world, i, hub, hinge


def test_a_hinged_part_goes_on_alike_in_another_world():
    (first, *_), (second, *_) = hinged(), hinged()
    run(first, 1 / 3, 1 / 60)
    goes_on_alike(first, 60, 1 / 60, second)


@pytest.mark.parametrize("stiffness", [500.0, 1e9])
def test_a_stiff_hand_on_a_hinged_part_keeps_it_on_its_hinge(stiffness):
    world, i, hub, hinge = hinged()
    world.hold(i, SpringHand(at(z=1.3), stiffness=stiffness, force=1e9, torque=1e9))
    for _ in range(300):
        world.step(1 / 60)
        assert np.linalg.norm(world.velocity(i)) < 1e3
    for joint in hinge:
        assert np.abs(joint.residual(world.pose(hub), world.pose(i))).max() < 1e-8
    way = world.pose(i).translation - [0.3, 0.0, 1.0]
    assert way[2] > 0.1, "the hand draws it up about the hinge"
