"""What a format cannot hold is named."""

import dataclasses

import pinocchio as pin
import pytest
import trimesh

import vpframe as vp
from tests.vpframe.exporters.moving import model, placed
from vpframe.scene import modelling as m
from vpframe.scene.scene import Size


def test_what_step_cannot_carry_is_named(tmp_path):
    scene = model()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="printed", unit="m")
    scene["ball"].inertia = pin.Inertia.Random()
    left = scene.export(tmp_path / "out.step")
    assert [line.split(":")[0] for line in left] == ["printed", "ball"]
    assert "mesh" in left[0] and "printed" not in vp.load(tmp_path / "out.step")
    only = vp.Scene()
    only.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="printed", unit="m")
    with pytest.raises(vp.VpframeError, match="all are meshes"):
        only.export(tmp_path / "none.step")
    assert not (tmp_path / "none.step").exists()


@pytest.mark.parametrize("ending", ["step", "glb", "urdf", "mjcf", "usda", "csv"])
def test_sizes_of_pmi_that_no_format_carries_are_named(tmp_path, ending):
    if ending == "usda":
        pytest.importorskip("pxr")
    scene = m.scene({"pin": (m.cylinder(0.004, 0.03), placed(1))})
    assert not any("PMI" in line for line in scene.export(tmp_path / f"plain.{ending}"))
    shape = scene["pin"].shape
    sized = [dataclasses.replace(s, size=Size(8e-3)) if s.geometry.kind == "cylinder" else s for s in shape.surfaces]
    object.__setattr__(shape, "surfaces", tuple(sized))
    assert sum("sizes of PMI" in line for line in scene.export(tmp_path / f"sized.{ending}")) == 1
