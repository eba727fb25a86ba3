"""Edges: across round bars at the bar's radius, wherever its facets are; and of rims of facets, wherever they cross."""

import numpy as np
import pinocchio as pin
import pytest
from physics_meshes import at, box_mesh, cylinder_mesh, tube_mesh

from collision import CollisionManager, SurfaceMesh
from collision.query.signed_distance import signed_distances
from constraints.geometry.surfaces import Cylinder
from physics import Body, Elastic, Friction, Gravity, Sleeping, World
from physics.contact.edge_contacts import _nearest_to_axis
from physics.contact.narrow_phase import find
from physics.model.shapes import make_shape, pack

RADIUS, LENGTH, SIDES = 0.01, 0.3, 12
FACET = RADIUS * (1.0 - np.cos(np.pi / SIDES))
"""m by which the middle of a facet lies below the round"""
RIDGE = 0.02 * np.sqrt(2.0)
Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("seed", range(30))
def test_the_nearest_point_of_an_edge_to_an_axis(seed):
    """Against a fine search along the edge."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    cylinder = np.array([*rng.normal(size=3), *(axis / np.linalg.norm(axis)), 0.1, 1.0, -1.0, 1.0, 1.0])
    p0, p1 = rng.normal(size=(2, 3))
    q = np.empty(3)
    within = _nearest_to_axis(p0, p1, cylinder, q)
    s = np.linspace(0.0, 1.0, 100_001)
    off = p0 + s[:, None] * (p1 - p0) - cylinder[:3]
    far = np.linalg.norm(off - np.outer(off @ cylinder[3:6], cylinder[3:6]), axis=1)
    k = int(np.argmin(far))
    assert within == (0 < k < len(s) - 1)
    if within:
        assert q == pytest.approx(p0 + s[k] * (p1 - p0), abs=2e-5 * np.linalg.norm(p1 - p0))


def test_an_edge_along_the_axis_has_no_nearest_point():
    cylinder = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1, 1.0, -1.0, 1.0, 1.0])
    assert not _nearest_to_axis(np.array([0.1, 0, -1.0]), np.array([0.1, 1e-11, 1.0]), cylinder, np.empty(3))


def on_ridges(turn, height=0.001, known=True, bar_first=True, behaviours=None, velocity=(0.0,) * 6):
    """A bar along x above the upper edges, along y, of two boxes; its facets turned by `turn`. The world and its id."""
    manager = CollisionManager()
    lying = pin.SE3(pin.exp3(np.array([0.0, np.pi / 2, 0.0])) @ pin.exp3(np.array([0.0, 0.0, turn])), np.zeros(3))
    lying.translation = np.array([0.0, 0.0, RIDGE + RADIUS + height])
    mesh = cylinder_mesh(RADIUS, LENGTH, SIDES)
    ridge = box_mesh(0.04, 1.0, 0.04)
    if bar_first:
        bar = manager.add(mesh, lying)
    for x in (-0.1, 0.1):
        manager.add(ridge, at(x=x, turn=(0.0, np.pi / 4, 0.0)), movable=False)
    if not bar_first:
        bar = manager.add(mesh, lying)
    world = World(manager)
    side = {0: Cylinder(np.zeros(3), [0.0, 0.0, 1.0], RADIUS)} if known else {}
    body = Body(0.5, [0.0, 0.0, 0.0], np.diag([4e-3, 4e-3, 0.25 * RADIUS**2]))  # ½ m r² about its axis
    world.add(bar, body, [Gravity(), Sleeping(False), *(behaviours or [Friction(0.5)])], side, velocity)
    return world, bar


@pytest.mark.parametrize("bar_first", [True, False])
@pytest.mark.parametrize("turn", [0.0, 0.01, np.pi / SIDES, 1.0])
def test_a_bar_rests_on_edges_at_its_radius(turn, bar_first):
    world, bar = on_ridges(turn, bar_first=bar_first)
    for _ in range(30):
        world.step(0.01)
    assert world.pose(bar).translation == pytest.approx([0, 0, RIDGE + RADIUS], abs=1e-9)
    assert abs(world.velocity(bar)).max() < 1e-9


def test_a_bar_that_is_not_known_to_be_round_rests_on_its_facets():
    for turn, low in ((0.0, 0.0), (np.pi / SIDES, FACET)):
        world, bar = on_ridges(turn, known=False)
        for _ in range(30):
            world.step(0.01)
        assert world.pose(bar).translation[2] == pytest.approx(RIDGE + RADIUS - low, abs=1e-9)


def test_a_bar_rolls_on_edges_at_one_height_and_speed():
    """Level and without slip: v stays, ω = v / r, over three turns of its facets."""
    world, bar = on_ridges(0.1, height=0.0, velocity=(0.0, 0.2, 0.0, -0.2 / RADIUS, 0.0, 0.0))
    for _ in range(100):
        world.step(0.01)
        assert world.pose(bar).translation[2] == pytest.approx(RIDGE + RADIUS, abs=1e-9)
    assert world.velocity(bar) == pytest.approx([0, 0.2, 0, -0.2 / RADIUS, 0, 0], abs=1e-6)
    assert world.pose(bar).translation[1] == pytest.approx(0.2, abs=1e-6)


def test_a_bar_rebounds_from_edges_where_it_is_round():
    """It falls 1 mm and comes back to e² of that, whichever way its facets look."""
    world, bar = on_ridges(np.pi / SIDES, behaviours=(Friction(0.0), Elastic(0.8)))
    highest = []
    for _ in range(70):
        world.step(0.0005)
        highest.append(world.pose(bar).translation[2] - RIDGE - RADIUS)
    low = int(np.argmin(highest))
    assert min(highest) > -1e-9
    assert max(highest[low:]) == pytest.approx(0.64e-3, rel=1e-3)


@pytest.mark.parametrize("turn", [0.05, np.pi / SIDES])
def test_a_box_rocks_on_the_round_of_a_fixed_bar(turn):
    """The other way about: a box's lower edge across a fixed bar, at its radius, the box held level by a second one."""
    manager = CollisionManager()
    lying = pin.exp3(np.array([0.0, np.pi / 2, 0.0])) @ pin.exp3(np.array([0.0, 0.0, turn]))
    mesh = cylinder_mesh(RADIUS, LENGTH, SIDES)
    side = {0: Cylinder(np.zeros(3), [0.0, 0.0, 1.0], RADIUS)}
    bars = [manager.add(mesh, pin.SE3(lying, np.array([0.0, y, 0.0])), movable=False) for y in (-0.1, 0.1)]
    box = manager.add(box_mesh(0.04, 0.4, 0.04), at(z=RADIUS + RIDGE + 1e-4, turn=(0.0, np.pi / 4, 0.0)))
    world = World(manager)
    for bar in bars:
        world.add(bar, None, [], side)
    world.add(box, Body.from_mesh(box_mesh(0.04, 0.4, 0.04), 1000.0), [Gravity(), Friction(0.5), Sleeping(False)])
    for _ in range(10):  # it would tip over its edge in the end
        world.step(0.01)
    assert world.pose(box).translation == pytest.approx([0, 0, RADIUS + RIDGE], abs=1e-9)


DEPTH = 3e-5
"""m"""


def sunk_at_a_vertex(rng, peg, hole):
    """A pose of `hole` at which a vertex of its lower bore rim has sunk a little into an edge of the peg's upper rim.

    None where the two do not touch there alone.
    """
    top = [e for e in peg.edges if (peg.vertices[e, 2] > 0.0).all() and np.hypot(*peg.vertices[e[0], :2]) > 0.007]
    low = [v for v in hole.vertices if v[2] < 0.0 and np.hypot(*v[:2]) < 0.009]
    p0, p1 = peg.vertices[top[rng.integers(len(top))]]
    spot = p0 + rng.uniform(0.2, 0.8) * (p1 - p0)
    out = np.array([*(spot[:2] / np.hypot(*spot[:2])), 0.0])
    vertex = low[rng.integers(len(low))]
    facing = np.arctan2(out[1], out[0]) - np.arctan2(vertex[1], vertex[0])
    lean = pin.exp3(rng.uniform(0.1, 0.9) * np.array([out[1], -out[0], 0.0]) + rng.normal(size=3) * 0.3)
    turn = lean @ pin.exp3(np.array([0.0, 0.0, facing]))
    pose = pin.SE3(turn, spot - turn @ vertex - DEPTH * (0.7 * out + 0.7 * Z))
    sunk = 0.0
    for shape, other, move in ((hole, peg, pose), (peg, hole, pose.inverse())):
        ends = shape.vertices[shape.edges]
        part = np.linspace(0.0, 1.0, 41)[:, None, None]
        points = (ends[:, 0] + part * (ends[:, 1] - ends[:, 0])).reshape(-1, 3) @ move.rotation.T + move.translation
        solid = SurfaceMesh(other.vertices, other.triangles, np.zeros(len(other.triangles), np.int64))
        near = points[(np.abs(points) < 1.01 * np.abs(other.vertices).max(axis=0)).all(axis=1)]
        sunk = max(sunk, -signed_distances(solid, near).min(initial=0.0))
    return pose if 0.1 * DEPTH < sunk < 3.0 * DEPTH else None


def test_rims_of_facets_that_have_sunk_in_at_a_vertex_are_seen():
    """Where a rim's facets meet, the crossing of a sunk edge with the one lies past its end, and with the other too."""
    rng = np.random.default_rng(0)
    meshes = tube_mesh(0.004, 0.008, 0.01, 24), tube_mesh(0.0085, 0.014, 0.004, 24)
    peg, hole = (make_shape(mesh) for mesh in meshes)
    shapes = pack([peg, hole])
    pairs = np.array([(0, i, 1, j) for i in range(4) for j in range(4)])
    reach = np.full(len(pairs), 2e-4)
    stamps = [np.zeros(len(items) + 1, np.int64) for items in (shapes.vertices, shapes.edges, shapes.kinds)]
    ints, reals = np.empty((4000, 6), np.int64), np.empty((4000, 7))
    seen, unseen = 0, 0
    for _ in range(400):
        pose = sunk_at_a_vertex(rng, peg, hole)
        if pose is None:
            continue
        n = find(
            pairs, np.stack([np.eye(3), pose.rotation]), np.stack([np.zeros(3), pose.translation]),
            np.arange(2), shapes, reach, reach, ints, reals, *stamps,
        )  # fmt: skip
        if (reals[:n, 6] < 0.0).any():
            seen += 1
        else:
            unseen += 1
    assert seen > 20
    assert unseen == 0
