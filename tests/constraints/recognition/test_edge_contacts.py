"""Edges and vertices that touch, faces that lie flush: from real contacts, each with what it must not be taken for."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import CollisionManager, Tolerance
from constraints import recognise, solve
from constraints.geometry.surfaces import Plane
from constraints.recognition.pairings import DEFAULT_KINDS, SLIGHT
from tests.constraints.shapes import Builder, at, box, housing, shaft, turned

EXACT = replace(Tolerance(), reach=0.0, reach_angular=0.0)
PLATE = box(0.2, 0.2, 0.02)  # its top is z = 0.01
CUBE = box(0.04, 0.04, 0.04)
ROD = shaft(0.01, 0.05, n=64)
BALL = turned([(0, -0.02, ("ball", 0.0)), (0, 0.02)], n=48)
TURN = pin.rpy.rpyToMatrix(0.5, 0.6, 0.2)
CORNERS = 0.02 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) @ TURN.T
LOWEST = CORNERS[np.argmin(CORNERS[:, 2])]
HALF = 0.02 * np.sqrt(2.0)


def found(bodies, poses, kinds=(*DEFAULT_KINDS, *SLIGHT)):
    world = CollisionManager(EXACT)
    for body, pose in zip(bodies, poses, strict=True):
        world.add(body.mesh, pose)
    return recognise([b.features for b in bodies], poses, world.contacts(5e-4), EXACT, kinds=kinds)


CASES = {
    "an edge in a plane": ([PLATE, CUBE], at(z=0.01 + 0.02 * (np.cos(0.3) + np.sin(0.3)), rpy=(0, 0.3, 0)), "line", 4),
    "a vertex on a plane": ([PLATE, CUBE], pin.SE3(TURN, np.array([0, 0, 0.01]) - LOWEST), "point", 5),
    "a rim on a plane": ([PLATE, ROD], at(z=0.01 + 0.01 * np.sin(0.3), rpy=(0.3, 0, 0)), "circle", 5),
    "an edge across a shaft": ([ROD, CUBE], at(x=0.01 + HALF, z=0.025, rpy=(0, np.pi / 4, 0)), "line", 5),
    "a vertex on a ball": ([BALL, CUBE], pin.SE3(TURN, np.array([0, 0, 0.02]) - LOWEST), "point", 5),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("swapped", [False, True])
def test_contact_of_an_edge(name, swapped):
    bodies, pose, feature, freedom = CASES[name]
    poses = [at(), pose]
    if swapped:
        bodies, poses = bodies[::-1], poses[::-1]
    (one,) = found(bodies, poses)  # once, though two or three faces meet there
    assert one.kind == "contact" and one.constraint.freedom == freedom
    assert feature in [f.kind for f in one.constraint.features]
    assert np.abs(one.constraint.residual(*poses)).max() < 1e-12
    assert 0.0 < one.score <= 0.5
    deeper = [pin.SE3(poses[0].rotation, poses[0].translation + 1e-3 * one.match.approach), poses[1]]
    back = solve([one.constraint], deeper, [0])
    assert back.converged and (back.poses[0].translation - deeper[0].translation) @ one.match.approach < -1e-4


def test_crossing_edges():
    poses = [at(rpy=(np.pi / 4, 0, 0)), at(x=0.003, z=2 * HALF, rpy=(0, np.pi / 4, 0))]
    (one,) = found([CUBE, CUBE], poses)
    assert [f.kind for f in one.constraint.features] == ["line", "line"] and one.constraint.freedom == 5
    np.testing.assert_allclose(one.match.origin, [0.003, 0.0, HALF], atol=1e-9)
    np.testing.assert_allclose(one.match.approach, [0, 0, 1], atol=1e-9)


def test_flush_faces_rank_below_what_holds_the_boxes_together():
    candidates = found([CUBE, CUBE], [at(), at(z=0.04)])
    assert [c.kind for c in candidates] == ["against"] + 4 * ["coplanar"]
    assert all(c.match.overlap == pytest.approx(0.04) for c in candidates[1:])
    shifted = found([CUBE, CUBE], [at(), at(x=0.01, z=0.04)])
    assert [c.kind for c in shifted] == ["against", "coplanar", "coplanar"]
    assert [c.match.overlap for c in shifted[1:]] == pytest.approx([0.03, 0.03])
    assert [c.kind for c in found([CUBE, CUBE], [at(), at(x=1e-4, z=0.04)])] == ["against", "coplanar", "coplanar"]


def test_planes_that_are_flush_without_meeting_mean_nothing():
    low = found([CUBE, CUBE], [at(), at(x=0.0401)])
    assert low == ()


def test_what_a_fit_says_already_is_not_said_again():
    assert [c.kind for c in found([PLATE, CUBE], [at(), at(z=0.03)])] == ["against"]
    assert [c.kind for c in found([housing(), shaft()], [at(), at(z=0.005)])] == ["concentric"]
    flush = found([housing(), shaft()], [at(), at(z=0.01)])
    assert [c.kind for c in flush] == ["concentric", "coplanar"]


def test_a_round_edge_in_facets_has_no_vertices_and_no_straight_edge():
    disc = Builder()
    angles = 2 * np.pi * np.arange(24) / 24
    rim = np.array([[0.02 * np.cos(a), 0.02 * np.sin(a), 0.0] for a in angles])
    disc.face(np.vstack([rim, [[0, 0, 0]]]), [[24, k, (k + 1) % 24] for k in range(24)], Plane([0, 0, 0], [0, 0, 1]), 1)
    disc = disc.body()
    for half in (0.0, np.pi / 24):  # on a vertex of its polygon, and on a side of it
        turn = pin.rpy.rpyToMatrix(0.0, 1.0, 0.0) @ pin.rpy.rpyToMatrix(0.0, 0.0, half)
        low = (rim @ turn.T)[:, 2].min()
        assert found([PLATE, disc], [at(), pin.SE3(turn, np.array([0, 0, 0.01 - low]))]) == ()


def test_they_are_offered_only_on_request():
    bodies, pose, _, _ = CASES["an edge in a plane"]
    assert found(bodies, [at(), pose], kinds=None) == ()
    assert [c.kind for c in found([CUBE, CUBE], [at(), at(z=0.04)], kinds=None)] == ["against"]
    assert {c.kind for c in found([CUBE, CUBE], [at(), at(z=0.04)], kinds=["coplanar"])} == {"coplanar"}
