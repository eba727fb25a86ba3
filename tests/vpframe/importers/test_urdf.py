"""URDF files."""

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.importers.robots import URDF, pose_of
from vpframe.analysis import mates


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
