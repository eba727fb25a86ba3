"""Geometry of faces that files leave untyped."""

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.importers.solids import bracket, truth, untyped
from vpframe.importers import brep, build
from vpframe.importers.raw import RawFace
from vpframe.scene import modelling as m


def test_surfaces_that_the_file_leaves_untyped_are_recognised(tmp_path):
    typed = m.shape(bracket())
    shape = vp.load(m.write_step(tmp_path / "a.step", {"a": untyped(bracket())}))["a"].shape
    assert len(shape.surfaces) > len(typed.surfaces)
    assert truth(shape) == truth(typed)
    fitted = [s for s in shape.surfaces if s.geometry.kind != "plane"]
    assert all(0.0 < s.residual <= 1e-5 for s in fitted)
    for feature in shape.features:
        assert feature.residual <= 1e-5
        assert {shape.surfaces[i].geometry.kind for i in feature.surfaces} == {feature.geometry.kind}


def test_where_the_kernel_declines_too_the_fit_finds_them():
    raw = brep.tessellate(untyped(bracket()).occ, 1e-4, 0.35)
    raw.faces = [RawFace(f.name, samples=f.samples) for f in raw.faces]
    assert truth(build.shape(raw)) == truth(m.shape(bracket()))


def test_a_kernels_answer_that_the_points_refute_is_not_taken():
    raw = brep.tessellate(untyped(m.cylinder(0.005, 0.02)).occ, 1e-4, 0.35)
    wrong = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0051)
    for face in raw.faces:
        if face.kind == "cylinder":
            face.numbers = wrong
    radii = [s.geometry.radius for s in build.shape(raw).surfaces if s.geometry.kind == "cylinder"]
    assert radii == pytest.approx([0.005, 0.005], abs=1e-9)


def test_freeform_stays_freeform():
    lens = m.box(0.04, 0.04, 0.01).filleted(0.003, lambda p: p[2] > 0.009 and p[0] < 0.03)
    pole = np.array(
        [
            [x, y, 0.002 * np.sin(90 * x) * np.cos(70 * y)]
            for x in np.linspace(0, 0.04, 8)
            for y in np.linspace(0, 0.04, 8)
        ]
    )
    raw = brep.tessellate(lens.occ, 1e-4, 0.35)
    assert "freeform" not in {s.geometry.kind for s in build.shape(raw).surfaces}
    grid = np.arange(49).reshape(7, 7) + np.arange(7)[:, None]
    a = grid.ravel()
    raw.vertices, raw.triangles = (
        pole,
        np.vstack([np.column_stack([a, a + 8, a + 9]), np.column_stack([a, a + 9, a + 1])]).astype(np.int32),
    )
    raw.face_of_triangle, raw.faces = np.zeros(98, np.int32), [RawFace("wave")]
    (wave,) = build.shape(raw).surfaces
    assert (wave.geometry.kind, wave.orientation, wave.residual) == ("freeform", "free", 0.0)
