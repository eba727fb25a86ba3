"""Matches that others imply are left out: looser fits on one axis, sleeves between, fillets beside flush planes."""

from dataclasses import replace

import numpy as np
import pinocchio as pin

from collision import CollisionManager, Tolerance
from constraints import recognise
from constraints.geometry.threads import threaded
from constraints.recognition.recognise import contacts_within
from tests.constraints.geometry.test_threads import helix
from tests.constraints.shapes import Builder, arc_face, at, box, housing, rectangles, shaft, turned

EXACT = replace(Tolerance(), reach=0.0, reach_angular=0.0)


def found(bodies, poses, features=None, **options):
    world = CollisionManager(EXACT)
    for body, pose in zip(bodies, poses, strict=True):
        world.add(body.mesh, pose)
    features = features or [b.features for b in bodies]
    return recognise(features, poses, world.contacts(contacts_within(features, EXACT)), EXACT, **options)


def counterbored():
    """A hole Ø6.6 under a counterbore Ø11, z from 0 to 0.02."""
    return turned([(0.0033, 0), (0.02, 0), (0.02, 0.02), (0.0055, 0.02), (0.0055, 0.01), (0.0033, 0.01)])


def cap_screw():
    """A shank Ø6 up to z = 0.01 and a head Ø10 over it."""
    return turned([(0, -0.01), (0.003, -0.01), (0.003, 0.01), (0.005, 0.01), (0.005, 0.016), (0, 0.016)])


def test_a_head_in_its_counterbore_says_no_more_than_the_shank_in_its_hole():
    bodies, poses = [counterbored(), cap_screw()], [at(), at()]
    concentric = [c for c in found(bodies, poses) if c.kind == "concentric"]
    assert [round(c.match.fit, 9) for c in concentric] == [3e-4]
    assert sorted(round(c.match.fit, 9) for c in found(bodies, poses, implied=True) if c.kind == "concentric") == [
        3e-4,
        5e-4,
    ]


def test_a_sleeve_between_two_parts_leaves_them_no_fit_of_their_own():
    sleeve = housing(0.003, 0.02, outer=0.0033)
    bodies, poses = [shaft(0.003, 0.02, phase=0.1), sleeve, housing(0.0033, 0.02)], [at()] * 3
    fits = {c.bodies for c in found(bodies, poses) if c.kind == "concentric"}
    assert fits == {(0, 1), (1, 2)}
    # where the sleeve ends, the shaft stands in the bore by itself
    short = [bodies[0], housing(0.003, 0.005, outer=0.0033), housing(0.0033, 0.02)]
    away = [at(), at(z=0.1), at()]
    assert {c.bodies for c in found(short, away) if c.kind == "concentric"} == {(0, 2)}


def rounded(radius=0.002):
    """A bar along y with its flat sole at z = 0 and a fillet from it up to its side."""
    builder = Builder()
    rectangles(builder, [(-0.02, 0.0, 0.0, 0.05)], 0.0, up=False)
    fillet = Builder()
    arc_face(fillet, radius, -np.pi / 2, 0.0, 0.0, 0.05, 1)
    (f,) = fillet.features
    turn = pin.SE3(pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0), np.array([0.0, 0.05, radius]))
    points = f.samples @ turn.rotation.T + turn.translation
    builder.face(points, f.triangles, f.geometry.transformed(turn), 1)
    return builder.body()


def test_a_fillet_is_tangent_to_no_plane_that_its_part_lies_on_already():
    bodies, poses = [box(0.2, 0.2, 0.02), rounded()], [at(), at(z=0.01)]
    assert [c.kind for c in found(bodies, poses)] == ["against"]
    assert sorted(c.kind for c in found(bodies, poses, implied=True)) == ["against", "tangent"]
    # a roll on the same plate is news: nothing else says it
    roll = shaft(0.01, 0.05, n=64)
    (tangent,) = found([bodies[0], roll], [at(), at(z=0.02, rpy=(np.pi / 2, 0.0, 0.0))])
    assert tangent.kind == "tangent"


def test_a_line_seen_at_one_of_its_points_is_no_line():
    """A roll whose line touches the tip of a plate's corner with the middle of its seventeen points."""
    plate, roll = box(0.02, 0.02, 0.02), shaft(0.01, 0.1, n=64)
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    tip = np.array([0.01, -0.01, 0.02])
    assert found([plate, roll], [at(), at(*(tip - 0.05 * along), rpy=(0.0, np.pi / 2, np.pi / 4))]) == ()


def test_a_short_line_on_a_long_roll_is_measured():
    """A rail 2 mm wide across a roll of 100 mm: seventeen points over the whole roll would see it once, or never."""
    rail, roll = box(0.02, 0.002, 0.02), shaft(0.01, 0.1, n=64)
    for y in (0.05, 0.0531):
        (tangent,) = found([rail, roll], [at(), at(y=y, z=0.02, rpy=(np.pi / 2, 0.0, 0.0))])
        assert tangent.kind == "tangent" and abs(tangent.match.overlap - 0.002) < 1e-9


def test_a_thread_with_crests_and_roots_is_one_mate():
    """Flanks, and the crests and roots that are cylinders on their axis: three pairs that fit, one screw."""

    def bolt_or_nut(turns, inside):
        mesh = helix(turns=turns, inside=inside, pose=pin.SE3.Identity())
        own, pitches = threaded(mesh, ())
        builder = Builder()
        for s in range(mesh.n_surfaces):
            corners = mesh.triangles[mesh.triangles_of(s)]
            used, triangles = np.unique(corners, return_inverse=True)
            builder.face(mesh.vertices[used], triangles.reshape(-1, 3), None, 1)
        for radius in (7.35e-3 - 5e-4, 7.35e-3 + 5e-4):
            arc_face(builder, radius, 0.0, 2.0 * np.pi, 0.0, turns * 2e-3, -1 if inside else 1, n=33)
        return builder.body(), (*own, *builder.features), pitches

    (bolt, of_bolt, p), (nut, of_nut, q) = bolt_or_nut(8.0, False), bolt_or_nut(3.0, True)
    pitches = {(0, k): pitch for k, pitch in p.items()} | {(1, k): pitch for k, pitch in q.items()}
    bodies, poses, features = [bolt, nut], [at(), at(z=4e-3)], [of_bolt, of_nut]
    every = found(bodies, poses, features, threads=pitches, implied=True)
    assert len(every) > 2
    (screw,) = found(bodies, poses, features, threads=pitches)
    assert screw.kind == "screw" and screw.surfaces == ((0, 1), (0, 1))
