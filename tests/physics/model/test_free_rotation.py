"""Free flight: energy and momentum."""

import pytest
from physics_meshes import at, box_mesh

from collision import CollisionManager
from physics import Body, World


def test_one_radian_a_step_keeps_energy_and_momentum():
    manager = CollisionManager()
    part = manager.add(box_mesh(0.1, 0.2, 0.3), at())
    world = World(manager)
    body = Body.box([0.1, 0.2, 0.3], 1.0)
    world.add(part, body, velocity=[0, 0, 0, 30.0, 80.0, 50.0])
    first = world.energy(part)
    momentum = body.inertia @ [30.0, 80.0, 50.0]
    for _ in range(1000):
        world.step(0.01)
    assert world.energy(part) == pytest.approx(first, rel=1e-12)
    r = world.pose(part).rotation
    assert r @ body.inertia @ r.T @ world.velocity(part)[3:] == pytest.approx(momentum, rel=1e-12)
