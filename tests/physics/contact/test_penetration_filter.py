"""Points inside a solid are told from points that only lie behind the plane of a face."""

import numpy as np
import pytest
from physics_meshes import at, box_mesh, room

from collision import SurfaceMesh
from physics import Body, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G


@pytest.mark.parametrize("gap", [0.0, 1e-7, -1e-7])
def test_shells_of_one_part_that_touch_are_no_thin_wall(gap):
    """A table whose eight legs are shells of their own, flush with its top, lands on all of them."""
    places = [(0.25 * np.cos(a), 0.25 * np.sin(a), 0.2 - gap) for a in np.pi / 4 * np.arange(8)]
    shells = [(box_mesh(0.6, 0.6, 0.04), (0, 0, 0.42)), *((box_mesh(0.03, 0.03, 0.4), p) for p in places)]
    vertices = np.vstack([m.vertices + p for m, p in shells])
    triangles = np.vstack([m.triangles + 8 * k for k, (m, _) in enumerate(shells)])
    mesh = SurfaceMesh(vertices, triangles, np.repeat(np.arange(6 * len(shells)), 2), "table")
    manager, _ = room()
    table = manager.add(mesh, at(z=0.05, turn=(0.05, 0.03, 0.1)))
    world = World(manager)
    body = Body.from_mesh(mesh, 700.0)
    world.add(table, body, [Gravity(), Friction(0.4), Sleeping(False)])
    for _ in range(100):
        world.step(0.01)
    assert world.pose(table).translation[2] == pytest.approx(gap, abs=1e-9)
    assert np.abs(world.velocity(table)).max() < 1e-9
    carried = sum(touch.impulse for touch in world.touches(table)) / 0.01
    assert carried == pytest.approx([0, 0, body.mass * G], abs=1e-6)
    assert len(world.touches(table)) >= 8
