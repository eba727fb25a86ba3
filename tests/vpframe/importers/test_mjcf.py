"""MJCF files."""

import pytest

import vpframe as vp
from vpframe.analysis import mates

MJCF = """<mujoco><worldbody><geom type="box" size=".1 .1 .01"/><geom type="plane" size="1 1 1"/>
<body name="a" pos="0 0 .1"><joint name="h" axis="0 0 1" range="-1 1" limited="true"/>
  <geom type="cylinder" size=".01 .05" rgba="0 1 0 1"/>
  <body name="b" pos=".1 0 0"><joint type="slide" axis="1 0 0"/><geom type="box" size=".01 .02 .03" mass="0.5"/></body>
</body><body name="free" pos="0 0 1"><freejoint/><geom type="sphere" size=".03"/></body></worldbody></mujoco>"""


def test_mjcf_bodies_are_parts_and_its_joints_statements(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "model.xml"
    path.write_text(MJCF)
    scene = vp.load(path)
    assert scene.names == ("world", "a", "b", "free")
    assert scene["a"].pose.translation == pytest.approx([0.0, 0.0, 0.1]) and scene["a"].color == (0.0, 1.0, 0.0, 1.0)
    assert sorted(s.geometry.kind for s in scene["a"].surfaces) == ["cylinder", "plane", "plane"]
    assert scene["b"].inertia.mass == pytest.approx(0.5) and scene["world"].fixed
    joints = {p["name"]: p["neighbours"] for p in mates.mates(scene).document()["parts"]}
    assert joints["a"] == [
        {"part": "world", "joint": "revolute", "freedom": 1}, {"part": "b", "joint": "prismatic", "freedom": 1},
    ]  # fmt: skip
    assert joints["free"] == []
    assert scene.notes == ("left out: geometries of kind plane (1), joint limits (1)",)
    path.write_text(MJCF.replace("</body></worldbody>", "</worldbody>"))
    with pytest.raises(vp.LoadError, match="MuJoCo does not read it"):
        vp.load(path)
