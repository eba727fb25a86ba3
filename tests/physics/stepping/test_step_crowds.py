"""Many bodies at once: each island by itself, nothing sinks, the same bits again."""

import numpy as np
import pytest
from physics_heap import run
from physics_meshes import at, box_mesh, room

from physics import Body, Friction, Gravity, Sleeping, World
from physics.stepping import step as stepping
from tests.physics.scenes import scattered


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
