"""Segmentation of triangle meshes into the surfaces from which they were tessellated."""

import pickle
import tracemalloc
from collections import Counter

import numpy as np
import pytest
import trimesh

import vpframe as vp
from collision import Tolerance
from tests.vpframe.importers.tessellated import merged, overlap, plate
from vpframe.importers import meshes
from vpframe.importers.mesh_files import weld
from vpframe.importers.segmentation import _Segmentation, segment
from vpframe.scene import modelling as m


def stepped_shaft() -> m.Solid:
    """Bands of planes, cylinders and cones in a row about one axis: a torus goes through any three of their circles."""
    profile = [
        (0, 0),
        (0.008, 0),
        (0.01, 0.002),
        (0.01, 0.02),
        (0.012, 0.021),
        (0.013, 0.023),
        (0.013, 0.03),
        (0.006, 0.034),
    ]
    return m.revolve([*profile, (0.006, 0.05), (0, 0.05)])


def wave() -> m.Solid:
    """Planes at blunt angles side by side, and a slot's rounded ends: no curved surface where there is none."""
    solid = m.extrude([(0, 0), (0.03, 0), (0.04, 0.004), (0.05, 0.012), (0.05, 0.03), (0, 0.03)], 0.008)
    slot = m.box(0.01, 0.006, 0.008) + m.cylinder(0.003, 0.008).translated(0, 0.003)
    slot += m.cylinder(0.003, 0.008).translated(0.01, 0.003)
    return solid - slot.translated(0.015, 0.012)


@pytest.mark.parametrize("make", [plate, stepped_shaft, wave])
@pytest.mark.parametrize("angular", [0.2, 0.35])
def test_the_surfaces_of_a_tessellated_solid_are_found_again(make, angular):
    truth = m.shape(make(), 1e-3, angular)
    mesh = truth.mesh
    vertices, triangles = weld(mesh.vertices.astype(np.float32).astype(np.float64), mesh.triangles.astype(np.int64))
    segments = segment(vertices, triangles, 1e-6)
    corners = vertices[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert np.array_equal(np.sort(np.concatenate([s.triangles for s in segments])), np.arange(len(triangles)))
    found = np.empty(len(triangles), int)
    for i, s in enumerate(segments):
        assert s.residual <= 1e-6
        found[s.triangles] = i
    kinds = [s.geometry.kind for s in truth.surfaces]
    expected = merged(vertices, triangles, mesh.surface_of_triangle.astype(int), kinds)
    found = merged(vertices, triangles, found, [s.geometry.kind for s in segments])
    for face in np.unique(expected):
        best = max(np.unique(found[expected == face]), key=lambda s: overlap(expected == face, found == s, area))
        assert overlap(expected == face, found == best, area) >= 0.9, f"{kinds[face]} {face} came back in pieces"
        assert segments[best].geometry.kind == kinds[face]


@pytest.mark.slow
def test_a_freeform_surface_between_planes_is_one_segment():
    n = 16
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 0.05, n), np.linspace(0, 0.05, n)))
    top = np.column_stack([x, y, 0.02 + 0.004 * np.sin(110 * x) * np.cos(90 * y)])
    grid = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    quads = np.vstack(
        [np.column_stack([grid, grid + 1, grid + n + 1]), np.column_stack([grid, grid + n + 1, grid + n])]
    )
    rim = np.r_[
        np.arange(n), np.arange(1, n) * n + n - 1, (n - 1) * n + np.arange(n - 2, -1, -1), np.arange(n - 2, 0, -1) * n
    ]
    foot = np.column_stack([top[rim, :2], np.zeros(len(rim))])
    k = np.arange(len(rim))
    nxt = np.roll(k, -1)
    walls = np.vstack(
        [np.column_stack([rim[k], k + n * n, rim[nxt]]), np.column_stack([rim[nxt], k + n * n, nxt + n * n])]
    )
    vertices, triangles = weld(np.vstack([top, foot]), np.vstack([quads, walls]))
    segments = segment(vertices, triangles, 1e-6)
    kinds = sorted(s.geometry.kind for s in segments)
    assert kinds == ["freeform", "plane", "plane", "plane", "plane"]
    free = next(s for s in segments if s.geometry.kind == "freeform")
    assert len(free.triangles) == len(quads)


BOX = trimesh.creation.box((0.1, 0.2, 0.3))


def test_the_same_mesh_gives_the_same_segments():
    mesh = m.shape(plate()).mesh
    vertices, triangles = weld(mesh.vertices, mesh.triangles.astype(np.int64))
    first, second = (segment(vertices, triangles, 1e-6, Tolerance()) for _ in range(2))
    assert [s.triangles.tolist() for s in first] == [s.triangles.tolist() for s in second]
    assert [repr(s.geometry) for s in first] == [repr(s.geometry) for s in second]


def ring(n: int, radius: float, height: float) -> np.ndarray:
    a = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return np.column_stack([radius * np.cos(a), radius * np.sin(a), np.full(n, height)])


def disc(n: int, lower: float, upper: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """A frustum of n sides whose ends are fans of triangles, as readers cut polygons."""
    i, fan = np.arange(n), np.arange(1, n - 1)
    j = (i + 1) % n
    sides = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    ends = np.vstack([np.column_stack([0 * fan, fan + 1, fan]), np.column_stack([0 * fan, fan, fan + 1]) + n])
    return np.vstack([ring(n, lower, 0.0), ring(n, upper, height)]), np.vstack([sides, ends])


@pytest.mark.parametrize(
    ("sizes", "kinds"),
    [
        ((0.05, 0.05, 0.02), {"plane": 2, "cylinder": 1}),
        ((0.05, 0.048, 0.0003), {"plane": 2, "cone": 1}),
        ((0.05, 0.03, 0.01), {"plane": 2, "cone": 1}),
    ],
)
def test_memory_and_calls_of_a_segmentation_grow_with_the_triangles(sizes, kinds):
    """Ends of many sides: the number of sides enters once, in memory and in work, not squared."""
    peaks = []
    for n in (400, 1600, 6400):
        vertices, triangles = disc(n, *sizes)
        tracemalloc.start()
        segments = segment(vertices, triangles.astype(np.int32), 1e-6)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert Counter(s.geometry.kind for s in segments) == kinds
    assert peaks[2] < 8 * peaks[1] and peaks[2] < 6400 * 4 * 20_000


def test_a_plane_of_few_directions_is_told_from_a_strip():
    """`_is_wide` against its definition: all directions of sides tried."""
    rng = np.random.default_rng(3)
    answers = set()
    for _ in range(60):
        n, turn = int(rng.integers(3, 9)), np.linalg.qr(rng.normal(size=(3, 3)))[0]
        x = np.sort(rng.uniform(0.0, 1.0, n))
        y = rng.choice([0.0, rng.choice([1e-7, 1e-3, 0.1])], n)
        points = np.vstack([np.column_stack([x, y, 0 * x]), np.column_stack([x, 0.3 + 0 * x, 0 * x])]) @ turn.T
        i = np.arange(n - 1)
        triangles = np.vstack([np.column_stack([i, i + 1, i + n]), np.column_stack([i + 1, i + n + 1, i + n])])
        found = _Segmentation(points, triangles.astype(np.int32), 1e-6, Tolerance())
        sides = points[np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])]
        along = sides[:, 1] - sides[:, 0]
        heights = points @ np.cross(turn[:, 2], along / np.linalg.norm(along, axis=1)[:, None]).T
        off = np.minimum(heights - heights.min(axis=0), heights.max(axis=0) - heights).max(axis=0)
        expected = len(points) >= 6 and bool(off.min() > 1e-6)
        assert found._is_wide(np.arange(len(triangles))) == expected
        answers.add(expected)
    assert answers == {True, False}


@pytest.mark.parametrize("form", ["stl", "obj", "glb"])
def test_a_mesh_is_segmented_when_its_surfaces_are_needed_and_once(tmp_path, monkeypatch, form):
    calls = []
    found = meshes.segment
    monkeypatch.setattr(meshes, "segment", lambda *given: calls.append(given) or found(*given))
    monkeypatch.setenv("VPFRAME_CACHE", str(tmp_path / "cache"))
    BOX.export(tmp_path / f"a.{form}")
    scene = vp.load(tmp_path / f"a.{form}")
    part = scene["a"]
    assert part.shape.closed and part.shape.volume > 0.0 and part.shape.center == pytest.approx(np.zeros(3), abs=1e-9)
    assert not calls
    copied = pickle.loads(pickle.dumps(part.shape))
    assert not calls
    assert len(part.surfaces) == len(part.features) == part.mesh.n_surfaces == 6
    assert len(calls) == 1
    assert len(copied.surfaces) == 6 and len(vp.load(tmp_path / f"a.{form}")["a"].surfaces) == 6
    assert len(calls) == 1, "kept beside the model"
