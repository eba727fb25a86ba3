"""Fits against surfaces that are known: exact points in, the surface out; noise in, no worse than the noise out."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collision import Tolerance
from constraints.geometry.surfaces import Cone, Cylinder, Geometry, Plane, Sphere, Torus
from constraints.recognition.fits import KINDS, FitError, allowed, fit_kind, fit_surface, refine

Z = np.array([0.0, 0.0, 1.0])


def patch(kind: str, size: float, sweep: float, n: int = 9) -> tuple[Geometry, np.ndarray, np.ndarray]:
    """A surface about the origin, (n², 3) points of a patch of it and their normals."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0.0, sweep, n), np.linspace(0.0, 1.0, n)))
    c, s = np.cos(u), np.sin(u)
    if kind == "plane":
        geometry: Geometry = Plane(np.zeros(3), Z)
        points = np.column_stack([u, v, 0.0 * u])
    elif kind == "cylinder":
        geometry = Cylinder(np.zeros(3), Z, 1.0)
        points = np.column_stack([c, s, v])
    elif kind == "cone":
        geometry = Cone(np.zeros(3), Z, 0.4)
        points = np.column_stack([(1 + v) * np.tan(0.4) * c, (1 + v) * np.tan(0.4) * s, 1 + v])
    elif kind == "sphere":
        geometry = Sphere(np.zeros(3), 1.0)
        points = np.column_stack([np.cos(v) * c, np.cos(v) * s, np.sin(v)])
    else:
        geometry = Torus(np.zeros(3), Z, 2.0, 0.5)
        w = 1.5 * v
        points = np.column_stack([(2 + 0.5 * np.cos(w)) * c, (2 + 0.5 * np.cos(w)) * s, 0.5 * np.sin(w)])
    normals = geometry.normals(points)
    return scaled(geometry, size), points * size, normals


def scaled(geometry: Geometry, size: float) -> Geometry:
    angles = {"half_angle", "normal", "axis"}
    return type(geometry)(**{k: v if k in angles else v * size for k, v in vars(geometry).items()})


def same(a: Geometry, b: Geometry, points: np.ndarray, gap: float) -> bool:
    return a.kind == b.kind and bool(np.abs(b.distance(points)).max() <= gap)


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    size=st.sampled_from([1e-4, 1e-2, 1.0, 1e3]),
    sweep=st.floats(0.6, 6.0),
    seed=st.integers(0, 10_000),
)
def test_exact_points_give_back_their_surface(kind, size, sweep, seed):
    truth, points, normals = patch(kind, size, sweep)
    rng = np.random.default_rng(seed)
    pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3) * size * 10.0)
    truth, points, normals = (
        truth.transformed(pose),
        points @ pose.rotation.T + pose.translation,
        normals @ pose.rotation.T,
    )
    fit = fit_surface(points, points, normals)
    assert fit is not None
    assert fit.geometry.kind == kind
    assert fit.residual <= 1e-9 * size
    assert np.abs(truth.distance(points)).max() <= 1e-9 * size
    for name in ("radius", "half_angle", "major", "minor"):
        if hasattr(truth, name):
            assert getattr(fit.geometry, name) == pytest.approx(getattr(truth, name), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_is_averaged_and_never_made_worse(kind):
    truth, points, normals = patch(kind, 0.01, 1.5, n=20)
    rng = np.random.default_rng(3)
    noisy = points + rng.normal(scale=1e-7, size=points.shape)
    rough = normals + rng.normal(scale=0.05, size=points.shape)
    fit = fit_kind(kind, noisy, noisy, rough)
    assert np.sum(fit.geometry.distance(noisy) ** 2) <= np.sum(truth.distance(noisy) ** 2) * (1 + 1e-9)
    assert np.abs(fit.geometry.distance(points)).max() < 2e-7


@pytest.mark.parametrize("kind", KINDS[1:])
def test_refine_reaches_a_point_where_no_small_step_helps(kind):
    truth, points, _ = patch(kind, 1.0, 2.0)
    rng = np.random.default_rng(5)
    noisy = points + rng.normal(scale=1e-3, size=points.shape)
    best = refine(truth, noisy)
    least = np.sum(best.distance(noisy) ** 2)
    for _ in range(200):
        nudge = pin.SE3(pin.exp3(rng.normal(scale=1e-4, size=3)), rng.normal(scale=1e-4, size=3))
        assert np.sum(best.transformed(nudge).distance(noisy) ** 2) >= least * (1 - 1e-9)


def test_a_half_bore_fits_to_nanometres_although_its_normals_are_those_of_facets():
    angles = np.linspace(0.0, np.pi, 10)
    ring = np.column_stack([0.005 * np.cos(angles), 0.005 * np.sin(angles)])
    points = np.vstack([np.column_stack([ring, np.full(10, z)]) for z in (0.0, 0.02)])
    middle = 0.5 * (ring[:-1] + ring[1:])
    bases = np.column_stack([middle, np.full(9, 0.01)])
    tilted = np.column_stack([middle, np.full(9, 1e-5)])
    fit = fit_surface(points, bases, tilted)
    assert fit is not None and isinstance(fit.geometry, Cylinder)
    assert fit.residual < 1e-12
    assert fit.geometry.radius == pytest.approx(0.005, abs=1e-12)
    assert np.linalg.norm(np.cross(fit.geometry.axis, Z)) < 1e-9


def test_what_is_no_analytic_surface_is_not_made_one():
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.01, 0.01, 12), np.linspace(-0.01, 0.01, 12)))
    points = np.column_stack([x, y, 20.0 * x * y + 900.0 * x**3])
    normals = np.column_stack([-20.0 * y - 2700.0 * x**2, -20.0 * x, np.ones_like(x)])
    assert fit_surface(points, points, normals) is None


def test_the_corners_of_a_cube_are_not_a_sphere():
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = corners[[[f[0], f[i], f[i + 1]] for f in faces for i in (1, 2)]]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    middles = triangles.mean(axis=1)
    assert fit_kind("sphere", corners, middles, normals).residual < 1e-12
    assert fit_surface(corners, middles, normals, kinds=("sphere",)) is None


def test_a_tiny_bent_face_is_not_a_plane_just_because_it_is_tiny():
    angles = np.linspace(0.0, np.pi / 2, 6)
    points = np.vstack(
        [np.column_stack([1e-5 * np.cos(angles), 1e-5 * np.sin(angles), np.full(6, z)]) for z in (0.0, 1e-4)]
    )
    normals = np.column_stack([points[:, :2], np.zeros(12)])
    assert fit_kind("plane", points, points, normals).residual < Tolerance().fit
    fit = fit_surface(points, points, normals)
    assert fit is not None and fit.geometry.kind == "cylinder"
    assert allowed(points, Tolerance()) < 1.1e-7


@pytest.mark.parametrize("kind", KINDS)
def test_points_of_no_extent_are_refused(kind):
    with pytest.raises(FitError, match="extent"):
        fit_kind(kind, np.zeros((5, 3)), np.zeros((5, 3)), np.ones((5, 3)))
