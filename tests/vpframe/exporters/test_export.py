"""Scenes out: what each format keeps, read back by somebody else where there is one."""

import csv
import json

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.exporters.moving import model, moving, placed
from vpframe.app import cli
from vpframe.scene import modelling as m
from vpframe.scene.motion import Motion


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
