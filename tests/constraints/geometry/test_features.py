"""Faces joined to features, on meshes whose faces are known."""

import numpy as np
import pinocchio as pin
import pytest

from collision import SurfaceMesh
from constraints.geometry.features import group_features
from constraints.geometry.surfaces import Cylinder, Freeform, Geometry, Plane, Sphere, Torus

Z = np.array([0.0, 0.0, 1.0])


def band(
    start: float, stop: float, low: float, high: float, radius: float, n: int = 12
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a piece of a cylinder about z."""
    angles = np.linspace(start, stop, n)
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    vertices = np.vstack([np.column_stack([ring, np.full(n, z)]) for z in (low, high)])
    k = np.arange(n - 1)
    triangles = np.vstack([np.column_stack([k, k + 1, k + n]), np.column_stack([k + 1, k + n + 1, k + n])])
    return vertices, triangles


def square(x: float, z: float, tilt: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.array([[x, 0, z], [x + 0.01, 0, z + tilt], [x + 0.01, 0.01, z + tilt], [x, 0.01, z]])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def packed(*pieces: tuple[np.ndarray, np.ndarray]) -> SurfaceMesh:
    starts = np.cumsum([0, *(len(v) for v, _ in pieces)])
    return SurfaceMesh(
        np.vstack([v for v, _ in pieces]),
        np.vstack([t + s for (_, t), s in zip(pieces, starts, strict=False)]),
        np.repeat(np.arange(len(pieces)), [len(t) for _, t in pieces]),
    )


def test_two_half_bores_are_one_feature_and_a_shaft_of_their_size_is_another():
    mesh = packed(
        band(0, np.pi, 0, 0.02, 0.005), band(np.pi, 2 * np.pi, 0, 0.02, 0.005), band(0, 6.0, 0.03, 0.05, 0.005)
    )
    bore = Cylinder(np.zeros(3), Z, 0.005)
    features = group_features(mesh, [bore, Cylinder(Z, -Z, 0.005), bore], [-1, -1, 1])
    assert [(f.surfaces, f.sense) for f in features] == [((0, 1), -1), ((2,), 1)]
    assert features[0].area == pytest.approx(2 * np.pi * 0.005 * 0.02, rel=0.01)
    assert features[0].residual < 1e-15
    corners = features[0].samples[features[0].triangles]
    assert len(corners) == len(mesh.triangles_of(0)) + len(mesh.triangles_of(1))
    assert {tuple(p) for p in corners.reshape(-1, 3)} == {tuple(p) for p in features[0].samples}


def test_a_bore_that_a_groove_interrupts_is_one_feature():
    mesh = packed(band(0, 6.2, 0, 0.01, 0.005), band(0, 6.2, 0.01, 0.012, 0.006), band(0, 6.2, 0.012, 0.03, 0.005))
    geometries = [Cylinder(np.zeros(3), Z, r) for r in (0.005, 0.006, 0.005)]
    features = group_features(mesh, geometries, [-1, -1, -1])
    assert [f.surfaces for f in features] == [(0, 2), (1,)]


def test_fitted_halves_are_fitted_anew_together():
    halves = (band(0, np.pi, 0, 0.02, 0.005), band(np.pi, 2 * np.pi, 0, 0.02, 0.005))
    off = pin.SE3(pin.exp3(np.array([2e-5, 0.0, 0.0])), np.array([3e-7, 0.0, 0.0]))
    geometries = [Cylinder(np.zeros(3), Z, 0.0050003).transformed(off), Cylinder(np.zeros(3), Z, 0.005)]
    (feature,) = group_features(packed(*halves), geometries, [-1, -1], [4e-7, 1e-7])
    assert feature.surfaces == (0, 1)
    assert isinstance(feature.geometry, Cylinder)
    assert feature.geometry.radius == pytest.approx(0.005, abs=1e-10)
    assert feature.residual < 1e-10


@pytest.mark.parametrize(
    "other",
    [
        Cylinder(np.array([3e-5, 0.0, 0.0]), Z, 0.005),  # beside it
        Cylinder(np.zeros(3), Z, 0.00503),  # wider
        Cylinder(np.zeros(3), np.array([0.0, 0.01, 1.0]), 0.005),  # tilted
    ],
)
def test_cylinders_that_differ_stay_apart(other):
    mesh = packed(band(0, 6.2, 0, 0.01, 0.005), band(0, 6.2, 0.02, 0.03, other.radius))
    assert len(group_features(mesh, [Cylinder(np.zeros(3), Z, 0.005), other], [-1, -1])) == 2


def test_a_plane_split_in_ten_is_one_feature_and_its_back_another():
    mesh = packed(*(square(0.02 * i, 0.0) for i in range(10)), square(0.0, 0.0), square(0.0, 1e-4))
    up = [Plane(np.array([0.02 * i, 0.0, 0.0]), Z) for i in range(10)]
    features = group_features(mesh, [*up, Plane(np.zeros(3), -Z), Plane(1e-4 * Z, Z)], [1] * 12)
    assert [f.surfaces for f in features] == [tuple(range(10)), (10,), (11,)]


def test_a_chain_of_faces_within_tolerance_of_each_other_does_not_creep():
    step = 6e-6  # neighbours are within the fit tolerance of 1e-5, the next but one is not
    mesh = packed(*(square(0.02 * i, step * i) for i in range(5)))
    features = group_features(mesh, [Plane(step * i * Z, Z) for i in range(5)], [1] * 5)
    assert max(np.ptp(f.samples[:, 2]) for f in features) <= 2e-5
    assert len(features) >= 2


def test_freeform_faces_belong_to_no_feature_and_balls_and_rings_are_told_apart():
    mesh = packed(*(square(0.02 * i, 0.0) for i in range(4)))
    geometries: list[Geometry] = [Freeform(), Sphere(np.zeros(3), 1.0), Torus(np.zeros(3), Z, 1.0, 0.1), Freeform()]
    features = group_features(mesh, geometries, [1, -1, 1, 1])
    assert [(f.geometry.kind, f.surfaces, f.sense) for f in features] == [("sphere", (1,), -1), ("torus", (2,), 1)]
