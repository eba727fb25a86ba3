"""Islands side by side, each with its own clock."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from physics import Body, Friction, Gravity, Sleeping, World
from tests.physics.scenes import scattered


def test_islands_side_by_side_do_what_each_does_alone():
    """Two stacks far apart take the very steps that either takes by itself."""

    def stacks(places):
        manager, _ = room(100.0)
        world = World(manager)
        mesh = box_mesh(0.1, 0.1, 0.1)
        ids = []
        for x, n in places:
            for k in range(n):
                i = manager.add(mesh, at(x=x, z=0.05 + 0.1 * k))
                world.add(i, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
                ids.append(i)
        for _ in range(20):
            world.step(0.01)
        return [world.pose(i).homogeneous for i in ids]

    both = stacks([(-20.0, 2), (20.0, 3)])
    alone = stacks([(-20.0, 2)]) + stacks([(20.0, 3)])
    assert np.abs(np.array(both) - np.array(alone)).max() < 1e-15


def test_an_impact_stops_only_what_it_can_reach():
    """A ball that bounces far off leaves the time steps of a sliding box as they are: exact."""
    world, ids, _ = scattered(1)
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = world.collision.add(mesh, at(x=-10.0, z=0.05))
    body = Body.from_mesh(mesh, 1000.0)
    world.add(box, body, [Gravity(), Friction(0.2), Sleeping(False)], velocity=[1.0, 0, 0, 0, 0, 0])
    for _ in range(40):
        world.step(0.01)
    way = 0.4 - 0.5 * 0.2 * 9.80665 * 0.16
    assert world.pose(box).translation == pytest.approx([-10.0 + way, 0, 0.05], abs=1e-12)
    assert world.pose(ids[0]).translation[2] < 0.05
