"""Recognised joints: pendulum, four-bar, screw, a loop at its singular pose, against closed forms and references."""

import numpy as np
import physics_cases as pc
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder
from constraints.kinds.concentric import Concentric
from constraints.kinds.screw import Screw
from physics import Body, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import goes_on_alike, hinge, run


def pendulum(angle=1.0):
    manager = CollisionManager()
    ground = manager.add(box_mesh(0.1, 0.1, 0.1), at(), movable=False)
    p = pc.PENDULUM
    mesh = box_mesh(p["length"], p["width"], p["height"])
    turn = pin.exp3(np.array([0, angle, 0]))
    bar = manager.add(mesh, pin.SE3(turn, turn @ [p["length"] / 2, 0, 0]))
    manager.ignore(ground, bar)
    world = World(manager)
    world.add(bar, Body.from_mesh(mesh, p["density"]), [Gravity(), Sleeping(False)])
    joints = hinge(ground, bar, np.zeros(3), np.array([-p["length"] / 2, 0, 0]))
    world.set_joints(joints)
    return world, bar, joints


def test_pendulum_against_jacobis_elliptic_functions():
    world, bar, joints = pendulum()
    for _ in range(500):
        world.step(0.02)
    x = world.pose(bar).rotation[:, 0]
    assert np.pi / 2 - np.arctan2(-x[2], x[0]) == pytest.approx(pc.pendulum_truth(), abs=1e-12)
    for joint in joints:
        assert np.abs(joint.residual(world.pose(0), world.pose(bar))).max() < 1e-14


def test_a_body_that_is_replaced_swings_with_its_own_inertia():
    other = Body(2.0, inertia=np.diag([0.1, 0.2, 0.2]))
    ends = []
    for steps in (0, 1):
        world, bar, _ = pendulum()
        for _ in range(steps):
            world.step(0.01)
        world.set_pose(bar, pendulum()[0].pose(bar))
        world.add(bar, other, [Gravity(), Sleeping(False)])
        for _ in range(20):
            world.step(0.01)
        ends.append(world.pose(bar).homogeneous)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-14)


def fourbar(crank, joint_set=hinge):
    manager = CollisionManager()
    f = pc.FOURBAR
    manager.add(box_mesh(0.02, 0.02, 0.02), at(), movable=False)
    a, d = np.zeros(3), np.array([f["ground"], 0, 0])
    b, c = (np.array([p[0], 0, p[1]]) for p in pc.fourbar_points(crank))
    world = World(manager)
    for (start, end), length in zip(((a, b), (b, c), (d, c)), f["bars"], strict=True):
        mesh = box_mesh(length, f["width"], f["width"])
        x = (end - start) / length
        y = np.array([0.0, 1.0, 0.0])
        i = manager.add(mesh, pin.SE3(np.column_stack([x, y, np.cross(x, y)]), (start + end) / 2))
        world.add(i, Body.from_mesh(mesh, f["density"]), [Gravity(), Sleeping(False)])
    for i in range(4):
        for j in range(i):
            manager.ignore(i, j)
    left, right = ([np.array([s * length / 2, 0, 0]) for length in f["bars"]] for s in (-1, 1))
    joints = hinge(0, 1, a, left[0]) + hinge(1, 2, right[0], left[1])
    joints += hinge(2, 3, right[1], right[2]) + hinge(0, 3, d, left[2])
    world.set_joints(joints)
    return world, joints


MASSES = [pc.FOURBAR["density"] * length * pc.FOURBAR["width"] ** 2 for length in pc.FOURBAR["bars"]]


def total(world):
    return sum(world.energy(i) + MASSES[i - 1] * G * world.pose(i).translation[2] for i in (1, 2, 3))


def test_fourbar_with_redundant_constraints_against_one_coordinate():
    world, joints = fourbar(pc.FOURBAR["crank"])
    first = total(world)
    for _ in range(100):
        world.step(0.02)
    assert world.pose(2).translation[[0, 2]] == pytest.approx(pc.fourbar_reference(), abs=1e-8)
    assert total(world) == pytest.approx(first, abs=1e-8)
    worst = max(np.abs(j.residual(world.pose(j.bodies[0]), world.pose(j.bodies[1]))).max() for j in joints)
    assert worst < 1e-12


def test_a_loop_at_its_singular_pose_stays_closed():
    """A parallelogram with all its bars in one line: it may leave either way, but it stays together."""
    manager = CollisionManager()
    manager.add(box_mesh(0.02, 0.02, 0.02), at(), movable=False)
    world = World(manager)
    mesh_short, mesh_long = box_mesh(0.2, 0.02, 0.02), box_mesh(0.5, 0.02, 0.02)
    for mesh, x in ((mesh_short, 0.1), (mesh_long, 0.45), (mesh_short, 0.6)):
        i = manager.add(mesh, at(x=x))
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Sleeping(False)])
    for i in range(4):
        for j in range(i):
            manager.ignore(i, j)
    e = np.array([1.0, 0, 0])
    joints = hinge(0, 1, np.zeros(3), -0.1 * e) + hinge(1, 2, 0.1 * e, -0.25 * e)
    joints += hinge(2, 3, 0.25 * e, 0.1 * e) + hinge(0, 3, 0.5 * e, -0.1 * e)
    world.set_joints(joints)
    lowest = 0.0
    for _ in range(100):
        world.step(0.01)
        lowest = min(lowest, world.pose(2).translation[2])
        worst = max(np.abs(j.residual(world.pose(j.bodies[0]), world.pose(j.bodies[1]))).max() for j in joints)
        assert worst < 1e-9
    assert lowest < -0.15


def test_screw_falls_as_its_pitch_allows():
    """A nut on a frictionless thread: a = g / (1 + I / (m p²)), p the pitch in m/rad."""
    manager = CollisionManager()
    bolt = manager.add(box_mesh(0.01, 0.01, 0.5), at(), movable=False)
    mesh = box_mesh(0.04, 0.04, 0.02)
    nut = manager.add(mesh, at(z=0.2))
    manager.ignore(bolt, nut)
    world = World(manager)
    body = Body.from_mesh(mesh, 7850.0)
    world.add(nut, body, [Gravity(), Sleeping(False), Friction(0.0)])
    z = np.array([0.0, 0.0, 1.0])
    features = (Cylinder(np.zeros(3), z, 0.005), Cylinder(np.zeros(3), z, 0.005))
    lead = 0.05
    screw = Screw((bolt, nut), features, pitch=lead).engaged(world.pose(bolt), world.pose(nut))
    world.set_joints([Concentric((bolt, nut), features), screw])
    for _ in range(30):
        world.step(0.01)
    p = lead / (2 * np.pi)
    a = G / (1 + body.inertia[2, 2] / (body.mass * p * p))
    assert world.pose(nut).translation == pytest.approx([0, 0, 0.2 - 0.5 * a * 0.09], abs=1e-10)


@pytest.mark.parametrize("n", [1, 2])
def test_joints_and_contacts_together(n):
    """A hinged door falls on the floor and lies there: joint held, nothing sunk."""
    manager, floor = room()
    post = manager.add(box_mesh(0.02, 0.02, 0.02), at(x=-1.0, z=0.1), movable=False)
    mesh = box_mesh(0.5, 0.1, 0.04)
    lid = manager.add(mesh, at(x=-1.0, z=0.35, turn=(0, -np.pi / 2 + 0.3 * n, 0)))
    manager.ignore(post, lid)
    world = World(manager)
    world.add(lid, Body.from_mesh(mesh, 1000.0), [Gravity()])
    pivot = world.pose(lid).act(np.array([-0.25, 0, 0]))
    joints = hinge(post, lid, world.pose(post).actInv(pivot), np.array([-0.25, 0, 0]))
    world.set_joints(joints)
    for _ in range(300):
        world.step(0.01)
        for joint in joints:
            assert np.abs(joint.residual(world.pose(post), world.pose(lid))).max() < 1e-9
    lowest = (world.pose(lid).translation + mesh.vertices @ world.pose(lid).rotation.T)[:, 2].min()
    assert lowest > -1e-8
    assert floor == 0 and np.abs(world.velocity(lid)).max() < 1e-6


@pytest.mark.parametrize("make", [pendulum, lambda: fourbar(pc.FOURBAR["crank"])], ids=["pendulum", "four-bar"])
def test_the_same_bits_after_a_snapshot(make):
    world = make()[0]
    run(world, 0.4, 0.02)
    goes_on_alike(world, 30, 0.02, make()[0])
