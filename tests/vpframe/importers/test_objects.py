"""Scenes of what is no CAD file: bytes, other libraries' objects, robot models."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import vpframe as vp
from vpframe.analysis import mates
from vpframe.analysis.clash import merged
from vpframe.scene import modelling as m

URDF = """<robot name="arm">
<material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual></link>
<link name="arm">
  <inertial><origin xyz="0.01 0 0" rpy="0 0 0.3"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0.1 0 0"/><geometry><mesh filename="package://arm/meshes/arm.stl" scale="0.001 0.001 0.001"/>
    </geometry><material name="red"/></visual>
</link>
<link name="empty"/>
<link name="tool"><visual><geometry><cylinder radius="0.01" length="0.05"/></geometry></visual></link>
<link name="lost"><visual><geometry><mesh filename="meshes/none.stl"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
  <origin xyz="0 0 0.03" rpy="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="empty"/>
  <origin xyz="0.2 0 0.05"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="spin" type="continuous"><parent link="empty"/><child link="tool"/><axis xyz="0 1 0"/></joint>
<joint name="weld" type="fixed"><parent link="tool"/><child link="lost"/></joint>
</robot>"""
MJCF = """<mujoco><worldbody><geom type="box" size=".1 .1 .01"/><geom type="plane" size="1 1 1"/>
<body name="a" pos="0 0 .1"><joint name="h" axis="0 0 1" range="-1 1" limited="true"/>
  <geom type="cylinder" size=".01 .05" rgba="0 1 0 1"/>
  <body name="b" pos=".1 0 0"><joint type="slide" axis="1 0 0"/><geom type="box" size=".01 .02 .03" mass="0.5"/></body>
</body><body name="free" pos="0 0 1"><freejoint/><geom type="sphere" size=".03"/></body></worldbody></mujoco>"""


def pose_of(xyz, yaw=0.0) -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array(xyz, dtype=np.float64))


@pytest.fixture
def robot(tmp_path):
    """A URDF in a package, with a mesh in millimetres."""
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (tmp_path / "arm" / "urdf").mkdir()
    trimesh.creation.box((200.0, 20.0, 20.0)).export(tmp_path / "arm" / "meshes" / "arm.stl")
    path = tmp_path / "arm" / "urdf" / "arm.urdf"
    path.write_text(URDF)
    return path


def test_bytes_are_what_their_content_says(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.004, 0.03)})
    scene = vp.load(path.read_bytes())
    assert scene.names == ("plate", "pin") and scene.source is None
    stl = trimesh.creation.box((1.0, 2.0, 3.0)).export(file_type="stl")
    assert vp.load(stl, unit="mm").parts[0].shape.volume == pytest.approx(6e-9)
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    assert vp.load(obj, format="obj", unit="m").parts[0].shape.volume == pytest.approx(1 / 6)
    with pytest.raises(vp.LoadError, match="what format they are in does not show; give format="):
        vp.load(obj)
    with pytest.raises(vp.LoadError, match=r"^bytes: is cut short"):
        vp.load(path.read_bytes()[:-100])


@pytest.mark.parametrize("thing", [3, None, [1], object()])
def test_what_cannot_be_loaded_is_one_clear_line(thing):
    with pytest.raises(vp.LoadError, match="cannot be loaded; give a path, bytes, a trimesh"):
        vp.load(thing)


def test_trimesh_meshes_and_scenes_keep_units_names_poses_and_colours():
    mesh = trimesh.creation.cylinder(radius=5.0, height=20.0, sections=64)
    mesh.units = "mm"
    part = vp.load(mesh).parts[0]
    assert np.ptp(part.mesh.vertices, axis=0) == pytest.approx([0.01, 0.01, 0.02])
    assert sorted(s.geometry.kind for s in part.surfaces) == ["cylinder", "plane", "plane"]
    scene = trimesh.Scene()
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.visual.face_colors = (255, 0, 0, 255)
    scene.add_geometry(box, node_name="a", geom_name="box")
    scene.graph.update("b", geometry="box", matrix=trimesh.transformations.translation_matrix([5.0, 0.0, 0.0]))
    loaded = vp.load(scene, unit="cm")
    assert loaded.names == ("a", "b") and loaded["a"].shape is loaded["b"].shape
    assert loaded["b"].pose.translation == pytest.approx([0.05, 0.0, 0.0])
    assert loaded["a"].color == (1.0, 0.0, 0.0, 1.0)
    mesh.units = "parsecs-ish"
    with pytest.raises(vp.LoadError, match="which are unknown; give unit="):
        vp.load(mesh)


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


def test_a_scene_takes_all_that_load_takes(tmp_path):
    path = m.write_step(tmp_path / "a.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": m.cylinder(0.004, 0.03)})
    scene = vp.Scene()
    assert [p.name for p in scene.add(path)] == ["plate", "pin"]
    lift = pose_of([0.0, 0.0, 0.5], 0.3)
    more = scene.add(path, name="second", pose=lift)
    assert [p.name for p in more] == ["second/plate", "second/pin"]
    assert scene["second/pin"].pose.isApprox(lift)
    assert scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="block", unit="m")[0].name == "block"
    with pytest.raises(vp.VpframeError, match="two parts are called 'plate'"):
        scene.add(path)
    assert len(scene) == 5  # nothing of it was added


def test_urdf_links_are_parts_its_joints_statements_and_its_inertias_count(robot):
    scene = vp.load(robot)
    assert scene.names == ("base", "arm", "tool")
    assert [p.fixed for p in scene.parts] == [True, False, False]
    turn = pose_of([0.0, 0.0, 0.03], 0.5)
    assert scene["arm"].pose.isApprox(turn * pose_of([0.1, 0.0, 0.0]))
    assert np.ptp(scene["arm"].mesh.vertices, axis=0) == pytest.approx([0.2, 0.02, 0.02])
    assert scene["arm"].color == (1.0, 0.0, 0.0, 1.0)
    inertia = scene["arm"].inertia
    assert inertia.mass == 2.0 and inertia.lever == pytest.approx([-0.09, 0.0, 0.0])
    r = pin.rpy.rpyToMatrix(0.0, 0.0, 0.3)
    assert inertia.inertia == pytest.approx(r @ np.diag([0.01, 0.02, 0.025]) @ r.T)
    joints = {p["name"]: p for p in mates.mates(scene).document()["parts"]}
    assert joints["arm"]["neighbours"] == [
        {"part": "base", "joint": "revolute", "freedom": 1},
        {"part": "tool", "joint": "cylindrical", "freedom": 2},  # slide and spin, through a link without geometry
    ]
    notes = " / ".join(scene.all_notes())
    assert "link lost" in notes and "none.stl: no such file" in notes
    assert "limits of 2 joints (shoulder, slide)" in notes
    with vp.Session(scene) as session:
        session.step()
        assert session.freedom("arm") == 1 and session.freedom("tool", to="arm") == 2
        hand = session.hand()
        hand.grab("arm")
        goal = turn * pose_of([0.0, 0.0, 0.0], 0.4) * pose_of([0.1, 0.0, 0.0])
        hand.move_to(goal, duration=0.3)
        assert np.abs(scene["arm"].pose.homogeneous - goal.homogeneous).max() < 1e-6
        session.reset()
        session.step()
        assert {c.kind for c in session.constraints if "arm" in c.parts} >= {"concentric", "coplanar"}


def test_scenes_that_are_put_together_keep_their_joints(robot):
    scene = merged([vp.load(robot), vp.load(robot)])
    assert next(s.parts for s in scene.statements) == ("arm/base", "arm/arm")
    assert [s.parts for s in scene.statements][-1] == ("arm_2/arm", "arm_2/tool")
    assert len(scene.copy().statements) == len(scene.statements) == 6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("<robot", "<!DOCTYPE a><robot"), "has a document type"),
        (('name="weld" type="fixed"', 'name="weld" type="sticky"'), "type 'sticky' is none of"),
        (('<parent link="tool"/>', '<parent link="tol"/>'), "there is no link 'tol'"),
        (('xyz="0 0 0.03"', 'xyz="0 zero 0.03"'), "3 finite numbers are needed"),
        (("</robot>", ""), "no well-formed XML"),
        (('<parent link="base"/>', '<parent link="tool"/>'), "2 roots|no root"),
    ],
)
def test_a_bad_urdf_is_one_clear_line(robot, change, words):
    robot.write_text(URDF.replace(*change))
    with pytest.raises(vp.LoadError, match=words) as caught:
        vp.load(robot)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-8-sig"])
def test_a_document_type_is_found_in_every_encoding(robot, encoding):
    entities = '<!DOCTYPE a [<!ENTITY b "1">]>'
    robot.write_bytes(f'<?xml version="1.0"?>{entities}{URDF}'.encode(encoding))
    with pytest.raises(vp.LoadError, match="has a document type"):
        vp.load(robot)
    robot.write_bytes(URDF.encode(encoding))
    assert "arm" in vp.load(robot).names


def test_a_colour_inside_a_link_is_its_own(tmp_path):
    links = "".join(
        f'<link name="{name}"><visual><geometry><sphere radius="0.1"/></geometry>'
        f'<material name="{material}">{color}</material></visual></link>'
        f'<joint name="{name}_" type="fixed"><parent link="base"/><child link="{name}"/></joint>'
        for name, material, color in (
            ("a", "", '<color rgba="1 0 0 1"/>'), ("b", "", '<color rgba="0 1 0 1"/>'),
            ("c", "red", '<color rgba="0 0 1 1"/>'), ("d", "red", ""), ("e", "none", ""),
        )
    )  # fmt: skip
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    base = '<link name="base"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'
    (tmp_path / "a.urdf").write_text(f'<robot name="r">{base}{links}{red}</robot>')
    scene = vp.load(tmp_path / "a.urdf")
    colors = {name: scene[name].color for name in "abcde"}
    red, green, blue = (1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
    assert colors == {"a": red, "b": green, "c": blue, "d": red, "e": scene["base"].color}


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
