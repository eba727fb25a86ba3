"""Coaxial rings with the same facets: every edge of the one meets its like of the other, and none may give way."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, cylinder_mesh, tube_mesh

from collision import CollisionManager
from constraints.geometry.surfaces import Cylinder
from constraints.kinds.concentric import Concentric
from physics import Body, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G

INNER, OUTER, HEIGHT = 0.00402, 0.008, 0.024
Z = np.array([0.0, 0.0, 1.0])

# (facets, turn of the upper ring in facets, further turn in rad, lean of the axis in degrees, friction)
STARTS = [
    (n, part, offset, lean, mu)
    for (n, part), offset, (lean, mu) in itertools.product(
        [(24, 0.0), (48, 0.5), (72, 1.0)], [0.0, 1e-12, -1e-9, 1e-6, 1e-5, -1e-4, 1e-3], [(0.0, 0.3), (8.0, 0.0)]
    )
]


ARMED = Body(0.2, [0.01, 0.0, 0.0], np.diag([2e-5, 5e-5, 5e-5]))


def rings(n, part, offset, lean, *behaviours, body=ARMED, joined=True):
    """A ring 3 mm above another on one axis, with an arm's weight to one side; the world and the upper one's id."""
    tilt = at(turn=(np.radians(lean), 0.0, 0.0))
    manager = CollisionManager()
    mesh = tube_mesh(INNER, OUTER, HEIGHT, n)
    known = {0: Cylinder(np.zeros(3), Z, INNER), 1: Cylinder(np.zeros(3), Z, OUTER)}
    lower = manager.add(mesh, tilt, movable=False)
    pin_mesh = cylinder_mesh(0.004, 0.1, n)
    rod = manager.add(pin_mesh, tilt, movable=False)
    upper = manager.add(mesh, tilt * at(z=HEIGHT + 0.003, turn=(0.0, 0.0, part * 2 * np.pi / n + offset)))
    world = World(manager)
    world.add(lower, None, [], known)
    world.add(rod, None, [], {0: Cylinder(np.zeros(3), Z, 0.004)})
    world.add(upper, body, [Gravity(), *behaviours, Sleeping(False)], known)
    if joined:
        world.set_joints([Concentric((rod, upper), (Cylinder(np.zeros(3), Z, 0.004), Cylinder(np.zeros(3), Z, INNER)))])
        manager.ignore(rod, upper)
    return world, upper, tilt, body


@pytest.mark.parametrize("n, part, offset, lean, mu", STARTS)
def test_a_ring_comes_to_rest_on_its_like(n, part, offset, lean, mu):
    world, upper, tilt, body = rings(n, part, offset, lean, Friction(mu))
    energy = [np.inf]
    for _ in range(20):
        world.step(1 / 60)
        height = tilt.actInv(world.pose(upper)).translation[2] - HEIGHT
        assert height > -1e-9
        energy.append(world.energy(upper) + body.mass * G * world.pose(upper).act(body.center)[2])
        assert energy[-1] < energy[-2] + 1e-4 * body.mass * G * 0.01
    assert height == pytest.approx(0.0, abs=1e-9)


def test_a_ring_without_friction_swings_freely_on_its_like():
    """It is a pendulum about the leaning axis: the period is that of its arm, and it turns as high as it began."""
    world, upper, tilt, body = rings(48, 0.25, 0.0, 8.0, Friction(0.0))
    world.set_pose(upper, tilt * at(z=HEIGHT, turn=(0.0, 0.0, np.radians(-70.0))))
    turn = []
    dt = 1 / 120
    while world.time < 2.0:
        world.step(dt)
        q = tilt.actInv(world.pose(upper))
        turn.append(np.arctan2(q.rotation[1, 0], q.rotation[0, 0]) + np.pi / 2)
        assert abs(q.translation[2] - HEIGHT) < 1e-9
    crossing = [k + turn[k] / (turn[k] - turn[k + 1]) for k in range(len(turn) - 1) if turn[k] * turn[k + 1] < 0.0]
    arm, amplitude = body.center[0], np.radians(20.0)
    about = body.inertia[2, 2] + body.mass * arm**2
    period = 2 * np.pi * np.sqrt(about / (body.mass * G * np.sin(np.radians(8.0)) * arm))
    period *= 1.0 + amplitude**2 / 16.0 + 11.0 * amplitude**4 / 3072.0
    assert 2.0 * np.diff(crossing).mean() * dt == pytest.approx(period, rel=1e-3)
    assert max(np.abs(turn)) == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.parametrize("turn", [0.0, 1e-9, 3e-4])
def test_a_ring_slides_down_its_pin_and_rests(turn):
    """No joint: the bore guides it by contact alone, with 20 µm of play."""
    steel = Body.from_mesh(tube_mesh(INNER, OUTER, HEIGHT, 48), "steel")
    world, upper, _, _ = rings(48, 0.0, turn, 0.0, Friction(0.2), body=steel, joined=False)
    for _ in range(40):
        world.step(1 / 60)
        assert world.pose(upper).translation[2] - HEIGHT > -1e-9
    assert world.pose(upper).translation[2] - HEIGHT == pytest.approx(0.0, abs=1e-9)
    assert np.hypot(*world.pose(upper).translation[:2]) < 2e-5 * (1 + 1e-6)
    assert pin.log3(world.pose(upper).rotation)[2] == pytest.approx(turn, abs=1e-3)
