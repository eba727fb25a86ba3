"""Bounds of distances while an object turns, held to distances measured on the way."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import CollisionManager, SurfaceMesh
from collision.query.revolution import least_gaps, profile, screw_axis
from tests.collision.shapes import box


def wall(radius: float, low: float, high: float, sides: int = 48) -> SurfaceMesh:
    """A prism without ends, its corners on a cylinder about z."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    vertices = np.concatenate([np.column_stack([circle, np.full(sides, z)]) for z in (low, high)])
    k, next_ = np.arange(sides), (np.arange(sides) + 1) % sides
    triangles = np.concatenate(
        [np.column_stack([k, next_, sides + k]), np.column_stack([next_, sides + next_, sides + k])]
    )
    return SurfaceMesh(vertices, triangles.astype(np.int32), np.zeros(2 * sides, np.int32))


def _bound(a, b, knots, within: float) -> float:
    found = screw_axis(knots, 1.0)
    assert found is not None
    origin, axis, travel = found
    profiles = [
        profile(mesh, knots[0] if k == 0 else pin.SE3.Identity(), origin, axis) for k, mesh in enumerate((a, b))
    ]
    return float(least_gaps(a, b, (profiles[0], profiles[1]), travel, within).min())


def _measured(a, b, knots, within: float) -> float:
    world = CollisionManager()
    world.add(a, pin.SE3.Identity()), world.add(b, pin.SE3.Identity())
    least = within
    for start, end in pairwise(knots):
        way = pin.log6(start.actInv(end))
        for t in np.linspace(0.0, 1.0, 20):
            world.set_pose(0, start * pin.exp6(way * t))
            rows = world.contacts(within)
            least = min(least, float(rows["distance"].min()) if len(rows) else within)
    return least


def _turned(place: pin.SE3, angles, travels) -> list[pin.SE3]:
    about = [
        pin.SE3(pin.exp3(np.array([0.0, 0.0, a])), np.array([0.0, 0.0, h]))
        for a, h in zip(angles, travels, strict=True)
    ]
    return [place * each * place.inverse() for each in about]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31))
def test_nothing_comes_nearer_than_the_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = pin.SE3.Random()
    place.translation = rng.uniform(-0.02, 0.02, 3)
    steps = int(rng.integers(1, 5))
    knots = _turned(
        place, np.arange(steps + 1) * rng.uniform(0.1, 2.5), np.arange(steps + 1) * rng.uniform(-0.01, 0.01)
    )
    a = box(tuple(rng.uniform(0.004, 0.03, 3))) if seed % 2 else wall(0.006, -0.01, 0.01)
    b = box(tuple(rng.uniform(0.004, 0.03, 3)))
    far = pin.SE3.Random()
    b = type(b)(b.vertices @ far.rotation.T + rng.uniform(-0.05, 0.05, 3), b.triangles, b.surface_of_triangle)
    assert _bound(a, b, knots, 0.05) <= _measured(a, b, knots, 0.05) + 1e-12


@pytest.mark.parametrize("gap", [3e-4, 1e-5])
def test_a_screw_in_its_hole_is_bounded_to_the_facets(gap: float) -> None:
    """Eight turns and 8 mm along, to the flats of the hole."""
    shaft, hole = wall(0.003, -0.02, 0.0), wall((0.003 + gap) / np.cos(np.pi / 48), -0.005, 0.0)
    turns = np.linspace(0.0, 16.0 * np.pi, 45)
    knots = _turned(pin.SE3.Identity(), turns, turns * 1e-3 / (2.0 * np.pi))
    assert _bound(shaft, hole, knots, 0.01) == pytest.approx(gap, rel=1e-6)


def test_ways_about_no_axis_or_two_have_none() -> None:
    step = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.5])), np.zeros(3))
    other = pin.SE3(pin.exp3(np.array([0.0, 0.5, 0.0])), np.zeros(3))
    aside = pin.SE3(np.eye(3), np.array([1e-6, 0.0, 0.0]))
    identity = pin.SE3.Identity()
    assert screw_axis([identity, step, aside * step], 0.1) is None
    assert screw_axis([identity, step, other * step], 0.1) is None
    assert screw_axis([identity, aside], 0.1) is None
    assert screw_axis([identity, step, step * step], 0.1) is not None
