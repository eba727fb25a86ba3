"""Tangencies recognised from real contacts: every pair of the table, both ways round, and what is none."""

from dataclasses import replace

import numpy as np
import pytest

from collision import CollisionManager, Tolerance
from constraints import recognise
from constraints.geometry.reach import reached
from tests.constraints.shapes import Builder, arc_face, at, box, housing, shaft, turned

EXACT = replace(Tolerance(), reach=0.0, reach_angular=0.0)
PLATE = box(0.2, 0.2, 0.02)  # its top is z = 0.01
ROD = shaft(0.01, 0.05, n=64)
BALL = turned([(0, -0.02, ("ball", 0.0)), (0, 0.02)], n=48)
SPIKE = turned([(0, 0), (0.02, 0.06), (0, 0.06)], n=48)  # a cone, apex down
RING = turned([(0.05, 0.0, ("ring", 0.04, 0.0)), (0.03, 0.0)], n=48)  # the upper half of a torus
LYING = (np.pi / 2, 0.0, 0.0)


def found(bodies, poses, tolerance=EXACT):
    world = CollisionManager(tolerance)
    for body, pose in zip(bodies, poses, strict=True):
        world.add(body.mesh, pose)
    return recognise([b.features for b in bodies], poses, world.contacts(1e-3), tolerance)


def socket(radius):
    return turned([(0, -0.05), (0.05, -0.05), (0.05, 0.0), (radius, 0.0, ("ball", 0.0)), (0, -radius)], n=48)


def cone_pose():
    """The spike on its side on the plate: its axis rises by the half angle."""
    half = np.arctan(0.02 / 0.06)
    return at(x=-0.03, z=0.01, rpy=(0.0, np.pi / 2 - half, 0.0))


CASES = {
    "plane and cylinder": ([PLATE, ROD], at(y=0.02, z=0.02, rpy=LYING), "outside"),
    "plane and sphere": ([PLATE, BALL], at(x=0.03, z=0.03), "outside"),
    "plane and cone": ([PLATE, SPIKE], cone_pose(), "outside"),
    "plane and torus": ([PLATE, RING], at(z=0.02, rpy=(np.pi, 0.0, 0.0)), "outside"),
    "cylinder and cylinder": ([ROD, shaft(0.005, 0.03, n=64)], at(x=0.015, z=0.01), "outside"),
    "cylinder and cylinder, crossed": ([ROD, shaft(0.005, 0.05)], at(x=0.015, y=0.025, z=0.025, rpy=LYING), "crossed"),
    "cylinder and cylinder, inside": ([housing(0.012, n=64), ROD], at(x=0.002), "inside"),
    "cylinder and sphere": ([ROD, BALL], at(x=0.03, z=0.025), "outside"),
    "cylinder and sphere, inside": ([housing(0.021, n=64), BALL], at(x=0.001, z=0.03), "inside"),
    "sphere and sphere": ([BALL, BALL], at(x=0.04), "outside"),
    "sphere and sphere, inside": ([socket(0.025), BALL], at(z=-0.005), "inside"),
    "torus and sphere": ([RING, BALL], at(x=0.04, z=0.03), "outside"),
    "cone and sphere": ([SPIKE, BALL], None, "outside"),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("swap", [False, True])
def test_pairs_of_the_table(name, swap):
    bodies, pose, mode = CASES[name]
    if pose is None:  # beside the cone, half way up
        half = np.arctan(0.02 / 0.06)
        out = np.array([np.cos(half), 0.0, -np.sin(half)])
        pose = at(*(np.array([0.01, 0.0, 0.03]) + 0.02 * out))
    poses = [at(), pose]
    if swap:
        bodies, poses = bodies[::-1], poses[::-1]
    tangents = [c for c in found(bodies, poses) if c.kind == "tangent"]
    assert len(tangents) == 1
    (candidate,) = tangents
    assert candidate.match.parameters == {"mode": mode}
    assert candidate.residual < 1e-9 and mode in candidate.why
    assert sorted(w for w in name.split(",")[0].split(" and ")) == sorted(g.kind for g in candidate.geometries)
    rows = candidate.constraint.residual(*poses)
    assert np.abs(rows).max() < 1e-9
    lifted = [poses[0], at(z=1e-4) * poses[1]] if not swap else [at(z=1e-4) * poses[0], poses[1]]
    moved = candidate.constraint.residual(*lifted)
    assert not any(c.kind == "tangent" for c in found(bodies, lifted)) or np.abs(moved).max() < 1e-5


def test_a_rod_past_the_end_of_the_plate_is_not_tangent_to_it():
    poses = [at(), at(x=0.1105, z=0.02, rpy=LYING)]  # touches the edge's side, not the top
    assert not [c for c in found([PLATE, ROD], poses, Tolerance()) if c.kind == "tangent"]


def test_the_missing_half_of_a_rod_is_not_tangent():
    half = Builder()
    arc_face(half, 0.01, 0.0, np.pi, 0.0, 0.05, 1, n=33)
    below, above = at(z=0.02, rpy=LYING), at(z=0.02, rpy=(-np.pi / 2, 0.0, 0.0))
    counts = [len([c for c in found([PLATE, half.body()], [at(), p]) if c.kind == "tangent"]) for p in (below, above)]
    assert sorted(counts) == [0, 1]


def test_equal_radii_are_a_fit_and_no_tangency():
    kinds = [c.kind for c in found([housing(0.01, n=64), ROD], [at(), at()])]
    assert kinds == ["concentric"]


def test_points_near_triangles_against_dense_sampling():
    rng = np.random.default_rng(4)
    triangles, points = rng.random((3, 3, 3)), rng.random((40, 3))
    w = rng.dirichlet(np.ones(3), 20_000)
    dense = np.concatenate([w @ t for t in triangles])
    nearest = np.linalg.norm(dense[None] - points[:, None], axis=2).min(axis=1)
    for slack in (0.05, 0.1, 0.2, 0.4):
        got = reached(points, triangles, slack)
        sure = np.abs(nearest - slack) > 0.02
        assert (got[sure] == (nearest <= slack)[sure]).all()
