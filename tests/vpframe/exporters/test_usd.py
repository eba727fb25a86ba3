"""USD files."""

import sys

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.exporters.moving import model, moving


def test_usd_holds_tree_poses_colours_and_time_samples(tmp_path):
    pxr = pytest.importorskip("pxr")
    scene = model()
    scene.export(tmp_path / "out.usda", moving(scene))
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert pxr and UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.GetStageUpAxis(stage) == "Z"
    prims = {p.GetCustomDataByKey("path"): p for p in stage.Traverse() if p.HasCustomDataKey("path")}
    assert set(prims) == set(scene.names)
    cache = UsdGeom.XformCache(Usd.TimeCode(60.0))
    for name, prim in prims.items():
        matrix = np.array(cache.GetLocalToWorldTransform(prim)).T
        expected = moving(scene).at(1.0)[name].homogeneous
        assert np.abs(matrix - expected).max() < 1e-12
    assert stage.GetEndTimeCode() == pytest.approx(120.0)
    pieces = [p for p in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Mesh)]
    assert len(pieces) == len(scene)


def test_usd_without_its_library_says_so(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(vp.VpframeError, match="usd-core, which is not installed"):
        model().export(tmp_path / "out.usd")
    assert not (tmp_path / "out.usd").exists()
