"""Links and joints of a model as constraints between parts."""

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.importers.robots import URDF
from vpframe.analysis.clash import merged


def test_scenes_that_are_put_together_keep_their_joints(robot):
    scene = merged([vp.load(robot), vp.load(robot)])
    assert next(s.parts for s in scene.statements) == ("arm/base", "arm/arm")
    assert [s.parts for s in scene.statements][-1] == ("arm_2/arm", "arm_2/tool")
    assert len(scene.copy().statements) == len(scene.statements) == 6


def test_a_geometry_model_of_pinocchio_comes_with_its_joints(robot, tmp_path):
    robot.write_text(URDF.replace("meshes/none.stl", "package://arm/meshes/arm.stl"))
    model = pin.buildModelFromUrdf(str(robot))
    geometry = pin.buildGeomFromUrdf(model, str(robot), pin.GeometryType.VISUAL, [str(tmp_path)])
    q = np.array([0.2, 0.01, *np.array([np.cos(0.3), np.sin(0.3)])])
    scene = vp.load((model, geometry, q))
    assert scene.names == ("base_0", "arm_0", "tool_0", "lost_0") and scene["base_0"].fixed
    data, placed = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, placed, q)
    for part, pose in zip(scene.parts, placed.oMg, strict=True):
        assert np.abs(part.pose.homogeneous - pose.homogeneous).max() < 1e-12
    assert scene["arm_0"].inertia.mass == pytest.approx(2.0)
    assert [(s.kind, s.parts) for s in scene.statements] == [
        ("fixed", ("tool_0", "lost_0")), ("concentric", ("base_0", "arm_0")), ("coplanar", ("base_0", "arm_0")),
        ("concentric", ("arm_0", "tool_0")),
    ]  # fmt: skip
    with pytest.raises(vp.LoadError, match=r"give \(model, geometry\)"):
        vp.load(geometry)
    with pytest.raises(vp.LoadError, match="the model takes 4 finite numbers"):
        vp.load((model, geometry, np.zeros(3)))
