"""Depth and direction against closed forms."""

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, SurfaceMesh, Tolerance
from collision.query.containment import inside
from collision.query.penetration import deepest_points, penetration
from tests.collision.brute_force import box, point_distances, sphere, turned
from tests.collision.shapes import at

TILT = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 2.0, -0.3]))


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


def tube(sectors: int, radius: float = 0.01, wall: float = 0.001, length: float = 0.03) -> SurfaceMesh:
    return turned(
        [(0, radius - wall), (0, radius), (length, radius), (length, radius - wall), (0, radius - wall)], sectors
    )


BORE = turned([(0, 0.01), (0, 0.03), (0.02, 0.03), (0.02, 0.01), (0, 0.01)], 24)
PEG = turned([(-0.01, 0), (-0.01, 0.0099), (0.03, 0.0099), (0.03, 0)], 24)
CASES = {
    "boxes, deep": (box(2.0, 2.0, 1.0, 3), box(1.0, 1.0, 1.0, 2), at(0.05, 0.02, 0.6)),
    "boxes, tilted": (box(2.0, 2.0, 1.0), box(1.0, 1.0, 1.0), TILT * at(-0.1, -1.6, 0.9)),
    "box in a corner": (box(1.0, 1.0, 1.0), box(0.5, 0.5, 0.5), at(0.6, 0.55, 0.65)),
    "spheres": (sphere(0.5, 12), sphere(0.3, 10), at(0.3, 0.4, 0.4)),
    "peg leans in its bore": (BORE, PEG, pin.SE3(pin.exp3(np.array([0.03, 0.0, 0.0])), np.array([1e-4, 0.0, 0.0]))),
    "peg too thick, turned": (BORE, turned([(-0.01, 0), (-0.01, 0.0102), (0.03, 0.0102), (0.03, 0)], 20), at(0.0)),
    "tubes side by side": (tube(16), tube(16), at(0.0193, 0.0, 0.005)),
    "tubes crossed": (tube(12), tube(12), pin.SE3(pin.exp3(np.array([1.5, 0.2, 0.1])), np.array([0.002, 0.01, 0.015]))),
    "tubes in one place, turned": (tube(16), tube(16), pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.05])), np.zeros(3))),
    "bars crossing": (box(1.0, 0.1, 0.1, 2), box(0.1, 1.0, 0.1, 2), at(0.01, 0.02, 0.08)),
}


def samples(mesh: SurfaceMesh, surface: int, pose: pin.SE3, n: int, rng: np.random.Generator) -> np.ndarray:
    """Points of a surface, moved by the pose: at random over its area, and on its edges and corners."""
    corners = mesh.vertices[mesh.triangles[mesh.triangles_of(surface)]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weights = rng.dirichlet([1.0, 1.0, 1.0], n)
    weights[: n // 4] = np.roll(np.stack([rng.random(n // 4), np.zeros(n // 4), np.zeros(n // 4)], axis=1), 1, axis=1)
    weights[: n // 4, 0] = 1.0 - weights[: n // 4, 1]
    points = np.einsum("nk,nkd->nd", weights, corners[rng.choice(len(corners), n, p=area / area.sum())])
    return np.concatenate([points, corners.reshape(-1, 3)]) @ pose.rotation.T + pose.translation


def deepest_sample(a: SurfaceMesh, s: int, b: SurfaceMesh, t: int, pose: pin.SE3, rng: np.random.Generator) -> float:
    """The definition by sampling: the deepest of many points of t in a to which no other surface is nearer than s."""
    points = samples(b, t, pose, 1500, rng)
    points = points[inside(a, points)]
    if not len(points):
        return 0.0
    own = point_distances(points, a.vertices[a.triangles[a.triangles_of(s)]]).min(axis=1)
    every = point_distances(points, a.vertices[a.triangles]).min(axis=1)
    nearest = own <= every * (1.0 + 1e-12)
    return float(every[nearest].max(initial=0.0))


@pytest.mark.parametrize("case", CASES)
def test_no_sampled_point_is_deeper_and_the_deepest_is_one(case: str) -> None:
    a, b, pose = CASES[case]
    rng = np.random.default_rng(3)
    world = CollisionManager()
    world.add(a, pin.SE3.Identity())
    world.add(b, pose)
    rows = penetration(world, 0, 1)
    assert len(rows) and rows["depth"].max() > 0.0
    np.testing.assert_allclose(np.linalg.norm(rows["direction"], axis=1), 1.0, atol=1e-12)
    for row in rows:
        s, t = int(row["surface_a"]), int(row["surface_b"])
        found = max(deepest_sample(a, s, b, t, pose, rng), deepest_sample(b, t, a, s, pose.inverse(), rng))
        assert found <= row["depth"] * 1.01 + 1e-7 + 1e-12
        if row["depth"] == 0.0:
            continue
        # the witness lies on one of the surfaces and as deep in the other part, nearest to the other surface
        on_a, on_b = row["point"][None], pose.actInv(row["point"])[None]
        to_s = float(point_distances(on_a, a.vertices[a.triangles[a.triangles_of(s)]]).min())
        to_t = float(point_distances(on_b, b.vertices[b.triangles[b.triangles_of(t)]]).min())
        assert min(to_s, to_t) < 1e-12
        assert max(to_s, to_t) == pytest.approx(row["depth"], rel=1e-9)
        solid, point = (a, on_a) if to_t <= to_s else (b, on_b)
        every = float(point_distances(point, solid.vertices[solid.triangles]).min())
        assert every == pytest.approx(row["depth"], rel=1e-9)
        assert inside(solid, point)[0]


@pytest.mark.parametrize("case", CASES)
def test_pairs_of_surfaces_are_as_deep_together_as_each_alone(case: str) -> None:
    """In any order: the depth of one pair is but a guess for the next."""
    a, b, pose = CASES[case]
    world = CollisionManager()
    pairs = np.array([(s, t) for s in range(a.n_surfaces) for t in range(b.n_surfaces)], np.int32)
    alone = np.array([deepest_points(world, (a, b), pose, pair[None])[0, 0] for pair in pairs])
    for order in (np.arange(len(pairs)), np.argsort(alone), np.argsort(-alone)):
        together = np.empty(len(pairs))
        together[order] = deepest_points(world, (a, b), pose, pairs[order])[:, 0]
        assert (np.abs(together - alone) <= 0.01 * np.maximum(together, alone) + 1e-7 + 1e-12).all()


def test_precision_is_the_tolerance_s() -> None:
    a, b, pose = CASES["spheres"]
    depths = []
    for depth in (0.2, 1e-2, 1e-4):
        world = CollisionManager(Tolerance(depth=depth))
        world.add(a, pin.SE3.Identity())
        world.add(b, pose)
        depths.append(float(penetration(world, 0, 1)["depth"][0]))
    assert depths[0] <= depths[2] * (1.0 + 1e-4) and depths[2] <= depths[0] * 1.2 + 2e-6
    assert depths[2] <= depths[1] * 1.01 + 1e-7


def test_what_a_mesh_does_not_wind_about_is_not_deep_in_it() -> None:
    """A cavity, turned inwards, sticks out of its part: there its faces have their backs to the outside.

    A box through one of them is behind it by 0.09; the face is in the box's material by 0.01.
    """
    outer, cavity = box(1.0, 1.0, 1.0), box(0.4, 0.4, 1.6)
    vertices = np.concatenate([outer.vertices, cavity.vertices])
    part = SurfaceMesh(vertices, np.concatenate([outer.triangles, cavity.triangles[:, ::-1] + len(outer.vertices)]))
    world = CollisionManager()
    world.add(part, TILT)
    world.add(box(0.1, 0.1, 0.1), TILT * at(0.2 + 0.04, 0.0, 0.7))
    depths = penetration(world, 0, 1)["depth"]
    assert depths.max() == pytest.approx(0.01, abs=1e-12)


def test_points_as_near_to_two_surfaces_are_behind_either() -> None:
    """A face begins in the plane beyond which the reentrant edge that two surfaces share is no longer nearest."""
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    corners = np.array([[x, y, z] for z in (0, 4) for x, y in outline], dtype=np.float64)
    ends = [(0, c, b) for b, c in ((1, 2), (2, 3), (3, 4), (4, 5))]
    triangles = [*ends, *((6 + c, 6 + b, 6 + a) for a, b, c in ends)]
    triangles += [t for i in range(6) for j in [(i + 1) % 6] for t in ((i, j, 6 + j), (i, 6 + j, 6 + i))]
    surfaces = np.array([0] * 4 + [1] * 4 + [2 + i for i in range(6) for _ in range(2)])
    rng = np.random.default_rng(0)
    for _ in range(200):
        pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * 10 ** rng.uniform(1, 3))
        solid = SurfaceMesh(corners @ pose.rotation.T + pose.translation, np.array(triangles), surfaces)
        face = rng.uniform([0.75, 0.75, 1.9], [0.98, 0.98, 2.1], size=(3, 3))
        face[:, 0] = 1.0, 1.0, face[2, 0] + 0.3
        tip = face.mean(axis=0) + np.array([0.05, 0.0, 0.05])
        sides = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
        outward = np.cross(face[1] - face[0], face[2] - face[0]) @ (tip - face[0]) < 0.0
        body = SurfaceMesh(np.vstack([face, tip]), sides if outward else sides[:, ::-1], np.array([0, 1, 1, 1]))
        found = deepest_points(CollisionManager(), (solid, body), pose, np.array([[5, 0]], np.int32))
        assert found[0, 0] == pytest.approx((1.0 - face[:2, 1]).max(), rel=0.011)
