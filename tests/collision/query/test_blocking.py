"""The blocking table against a lattice, its legs against sampled poses, and what may be grazed."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import CollisionManager, SurfaceMesh, Tolerance, colliding_surfaces
from collision.query.blocking import PRESSED, Sweeps

TOLERANCE = Tolerance(linear=1e-6, slop=0.01)
AXES = [np.array(d, np.float64) for d in product((-1, 0, 1), repeat=3) if sum(map(abs, d)) == 1]


def block(low, high):
    """A box between two corners (m), a surface a side."""
    corners = np.array(list(product(*zip(low, high, strict=True))), np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return SurfaceMesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.repeat(np.arange(6), 2))


def joined(meshes):
    """Several boxes as one mesh."""
    vertices, triangles, surfaces, v, s = [], [], [], 0, 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        triangles.append(mesh.triangles + v)
        surfaces.append(mesh.surface_of_triangle + s)
        v, s = v + len(mesh.vertices), s + mesh.n_surfaces
    return SurfaceMesh(np.concatenate(vertices), np.concatenate(triangles), np.concatenate(surfaces))


def at(*x):
    return pin.SE3(np.eye(3), np.array(x, np.float64))


def sweeps(*meshes, excuse=lambda i, j, start, end: ()):
    return Sweeps(meshes, [pin.SE3.Identity()] * len(meshes), TOLERANCE, excuse)


cells = st.sets(st.tuples(*[st.integers(0, 2)] * 3), min_size=1, max_size=4)


@settings(max_examples=25, deadline=None)
@given(cells, cells)
def test_the_table_of_cubes_is_that_of_the_lattice(one, two):
    two = two - one
    if not two:
        return
    unit = 0.01
    mine, theirs = (
        joined([block(np.array(c) * unit, (np.array(c) + 1) * unit) for c in sorted(s)]) for s in (one, two)
    )
    table = sweeps(mine, theirs).table(AXES, 1e-3)
    for k, axis in enumerate(AXES):
        blocked = any(tuple(int(v) for v in np.array(c) + n * axis) in two for c in one for n in range(1, 4))
        assert table[k, 0, 1] == blocked
        back = next(m for m, other in enumerate(AXES) if np.array_equal(other, -axis))
        assert table[k, 1, 0] == table[back, 0, 1]


def test_a_stop_is_where_the_gap_closes_and_names_the_sides():
    s = sweeps(block((0, 0, 0), (0.01, 0.01, 0.01)), block((0.03, 0, 0), (0.04, 0.01, 0.01)))
    stop = s.straight(0, 1, np.array([1.0, 0.0, 0.0]), 1e-3)
    assert stop is not None
    reached = stop.t * (0.04 + 1e-3)
    assert 0.02 - 2e-6 < reached < 0.02
    assert {(int(r["surface_a"]), int(r["surface_b"])) for r in stop.contacts} >= {(1, 0)}
    assert s.straight(0, 1, np.array([-1.0, 0.0, 0.0]), 1e-3) is None


def test_edges_that_pass_in_one_plane_are_grazed_and_do_not_stop():
    """A slider on a rail as long as itself, flush with it: its back edge passes the rail's front edge."""
    rail = block((0, 0, -0.01), (0.02, 0.04, 0.0))
    slider = joined([block((0, 0, 0), (0.02, 0.04, 0.01))])
    assert sweeps(slider, rail).straight(0, 1, np.array([0.0, 1.0, 0.0]), 1e-3) is None


@pytest.mark.parametrize("gap", [2e-5, 4e-6])
def test_a_narrow_gap_is_passed_and_a_step_in_it_is_not(gap):
    channel = joined([block((0, -0.01, 0), (0.05, 0, 0.01)), block((0, 0.01 + 2 * gap, 0), (0.05, 0.02, 0.01))])
    peg = block((0, gap, 0), (0.01, 0.01 + gap, 0.01))
    assert sweeps(peg, channel).straight(0, 1, np.array([1.0, 0.0, 0.0]), 1e-3) is None
    step = joined([channel, block((0.03, 0, 0), (0.04, 2 * gap, 0.01))])
    stop = sweeps(peg, step).straight(0, 1, np.array([1.0, 0.0, 0.0]), 1e-3)
    assert stop is not None
    assert stop.t * 0.051 == pytest.approx(0.02, abs=3e-6)


def test_however_many_legs_press_surfaces_go_no_deeper_than_the_bound():
    s = sweeps(block((0.005, 0.005, 0.01), (0.015, 0.015, 0.02)), block((0, 0, 0), (0.02, 0.02, 0.01)))
    here, lowest = pin.SE3.Identity(), 0.0
    for _ in range(40):
        end = at(0.0, 0.0, -8e-9) * here
        stop = s.stop(0, 1, (here, end))
        here = end if stop is None else here * pin.exp6(pin.log6(here.actInv(end)) * stop.t)
        lowest = min(lowest, here.translation[2])
    assert -PRESSED * TOLERANCE.slop * TOLERANCE.linear <= lowest < 0.0
    assert stop is not None and {(int(r["surface_a"]), int(r["surface_b"])) for r in stop.contacts} >= {(4, 5)}
    assert s.stop(0, 1, (here, at(0.0, 0.0, 1e-3) * here)) is None  # it may still be lifted off


def test_an_excuse_leaves_surfaces_out_and_none_stops_the_leg():
    a, b = block((0, 0, 0), (0.01, 0.01, 0.01)), block((0.02, 0, 0), (0.03, 0.01, 0.01))
    every = tuple(range(6))
    assert sweeps(a, b, excuse=lambda i, j, s, e: [(every, every)]).straight(0, 1, AXES[-1], 1e-3) is None
    held = sweeps(a, b, excuse=lambda i, j, s, e: None).straight(0, 1, AXES[-1], 1e-3)
    assert held is not None and held.t == 0.0 and len(held.contacts) == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_no_pose_before_a_stop_of_a_turning_leg_collides(seed):
    random = np.random.default_rng(seed)
    a = joined([block((-0.01, -0.002, -0.002), (0.01, 0.002, 0.002)), block((0.006, 0.0, 0.0), (0.01, 0.012, 0.002))])
    place = random.uniform(-0.02, 0.02, 3)
    b = block(place, place + random.uniform(0.002, 0.02, 3))
    if len(colliding_surfaces(a, b, pin.SE3.Identity())):
        return
    end = pin.SE3(pin.exp3(random.uniform(-1, 1, 3)), random.uniform(-0.03, 0.03, 3))
    stop = sweeps(a, b).stop(0, 1, (pin.SE3.Identity(), end))
    until = 1.0 if stop is None else stop.t
    way = pin.log6(end)
    for s in np.linspace(0.0, until, 80):
        pose = pin.exp6(way * s)
        if len(colliding_surfaces(a, b, pose.inverse())):  # grazed: no deeper than a tenth of the tolerance
            world = CollisionManager()
            i, j = world.add(a, pose), world.add(b, pin.SE3.Identity())
            assert world.penetration(i, j)["depth"].max() <= 0.1 * TOLERANCE.linear


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_what_stays_clear_of_a_turn_changes_no_stop(seed: int) -> None:
    """A block is screwed along a random axis past another one: the same stop as of every pair of surfaces."""
    rng = np.random.default_rng(seed)
    axis = pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.01, 0.01, 3))
    angle, travel = rng.uniform(0.5, 2.0), rng.uniform(-0.004, 0.004)
    turns = [pin.SE3(pin.exp3(np.array([0.0, 0.0, k * angle])), np.array([0.0, 0.0, k * travel])) for k in range(6)]
    knots = tuple(axis * each * axis.inverse() for each in turns)
    sizes = rng.uniform(0.003, 0.02, (2, 3))
    meshes = [block(-size / 2, size / 2) for size in sizes]
    poses = [axis, pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), axis.translation + rng.uniform(-0.02, 0.02, 3))]
    plain = Sweeps(meshes, poses, Tolerance())
    plain._clear_of_turn = lambda i, j, knots: ()  # type: ignore[method-assign]
    a, b = plain.stop(0, 1, knots), Sweeps(meshes, poses, Tolerance()).stop(0, 1, knots)
    assert (a is None) == (b is None)
    if a is not None and b is not None:
        assert a.leg + a.t == pytest.approx(b.leg + b.t, abs=1e-3)  # a sweep ends within its slop


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_only_what_is_ahead_or_beside_may_stop_a_path(seed: int) -> None:
    """Every object that stops a straight path is among those ahead, and every one that stops any path beside it."""
    rng = np.random.default_rng(seed)
    meshes = [block(-size / 2, size / 2) for size in rng.uniform(0.003, 0.02, (7, 3))]
    poses = [pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.03, 0.03, 3)) for _ in meshes]
    many = Sweeps(meshes, poses, TOLERANCE)
    direction = rng.normal(size=3)
    direction = AXES[rng.integers(6)] if rng.random() < 0.5 else direction / np.linalg.norm(direction)
    knots = pin.SE3.Identity(), pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.03, 0.03, 3))
    ahead, beside = many.ahead(0, direction).tolist(), many.beside(0, knots).tolist()
    assert 0 not in ahead and 0 not in beside
    corners = [mesh.vertices @ pose.rotation.T + pose.translation for mesh, pose in zip(meshes, poses, strict=True)]
    for j in range(1, len(meshes)):
        far = max(0.0, float((corners[j] @ direction).max() - (corners[0] @ direction).min())) + 1e-3
        straight = pin.SE3.Identity(), pin.SE3(np.eye(3), far * direction)
        assert j in ahead or many.stop(0, j, straight) is None
        assert j in beside or many.stop(0, j, knots) is None
        assert np.allclose(many.extent(j, direction), [(corners[j] @ direction).min(), (corners[j] @ direction).max()])


def test_the_hull_of_a_mesh_has_its_extents():
    rng = np.random.default_rng(0)
    pieces = [block(p, p + rng.uniform(0.001, 0.01, 3)) for p in rng.uniform(-0.02, 0.02, (30, 3))]
    mesh, pose = joined(pieces), pin.SE3(pin.exp3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-0.1, 0.1, 3))
    one = Sweeps([mesh], [pose], TOLERANCE)
    assert len(one.corners(0)) < len(mesh.vertices)
    for direction in rng.normal(size=(50, 3)):
        heights = (mesh.vertices @ pose.rotation.T + pose.translation) @ direction
        assert np.allclose(one.extent(0, direction), [heights.min(), heights.max()], rtol=0.0, atol=1e-14)
