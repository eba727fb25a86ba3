"""The filter by arrays drops no pair of features that the pairing table matches, and nearly all others."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import Tolerance
from constraints.geometry.features import Feature
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from constraints.geometry.views import Limits
from constraints.recognition.recognise import Recogniser
from tests.constraints.shapes import box, flanged_shaft, housing

EXACT = Limits.offer(replace(Tolerance(), reach=0.0, reach_angular=0.0))
LIMITS = (EXACT, Limits.offer(Tolerance()), Limits.keep(Tolerance()), replace(EXACT, linear=np.inf, angular=np.pi / 2))
AXIS = np.array([0.0, 0.0, 1.0])
RADII = (0.004, 0.0041, 0.005, 0.0066)


def patch(geometry: Geometry, sense: int, points: np.ndarray) -> Feature:
    """A feature whose samples are a grid (n, m, 3) on its surface."""
    n, m = points.shape[:2]
    corners = [(i * m + j, (i + 1) * m + j, i * m + j + 1) for i in range(n - 1) for j in range(m - 1)]
    corners += [((i + 1) * m + j, (i + 1) * m + j + 1, i * m + j + 1) for i in range(n - 1) for j in range(m - 1)]
    return Feature(geometry, (0,), sense, points.reshape(-1, 3), np.array(corners, np.int32), 0.0, 1e-4)


def feature_of(kind: str, sense: int, radius: float, origin: float) -> Feature:
    """A surface about the z axis; `origin`: m, along it, from the middle of the feature to where its axis begins."""
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-0.005, 0.005, 5), indexing="ij")
    start = np.array([0.0, 0.0, origin])

    def about(r: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=2)

    if kind == "plane":
        x, y = np.meshgrid(np.linspace(-radius, radius, 3), np.linspace(-0.01, 0.01, 3), indexing="ij")
        return patch(Plane(np.zeros(3), AXIS), 1, np.stack([x, y, 0 * x], axis=2))
    if kind == "cylinder":
        return patch(Cylinder(start, AXIS, radius), sense, about(0 * height + radius, height))
    if kind == "cone":
        return patch(Cone(-radius * AXIS, AXIS, np.pi / 4), sense, about(height + radius, height))
    angle = height / 0.005 * 1.2
    if kind == "sphere":
        return patch(Sphere(np.zeros(3), radius), sense, about(radius * np.cos(angle), radius * np.sin(angle)))
    ring = Torus(np.zeros(3), AXIS, 0.01, radius)
    return patch(ring, sense, about(0.01 + radius * np.cos(2.5 * angle), radius * np.sin(2.5 * angle)))


features = st.builds(
    feature_of,
    st.sampled_from(["plane", "cylinder", "cylinder", "cone", "sphere", "torus"]),
    st.sampled_from([1, -1]),
    st.sampled_from(RADII),
    st.sampled_from([0.0, 0.3]),
)


@settings(max_examples=400, deadline=None)
@given(
    mine=st.lists(features, min_size=3, max_size=6),
    theirs=st.lists(features, min_size=3, max_size=6),
    seed=st.integers(0, 2**32 - 1),
    off=st.sampled_from([0.0, 1e-5, 1e-4, 1e-3]),
    tilt=st.sampled_from([0.0, 1e-4, 1e-2, 0.3]),
    quarter=st.sampled_from([(0, 0), (1, 0), (2, 0), (0, 1)]),
    side=st.sampled_from([0.0, *RADII, 0.008, 0.01, 0.014]),
    limits=st.sampled_from(LIMITS),
)
def test_what_the_table_matches_passes(mine, theirs, seed, off, tilt, quarter, side, limits):
    rng = np.random.default_rng(seed)
    turned = pin.rpy.rpyToMatrix(*(0.5 * np.pi * np.array([*quarter, 0.0]))) @ pin.exp3(rng.normal(0, tilt, 3))
    shift = side * rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)] + rng.normal(0, off, 3)
    base = pin.SE3.Random()
    poses = [base, base * pin.SE3(turned, shift)]
    recogniser = Recogniser([mine, theirs], {(0, 0): 1e-3} if seed % 3 == 0 else {})
    pairs = [(0, i, 1, j) for i in range(len(mine)) for j in range(len(theirs))]
    codes = np.array([recogniser.code(pair) for pair in pairs])
    kept = set(recogniser.likely(codes, poses, limits).tolist())
    for pair, code in zip(pairs, codes.tolist(), strict=True):
        assert recogniser.pair(code) == pair
        assert code in kept or recogniser.matches(pair, poses, limits) is None, pair


@pytest.mark.parametrize("gap", [0.0, 1e-3])
def test_of_a_shaft_in_its_housing_little_is_measured(gap):
    bodies = [housing(0.01002), flanged_shaft(phase=0.05), box(0.05, 0.05, 0.05)]
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01 + gap])), pin.SE3.Random()]
    recogniser = Recogniser([body.features for body in bodies])
    places = [(i, f) for i, body in enumerate(bodies) for f in range(len(body.features))]
    codes = np.array([recogniser.code((*p, *q)) for p in places for q in places if p[0] < q[0]])
    assert len(recogniser.likely(codes, poses, EXACT)) <= 0.1 * len(codes)
