"""Depth and direction against closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager
from collision.penetration import penetration
from tests.collision.reference import box, sphere, turned

TILT = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 2.0, -0.3]))


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


@pytest.mark.parametrize("cells", [1, 5])
@pytest.mark.parametrize("d", [1e-6, 1e-3, 0.05])
def test_box_on_box_overlaps_by_d(d: float, cells: int) -> None:
    world = CollisionManager()
    world.add(box(2.0, 2.0, 1.0, cells), TILT)
    world.add(box(1.0, 1.0, 1.0, cells), TILT * at(0.05, 0.02, 1.0 - d))
    rows = penetration(world, 0, 1)
    sides = rows[rows["surface_a"] == 5]
    assert sorted(sides["surface_b"]) == [0, 1, 2, 3]
    np.testing.assert_allclose(sides["depth"], d, atol=2e-7)
    np.testing.assert_allclose(sides["direction"], np.tile(TILT.rotation[:, 2], (4, 1)), atol=1e-6)
    for row in sides:
        local = (TILT * at(0.0, 0.0, 0.5)).actInv(row["point"])
        assert local[2] == pytest.approx(-d, abs=2e-7)


@pytest.mark.parametrize("d", [2e-4, 0.02, 0.2])
def test_sphere_in_plane(d: float) -> None:
    world = CollisionManager()
    world.add(box(6.0, 6.0, 3.0), TILT)
    world.add(sphere(0.5, 32), TILT * at(0.4, 0.3, 1.5 + 0.5 - d))
    (row,) = penetration(world, 0, 1)
    assert row["depth"] == pytest.approx(d, abs=2e-7)
    np.testing.assert_allclose(row["direction"], TILT.rotation[:, 2], atol=1e-6)


def test_peg_reaches_50_um_into_the_wall_of_its_bore() -> None:
    sectors, r_bore, r_peg, into = 96, 0.010, 0.0099, 50e-6
    bore = turned([(0, r_bore), (0, 0.03), (0.02, 0.03), (0.02, r_bore), (0, r_bore)], sectors)
    peg = turned([(-0.01, 0), (-0.01, r_peg), (0.03, r_peg), (0.03, 0)], sectors)
    world = CollisionManager()
    world.add(bore, TILT)
    world.add(peg, TILT * at(r_bore - r_peg + into))
    (row,) = [r for r in penetration(world, 0, 1) if (r["surface_a"], r["surface_b"]) == (3, 1)]
    # a vertex of the peg beyond a vertex of the bore: the nearest wall is a facet half a sector to the side
    assert row["depth"] == pytest.approx(into * np.cos(np.pi / sectors), abs=2e-7)
    assert row["direction"] @ TILT.rotation[:, 0] == pytest.approx(-1.0, abs=1e-2)


def test_crossing_bars_have_no_corner_inside_each_other() -> None:
    world = CollisionManager()
    world.add(box(1.0, 0.1, 0.1), at(0.0))
    world.add(box(0.1, 1.0, 0.1), at(0.0, 0.0, 0.098))
    rows = penetration(world, 0, 1)
    assert len(rows) >= 4
    assert rows["depth"].max() == pytest.approx(0.002, abs=2e-7)


def test_depth_grows_with_the_way_in_and_is_zero_when_touching() -> None:
    world = CollisionManager()
    world.add(box(2.0, 2.0, 1.0), at(0.0))
    world.add(sphere(0.3, 20), at(0.0))
    depths = []
    for d in np.linspace(0.0, 0.4, 9):
        world.set_pose(1, at(0.1, 0.2, 0.5 + 0.3 - d))
        depths.append(float(penetration(world, 0, 1)["depth"][0]))
    assert depths[0] <= 1e-15
    assert (np.diff(depths) > 0.0).all()


def test_ignored_surfaces_are_left_out() -> None:
    world = CollisionManager()
    world.add(box(2.0, 2.0, 1.0), at(0.0))
    world.add(box(1.0, 1.0, 1.0), at(0.0, 0.0, 0.9))
    before = penetration(world, 1, 0)
    world.ignore_surfaces(0, [5], 1, [0, 1])
    after = penetration(world, 0, 1)
    assert len(before) == len(after) + 2
