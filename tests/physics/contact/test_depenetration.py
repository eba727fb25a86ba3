"""Bodies that start in one another come apart without an explosion."""

import numpy as np
import pytest
from physics_meshes import at, ball_mesh, box_mesh, room, tube_mesh

from collision import SurfaceMesh
from physics import Body, Friction, Gravity, Sleeping, World
from physics.forces.behaviours import STANDARD_GRAVITY as G
from tests.physics.scenes import energy


def test_many_that_start_in_one_another_part_without_an_explosion():
    """A pyramid, each 5 mm deep in the one below: no faster than a fall through all that overlap."""
    manager, _ = room()
    world = World(manager)
    sides = [0.16, 0.12, 0.08]
    ids, expected = [], []
    for k, side in enumerate(sides):
        expected.append(sum(sides[:k]) + side / 2)
        ids.append(manager.add(box_mesh(side, side, side), at(z=expected[-1] - 0.005 * k)))
        world.add(ids[-1], Body.box([side] * 3, 1.0), [Gravity(), Friction(0.5)])
    for _ in range(60):
        world.step(0.01)
        assert max(np.abs(world.velocity(i)[:3]).max() for i in ids) < np.sqrt(2 * G * 0.015)
    assert [world.pose(i).translation[2] for i in ids] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("side", [0.06, 0.1, 0.14])
@pytest.mark.parametrize("sunk", [1e-4, 5e-3, 0.017])
def test_boxes_that_start_flush_in_one_another_are_lifted_apart(side, sunk):
    """The sunk corners lie on the lower box's sides, or nearer to them than to its top: they came through the top."""
    manager, _ = room()
    world = World(manager)
    ids = []
    for size, x, z in ((0.1, 0.0, 0.05), (side, 0.5 * (0.1 - side), 0.1 + 0.5 * side - sunk)):
        ids.append(manager.add(box_mesh(size, size, size), at(x=x, z=z)))
        world.add(ids[-1], Body.box([size] * 3, 1.0), [Gravity(), Friction(0.5)])
    for _ in range(40):
        world.step(0.01)
        assert max(np.abs(world.velocity(i)).max() for i in ids) < G * 0.01  # no faster than a fall of one step
    assert [world.pose(i).translation[2] for i in ids] == pytest.approx([0.05, 0.1 + 0.5 * side], abs=1e-9)


def test_a_deep_start_is_resolved_without_an_explosion():
    manager, _ = room()
    mesh = box_mesh(0.1, 0.1, 0.1)
    box = manager.add(mesh, at(z=0.045))  # 5 mm deep
    world = World(manager)
    world.add(box, Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    for _ in range(100):
        world.step(0.01)
        assert world.energy(box) < 1e-9
    assert world.pose(box).translation == pytest.approx([0, 0, 0.05], abs=1e-9)


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.3, 0.2, 0.1)])
@pytest.mark.parametrize("sunk", [0.5, 0.8])
@pytest.mark.parametrize("mesh", [box_mesh(0.1, 0.1, 0.1), tube_mesh(0.03, 0.05, 0.04), ball_mesh(0.05, 8)])
def test_what_starts_deep_in_the_floor_is_lifted_out_of_it(mesh, sunk, turn):
    """Deeper than contacts are looked for: it used to fall through. The work done is that of lifting it, no more."""
    manager, _ = room()
    pose = at(turn=turn)
    heights = (mesh.vertices @ pose.rotation.T)[:, 2]
    depth = sunk * float(np.ptp(heights))
    pose.translation = np.array([0.0, 0.0, -heights.min() - depth])
    part = manager.add(mesh, pose)
    body = Body.from_mesh(mesh, 1000.0)
    world = World(manager)
    world.add(part, body, [Gravity(), Friction(0.5), Sleeping(False)])
    before = energy(world, part, body)
    last = before + 1.02 * body.mass * G * depth
    for _ in range(60):
        world.step(0.01)
        now = energy(world, part, body)
        assert now <= last + 1e-3 * body.mass * G * 0.05  # for facets that roll and slide, in steps of 10 ms
        last = now
    assert (world.pose(part).translation + mesh.vertices @ world.pose(part).rotation.T)[:, 2].min() > -1e-9


def test_a_correction_pushes_nothing_through_what_carries_it():
    """Cups put into one another, the lower on the floor: it stays there, and the upper one is lifted."""
    profile = [(0.03, 0.0), (0.04, 0.09), (0.038, 0.09), (0.028, 0.002)]
    turns = 2 * np.pi / 24 * np.arange(24)
    ring = np.stack([np.cos(turns), np.sin(turns), np.zeros(24)], axis=1)
    rings = [r * ring + [0, 0, z] for r, z in profile]
    triangles, surfaces = [], []
    for k in range(24):
        m = (k + 1) % 24
        triangles += [(96, m, k), (97, 72 + k, 72 + m)]
        surfaces += [0, 1]
        for j in range(3):
            a, b = 24 * j, 24 * j + 24
            triangles += [(a + k, a + m, b + k), (a + m, b + m, b + k)]
            surfaces += [j + 2] * 2
    cup = SurfaceMesh(np.vstack([*rings, [[0, 0, 0], [0, 0, 0.002]]]), triangles, surfaces, "cup")
    body = Body.from_mesh(cup, 1050.0)
    manager, _ = room()
    world = World(manager)
    ids = [manager.add(cup, at(z=0.0201 * k, turn=(0, 0, 0.1 * k))) for k in range(2)]
    for i in ids:
        world.add(i, body, [Gravity(), Friction(0.3), Sleeping(False)])
    for _ in range(60):
        world.step(0.01)
    assert body.notes == () and manager.penetration(*ids)["depth"].max(initial=0.0) < 1e-9
    assert world.pose(ids[0]).translation == pytest.approx(np.zeros(3), abs=1e-9)
    assert 0.015 < world.pose(ids[1]).translation[2] < 0.03
    assert max(np.abs(world.velocity(i)).max() for i in ids) < 1e-9
