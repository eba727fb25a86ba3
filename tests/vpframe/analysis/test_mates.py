"""Mates of an assembly as it stands, its document, and its mechanism as URDF."""

import json
from collections import Counter

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import vpframe as vp
from collision import Tolerance
from constraints.mechanism.urdf import load_urdf
from vpframe.analysis import mates
from vpframe.analysis.static import base_parts
from vpframe.app.cli import main
from vpframe.scene import modelling


def bolted():
    """A plate with two holes, a bolt in each, a cap that lies loose on the side."""
    hole = modelling.cylinder(0.005, 0.02)
    plate = modelling.box(0.1, 0.04, 0.02)
    low = plate_low(plate)
    at = [np.array([0.025, 0.02, 0.0]) + low, np.array([0.075, 0.02, 0.0]) + low]
    for p in at:
        plate = plate - hole.translated(*p)
    bolt = modelling.cylinder(0.005, 0.025) + modelling.hexagon(0.016, 0.006).translated(z=0.025)
    poses = [pin.SE3(np.eye(3), p + np.array([0, 0, -0.005])) for p in at]
    cap = (modelling.box(0.01, 0.01, 0.01), pin.SE3(np.eye(3), np.array([0.0, 0.5, 0.0])))
    return modelling.scene({"bolt 1": (bolt, poses[0]), "plate": plate, "bolt 2": (bolt, poses[1]), "cap": cap})


def plate_low(solid):
    return modelling.shape(solid).mesh.vertices.min(axis=0)


def test_a_bolted_plate():
    document = mates.mates(bolted()).document()
    assert Counter(c["kind"] for c in document["constraints"]) == {"against": 2, "concentric": 2}
    joints = {p["name"]: (p["joint"], p["freedom"]) for p in document["parts"]}
    assert joints == {
        "plate": ("fixed", 0),
        "bolt 1": ("revolute", 1),
        "bolt 2": ("revolute", 1),
        "cap": ("free", 6),
    }
    for c in document["constraints"]:
        assert "plate" in c["parts"] and c["residual"] < 1e-9 and all(c["surfaces"])
    json.dumps(document)


def test_the_base_is_what_is_fixed_else_the_largest():
    scene = bolted()
    assert base_parts(scene) == (scene.index("plate"),)
    scene["bolt 2"].fixed = True
    assert base_parts(scene) == (scene.index("bolt 2"),)
    assert base_parts(vp.Scene()) == ()
    assert mates.mates(vp.Scene()).document() == {"parts": [], "groups": [], "constraints": []}


def test_table_names_every_part_and_counts_every_kind():
    text = mates.table(mates.mates(bolted()))
    assert all(name in text for name in ("plate", "bolt 1", "bolt 2", "cap"))
    assert "2 against, 2 concentric" in text and "Ø10 in Ø10 mm" in text


def test_a_part_off_by_more_than_the_tolerance_has_no_mate():
    scene = bolted()
    scene["bolt 1"].pose = pin.SE3(np.eye(3), np.array([0, 0, 5e-5])) * scene["bolt 1"].pose
    kinds = Counter(c["kind"] for c in mates.mates(scene).document()["constraints"])
    assert kinds == {"against": 1, "concentric": 2}


def test_urdf_with_meshes_turns_the_bolts(tmp_path):
    scene = bolted()
    (assumed,) = mates.write_urdf(scene, tmp_path / "bolted.urdf")
    assert "1000 kg/m³" in assumed and "plate" in assumed
    assert assumed in (tmp_path / "bolted.urdf").read_text()
    model, welds = load_urdf(tmp_path / "bolted.urdf")
    assert welds == [] and model.nq == 2 + 6  # two bolts turn, the cap floats
    files = sorted(p.name for p in (tmp_path / "bolted_meshes").iterdir())
    assert len(files) == 3  # two bolts share one
    data = model.createData()
    for angle in (0.0, 0.4):
        q = np.zeros(model.nq)
        q[model.joints[model.getJointId("plate--bolt 1")].idx_q] = angle
        pin.framesForwardKinematics(model, data, q)
        got = data.oMf[model.getFrameId("bolt 1")]
        start = scene["bolt 1"].pose
        assert np.abs(got.translation - start.translation).max() < 1e-12
        assert abs(pin.log3(start.rotation.T @ got.rotation)[2]) == pytest.approx(angle, abs=1e-12)
    mesh = trimesh.load(tmp_path / "bolted_meshes" / next(f for f in files if "plate" in f))
    assert mesh.volume == pytest.approx(scene["plate"].shape.volume, rel=5e-3)


def two_machines():
    """Two slides on rails, one rail fixed, with a screw through a clearance hole; and a block by itself."""
    rail, slide = modelling.box(0.2, 0.04, 0.02), modelling.box(0.04, 0.04, 0.02)
    hole = modelling.cylinder(0.0033, 0.02).translated(0.02, 0.02, 0.0)
    screw = modelling.cylinder(0.003, 0.02) + modelling.cylinder(0.005, 0.004).translated(z=0.02)

    def at(x=0.0, y=0.0, z=0.0):
        return pin.SE3(np.eye(3), np.array([x, y, z]))

    scene = modelling.scene(
        {
            "rail": rail,
            "slide": (slide - hole, at(0.05, 0.0, 0.02)),
            "screw": (screw, at(0.07, 0.02, 0.02)),
            "rail 2": (rail, at(0.0, 0.2, 0.0)),
            "slide 2": (slide, at(0.05, 0.2, 0.02)),
            "block": (slide, at(0.0, 1.0, 0.0)),
        }
    )
    scene["slide 2"].fixed = True
    return scene


def test_every_group_has_a_base_of_its_own_and_says_why():
    document = mates.mates(two_machines()).document()
    assert document["groups"] == [
        {"parts": ["rail", "slide", "screw"], "base": ["rail"], "why": "the largest of them by volume"},
        {"parts": ["rail 2", "slide 2"], "base": ["slide 2"], "why": "fixed"},
        {"parts": ["block"], "base": [], "why": "joined to nothing"},
    ]
    text = mates.table(mates.mates(two_machines()))
    assert "3 parts on rail (the largest of them by volume)" in text and "2 parts on slide 2 (fixed)" in text
    assert "joined to nothing: block" in text


def test_each_part_has_its_joints_its_freedom_alone_and_with_what_it_carries():
    parts = {p["name"]: p for p in mates.mates(two_machines()).document()["parts"]}
    screw, slide = parts["screw"], parts["slide"]
    assert screw["neighbours"] == [
        {"part": "rail", "joint": "planar", "freedom": 3},
        {"part": "slide", "joint": "revolute", "freedom": 1},
    ]
    assert screw["alone"] == {"joint": "revolute", "freedom": 1}
    assert slide["alone"] == {"joint": "revolute", "freedom": 1}  # about the screw that stays
    assert (slide["joint"], slide["freedom"]) == ("planar", 3)  # the screw goes along
    assert (parts["rail"]["joint"], parts["rail"]["base"]) == ("fixed", ["rail"])
    assert parts["rail 2"]["joint"] == "planar" and parts["rail 2"]["base"] == ["slide 2"]
    assert parts["block"]["alone"] == {"joint": "free", "freedom": 6} and parts["block"]["neighbours"] == []
    text = mates.table(mates.mates(two_machines()))
    (line,) = [line for line in text.splitlines() if line.startswith("  screw ") and "others" not in line]
    assert "planar 3 rail, revolute 1 slide" in line


@pytest.mark.parametrize("make", [bolted, two_machines])
def test_a_session_says_the_same_freedom(make):
    document = mates.mates(make()).document()
    session = vp.Session(make())
    for part in document["parts"]:
        alone = part["alone"]["joint"], part["alone"]["freedom"]
        assert (session.joint(part["name"]), session.freedom(part["name"])) == alone


def test_a_row_names_faces_that_are_near_each_other():
    """A pin in one of three lands of a bore: the row names that land, not the one 30 mm away."""
    bar = modelling.box(0.02, 0.02, 0.06) - modelling.cylinder(0.005, 0.06).translated(0.01, 0.01, 0.0)
    groove = modelling.cylinder(0.007, 0.01)
    bar = bar - groove.translated(0.01, 0.01, 0.015) - groove.translated(0.01, 0.01, 0.035)
    pin_in = (modelling.cylinder(0.005, 0.012), pin.SE3(np.eye(3), np.array([0.01, 0.01, 0.001])))
    scene = modelling.scene({"bar": bar, "pin": pin_in})
    (row,) = [c for c in mates.mates(scene).document()["constraints"] if c["kind"] == "concentric"]
    bar = scene["bar"]
    bores = [f for f in bar.features if f.geometry.kind == "cylinder" and abs(f.geometry.radius - 0.005) < 1e-9]
    assert len(bores) == 1 and len(bores[0].surfaces) == 3

    def height(surface):
        return bar.mesh.vertices[bar.mesh.triangles[bar.mesh.triangles_of(surface)]][..., 2].mean()

    assert row["surfaces"][0] == (min(bores[0].surfaces, key=height),)


def test_a_screw_in_its_hole_and_its_thread_are_two_mates():
    """M6 through Ø6.5 into Ø5: a clearance of exactly 0.25 mm is a fit, and the tapped hole a thread."""
    plate = modelling.box(0.03, 0.03, 0.01)
    top = plate - modelling.cylinder(0.00325, 0.01).translated(0.015, 0.015, 0.0)
    below = plate - modelling.cylinder(0.0025, 0.01).translated(0.015, 0.015, 0.0)
    screw = modelling.cylinder(0.003, 0.018) + modelling.cylinder(0.005, 0.006).translated(z=0.018)

    def at(x=0.0, y=0.0, z=0.0):
        return pin.SE3(np.eye(3), np.array([x, y, z]))

    scene = modelling.scene({"below": below, "top": (top, at(z=0.01)), "screw": (screw, at(0.015, 0.015, 0.002))})
    found = {(c["kind"], *c["parts"]): c for c in mates.mates(scene).document()["constraints"]}
    assert set(found) == {
        ("against", "below", "top"),
        ("against", "top", "screw"),
        ("concentric", "top", "screw"),
        ("screw", "below", "screw"),
    }
    assert found["concentric", "top", "screw"]["fit"] == pytest.approx(2.5e-4)
    assert "thread M6: Ø6 in Ø5 mm tapping hole, head Ø10 mm" in found["screw", "below", "screw"]["why"]
    tight = Tolerance(clearance=2e-4, clearance_relative=0.0)
    assert "concentric" not in {c["kind"] for c in mates.mates(scene, tight).document()["constraints"]}


def test_the_command_takes_the_greatest_clearance_of_a_fit(tmp_path, capsys):
    plate = modelling.box(0.03, 0.03, 0.01) - modelling.cylinder(0.0033, 0.01).translated(0.015, 0.015, 0.0)
    pin_in = (modelling.cylinder(0.003, 0.02), pin.SE3(np.eye(3), np.array([0.015, 0.015, -0.005])))
    modelling.write_step(tmp_path / "loose.step", {"plate": plate, "pin": pin_in})
    for given, kinds in (((), ["concentric"]), (("--fit", "0.2mm"), [])):
        assert main(["mates", str(tmp_path / "loose.step"), "--json", *given]) == 0
        assert [c["kind"] for c in json.loads(capsys.readouterr().out)["constraints"]] == kinds


@pytest.mark.parametrize("name", ["as1-oc-214.stp", "as1_pe_203.stp"])
def test_as1_has_sixteen_against_and_twenty_two_concentric(name, real_models):
    document = mates.mates(vp.load(real_models / "step" / name)).document()
    assert Counter(c["kind"] for c in document["constraints"]) == {"against": 16, "concentric": 22}
    assert len({(*c["parts"], *map(tuple, c["surfaces"])) for c in document["constraints"]}) == 38
