"""Many bodies at once: each island by itself, nothing sinks, the same bits again."""

from __future__ import annotations

import numpy as np
import pytest
from physics_heap import run
from physics_meshes import at, box_mesh, room

from physics import Body, Elastic, Friction, Gravity, Sleeping, World
from physics.stepping import step as stepping


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


def lowest(world, ids, mesh):
    return min((world.pose(i).translation + mesh.vertices @ world.pose(i).rotation.T)[:, 2].min() for i in ids)


@pytest.mark.slow
def test_steps_in_one_piece_land_and_come_to_rest(monkeypatch):
    """As crowds are stepped, whose impacts are too many to be had each at its time: none falls through."""
    monkeypatch.setattr(stepping, "IMPACTS", 0)
    world, ids, mesh = scattered(6, apart=0.06)
    for _ in range(200):
        world.step(0.01)
        assert lowest(world, ids, mesh) > -1e-3
        if not world.awake:
            break
    assert world.awake == ()
    assert lowest(world, ids, mesh) > -1e-9


def test_a_crowd_has_the_same_bits_again():
    futures = []
    for _ in range(2):
        world, ids, _ = scattered(12, apart=0.06)
        for _ in range(30):
            world.step(0.01)
        futures.append([world.pose(i).homogeneous.tobytes() for i in ids])
    assert futures[0] == futures[1]


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


def heaped(n, seconds):
    """A heap of n cubes falls into a tray: no step leaves an error, or makes energy; the rows of `physics_heap.run`."""
    rows = run(n, seconds)
    column = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    assert column["overlap"].max() < 1e-4
    assert column["residual"].max() < 5e-3
    assert np.diff(column["energy"]).max() < 1e-9 * column["energy"][0]
    return column


@pytest.mark.slow
def test_a_heap_forms_without_overlap_or_energy_and_falls_asleep():
    """More bodies than are solved exactly, in one island: overlaps told by separating axes, not by our contacts."""
    column = heaped(100, 1.5)
    assert column["energy"][-1] < 0.5 * column["energy"][0]
    assert column["awake"][-1] == 0


@pytest.mark.slow
def test_five_hundred_make_a_heap():
    column = heaped(500, 0.6)
    assert column["awake"][-1] == 500
    assert column["energy"][-1] < 0.6 * column["energy"][0]


def test_a_wall_of_many_bricks_rests_as_exactly_as_few():
    """An island of more bodies than are solved exactly while they move."""
    manager, _ = room(100.0)
    world = World(manager)
    mesh = box_mesh(0.1, 0.05, 0.05)
    ids = []
    for row in range(10):
        for k in range(8):
            ids.append(manager.add(mesh, at(x=0.1 * k + 0.05 * (row % 2), z=0.025 + 0.05 * row)))
            world.add(ids[-1], Body.from_mesh(mesh, 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    before = np.array([world.pose(i).homogeneous for i in ids])
    for _ in range(20):
        world.step(0.01)
    assert np.abs(np.array([world.pose(i).homogeneous for i in ids]) - before).max() < 1e-14
