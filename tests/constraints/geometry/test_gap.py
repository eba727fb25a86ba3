"""The gap of trimmed faces, held to meshes of a hundredth of the deflection, and to closed forms."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from collision import CollisionManager
from constraints.geometry.gap import SAME, faces_of, gap, moved
from vpframe.scene import modelling as m
from vpframe.scene.deflection import deflections

FINE = {"deflection": 1e-6, "angular": 0.05}
SOLIDS = {
    "ball": lambda: m.sphere(4e-3),
    "rod": lambda: m.cylinder(3e-3, 0.012).translated(0.0, 0.0, -0.006),
    "frustum": lambda: m.cone(5e-3, 2e-3, 6e-3).translated(0.0, 0.0, -3e-3),
    "point": lambda: m.cone(4e-3, 0.0, 6e-3).translated(0.0, 0.0, -2e-3),
    "ring": lambda: m.torus(5e-3, 1.5e-3),
    "brick": lambda: m.box(8e-3, 6e-3, 4e-3).translated(-4e-3, -3e-3, -2e-3),
    "washer": lambda: (m.cylinder(6e-3, 3e-3) - m.cylinder(3e-3, 3e-3)).translated(0.0, 0.0, -1.5e-3),
    "cup": lambda: m.cylinder(6e-3, 5e-3).translated(0.0, 0.0, -5e-3) - m.sphere(4.5e-3),
    "rounded": lambda: m.box(8e-3, 6e-3, 4e-3).translated(-4e-3, -3e-3, -2e-3).filleted(1e-3),
    "crossbored": lambda: m.cylinder(4e-3, 0.012).translated(0.0, 0.0, -6e-3)
    - m.cylinder(2e-3, 0.02).translated(0.0, 0.0, -0.01).rotated([1.0, 0.0, 0.0], np.pi / 2),
}  # fmt: skip
NEAR = 3e-4
"""m"""
kinds, seeds = st.sampled_from(sorted(SOLIDS)), st.integers(0, 2**32 - 1)
slow = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@cache
def shapes(kind):
    """The shape with facets of 0.1 mm and its faces, and the mesh with facets of 1 µm."""
    solid = SOLIDS[kind]()
    shape, fine = m.shape(solid), m.shape(solid, **FINE)
    senses = [-1 if s.orientation == "concave" else 1 for s in shape.surfaces]
    faces = faces_of(shape.mesh, [s.geometry for s in shape.surfaces], senses, deflections(shape))
    assert [s.geometry.kind for s in shape.surfaces] == [s.geometry.kind for s in fine.surfaces]
    return shape, faces, fine, deflections(fine)


def placed(a, b, rng, aim):
    """A pose of b beside a, at a distance of about `aim` (m) of their fine meshes."""
    u = rng.normal(size=3)
    u /= np.linalg.norm(u)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), 0.03 * u)
    manager = CollisionManager()
    manager.add(shapes(a)[2].mesh, pin.SE3.Identity(), movable=False)
    manager.add(shapes(b)[2].mesh, pose)
    for _ in range(12):
        far = float(manager.clearance(0, 1)["distance"][0])
        if far < aim + 1e-5:
            break
        pose.translation = pose.translation - 0.98 * (far - aim) * u
        manager.set_pose(1, pose)
    return pose, manager


def bounds(a, b, pose, row, slack):
    """The gap of the faces of a row of contacts of the coarse meshes."""
    i, j = int(row["surface_a"]), int(row["surface_b"])
    fa, fb = shapes(a)[1], moved(shapes(b)[1], pose)
    middle = 0.5 * (row["point_a"] + row["point_b"])
    return gap(fa, i, fb, j, float(row["distance"]) - slack, float(row["distance"]) + slack, middle)


@slow
@given(kinds, kinds, seeds, st.floats(2e-6, 2e-4))
def test_clearances_are_those_of_fine_meshes_and_never_overstated(a, b, seed, aim):
    rng = np.random.default_rng(seed)
    pose, fine = placed(a, b, rng, aim)
    coarse = CollisionManager()
    coarse.add(shapes(a)[0].mesh, pin.SE3.Identity(), movable=False)
    coarse.add(shapes(b)[0].mesh, pose)
    true = {(int(r["surface_a"]), int(r["surface_b"])): float(r["distance"]) for r in fine.contacts(NEAR)}
    nearest = min(true.values())
    sags = [deflections(shapes(kind)[0]) for kind in (a, b)]
    for row in coarse.contacts(NEAR + 2e-4):
        i, j = int(row["surface_a"]), int(row["surface_b"])
        if (i, j) not in true or row["distance"] == 0.0 or nearest == 0.0:
            continue
        low, high, point = bounds(a, b, pose, row, float(sags[0][i] + sags[1][j]) + 1e-7)
        off = float(shapes(a)[3][i] + shapes(b)[3][j]) + 1e-8
        assert low <= true[i, j] + off and high >= true[i, j] - off, (i, j, low, high, true[i, j])
        if true[i, j] == nearest:
            assert high - low <= 1e-8, "the nearest faces are known exactly"
            assert np.linalg.norm(point - 0.5 * (row["point_a"] + row["point_b"])) < 0.02


@slow
@given(kinds, kinds, seeds, st.floats(5e-6, 8e-5))
@example("frustum", "frustum", 618, 2.0780017877905022e-05)  # rims that are nearest beside their overlap
def test_depths_are_those_of_fine_meshes(a, b, seed, deep):
    """The parts are moved together until their fine meshes overlap; the deepest faces have the fine meshes' depth."""
    rng = np.random.default_rng(seed)
    pose, fine = placed(a, b, rng, 1e-6)
    row = fine.clearance(0, 1)[0]
    u = row["point_a"] - row["point_b"]
    pose = pose.copy()
    pose.translation = pose.translation + deep * u / np.linalg.norm(u)
    fine.set_pose(1, pose)
    rows = fine.penetration(0, 1)
    if not len(rows):
        return
    worst = rows[np.argmax(rows["depth"])]
    i, j, true = int(worst["surface_a"]), int(worst["surface_b"]), float(worst["depth"])
    off = 0.01 * true + 2e-7 + float(shapes(a)[3][i] + shapes(b)[3][j])
    if true < 2.0 * off:
        return
    slack = sum(float(deflections(shapes(kind)[0])[k]) for kind, k in ((a, i), (b, j))) + 1e-6
    low, high, _ = gap(shapes(a)[1], i, moved(shapes(b)[1], pose), j, -true - slack, slack - true, worst["point"])
    assert low - off <= -true <= high + off


AT = {
    # two balls; a ball and the ends of a rod; a rod across a ring; a rod in a washer
    ("ball", "ball"): (lambda g: (0.0, 0.0, 8e-3 + g), "sphere", "sphere"),
    ("ball", "rod"): (lambda g: (7e-3 + g, 0.0, 1e-3), "sphere", "cylinder"),
    ("ring", "ring"): (lambda g: (0.0, 0.0, 3e-3 + g), "torus", "torus"),
    ("ball", "ring"): (lambda g: (10.5e-3 + g, 0.0, 0.0), "sphere", "torus"),
}


@pytest.mark.parametrize("g", [-1.2e-4, -2e-5, -2e-9, 2e-9, 3e-6, 1e-4])
@pytest.mark.parametrize("pair", sorted(AT))
def test_closed_forms_to_a_nanometre(pair, g):
    place, first, second = AT[pair]
    (shape_a, fa, *_), (shape_b, fb, *_) = (shapes(kind) for kind in pair)
    pose = pin.SE3(np.eye(3), np.array(place(g)))
    i = next(s.index for s in shape_a.surfaces if s.geometry.kind == first)
    j = next(s.index for s in shape_b.surfaces if s.geometry.kind == second)
    low, high, _ = gap(fa, i, moved(fb, pose), j, -2e-4, 2e-4, 0.5 * pose.translation)
    assert low == pytest.approx(g, abs=1e-12) and high == pytest.approx(g, abs=1e-12)


def test_faces_that_share_no_depth_only_touch():
    """Two rods side by side, one above the other: their sides overlap as seen from above, their ends are level."""
    (shape, faces, *_), side = shapes("rod"), 6e-3 - 3e-5
    around = next(s.index for s in shape.surfaces if s.geometry.kind == "cylinder")
    seed = np.array([3e-3, 0.0, 6e-3])
    beside = moved(faces, pin.SE3(np.eye(3), np.array([side, 0.0, 0.0])))
    above = moved(faces, pin.SE3(np.eye(3), np.array([side, 0.0, 0.012])))
    assert gap(faces, around, beside, around, -1e-4, 1e-4, seed)[:2] == pytest.approx((-3e-5, -3e-5), abs=1e-12)
    low, high, _ = gap(faces, around, above, around, -1e-4, 1e-4, seed)
    assert abs(low) <= SAME or low == -1e-4, "no overlap is made up"
    assert high >= -SAME


def test_bounds_stay_where_the_surfaces_have_no_nearest_points():
    (_, ball, *_), (_, other, *_) = shapes("ball"), shapes("brick")
    far = moved(other, pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.0])))
    low, high, point = gap(ball, 0, far, 0, 1e-5, 2e-5, np.array([1.0, 2.0, 3.0]))
    assert (low, high) == (1e-5, 2e-5) and point.tolist() == [1.0, 2.0, 3.0]
