"""Mates of an assembly as it stands, its document, and its mechanism as URDF."""

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import vpframe as vp
from constraints.urdf import load_urdf
from vpframe import mates, modelling


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
    document = mates.mates(bolted())
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
    assert mates.base_parts(scene) == (scene.index("plate"),)
    scene["bolt 2"].fixed = True
    assert mates.base_parts(scene) == (scene.index("bolt 2"),)
    assert mates.base_parts(vp.Scene()) == ()
    assert mates.mates(vp.Scene()) == {"parts": [], "constraints": []}


def test_table_names_every_part_and_counts_every_kind():
    text = mates.table(mates.mates(bolted()))
    assert all(name in text for name in ("plate", "bolt 1", "bolt 2", "cap"))
    assert "2 against, 2 concentric" in text and "Ø10 in Ø10 mm" in text


def test_a_part_off_by_more_than_the_tolerance_has_no_mate():
    scene = bolted()
    scene["bolt 1"].pose = pin.SE3(np.eye(3), np.array([0, 0, 5e-5])) * scene["bolt 1"].pose
    kinds = Counter(c["kind"] for c in mates.mates(scene)["constraints"])
    assert kinds == {"against": 1, "concentric": 2}


def test_urdf_with_meshes_turns_the_bolts(tmp_path):
    scene = bolted()
    assert mates.write_urdf(scene, tmp_path / "bolted.urdf") == ()
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


real_models = pytest.mark.skipif("VPFRAME_DATA" not in os.environ, reason="VPFRAME_DATA names no folder of real models")


@real_models
@pytest.mark.parametrize("name", ["as1-oc-214.stp", "as1_pe_203.stp"])
def test_as1_has_sixteen_against_and_twenty_two_concentric(name):
    document = mates.mates(vp.load(str(Path(os.environ["VPFRAME_DATA"]) / "step" / name)))
    assert Counter(c["kind"] for c in document["constraints"]) == {"against": 16, "concentric": 22}
    assert len({(*c["parts"], *map(tuple, c["surfaces"])) for c in document["constraints"]}) == 38
