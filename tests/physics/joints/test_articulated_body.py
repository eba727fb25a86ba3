"""Bolts that move: joint coordinates and velocity rows give the same motion."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Sphere
from constraints.kinds.screw import Screw
from constraints.kinds.spherical import Spherical
from physics import Body, Friction, Gravity, Sleeping, World
from physics.joints.articulated_body import ArticulatedBody
from tests.physics.scenes import hinge


def linked(loop, mu):
    """A nut with an eccentric mass on a rod that swings; with `loop`, held by a ball joint while a crank pulls the rod.

    The world, the nut's id, and the screw.
    """
    manager = CollisionManager()
    manager.add(box_mesh(0.02, 0.02, 0.02), at(), movable=False)
    world = World(manager)

    def add(mesh, pose):
        i = manager.add(mesh, pose)
        world.add(i, Body.from_mesh(mesh, 2000.0), [Gravity(), Sleeping(False), Friction(mu)])
        return i

    x, y, o = np.eye(3)[0], np.eye(3)[1], np.zeros(3)
    nut_mesh = box_mesh(0.03, 0.05, 0.04)
    if loop:
        turn = pin.exp3(-0.9 * y)
        crank = add(box_mesh(0.1, 0.02, 0.02), pin.SE3(turn, turn @ (0.05 * x)))
        end, ball = turn @ (0.1 * x), 0.4 * x
        along = (ball - end) / np.linalg.norm(ball - end)
        frame = np.column_stack([along, y, np.cross(along, y)])
        rod = add(box_mesh(0.25, 0.01, 0.01), pin.SE3(frame, end + 0.125 * along))
        nut = add(nut_mesh, pin.SE3(frame, ball))
        joints = hinge(0, crank, o, -0.05 * x) + hinge(crank, rod, 0.05 * x, -0.125 * x)
        joints += [Spherical((0, nut), (Sphere(ball, 0.01), Sphere(o, 0.01)))]
    else:
        rod = add(box_mesh(0.4, 0.01, 0.01), at(x=0.2))
        nut = add(nut_mesh, at(x=0.15, turn=(0.3, 0.0, 0.0)))
        joints = hinge(0, rod, o, -0.2 * x)
    for i in range(nut + 1):
        for j in range(i):
            manager.ignore(i, j)
    thread = (Cylinder(o, x, 0.01), Cylinder(o, x, 0.01))
    screw = Screw((rod, nut), thread, pitch=0.1, flank=0.3).engaged(world.pose(rod), world.pose(nut))
    world.set_joints([*joints, screw])
    return world, nut, screw


@pytest.mark.parametrize("loop", [False, True])
def test_joint_coordinates_and_rows_agree_on_moving_bolts(loop, monkeypatch):
    """Two formulations with nothing in common but the law: what turns and swings, in a tree and in a loop."""
    ends = {}
    for way, steps in (("coordinates", 20), ("rows", 40), ("rows", 160)):
        with monkeypatch.context() as patch:
            if way == "rows":
                patch.setattr(ArticulatedBody, "build", classmethod(lambda cls, *_: None))
            world, nut, screw = linked(loop, 0.1)
            for _ in range(steps):
                world.step(0.2 / steps)
            ends[way, steps] = world.pose(nut).homogeneous
            assert np.abs(screw.residual(*map(world.pose, screw.bodies))).max() < 1e-12
    exact = ends["coordinates", 20]
    coarse, fine = (np.abs(ends["rows", n] - exact).max() for n in (40, 160))
    assert fine < 5e-4 and fine < 0.4 * coarse
