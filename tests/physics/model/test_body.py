import numpy as np
import pytest
from physics_meshes import ball_mesh, box_mesh, cylinder_mesh

from collision import SurfaceMesh
from physics import Body, BodyError


def test_box_has_its_closed_form():
    body = Body.from_mesh(box_mesh(0.1, 0.2, 0.3), 7850.0)
    mass = 7850.0 * 0.006
    assert body.mass == pytest.approx(mass, rel=1e-14)
    expected = mass / 12 * np.diag([0.2**2 + 0.3**2, 0.1**2 + 0.3**2, 0.1**2 + 0.2**2])
    assert np.abs(body.inertia - expected).max() < 1e-14 * expected.max()
    assert np.abs(body.center).max() < 1e-16
    assert body.notes == ()


def test_far_from_the_origin_nothing_cancels():
    near = box_mesh(0.1, 0.2, 0.3)
    far = SurfaceMesh(near.vertices + np.array([1e3, -2e3, 5e2]), near.triangles, near.surface_of_triangle)
    body = Body.from_mesh(far, 1000.0)
    assert np.abs(body.center - [1e3, -2e3, 5e2]).max() < 1e-11
    assert np.abs(body.inertia - Body.from_mesh(near, 1000.0).inertia).max() < 1e-9


@pytest.mark.parametrize("n", [8, 16, 32])
def test_ball_errs_by_its_deflection_only(n):
    """A ball of inscribed facets misses no more than a shell as thick as the deflection."""
    body = Body.from_mesh(ball_mesh(0.05, n), 1000.0)
    volume = 4 / 3 * np.pi * 0.05**3
    vertices, triangles = ball_mesh(0.05, n).vertices, ball_mesh(0.05, n).triangles
    deflection = 0.05 - np.linalg.norm(vertices[triangles].mean(axis=1), axis=1).min()
    assert 0 < volume - body.volume < 4 * np.pi * 0.05**2 * deflection


def test_cylinder_converges_to_its_closed_form():
    errors = []
    for n in (32, 64):
        body = Body.from_mesh(cylinder_mesh(0.02, 0.1, n), 1000.0)
        mass = 1000 * np.pi * 0.02**2 * 0.1
        errors.append(abs(body.inertia[2, 2] / (0.5 * mass * 0.02**2) - 1))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def test_inverted_and_open_meshes_are_named():
    mesh = box_mesh(0.1, 0.1, 0.1)
    inverted = SurfaceMesh(mesh.vertices, mesh.triangles[:, ::-1], mesh.surface_of_triangle, "turned")
    body = Body.from_mesh(inverted, 1000.0)
    assert body.mass == pytest.approx(1.0) and "turned" in body.notes[0] and "inverted" in body.notes[0]
    opened = SurfaceMesh(mesh.vertices, mesh.triangles[2:], mesh.surface_of_triangle[2:] - 1, "lidless")
    body = Body.from_mesh(opened, 1000.0)
    assert body.mass == pytest.approx(1.0) and "lidless" in body.notes[0] and "convex hull" in body.notes[0]


def test_a_vertex_on_a_neighbours_edge_opens_nothing():
    """One side of a box is cut in three at points of its edges: no gap. With one of the three taken away there is."""
    mesh = box_mesh(0.1, 0.2, 0.3)
    a, b, c = mesh.triangles[0]
    middle = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
    third = (mesh.vertices[a] + 2.0 * middle) / 3.0
    vertices = np.vstack([mesh.vertices, middle, third])
    cut = [(a, 9, c), (9, 8, c), (8, b, c)]
    whole = SurfaceMesh(vertices, [*mesh.triangles[1:], *cut], None, "cut")
    body = Body.from_mesh(whole, 1000.0)
    assert body.notes == () and body.mass == pytest.approx(6.0, rel=1e-12)
    body = Body.from_mesh(SurfaceMesh(vertices, [*mesh.triangles[1:], *cut[1:]], None, "torn"), 1000.0)
    assert "torn" in body.notes[0] and "3 edges" in body.notes[0] and "0.006 m³" in body.notes[0]


def test_unshared_vertices_still_close_the_mesh():
    mesh = box_mesh(0.1, 0.1, 0.1)
    loose = SurfaceMesh(mesh.vertices[mesh.triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert Body.from_mesh(loose, 1000.0).notes == ()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"mass": 0.0}, "mass"),
        ({"mass": -1.0}, "mass"),
        ({"mass": np.nan}, "mass"),
        ({"inertia": np.diag([1.0, 1.0, 3.0])}, "inertia"),
        ({"inertia": np.diag([1.0, 0.0, 1.0])}, "inertia"),
        ({"inertia": np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]])}, "inertia"),
        ({"center": [0.0, np.inf, 0.0]}, "center"),
        ({"volume": -1.0}, "volume"),
    ],
)
def test_impossible_bodies(change, field):
    given = {"mass": 1.0, "inertia": np.eye(3), "name": "crank"} | change
    with pytest.raises(BodyError, match="crank") as caught:
        Body(**given)
    assert caught.value.name == "crank" and caught.value.field == field


def test_flat_mesh_and_unknown_material():
    flat = SurfaceMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="sheet")
    with pytest.raises(BodyError, match="sheet"):
        Body.from_mesh(flat, 1000.0)
    with pytest.raises(BodyError, match="unobtainium"):
        Body.from_mesh(box_mesh(1, 1, 1), "unobtainium")
    assert Body.from_mesh(box_mesh(1, 1, 1), "Steel").mass == pytest.approx(7850.0)
