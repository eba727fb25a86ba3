"""Bare meshes: what the files say is kept, and surfaces are found again that tessellation hid."""

import numpy as np
import pytest
import trimesh

import vpframe as vp
from constraints.geometry.surfaces import Cylinder
from tests.vpframe.importers.tessellated import merged, overlap, plate, soup
from vpframe.importers.mesh_files import weld
from vpframe.importers.segmentation import segment
from vpframe.scene import modelling as m


@pytest.mark.parametrize("form", ["stl", "obj", "ply", "glb"])
def test_a_mesh_file_becomes_typed_surfaces(tmp_path, form):
    truth = m.shape(plate())
    soup(truth, 1.0 if form == "glb" else 1000.0).export(tmp_path / f"plate.{form}")
    scene = vp.load(tmp_path / f"plate.{form}")
    (part,) = scene.parts
    assert part.shape.closed
    assert part.mesh.vertices.min(axis=0) == pytest.approx(truth.mesh.vertices.min(axis=0), abs=1e-8)
    assert part.shape.volume == pytest.approx(truth.volume, rel=5e-3)
    expected = sorted((f.geometry.kind, f.sense) for f in truth.features)
    assert sorted((f.geometry.kind, f.sense) for f in part.features) == expected
    bore = next(f.geometry for f in part.features if isinstance(f.geometry, Cylinder) and f.sense < 0)
    assert bore.radius == pytest.approx(0.004, abs=1e-8)
    assert any("mm" in note for note in scene.notes) == (form != "glb")


@pytest.mark.parametrize(
    ("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254), ("ft", 0.3048), (None, 0.001)]
)
def test_units(tmp_path, unit, metres):
    trimesh.creation.box((10.0, 20.0, 30.0)).export(tmp_path / "a.stl")
    part = vp.load(tmp_path / "a.stl", unit=unit)["a"]
    assert np.ptp(part.mesh.vertices, axis=0) == pytest.approx(np.array([10.0, 20.0, 30.0]) * metres, rel=1e-6)


def test_a_small_model_without_a_unit_is_taken_to_be_in_metres_and_says_so(tmp_path):
    trimesh.creation.box((0.01, 0.02, 0.03)).export(tmp_path / "a.ply")
    scene = vp.load(tmp_path / "a.ply")
    assert np.ptp(scene["a"].mesh.vertices, axis=0) == pytest.approx([0.01, 0.02, 0.03], rel=1e-6)
    assert any("taken as m;" in note for note in scene.notes)


class TestRealModels:
    @pytest.mark.parametrize(
        ("name", "concave", "diameter"),
        [("factory_round_peg_8mm_tight", False, 7.995e-3), ("factory_round_hole_8mm_subdiv_3x", True, 8.1e-3)],
    )
    def test_peg_and_hole(self, real_models, name, concave, diameter):
        (part,) = vp.load(real_models / "mesh" / f"{name}.obj").parts
        (fit,) = (s for s in part.surfaces if isinstance(s.geometry, Cylinder))
        assert fit.orientation == ("concave" if concave else "convex")
        assert 2 * fit.geometry.radius == pytest.approx(diameter, abs=1e-5)

    @pytest.mark.parametrize(
        ("name", "needed", "total"), [("odri_pulley", 76, 76), ("tinymovr_gimbal_bracket", 48, 56)]
    )
    def test_segmentation(self, real_models, name, needed, total):
        """Faces recovered with at least 0.9 of their area, neighbours on one analytic surface merged on both sides."""
        stl = trimesh.load_mesh(real_models / "segmentation" / f"{name}.stl", process=False)
        truth = np.load(real_models / "segmentation" / f"{name}_truth.npz")
        vertices, triangles = weld(np.asarray(stl.vertices) * 1e-3, np.asarray(stl.faces))
        corners = vertices[triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        vertices, triangles, face, area = vertices, triangles[area > 0], truth["face_id"][area > 0], area[area > 0]
        segments = segment(vertices, triangles, 1e-6)
        found = np.empty(len(triangles), int)
        for i, s in enumerate(segments):
            found[s.triangles] = i
        face = merged(vertices, triangles, face, [str(k) for k in truth["kind"]])
        found = merged(vertices, triangles, found, [s.geometry.kind for s in segments])
        numbers = np.unique(face)
        best = [max(overlap(face == f, found == s, area) for s in np.unique(found[face == f])) for f in numbers]
        assert len(numbers) == total
        assert sum(b >= 0.9 for b in best) >= needed
