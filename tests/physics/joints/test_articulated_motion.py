"""Recognised joints: pendulum, four-bar, screw, a loop at its singular pose, against closed forms and references."""

from __future__ import annotations

import numpy as np
import physics_cases as pc
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from constraints.kinds.screw import Screw
from physics import Body, Friction, Gravity, ScriptedPath, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from physics.joints.lower_pair import pair_between


def hinge(a, b, at_a, at_b, axis=(0.0, 1.0, 0.0)):
    return [
        Concentric((a, b), (Cylinder(at_a, axis, 0.005), Cylinder(at_b, axis, 0.005))),
        Coplanar((a, b), (Plane(at_a, axis), Plane(at_b, axis))),
    ]


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


def total(world):
    return sum(world.energy(i) + world._body[i].mass * G * world.pose(i).translation[2] for i in (1, 2, 3))


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


def test_lower_pairs_are_named():
    z, o = np.array([0, 0, 1.0]), np.zeros(3)
    shaft = Concentric((0, 1), (Cylinder(o, z, 0.01), Cylinder(o, z, 0.01)))
    flush = Coplanar((0, 1), (Plane(o, z), Plane(o, z)))
    side = Coplanar((0, 1), (Plane(o, [1, 0, 0]), Plane(o, [1, 0, 0])))
    cases = {
        "cylindrical": [shaft], "revolute": [shaft, flush], "planar": [flush], "prismatic": [shaft, side],
        "rigid": [shaft, flush, side],
    }  # fmt: skip
    for name, joints in cases.items():
        assert pair_between(joints, 1, at(), at()).name == name


@pytest.mark.parametrize("make", [pendulum, lambda: fourbar(pc.FOURBAR["crank"])], ids=["pendulum", "four-bar"])
def test_the_same_bits_after_a_snapshot(make):
    """Restored in the middle, here and in a world made anew, a mechanism goes on bit for bit."""

    def go(world, steps):
        out = []
        for _ in range(steps):
            world.step(0.02)
            out.append([np.concatenate([p.homogeneous.ravel(), world.velocity(i)]) for i, p in world.poses.items()])
        return np.array(out)

    world = make()[0]
    go(world, 20)
    snapshot = world.save()
    once = go(world, 30)
    world.load(snapshot)
    assert np.array_equal(go(world, 30), once)
    fresh = make()[0]
    fresh.load(snapshot)
    assert np.array_equal(go(fresh, 30), once)


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
