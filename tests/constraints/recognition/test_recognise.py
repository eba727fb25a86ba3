"""Recognition from real contacts: one candidate a pair of features, nothing for what does not touch."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh, Tolerance
from constraints import solve
from constraints.freedom.mobility import mobility
from constraints.geometry.features import group_features
from tests.constraints.recognition.finding import EXACT, found
from tests.constraints.shapes import Body, Builder, arc_face, at, box, flanged_shaft, housing, joined, rectangles, shaft


def kinds(candidates):
    return sorted(c.kind for c in candidates)


def test_flanged_shaft_in_its_housing():
    candidates = found([housing(0.01002), flanged_shaft(phase=0.05)], [at(), at(z=0.01)])
    assert kinds(candidates) == ["against", "concentric"]
    concentric = next(c for c in candidates if c.kind == "concentric")
    assert concentric.key == (0, 3, 1, 1, "concentric")
    assert concentric.bodies == (0, 1) and concentric.surfaces == ((3,), (1,))
    assert concentric.match.fit == pytest.approx(2e-5)
    assert concentric.constraint.kind == "concentric"
    assert np.abs(concentric.constraint.residual(at(), at(z=0.01))).max() < 1e-12


def test_the_order_of_bodies_does_not_matter():
    one = found([housing(), flanged_shaft()], [at(), at(z=0.01)])
    other = found([flanged_shaft(), housing()], [at(z=0.01), at()])
    assert kinds(one) == kinds(other)
    assert [c.score for c in one] == pytest.approx([c.score for c in other])


def test_boxes_that_overlap_without_contact_mean_nothing():
    """Iacob et al., figure 3: bounding boxes find a planar mate that the surfaces do not have.

    A tongue stands free in the gap of a fork. Its sole and the fork's face lie in one plane, face each other, and
    their boxes overlap: but no surface touches.
    """
    fork, tongue = Builder(), Builder()
    rectangles(fork, [(0, 0, 0.1, 0.02), (0, 0.02, 0.02, 0.06), (0.08, 0.02, 0.1, 0.06)], 0.0, up=True)
    rectangles(tongue, [(0.03, 0.03, 0.07, 0.1)], 0.0, up=False)
    fork, tongue = fork.body(), tongue.body()
    low_a, high_a = fork.mesh.vertices.min(0), fork.mesh.vertices.max(0)
    low_b, high_b = tongue.mesh.vertices.min(0), tongue.mesh.vertices.max(0)
    assert (low_a <= high_b).all() and (low_b <= high_a).all()
    assert found([fork, tongue], [at(), at()]) == ()
    assert found([fork, tongue], [at(), at()], Tolerance()) == ()
    assert kinds(found([fork, tongue], [at(), at(x=-0.04)])) == ["against"]  # over a prong it is one


def test_coaxial_arcs_that_do_not_meet_mean_nothing():
    hollow, solid = Builder(), Builder()
    for start in (0.0, np.pi):
        arc_face(hollow, 0.02, start, start + 1.0, 0.0, 0.05, -1)
    for start in (1.5, np.pi + 1.5):
        arc_face(solid, 0.02, start, start + 1.0, 0.0, 0.05, 1)
    hollow, solid = hollow.body(), solid.body()
    assert found([hollow, solid], [at(), at()]) == ()
    assert kinds(found([hollow, solid], [at(), at(rpy=(0, 0, 1.0))])) != []


def test_two_half_bores_are_one_mate():
    builder = Builder()
    for start in (0.0, np.pi):
        arc_face(builder, 0.01, start, start + np.pi, 0.0, 0.05, -1, n=16)
    body = builder.body()
    features = group_features(body.mesh, [f.geometry for f in body.features], [-1, -1])
    candidates = found([Body(body.mesh, features), shaft(0.01, 0.05, phase=0.1)], [at(), at()])
    assert kinds(candidates) == ["concentric"]
    assert candidates[0].surfaces[0] == (0, 1) and candidates[0].match.closed


def test_half_bore_holds_its_shaft_on_one_side_only():
    builder = Builder()
    arc_face(builder, 0.01, 0.0, np.pi, 0.0, 0.05, -1, n=16)
    (candidate,) = found([builder.body(), shaft(0.01, 0.05, phase=0.1)], [at(), at()])
    assert candidate.kind == "concentric" and not candidate.match.closed


def interrupted(split=False, radius=0.01, gap=0.015, n=16):
    """A bore of three lands along its axis, grooves between them; `split`: each land as two half cylinders."""
    builder = Builder()
    for k in range(3):
        z = k * (0.01 + gap)
        halves = (0.0, np.pi) if split else (0.0,)
        for start in halves:
            arc_face(builder, radius, start, start + 2 * np.pi / len(halves), z, z + 0.01, -1, n=n if split else 2 * n)
    raw = builder.body()
    features = group_features(raw.mesh, [f.geometry for f in raw.features], [-1] * len(raw.features))
    return Body(raw.mesh, features)


@pytest.mark.parametrize("split", [False, True])
def test_an_interrupted_bore_is_one_mate_over_all_its_lands(split):
    body = interrupted(split)
    assert len(body.features) == 1
    (candidate,) = found([body, shaft(0.01, 0.07, phase=0.1)], [at(), at(z=-0.005)])
    assert candidate.kind == "concentric" and candidate.match.closed
    assert candidate.surfaces[0] == tuple(range(6 if split else 3))
    assert candidate.match.overlap == pytest.approx(0.03)  # the grooves bear nothing
    assert candidate.match.share == pytest.approx(1.0)


def test_a_shaft_in_one_land_of_three_shares_that_one_alone():
    (candidate,) = found([interrupted(), shaft(0.01, 0.01, phase=0.1)], [at(), at(z=0.0255)])
    assert candidate.kind == "concentric" and candidate.match.overlap == pytest.approx(0.0095)


def test_a_shaft_between_two_lands_touches_neither():
    assert found([interrupted(), shaft(0.01, 0.01, phase=0.1)], [at(), at(z=0.0125)]) == ()


@pytest.mark.parametrize("half", [False, True])
def test_interrupted_and_half_bores_center_their_shaft_as_a_whole_one_does(half):
    """Solved from 10 % and 30° off: one axis, two freedoms, the length along it untouched by where the lands are."""
    builder = Builder()
    arc_face(builder, 0.01, 0.0, np.pi, 0.0, 0.05, -1, n=16)
    body = builder.body() if half else interrupted(split=True)
    pin_at = at(z=-0.005)
    (candidate,) = found([body, shaft(0.01, 0.06, phase=0.1)], [at(), pin_at])
    start = pin_at * at(x=0.004, y=-0.004, rpy=(np.pi / 6, 0.2, 0.1))
    solution = solve([candidate.constraint], [at(), start], [1])
    assert solution.converged and solution.residual < 1e-12
    pose = solution.poses[1]
    assert np.abs(pose.rotation[:2, 2]).max() < 1e-12 and np.abs(pose.translation[:2]).max() < 1e-12
    left = mobility([candidate.constraint], [at(), pose], [0]).parts[1]
    assert (left.freedom, left.joint) == (2, "cylindrical")


def test_plane_split_in_ten_is_one_mate():
    builder = Builder()
    for k in range(10):
        rectangles(builder, [(0.01 * k, 0.0, 0.01 * (k + 1), 0.05)], 0.0, up=True)
    body = builder.body()
    features = group_features(body.mesh, [f.geometry for f in body.features], [1] * 10)
    (candidate,) = found([Body(body.mesh, features), box(0.2, 0.2, 0.02)], [at(), at(z=0.01)])
    assert candidate.surfaces[0] == tuple(range(10)) and candidate.contacts == 10


def test_bolt_circle_gives_one_mate_a_hole():
    angles = 2 * np.pi * np.arange(6) / 6
    places = [at(0.05 * np.cos(a), 0.05 * np.sin(a)) for a in angles]
    plate = joined([housing(0.005, 0.02, 0.008)] * 6, places)
    bolts = [shaft(0.00495, 0.03, phase=0.2)] * 6
    candidates = found([plate, *bolts], [at(), *(pin.SE3(p) for p in places)])
    concentric = [c for c in candidates if c.kind == "concentric"]
    assert len(concentric) == 6 and len({c.key[1] for c in concentric}) == 6
    assert sorted(c.bodies[1] for c in concentric) == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_scale(scale):
    t = replace(EXACT, clearance=1e-3 * scale, linear=1e-6 * scale)
    bodies = [housing(0.01 * scale, 0.06 * scale, 0.03 * scale), shaft(0.01 * scale, 0.05 * scale, phase=0.1)]
    assert kinds(found(bodies, [at(), at()], t)) == ["concentric"]


def test_tiny_on_huge():
    pebble, ground = box(1e-4, 1e-4, 1e-4), box(1e3, 1e3, 1.0)
    assert kinds(found([ground, pebble], [at(z=-0.5), at(x=300.0, y=-200.0, z=5e-5)])) == ["against"]


def test_radii_equal_to_a_nanometre():
    candidates = found([housing(0.01 + 1e-9), shaft(0.01, 0.05, phase=0.1)], [at(), at()])
    assert kinds(candidates) == ["concentric"]
    assert candidates[0].match.fit == pytest.approx(1e-9, rel=1e-6)
    assert "same radius" in candidates[0].why  # as far as a person is concerned


def test_planes_a_tenth_of_a_microradian_off_are_against():
    bodies, poses = [box(0.1, 0.1, 0.02), box(0.1, 0.1, 0.02)], [at(), at(z=0.02, rpy=(1e-7, 0, 0))]
    (candidate,) = found(bodies, poses)
    assert candidate.match.angle == pytest.approx(1e-7, rel=1e-3)
    assert candidate.residual == pytest.approx(0.05 * 1e-7, rel=0.1)


def test_coincident_copies_have_no_facing_planes():
    assert found([box(0.1, 0.1, 0.1)] * 2, [at(), at()]) == ()


def test_reach_sees_what_a_shaking_hand_brings():
    bodies = [housing(0.0101), flanged_shaft(phase=0.05)]
    poses = [at(), at(x=4e-4, z=0.0102, rpy=(0.004, 0.003, 0.0))]
    assert kinds(found(bodies, poses, Tolerance())) == ["against", "concentric"]
    assert found(bodies, poses) == ()


def test_a_thread_is_one_screw():
    bodies = [housing(0.01), shaft(0.01, 0.05, phase=0.1)]
    candidates = found(bodies, [at(), at(z=0.003)], threads={(1, 1): 2e-3})
    assert kinds(candidates) == ["screw"]
    (screw,) = candidates
    assert screw.pitch == 2e-3 and "thread of pitch 2 mm" in screw.why
    turned_in = at(z=0.003 + 2e-3 / 4, rpy=(0, 0, np.pi / 2))
    assert np.abs(screw.constraint.residual(at(), turned_in)).max() < 1e-12


def test_only_the_kinds_asked_for():
    bodies, poses = [housing(), flanged_shaft()], [at(), at(z=0.01)]
    assert kinds(found(bodies, poses, kinds=["against"])) == ["against"]


@pytest.mark.parametrize("clearance", [2e-5, -2e-5])
def test_fit_is_judged_on_the_surfaces_not_on_their_facets(clearance):
    """20 µm at Ø20 mm vanish in the facets of 32 sections (48 µm of sag), whichever way the facets stand."""
    for phase in np.linspace(0.0, 2 * np.pi / 32, 5):
        (candidate,) = found([housing(0.01 + clearance), shaft(0.01, 0.05, phase=phase)], [at(), at()])
        assert candidate.match.fit == pytest.approx(clearance, abs=1e-12)
        assert ("interference" in candidate.why) == (clearance < 0)


def test_faces_of_no_type_belong_to_no_mate():
    builder = Builder()
    rectangles(builder, [(0, 0, 0.1, 0.1)], 0.0, up=True, geometry=False)
    body = builder.body()
    assert isinstance(body.mesh, SurfaceMesh) and body.features == ()
    assert found([body, box(0.1, 0.1, 0.1)], [at(), at(z=0.05)]) == ()
