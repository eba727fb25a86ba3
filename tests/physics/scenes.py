"""Scenes of the physics tests: what falls, hangs and lies."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder, Plane
from constraints.kinds.concentric import Concentric
from constraints.kinds.coplanar import Coplanar
from physics import Behaviour, Body, Elastic, Friction, Gravity, ScriptedPath, Sleeping, World, force
from physics.forces.behaviours import STANDARD_GRAVITY as G


def ball(*behaviours, mass=0.1, velocity=(0.0,) * 6, pose=None):
    """A ball of 2 cm in empty space."""
    manager = CollisionManager()
    i = manager.add(ball_mesh(0.02, 4), at() if pose is None else pose)
    world = World(manager)
    world.add(i, Body.sphere(0.02, mass), behaviours, velocity=velocity)
    return world, i


def run(world, seconds, dt=0.01):
    for _ in range(round(seconds / dt)):
        world.step(dt)


class Draught(Behaviour):
    def wrench(self, view):
        return force([0.005 * np.sin(np.pi * view.time), 0.0, 0.0])


def dropped_box(height=0.5, behaviours=(), **more):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=height))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), *behaviours], **more)
    return world, box


def table(z=0.05):
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=z))
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5)])
    return world, box


def energy(world, i, body):
    """J: kinetic and potential."""
    return world.energy(i) + body.mass * G * world.pose(i).act(np.array(body.center))[2]


def hinge(a, b, at_a, at_b, axis=(0.0, 1.0, 0.0)):
    return [
        Concentric((a, b), (Cylinder(at_a, axis, 0.005), Cylinder(at_b, axis, 0.005))),
        Coplanar((a, b), (Plane(at_a, axis), Plane(at_b, axis))),
    ]


def scattered(n, apart=0.5, seed=3):
    """n cubes that tumble on to a floor, `apart` (m) from one another."""
    rng = np.random.default_rng(seed)
    manager, _ = room(100.0)
    world = World(manager)
    mesh = box_mesh(0.03, 0.03, 0.03)
    ids = []
    for k in range(n):
        i = manager.add(mesh, at(x=apart * k, z=0.06, turn=tuple(rng.normal(size=3))))
        world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.4), Elastic(0.2)])
        ids.append(i)
    return world, ids, mesh


def future(world, steps, dt=0.01):
    """Poses and velocities of all bodies after each step, to the bit."""
    out = []
    for _ in range(steps):
        world.step(dt)
        out.append([(pose.homogeneous.tobytes(), world.velocity(i).tobytes()) for i, pose in world.poses.items()])
    return out


def goes_on_alike(world, steps, dt=0.01, fresh=None):
    """Restored from what was saved, through bytes, the world, and one made anew, have the same future to the bit."""
    saved = pickle.loads(pickle.dumps(world.save()))
    once = future(world, steps, dt)
    for other in (world, fresh) if fresh else (world,):
        other.load(saved)
        assert future(other, steps, dt) == once


LENGTH, THICKNESS = 1.0, 0.001
"""m: a rod"""


def end_of_rod(angle):
    """Inverse mass (2, 2) at the end of a rod of 1 kg, along the floor and off it, and turning (2,) by an impulse."""
    c, s = np.cos(angle), np.sin(angle)
    x, z = 0.5 * (LENGTH * c - THICKNESS * s), -0.5 * (LENGTH * s + THICKNESS * c)
    arm = np.array([z, -x])  # ω about y moves the end by (ω z, -ω x)
    turning = arm * 12.0 / (LENGTH**2 + THICKNESS**2)
    return np.eye(2) + np.outer(arm, turning), turning


def rod_after_blow(elastic, mu, angle, along, floor_elastic=None, lift=0.0):
    """Velocity (along, off the floor) and turning of a rod after its end struck a floor; its kinetic energy over that
    before the blow; and how fast its end parts, m/s.

    angle: rad, of the rod to the floor; along: m/s; lift: m/s at which the floor comes up, the rod the less down.
    """
    manager = CollisionManager()
    floor = manager.add(box_mesh(4.0, 4.0, 0.2), at(z=-0.1), movable=False)
    mesh = box_mesh(LENGTH, THICKNESS, THICKNESS)
    turn = (0.0, angle, 0.0)
    corner = np.array([0.5 * LENGTH, 0.0, -0.5 * THICKNESS])
    rod = manager.add(mesh, at(z=0.001 - (pin.exp3(np.array(turn)) @ corner)[2], turn=turn))
    world = World(manager)
    rules = [floor_elastic] if floor_elastic else []
    if lift:
        rules.append(ScriptedPath(lambda time: at(z=-0.1 + lift * time)))
    world.add(floor, None, rules)
    body = Body.from_mesh(mesh, 1e6)
    assert body.mass == pytest.approx(1.0)
    start = [along, 0.0, lift - 1.0, 0.0, 0.0, 0.0]
    world.add(rod, body, [Friction(mu), elastic, Sleeping(False)], velocity=start)
    before = world.energy(rod)
    world.step(0.0012)
    v = world.velocity(rod)
    end = v[2] - lift + np.cross(v[3:], world.pose(rod).rotation @ corner)[2]
    return np.array([v[0], v[2] - lift, v[4]]), world.energy(rod) / before, end
