"""STEP files that OpenCascade reads back."""

import numpy as np
import pytest
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer

import vpframe as vp
from tests.vpframe.exporters.moving import model


def solids(path) -> list[tuple[float, np.ndarray]]:
    """Volume (mm³) and centre (mm) of the solids of a STEP file, by OpenCascade alone."""
    reader = STEPControl_Reader()
    assert reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
    reader.TransferRoots()
    explorer = TopExp_Explorer(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_SOLID)
    found = []
    while explorer.More():
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(explorer.Current(), properties)
        c = properties.CentreOfMass()
        found.append((properties.Mass(), np.array([c.X(), c.Y(), c.Z()])))
        explorer.Next()
    return found


def test_step_is_exact_for_opencascade_and_keeps_names_tree_colours_and_densities(tmp_path):
    scene = model()
    assert scene.export(tmp_path / "out.step") == ()
    there = sorted(solids(tmp_path / "out.step"), key=lambda s: s[1].tolist())
    here = [(1e9 * p.shape.volume, 1e3 * p.pose.act(p.shape.center)) for p in scene.parts]
    for (volume, center), (known, at) in zip(there, sorted(here, key=lambda s: s[1].tolist()), strict=True):
        assert volume == pytest.approx(known, rel=1e-9)
        assert np.abs(center - at).max() < 1e-6  # mm: a nanometre a metre from the origin
    back = vp.load(tmp_path / "out.step")
    assert back.names == scene.names
    assert back.all_notes() == ()
    for name in scene:
        assert np.abs(back[name].pose.homogeneous - scene[name].pose.homogeneous).max() < 1e-12
        assert back[name].shape.volume == pytest.approx(scene[name].shape.volume, rel=1e-9)
        assert back[name].color == pytest.approx(scene[name].color, abs=1e-6)
        assert back[name].density == (None if scene[name].density is None else pytest.approx(scene[name].density))
        assert [s.geometry.kind for s in back[name].surfaces] == [s.geometry.kind for s in scene[name].surfaces]
    assert back["base/Bolzen Ø8 (größer)_1"].shape is back["base/sub/Bolzen_2"].shape


def test_colours_of_single_faces_and_the_exact_surface_come_back(tmp_path):
    scene = model()
    shape = scene["ball"].shape
    object.__setattr__(shape.surfaces[0], "color", (0.0, 0.0, 1.0, 1.0))
    scene.export(tmp_path / "out.step")
    assert vp.load(tmp_path / "out.step")["ball"].surfaces[0].color == pytest.approx((0.0, 0.0, 1.0, 1.0))
