"""Shapes of build123d and of kernels that cannot share an environment."""

import numpy as np
import pytest

import vpframe as vp
from vpframe.analysis import mates
from vpframe.scene import modelling as m


def test_build123d_parts_keep_tree_labels_colours_exact_shapes_and_joints(tmp_path):
    b = pytest.importorskip("build123d")
    base = b.Box(20, 20, 10) - b.Cylinder(4, 10)
    base.label, base.color = "base", b.Color("red")
    shaft = b.Cylinder(4, 30)
    shaft.label = "shaft"
    hole = b.RevoluteJoint("hole", base, axis=b.Axis((0, 0, 0), (0, 0, 1)))
    hole.connect_to(b.RigidJoint("end", shaft, b.Location((0, 0, 0))), angle=30)
    ball = b.Sphere(2)
    ball.label = "ball"
    group = b.Compound(label="group", children=[ball])
    group.location = b.Location((50, 0, 0))
    scene = vp.load(b.Compound(label="all", children=[base, shaft, group]))
    assert scene.names == ("base", "shaft", "group/ball")
    assert scene["base"].shape.volume == pytest.approx((20 * 20 * 10 - np.pi * 16 * 10) * 1e-9, rel=1e-9)
    assert scene["base"].color == pytest.approx((1.0, 0.0, 0.0, 1.0))
    assert scene["group/ball"].pose.translation == pytest.approx([0.05, 0.0, 0.0])
    assert [(s.kind, s.parts) for s in scene.statements] == [
        ("concentric", ("base", "shaft")), ("coplanar", ("base", "shaft")),
    ]  # fmt: skip
    joints = {p["name"]: p["neighbours"] for p in mates.mates(scene).document()["parts"]}
    assert joints["shaft"] == [{"part": "base", "joint": "revolute", "freedom": 1}]
    left = scene.export(tmp_path / "out.step")
    assert left == ("joint of base and shaft (concentric)", "joint of base and shaft (coplanar)")
    alone = vp.load(shaft)
    assert alone.names == ("shaft",) and alone.parts[0].pose.translation == pytest.approx([0.0, 0.0, -0.015])
    with pytest.raises(vp.LoadError, match="shape is empty"):
        vp.load(b.Part())


def test_brep_is_the_way_for_kernels_that_cannot_share_an_environment(tmp_path):
    from OCP.BRepTools import BRepTools

    BRepTools.Write_s(m.box(0.1, 0.2, 0.3).occ, str(tmp_path / "block.brep"))
    scene = vp.load(tmp_path / "block.brep")
    assert scene.names == ("block",) and scene["block"].shape.volume == pytest.approx(0.006)
    assert len(vp.load((tmp_path / "block.brep").read_bytes())) == 1
    (tmp_path / "cut.brep").write_bytes((tmp_path / "block.brep").read_bytes()[:900])
    with pytest.raises(vp.LoadError, match=r"cut\.brep: "):
        vp.load(tmp_path / "cut.brep")
