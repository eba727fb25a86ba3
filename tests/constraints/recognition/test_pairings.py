"""Each row of the pairing table: what passes, what does not, and the sign of fits and gaps."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import Tolerance
from constraints.errors import GeometryError
from constraints.geometry.views import Extent, FeatureView, Limits
from constraints.recognition.candidate import KINDS
from constraints.recognition.pairings import FITS, PAIRINGS, matches, over, rows_for
from tests.constraints.shapes import box, flanged_shaft, housing, shaft, turned

EXACT = Limits.offer(replace(Tolerance(), reach=0.0, reach_angular=0.0))
NEAR = Limits.offer(Tolerance())


def view(body, feature, xyz=(0, 0, 0), rpy=(0, 0, 0)):
    pose = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz, float))
    return FeatureView(Extent.of(body.features[feature]), pose)


def test_box_on_box():
    a, b = box(0.1, 0.1, 0.02), box(0.05, 0.05, 0.05)
    top, bottom = view(a, 5), view(b, 4, (0.04, 0, 0.035))
    match = matches(top, bottom, EXACT)
    assert match.kind == "against" and not match.closed
    assert match.overlap == pytest.approx(0.035 * 0.05)
    assert match.share == pytest.approx(0.7)
    assert match.residual == pytest.approx(0.0, abs=1e-15)
    assert match.approach == pytest.approx([0, 0, 1])  # body a moves up against body b


@pytest.mark.parametrize(
    ("xyz", "rpy"),
    [
        ((0.08, 0, 0.035), (0, 0, 0)),  # no area in common
        ((0.075, 0, 0.035), (0, 0, 0)),  # an edge in common
        ((0, 0, 0.0351), (0, 0, 0)),  # 0.1 mm apart
        ((0, 0, 0.035), (0.01, 0, 0)),  # 0.6° off
        ((0, 0, 0.035), (np.pi, 0, 0)),  # turned over: both normals up
    ],
)
def test_planes_that_are_not_against(xyz, rpy):
    assert matches(view(box(0.1, 0.1, 0.02), 5), view(box(0.05, 0.05, 0.05), 4, xyz, rpy), EXACT) is None


def test_planes_that_interfere_say_so():
    match = matches(view(box(0.1, 0.1, 0.02), 5), view(box(0.05, 0.05, 0.05), 4, (0, 0, 0.035 - 5e-6)), EXACT)
    assert "5 µm of overlap" in match.words


@pytest.mark.parametrize("turn", [0.0, np.pi])
def test_shaft_in_bore(turn):
    s, h = shaft(0.01, 0.05, phase=0.1), housing(0.01002, 0.06)
    z = 0.03 if turn == 0.0 else 0.08
    match = matches(view(h, 3), view(s, 1, (0, 0, z), (turn, 0, 0)), EXACT)
    assert match.kind == "concentric" and match.closed
    assert match.fit == pytest.approx(2e-5)
    assert match.overlap == pytest.approx(0.03)
    assert match.residual == pytest.approx(0.0, abs=1e-15)
    # the housing moves up to take in more of the shaft
    assert match.approach == pytest.approx([0, 0, 1])


def test_interference_is_reported_as_one():
    match = matches(view(shaft(0.01002, 0.05), 1), view(housing(0.01, 0.06), 3), EXACT)
    assert match.fit == pytest.approx(-2e-5)
    assert "20 µm radial interference" in match.words


@pytest.mark.parametrize(
    ("s", "h", "xyz", "rpy"),
    [
        (shaft(0.01, 0.05), housing(0.0121, 0.06), (0, 0, 0), (0, 0, 0)),  # too loose
        (shaft(0.0104, 0.05), housing(0.01, 0.06), (0, 0, 0), (0, 0, 0)),  # too tight
        (shaft(0.01, 0.05), housing(0.01, 0.06), (1e-4, 0, 0), (0, 0, 0)),  # off the axis
        (shaft(0.01, 0.05), housing(0.01, 0.06), (0, 0, 0.06), (0, 0, 0)),  # end to end
        (shaft(0.01, 0.05), housing(0.01, 0.06), (0, 0, 0), (2e-3, 0, 0)),  # near-parallel axes
    ],
)
def test_shafts_that_do_not_fit(s, h, xyz, rpy):
    assert matches(view(s, 1, xyz, rpy), view(h, 3), EXACT) is None


def test_shaft_may_lie_in_its_clearance():
    s, h = shaft(0.01, 0.05), housing(0.0101, 0.06)
    assert matches(view(s, 1, (1e-4, 0, 0)), view(h, 3), EXACT).residual == pytest.approx(1e-4)


def test_two_solid_cylinders_or_two_bores_are_not_concentric():
    assert matches(view(shaft(), 1), view(shaft(), 1), EXACT) is None
    assert matches(view(housing(), 3), view(housing(), 3), EXACT) is None


def test_reach_offers_before_the_shaft_is_in():
    s, h = view(shaft(0.01, 0.05), 1, (3e-4, 0, 0.0605), (0.005, 0, 0)), view(housing(0.0101, 0.06), 3)
    match = matches(s, h, NEAR)
    assert match.kind == "concentric" and match.overlap == pytest.approx(-5e-4, abs=1e-4) and match.share == 0.0
    assert matches(s, h, EXACT) is None


def test_cone_in_cone():
    plug = turned([(0, 0), (0.01, 0), (0.02, 0.04), (0, 0.04)])
    seat = turned([(0.01, 0), (0.03, 0), (0.03, 0.04), (0.02, 0.04)])
    a, b = plug.features[1], seat.features[3]
    assert a.sense == 1 and b.sense == -1
    match = matches(view(plug, 1), view(seat, 3), EXACT)
    assert match.kind == "conical" and match.residual == pytest.approx(0.0, abs=1e-15)
    lifted = matches(view(plug, 1, (0, 0, 2e-4)), view(seat, 3), NEAR)
    assert lifted.fit == pytest.approx(2e-4 * np.sin(np.arctan(0.25)))
    assert matches(view(plug, 1, (0, 0, 2e-4)), view(seat, 3), EXACT) is None


def test_ball_in_socket():
    ball = turned([(0, -0.02, ("ball", 0.0)), (0, 0.02)])
    socket = turned([(0, -0.03), (0.03, -0.03), (0.03, 0), (0.02, 0, ("ball", 0.0)), (0, -0.02)])
    assert [(f.geometry.kind, f.sense) for f in socket.features][-1] == ("sphere", -1)
    match = matches(view(ball, 0, (0, 0, 5e-6)), view(socket, 3), EXACT)
    assert match.kind == "spherical" and match.residual == pytest.approx(5e-6)
    assert match.fit == pytest.approx(0.0, abs=1e-12)
    assert matches(view(ball, 0, (0, 0, 5e-4)), view(socket, 3), EXACT) is None


def test_ring_in_groove():
    ring = turned([(0.022, 0, ("ring", 0.02, 0.0)), (0.018, 0)])
    solid = ring.features[0]
    hollow = replace(solid, sense=-1)
    match = matches(
        FeatureView(Extent.of(solid), pin.SE3.Identity()), FeatureView(Extent.of(hollow), pin.SE3.Identity()), EXACT
    )
    assert match.kind == "toroidal" and match.fit == 0.0


def test_flanged_shaft_has_the_faces_the_docstring_says():
    kinds = [(f.geometry.kind, f.sense) for f in flanged_shaft().features]
    assert kinds == [("plane", 1), ("cylinder", 1), ("plane", 1), ("cylinder", 1), ("plane", 1)]
    assert flanged_shaft().features[2].geometry.normal == pytest.approx([0, 0, -1])


def test_ball_in_a_groove_of_its_radius():
    ball = turned([(0, -0.002, ("ball", 0.0)), (0, 0.002)])
    race = turned(
        [
            (0.03, -0.004),
            (0.03, 0.004),
            (0.02, 0.004),
            (0.02, 0.002, ("ring", 0.02, 0.0)),
            (0.02, -0.002),
            (0.02, -0.004),
        ]
    )
    place = next(i for i, f in enumerate(race.features) if f.geometry.kind == "torus")
    assert race.features[place].sense == -1
    match = matches(view(ball, 0, (0.02, 5e-6, 2e-6)), view(race, place), EXACT)
    assert match.kind == "groove" and match.fit == pytest.approx(0.0, abs=1e-12) and not match.closed
    assert match.residual == pytest.approx(2e-6, rel=1e-3)  # along the ring it may be anywhere
    np.testing.assert_allclose(np.abs(match.direction), [0, 1, 0], atol=1e-3)
    assert matches(view(ball, 0, (0.0202, 0, 0)), view(race, place), EXACT) is None
    bore = turned([(0.002, 0), (0.01, 0), (0.01, 0.02), (0.002, 0.02)])
    match = matches(view(ball, 0, (0, 0, 0.015)), view(bore, 3), EXACT)
    assert match.kind == "groove" and match.closed
    assert matches(view(ball, 0, (0, 0, 0.03)), view(bore, 3), EXACT) is None  # out of the bore


def test_a_ball_smaller_than_its_groove_is_tangent():
    ball = turned([(0, -0.0015, ("ball", 0.0)), (0, 0.0015)])
    bore = turned([(0.002, 0), (0.01, 0), (0.01, 0.02), (0.002, 0.02)])
    match = matches(view(ball, 0, (0.0005, 0, 0.01)), view(bore, 3), EXACT)
    assert match.kind == "tangent" and match.parameters == {"mode": "inside"}


@pytest.mark.parametrize("kinds", [{"against"}, {"concentric", "against"}, set(FITS), {"tangent"}, {"groove"}, set()])
def test_as_much_of_the_table_as_tells_some_kinds_says_the_same_of_them(kinds):
    bodies = [box(0.1, 0.1, 0.02), housing(0.01002, 0.06), shaft(0.01, 0.05, phase=0.1), flanged_shaft()]
    told = set()
    for a, b in [(0, 1), (0, 2), (1, 2), (1, 3), (0, 3)]:
        for fa, fb in np.ndindex(len(bodies[a].features), len(bodies[b].features)):
            for z, lying in ((0.0, 0.0), (0.01, 0.0), (0.03, 0.0), (0.02, np.pi / 2)):
                first, second = view(bodies[a], fa), view(bodies[b], fb, (0, 0, z), (lying, 0, 0))
                whole = matches(first, second, NEAR)
                part = matches(first, second, NEAR, rows_for(kinds))
                if whole is not None and whole.kind in kinds:
                    told.add(whole.kind)
                    assert (part.kind, part.words, part.residual) == (whole.kind, whole.words, whole.residual)
                else:
                    assert part is None or part.kind not in kinds
    assert told == kinds & {"against", "concentric", "tangent"}


def all_features():
    """Every geometry of the table, solid and hollow, as features of small bodies."""
    bodies = [
        box(0.02, 0.02, 0.02),
        shaft(0.005, 0.02),
        housing(0.0052, 0.02),
        turned([(0, 0), (0.01, 0.02), (0, 0.02)]),
        turned([(0.01, 0), (0.03, 0), (0.03, 0.04), (0.02, 0.04)]),
        turned([(0, -0.005, ("ball", 0.0)), (0, 0.005)]),
        turned([(0, -0.03), (0.03, -0.03), (0.03, 0), (0.006, 0, ("ball", 0.0)), (0, -0.006)]),
        turned([(0.025, 0, ("ring", 0.02, 0.0)), (0.015, 0)]),
        turned([(0.03, -0.01), (0.03, 0.01), (0.02, 0.01), (0.02, 0.005, ("ring", 0.02, 0.0)), (0.02, -0.005)]),
    ]
    found = {}
    for body in bodies:
        for feature in body.features:
            found.setdefault((feature.geometry.kind, feature.sense), feature)
    return found


FEATURES = all_features()
POSES = st.tuples(
    *[st.sampled_from([0.0, 0.005, -0.005, 0.01, 0.02])] * 3, *[st.sampled_from([0.0, 0.5, np.pi / 2])] * 3
)


def test_the_features_are_of_every_kind_and_sense():
    kinds = {"cylinder", "cone", "sphere", "torus"}
    assert set(FEATURES) == {("plane", 1)} | {(kind, sense) for kind in kinds for sense in (1, -1)}


@settings(max_examples=60, deadline=None)
@given(first=st.sampled_from(sorted(FEATURES)), second=st.sampled_from(sorted(FEATURES)), pose=POSES)
def test_every_rule_takes_every_pair_of_geometries_in_either_order(first, second, pose):
    a, b = (Extent.of(FEATURES[key]) for key in (first, second))
    there = pin.SE3(pin.rpy.rpyToMatrix(*pose[3:]), np.array(pose[:3]))
    for limits in (EXACT, NEAR, Limits.keep(Tolerance()), replace(NEAR, linear=1.0, angular=np.pi / 2)):
        one, other = FeatureView(a, pin.SE3.Identity()), FeatureView(b, there)
        for row in PAIRINGS:
            there_found, back_found = row.match(one, other, limits), row.match(other, one, limits)
            assert (there_found is None) == (back_found is None)
            if there_found is None or {type(a.feature.geometry), type(b.feature.geometry)} != {row.first, row.second}:
                assert there_found is None
                continue
            assert there_found.kind == back_found.kind == row.kind
            # an axis tells no sign where the middles coincide, and two alike may each be the first
            assert there_found.residual == pytest.approx(back_found.residual, rel=1e-6, abs=1e-9)
            np.testing.assert_allclose(one.pose.act(there_found.local), there_found.origin, atol=1e-9)
            np.testing.assert_allclose(other.pose.act(back_found.local), back_found.origin, atol=1e-9)
            if row.first is not row.second:
                np.testing.assert_allclose(there_found.approach, -back_found.approach, atol=1e-12)
            try:
                KINDS[row.kind](
                    (0, 1), (a.feature.geometry, b.feature.geometry), ((), ()), 0.01, **there_found.parameters
                )
            except GeometryError as error:
                pytest.fail(f"{row.kind} of {first} and {second}: {error}")


def test_a_ball_and_a_shaft_in_a_hollow_ball_are_nothing_rather_than_an_error():
    """A row of the table holds for its own order: the sphere as the hollow one of a cylinder and a sphere is none."""
    rod, socket = FEATURES["cylinder", 1], FEATURES["sphere", -1]
    for a, b in ((rod, socket), (socket, rod)):
        assert (
            matches(FeatureView(Extent.of(a), pin.SE3.Identity()), FeatureView(Extent.of(b), pin.SE3.Identity()), NEAR)
            is None
        )


MEDIUM = {
    3: 3.4,
    4: 4.5,
    5: 5.5,
    6: 6.6,
    8: 9,
    10: 11,
    12: 13.5,
    16: 17.5,
    20: 22,
    24: 26,
    30: 33,
    36: 39,
    64: 70,
    150: 158,
}
COARSE = {14: 16.5, 16: 18.5, 20: 24, 24: 28, 30: 35, 36: 42, 42: 48, 48: 56}


@pytest.mark.parametrize(("screw", "hole"), [*MEDIUM.items(), *COARSE.items(), (6, 6.5)])
def test_a_screw_fits_its_clearance_hole_of_iso_273(screw, hole):
    match = matches(view(shaft(screw / 2e3, 0.05), 1), view(housing(hole / 2e3, 0.02, outer=hole / 1e3), 3), EXACT)
    assert match.kind == "concentric" and match.fit == pytest.approx((hole - screw) / 2e3)


def test_the_limit_of_clearance_is_a_parameter():
    one, other = view(shaft(0.003, 0.05), 1), view(housing(0.00325, 0.06), 3)
    tight = Limits.offer(replace(Tolerance(), reach=0.0, clearance=2e-4, clearance_relative=0.0))
    assert matches(one, other, EXACT).kind == "concentric"
    assert matches(one, other, tight) is None
    wide = replace(Tolerance(), reach=0.0, clearance=5e-3)
    assert matches(one, view(housing(0.0079, 0.06), 3), Limits.offer(wide)).kind == "concentric"
    # interference is no clearance hole: it stays within `clearance`
    assert matches(view(shaft(0.0405, 0.05), 1), view(housing(0.04, 0.06, outer=0.06), 3), EXACT) is None


def test_a_loose_shaft_at_the_wall_of_its_bore_is_tangent_to_it():
    match = matches(view(shaft(0.01, 0.05), 1, (0.0005, 0, 0)), view(housing(0.0105, 0.06), 3), EXACT)
    assert match.kind == "tangent" and match.parameters == {"mode": "inside"}


def test_surfaces_that_do_not_overlap_are_not_said_to():
    words = [over(length) for length in (0.012, 1e-15, 0.0, -0.0012)]
    assert words == [" over 12 mm", ", end to end", ", end to end", ", ends 1.2 mm apart"]
