"""Scenes out: what each format keeps, read back by somebody else where there is one."""

from __future__ import annotations

import csv
import dataclasses
import json
import sys

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer

import vpframe as vp
from vpframe.app import cli
from vpframe.scene import modelling as m
from vpframe.scene.motion import Motion
from vpframe.scene.scene import Size

RED = (1.0, 0.0, 0.0, 0.5)


def placed(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))


def model() -> vp.Scene:
    """Parts of three levels, two of one shape, with colours, a coloured face, densities and names of every kind."""
    plate = m.box(0.1, 0.08, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.04)
    pin_ = m.cylinder(0.004, 0.03).chamfered(0.0005)
    scene = m.scene(
        {
            "base/plate": (plate, placed(0), RED, 7850.0),
            "base/Bolzen Ø8 (größer)_1": (pin_, placed(1), (0.1, 0.2, 0.3), 20.0),
            "base/sub/Bolzen_2": (pin_, placed(2), (0.4, 0.2, 0.3), 20.0),
            "base/sub/1": (pin_, placed(3)),
            "base/sub/2": (pin_, placed(4)),
            "ball": (m.sphere(0.01), placed(5), None, 23000.0),
        }
    )
    return scene


def moving(scene: vp.Scene, part: str = "ball") -> Motion:
    """A part that rests half a second, goes 0.3 m along x in one, and rests again; all else stands still."""

    def poses(t: float) -> dict[str, pin.SE3]:
        out = {p.name: p.pose for p in scene.parts}
        shift = np.array([0.3 * np.clip(t - 0.5, 0.0, 1.0), 0.0, 0.0])
        out[part] = pin.SE3(out[part].rotation, out[part].translation + shift)
        return out

    return Motion.of((t, poses(t)) for t in np.arange(0.0, 2.01, 0.1).tolist())


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


def test_glb_holds_tree_colours_poses_and_the_motion(tmp_path):
    scene = model()
    left = scene.export(tmp_path / "out.glb", moving(scene))
    assert left == ("exact surfaces: GLB has triangles only", "densities and inertias")
    data = (tmp_path / "out.glb").read_bytes()
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    nodes = header["nodes"]
    by_path = {node["extras"]["path"]: node for node in nodes if "extras" in node}
    assert set(by_path) == set(scene.names)
    for part in scene.parts:
        row = pin.SE3ToXYZQUAT(part.pose).tolist()
        assert by_path[part.name]["translation"] == pytest.approx(row[:3], abs=1e-15)
        assert by_path[part.name]["rotation"] == pytest.approx(row[3:], abs=1e-15)
    assert [nodes[i]["name"] for i in nodes[0]["children"]] == ["base", "ball"]
    (animation,) = header["animations"]
    assert {nodes[c["target"]["node"]]["name"] for c in animation["channels"]} == {"ball"}
    keys = header["accessors"][animation["samplers"][0]["input"]]
    assert keys["min"] == [0.0] and keys["max"] == pytest.approx([1.5])
    read = trimesh.load_scene(tmp_path / "out.glb")
    up = pin.SE3(pin.exp3(np.array([-np.pi / 2, 0.0, 0.0])), np.zeros(3))  # z up to y up
    there = sorted((read.graph[node][0] for node in read.graph.nodes_geometry), key=lambda t: t[:3, 3].tolist())
    here = sorted(((up * p.pose).homogeneous for p in scene.parts), key=lambda t: t[:3, 3].tolist())
    assert np.abs(np.array(there) - np.array(here)).max() < 1e-9
    for mesh in read.geometry.values():
        assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=True, merge_norm=True).volume > 0.0


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


def test_motion_goes_through_a_table_and_back(tmp_path):
    scene = model()
    motion = moving(scene)
    scene.export(tmp_path / "poses.csv", motion)
    back = vp.read_motion(tmp_path / "poses.csv")
    assert back.moving == ("ball",) and back.duration == pytest.approx(1.5)
    for t in (0.0, 0.52, 1.0, 1.5):
        for name, pose in motion.at(t).items():
            assert np.abs(pose.homogeneous - back.at(t)[name].homogeneous).max() < 1e-15
    assert len(motion.keys["ball"][0]) == 12 and len(motion.keys["base/plate"][0]) == 1
    pytest.importorskip("pyarrow")
    scene.export(tmp_path / "poses.parquet", motion)
    same = vp.read_motion(tmp_path / "poses.parquet")
    assert np.array_equal(same.keys["ball"][1], back.keys["ball"][1])


def test_a_moment_of_a_motion_is_exported_and_a_motion_that_a_format_lacks_is_named(tmp_path):
    scene = model()
    motion = moving(scene)
    assert scene.export(tmp_path / "at.step", motion, 1.0) == ()
    got = vp.load(tmp_path / "at.step")["ball"].pose.translation - scene["ball"].pose.translation
    assert got == pytest.approx([0.15, 0.0, 0.0], abs=1e-12)
    (line,) = scene.export(tmp_path / "end.step", motion)
    assert line.startswith("motion: the state at its end")
    got = vp.load(tmp_path / "end.step")["ball"].pose.translation - scene["ball"].pose.translation
    assert got == pytest.approx([0.3, 0.0, 0.0], abs=1e-12)
    with pytest.raises(vp.VpframeError, match="ends at 2 s"):
        scene.export(tmp_path / "late.step", motion, 3.0)


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


@pytest.mark.parametrize("name", ["out.step", "out.glb", "out.usdc", "out.csv", "out.urdf", "out.mjcf", "out.parquet"])
def test_a_file_of_ours_is_replaced_and_no_other(tmp_path, name):
    pytest.importorskip({"out.usdc": "pxr", "out.parquet": "pyarrow"}.get(name, "numpy"))
    scene = model()
    scene.export(tmp_path / name)
    scene.export(tmp_path / name)
    (tmp_path / name).write_text("a person's notes")
    with pytest.raises(vp.OutputError, match="vpframe wrote"):
        scene.export(tmp_path / name)
    assert (tmp_path / name).read_text() == "a person's notes"


def test_bad_requests_are_one_clear_line(tmp_path):
    scene = model()
    with pytest.raises(vp.VpframeError, match=r"not written as \.dwg; \.step"):
        scene.export(tmp_path / "out.dwg")
    with pytest.raises(vp.VpframeError, match="no parts"):
        vp.Scene().export(tmp_path / "out.glb")
    with pytest.raises(vp.VpframeError, match="the scene has none"):
        scene.export(tmp_path / "out.glb", Motion({"other": (np.zeros(1), np.eye(7)[None, 6])}))
    with pytest.raises(vp.VpframeError, match="give motion= too"):
        scene.export(tmp_path / "out.glb", time=1.0)
    for text, words in (
        ("part,t,x\n", "no column y"),
        ("part,t,x,y,z,qx,qy,qz,qw\na,0,0,0,0,0,0,0,2\n", "no position and unit quaternion"),
        ("part,t,x,y,z,qx,qy,qz,qw\na,0,0,0,zero,0,0,0,1\n", "row 2"),
        ("part,t,x,y,z,qx,qy,qz,qw\n", "holds no pose"),
    ):
        (tmp_path / "poses.csv").write_text(text)
        with pytest.raises(vp.LoadError, match=words):
            vp.read_motion(tmp_path / "poses.csv")
    with pytest.raises(vp.LoadError, match="no motion is read"):
        vp.read_motion(tmp_path / "poses.txt")


def test_the_command_line_exports_the_state_of_a_recording(tmp_path, capsys):
    source = m.write_step(
        tmp_path / "model.step", {"plate": m.box(0.1, 0.1, 0.01), "pin": (m.cylinder(0.004, 0.03), placed(1))}
    )
    scene = vp.load(source)
    home = scene["pin"].pose.copy()
    run = tmp_path / "run.rrd"
    with vp.Session(scene, record=run) as session:
        hand = session.hand()
        hand.grab("pin")
        hand.move_to(pin.SE3(home.rotation, home.translation + np.array([0.2, 0.0, 0.0])), duration=0.5)
        end = session.time
        hand.move_to(home, duration=0.5)
    out = tmp_path / "out.step"
    assert cli.main(["export", str(source), "--poses", f"{run}@{end:.9f}s", "--to", str(out)]) == 0
    assert "2 parts" in capsys.readouterr().out
    back = vp.load(out)
    assert back["pin"].pose.translation == pytest.approx(home.translation + np.array([0.2, 0.0, 0.0]), abs=1e-6)
    assert np.abs(back["plate"].pose.homogeneous - np.eye(4)).max() < 1e-15  # what did not move is exact
    glb = tmp_path / "out.glb"
    assert cli.main(["export", str(source), "--poses", str(run), "--to", str(glb), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["left_out"] == ["exact surfaces: GLB has triangles only"] and b'"animations"' in glb.read_bytes()
    assert cli.main(["export", str(source), "--poses", f"{run}@9s", "--to", str(out)]) == 2
    assert "there is no state at 9 s" in capsys.readouterr().err
    assert cli.main(["export", str(source), "--to", str(source)]) == 2
    assert "is what this run reads" in capsys.readouterr().err
    table = tmp_path / "events.csv"
    assert cli.main(["replay", str(run), "--events", str(table)]) == 0
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert "grabbed" in {row["kind"] for row in rows}


def test_events_are_tables_of_numbers_and_text(tmp_path):
    with vp.Session(m.scene({"a": m.box(0.1, 0.1, 0.1), "b": (m.box(0.1, 0.1, 0.1), placed(3))})) as session:
        session.note('said "so", twice')
        session.step()
        events = session.events
    vp.write_table(tmp_path / "events.csv", events)
    with (tmp_path / "events.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == [event.kind for event in events]
    assert [float(row["time"]) for row in rows] == [event.time for event in events]
    assert any(row["text"] == 'said "so", twice' for row in rows)
    assert [tuple(json.loads(row["parts"])) for row in rows] == [event.parts for event in events]
    parquet = pytest.importorskip("pyarrow.parquet")
    vp.write_table(tmp_path / "events.parquet", events)
    table = parquet.read_table(tmp_path / "events.parquet")
    assert table.column("time").to_pylist() == [event.time for event in events]
    with pytest.raises(vp.VpframeError, match=r"\.csv or \.parquet"):
        vp.write_table(tmp_path / "events.xls", events)


def test_tracks_go_out_and_come_back(tmp_path):
    track = vp.Track(np.array([0.0, 0.25, 1.0]), (placed(0), placed(1), placed(2)))
    for name in ("track.csv", "track.json"):
        back = vp.read_track(vp.write_track(tmp_path / name, track))
        assert np.array_equal(back.times, track.times)
        for a, b in zip(back.poses, track.poses, strict=True):
            assert np.abs(a.homogeneous - b.homogeneous).max() < 1e-15
    path = vp.Straight(placed(0), placed(1), 0.5)
    sampled = vp.read_track(vp.write_track(tmp_path / "straight.csv", path, rate=100.0))
    assert len(sampled.times) == 51
    for t in sampled.times:
        assert np.abs(sampled.pose(t).homogeneous - path.pose(t).homogeneous).max() < 1e-12
    with pytest.raises(vp.TaskError, match=r"\.csv or \.json"):
        vp.write_track(tmp_path / "track.txt", track)
