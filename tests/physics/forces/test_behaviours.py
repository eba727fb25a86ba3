"""Behaviours against closed forms, a user's own, and what strangers do with them."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import (
    Behaviour,
    BehaviourError,
    Body,
    BodyError,
    Drag,
    Elastic,
    Friction,
    Gravity,
    Magnet,
    Motor,
    ScriptedPath,
    Sleeping,
    Solidity,
    Spring,
    SpringHand,
    Wind,
    World,
    WorldError,
)
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import Draught, ball, future, run

Z = np.array([0.0, 0.0, 1.0])


def test_drag_tends_to_terminal_speed():
    """v = v∞ tanh(g t / v∞)."""
    area = 0.05
    world, i = ball(Gravity(), Drag(area=area))
    terminal = np.sqrt(2 * 0.1 * G / (1.204 * 0.47 * area))
    run(world, 0.3)
    assert world.velocity(i)[2] == pytest.approx(-terminal * np.tanh(G * 0.3 / terminal), rel=1e-9)
    run(world, 3.2)
    assert world.velocity(i)[2] == pytest.approx(-terminal * np.tanh(G * 3.5 / terminal), rel=1e-9)


def test_linear_drag_decays_as_an_exponential():
    world, i = ball(Drag(linear=0.05), velocity=[2.0, 0, 0, 0, 0, 0])
    run(world, 1.0)
    assert world.velocity(i)[0] == pytest.approx(2.0 * np.exp(-0.5), rel=1e-9)
    assert world.pose(i).translation[0] == pytest.approx(2.0 / 0.5 * (1 - np.exp(-0.5)), rel=1e-9)


def test_wind_carries_along():
    world, i = ball(Wind([3.0, 0.0, 0.0], area=0.05), mass=0.01)
    run(world, 5.0)
    v = world.velocity(i)
    rate = 0.5 * 1.204 * 0.05 / 0.01  # u' = -rate u² of u = 3 - v
    assert v[0] == pytest.approx(3.0 - 3.0 / (1 + 3.0 * rate * 5.0), rel=1e-9)
    assert v[1:] == pytest.approx(np.zeros(5), abs=1e-15)


def test_a_spring_swings_at_its_frequency():
    world, i = ball(Spring([0, 0, 0], stiffness=10.0), pose=at(x=0.1))
    run(world, 2.0)
    assert world.pose(i).translation[0] == pytest.approx(0.1 * np.cos(2.0 * np.sqrt(10.0 / 0.1)), abs=1e-9)


def test_a_magnet_snaps_within_its_reach_and_not_beyond():
    magnet = Magnet([0, 0, 0], strength=2.0, reach=0.1, damping=0.5)
    world, i = ball(magnet, pose=at(x=0.09))
    run(world, 6.0)
    assert world.pose(i).translation == pytest.approx(np.zeros(3), abs=1e-6)
    world, i = ball(magnet, pose=at(x=0.11))
    run(world, 1.0)
    assert world.pose(i).translation[0] == 0.11


def test_a_motor_governs_its_speed():
    world, i = ball(Motor([0, 0, 2.0], speed=5.0, limit=1.0, gain=1e-4))
    run(world, 5.0)
    assert world.velocity(i)[3:] == pytest.approx([0, 0, 5.0], rel=1e-6)


def test_a_motor_drives_a_recognised_joint():
    manager, _ = room()
    mesh = box_mesh(0.2, 0.02, 0.02)
    post, arm = manager.add(box_mesh(0.02, 0.02, 0.02), at(z=1.0)), manager.add(mesh, at(z=1.05))
    eye = np.array([0.1, 0.0, 0.0])
    hinge = [
        Concentric((post, arm), (Cylinder(np.array([0, 0, 0.05]), Z, 0.004), Cylinder(-eye, Z, 0.004))),
        Coplanar((post, arm), (Plane(np.array([0, 0, 0.05]), Z), Plane(np.zeros(3), Z))),
    ]
    manager.set_pose(arm, at(x=0.1, z=1.05))
    world = World(manager)
    world.add(arm, Body.from_mesh(mesh, 1000.0), [Gravity(), Motor.on(hinge[0], arm, 4.0, limit=1.0, gain=1e-2)])
    world.set_joints(hinge)
    run(world, 2.0)
    assert world.velocity(arm)[5] == pytest.approx(4.0, rel=1e-6)
    assert world.pose(arm).act(-eye) == pytest.approx([0.0, 0.0, 1.05], abs=1e-12)
    with pytest.raises(BehaviourError, match="is not on"):
        Motor.on(hinge[0], 17, 4.0, limit=1.0, gain=1e-2)
    with pytest.raises(BehaviourError, match="no axis"):
        Motor.on(hinge[1], arm, 4.0, limit=1.0, gain=1e-2)


def test_a_scripted_path_is_followed_to_the_bit_of_its_poses():
    path = [(0.0, at()), (0.5, at(x=0.2, turn=(0, 0, 1.0))), (1.0, at(x=0.2, z=0.3))]
    world, i = ball(ScriptedPath(path))
    run(world, 0.5)
    assert world.pose(i).isApprox(path[1][1], 1e-12)
    run(world, 0.7)
    assert world.pose(i).isApprox(path[2][1], 1e-12)
    assert world.velocity(i) == pytest.approx(np.zeros(6), abs=1e-12)
    with pytest.raises(BehaviourError, match="rising"):
        ScriptedPath([(1.0, at()), (0.5, at())])


def test_a_users_behaviour_in_a_few_lines():
    world, i = ball(Draught())
    run(world, 2.0)
    assert world.velocity(i)[0] == pytest.approx(0.0, abs=1e-12)
    assert world.pose(i).translation[0] == pytest.approx(0.05 * 2.0 / np.pi, rel=1e-9)


class Lift(Behaviour):
    """Carries up for half a second, then lets go."""

    def pose(self, time):
        return at(z=2.0 * time) if time < 0.505 else None


def test_a_path_that_ends_leaves_the_object_free_with_its_speed():
    world, i = ball(Gravity(), Lift())
    run(world, 0.5)
    assert world.pose(i).translation[2] == pytest.approx(1.0, abs=1e-12)
    run(world, 0.3)
    assert world.pose(i).translation[2] == pytest.approx(1.0 + 2.0 * 0.3 - 0.5 * G * 0.09, abs=1e-12)


@pytest.mark.parametrize("dt", [0.0, -0.01, np.nan, np.inf])
def test_bad_time_steps(dt):
    world, i = ball(Gravity())
    with pytest.raises(WorldError, match="dt"):
        world.step(dt)
    assert world.time == 0.0 and not world.pose(i).translation.any()


def test_bad_bodies_and_laws_before_anything_moves():
    world, i = ball(Gravity())
    with pytest.raises(BodyError, match="mass"):
        world.add(i, Body.sphere(0.02, 0.0))
    with pytest.raises(BehaviourError, match="restitution"):
        world.add(i, Body.sphere(0.02, 1.0), [Elastic(1.2)])
    with pytest.raises(BehaviourError, match="no Behaviour"):
        world.add(i, Body.sphere(0.02, 1.0), [Gravity])
    world.step(0.01)
    assert world.velocity(i)[2] == pytest.approx(-0.01 * G)


def test_behaviours_are_swapped_while_it_runs():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.05))
    world = World(manager)
    body = Body.from_mesh(mesh, 1000.0)
    world.add(box, body, [Gravity(), Friction(0.5)])
    run(world, 0.7)
    assert world.awake == ()
    world.add(box, body, [Gravity(), Friction(0.5), Solidity(False)])
    run(world, 0.2)
    assert world.pose(box).translation[2] == pytest.approx(0.05 - 0.5 * G * 0.04, abs=1e-9)
    world.add(box, body, [Gravity([0, 0, 0]), Sleeping(False)], velocity=[0, 0, 1.0, 0, 0, 0])
    run(world, 0.1)
    assert np.isfinite(world.pose(box).homogeneous).all()


@pytest.mark.parametrize("what", ["tumbling", "sleeping", "hand"])
def test_restored_states_have_the_same_future(what):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    world = World(manager)
    ids = [manager.add(mesh, at(x=0.01 * k, z=0.06 + 0.12 * k)) for k in range(3)]
    spin = [0.3, 0, 0, 2.0, 3.0, 1.0] if what == "tumbling" else [0.0] * 6
    for i in ids:
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.4), Elastic(0.3)], velocity=spin)
    run(world, 1.5 if what == "sleeping" else 0.3)
    if what == "hand":
        world.hold(ids[2], SpringHand(at(x=0.3, z=0.4)))
        run(world, 0.1)
    if what == "sleeping":
        assert world.awake == ()
    saved = world.save()
    futures = []
    for _ in range(2):
        world.load(saved)
        world.set_velocity(ids[0], [0.5, 0, 0, 0, 0, 0])
        futures.append(future(world, 25))
    assert futures[0] == futures[1]
