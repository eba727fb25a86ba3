import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.watching import box, fake_session, pressing_frames, pressing_scene
from vpframe.errors import LoadError, VpframeError
from vpframe.events import ConstraintView
from vpframe.scene.scene import Part, Scene
from vpframe.view import palette, replay
from vpframe.view.display import display_mesh
from vpframe.view.recorder import RerunRecorder

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording, its frames, and its rows by entity."""
    path = tmp_path_factory.mktemp("recording") / "deep" / "run.rrd"
    frames = pressing_frames(300)
    recorder = RerunRecorder(path)
    recorder.begin(fake_session().scene)
    for frame in frames:
        recorder.frame(frame)
    recorder.end()
    return path, frames, rows_of(path)


def rows_of(path):
    rows = {}
    for entity, chunk in replay.tables(path):
        rows.setdefault(entity, []).extend(chunk)
    return rows


def at_step(rows, component):
    """Value by step of one component; a later row of a step counts."""
    return {row["step"]: row[component] for row in rows if component in row and "step" in row}


def test_poses_are_those_of_the_session(recorded):
    _, frames, rows = recorded
    translation = at_step(rows["parts/rod"], "Transform3D:translation")
    quaternion = at_step(rows["parts/rod"], "Transform3D:quaternion")
    now = None
    for frame in frames:
        now = translation.get(frame.step, now)
        np.testing.assert_allclose(now[0], frame.poses["rod"].translation, atol=1e-7)
        turn = pin.Quaternion(np.array(quaternion.get(frame.step, [[0, 0, 0, 1]])[0], dtype=float))
        np.testing.assert_allclose(turn.matrix(), frame.poses["rod"].rotation, atol=1e-6)
    assert len(at_step(rows["parts/plate"], "Transform3D:translation")) == 1  # it never moves: told once


def test_geometry_is_written_once_and_is_that_of_the_parts(recorded):
    _, _, rows = recorded
    for part in pressing_scene().parts:
        for surface in range(part.mesh.n_surfaces):
            found = [r for r in rows[f"parts/{part.name}/surfaces/{surface}"] if "Mesh3D:vertex_positions" in r]
            assert len(found) == 1
            assert "step" not in found[0]  # static
            points = np.array(found[0]["Mesh3D:vertex_positions"])
            drawn = points[np.array(found[0]["Mesh3D:triangle_indices"])]
            true = part.mesh.vertices[part.mesh.triangles[part.mesh.triangles_of(surface)]]
            np.testing.assert_allclose(drawn, true, atol=1e-7)


def test_surfaces_are_highlighted_while_they_collide(recorded):
    _, frames, rows = recorded
    red = [int(v) for v in np.array([round(255 * c) for c in palette.COLLIDING])]
    red = (red[0] << 24) | (red[1] << 16) | (red[2] << 8) | 0xFF
    for name, index in (("plate", 0), ("rod", 1)):
        for surface in range(6 if name == "plate" else 3):
            colors = at_step(rows[f"parts/{name}/surfaces/{surface}"], "Mesh3D:albedo_factor")
            now = None
            for frame in frames:
                now = colors.get(frame.step, now)
                collides = any(tuple(row[2 * index : 2 * index + 2]) == (index, surface) for row in frame.colliding)
                assert (now == [red]) == collides, (name, surface, frame.step)


def test_plots_hold_the_numbers_in_the_units_they_name(recorded):
    _, frames, rows = recorded
    freedom = at_step(rows["plots/freedom/rod"], "Scalars:scalars")
    clearance = at_step(rows["plots/clearance"], "Scalars:scalars")
    timing = at_step(rows["plots/timings/collision"], "Scalars:scalars")
    for frame in frames:
        assert freedom[frame.step] == [frame.freedom["rod"]]
        assert clearance[frame.step] == [1e3 * frame.clearance]
        assert timing[frame.step] == [1e3 * frame.timings["collision"]]
    names = [r["SeriesLines:names"] for r in rows["plots/clearance"] if "SeriesLines:names" in r]
    assert names == [["clearance (mm)"]]


def test_constraint_states_and_symbols_come_and_go(recorded):
    _, frames, rows = recorded
    state = at_step(rows["constraints/against-plate-rod-0"], "StateChange:state")
    strips = at_step(rows["symbols/constraint/0"], "LineStrips3D:strips")
    now, drawn = None, None
    for frame in frames:
        now, drawn = state.get(frame.step, now), strips.get(frame.step, drawn)
        if frame.constraints:
            assert now == [frame.constraints[0].state]
            assert len(drawn) == 6  # a square, the shaft and four barbs of an arrow
        else:
            assert now in (None, ["removed"])
            assert not drawn


def test_events_and_script_are_the_sessions(recorded):
    path, frames, _ = recorded
    lines = replay.lines(path)
    events = [(e.step, e.kind, e.text) for frame in frames for e in frame.events]
    assert [(line.step, line.kind, line.text) for line in lines if line.kind != "script"] == events
    assert len(events) == 3
    said, now = {line.step: line.text for line in lines if line.kind == "script"}, None
    for frame in frames:
        now = said.get(frame.step, now)
        assert now == frame.script
    assert all(line.time == pytest.approx(line.step / 60, abs=1e-8) for line in lines)


def test_replay_script_prints_the_events(recorded, capsys):
    path, _, _ = recorded
    assert replay.replay(path, script=True) == 0
    printed = capsys.readouterr().out
    assert "collided" in printed and "plate and rod collide" in printed and "hand.move_to(z=0.050)" in printed


def test_the_recording_carries_a_blueprint(recorded):
    from rerun.chunk import RrdReader

    reader = RrdReader(recorded[0])
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 2  # as the session began, and when all that was seen is known


def test_a_real_session_is_recorded_as_it_was(tmp_path):
    from tests.vpframe.bench_scene import SEAT, scene
    from vpframe.hands.conditions import constraint
    from vpframe.session.session import Session

    path = tmp_path / "run.rrd"
    with Session(scene(), record=path) as session:
        hand = session.hand(at=(0.06, 0.0, 0.08))
        hand.grab("peg")
        hand.move_to(SEAT + np.array([0.0, 0.0, 0.03]), duration=0.5)
        hand.slide("down", until=constraint("concentric", other="block"))
        hand.release()
    rows = rows_of(path)
    told = [(line.step, line.kind, line.text) for line in replay.lines(path) if line.kind != "script"]
    assert sorted(told) == sorted((e.step, e.kind, e.text) for e in session.events)
    assert {"grabbed", "recognised", "accepted", "released"} <= {kind for _, kind, _ in told}
    translation = at_step(rows["parts/peg"], "Transform3D:translation")
    trail = session.trail("peg")
    assert len(trail) > 30
    for step, pose in trail:
        np.testing.assert_allclose(translation[step][0], pose.translation, atol=1e-7)
    freedom = at_step(rows["plots/freedom/peg"], "Scalars:scalars")
    assert freedom[max(freedom)] == [session.freedom("peg")]
    states = [row["StateChange:state"][0] for e, r in rows.items() if "concentric" in e for row in r if "step" in row]
    assert "active" in states


def test_names_with_slashes_and_spaces_do_not_nest(tmp_path):
    shape = pressing_scene()["rod"].shape
    names = ("a", "a/b", "a b (2)", "größe")
    scene = Scene([Part(name, shape, pin.SE3.Identity()) for name in names])
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session(scene).scene)
    recorder.end()
    moved = [
        e for e, chunk in replay.tables(tmp_path / "run.rrd") if any("Transform3D:translation" in r for r in chunk)
    ]
    assert len(set(moved)) == len(names)


def test_a_recording_cut_anywhere_gives_what_it_has(recorded, tmp_path):
    path, _, _ = recorded
    data, cut = path.read_bytes(), tmp_path / "cut.rrd"
    reached = []
    for share in (0.3, 0.5, 0.77, 0.999, 1.0):
        cut.write_bytes(data[: int(share * len(data))])
        rows = rows_of(cut)
        assert "parts/rod/surfaces/0" in rows
        reached.append(max((row["step"] for row in rows.get("plots/clearance", ()) if "step" in row), default=-1))
    assert reached == sorted(reached)
    assert reached[-1] == 299


def test_killed_at_any_moment_the_recording_can_be_read(tmp_path):
    program = textwrap.dedent("""
        import sys, time
        from tests.vpframe.watching import fake_session, pressing_frames
        from vpframe.view.recorder import RerunRecorder
        recorder = RerunRecorder(sys.argv[1])
        recorder.begin(fake_session().scene)
        for frame in pressing_frames(6000):
            recorder.frame(frame)
            time.sleep(0.002)
            if frame.step == 700:
                print("go", flush=True)
    """)
    path = tmp_path / "run.rrd"
    process = subprocess.Popen([sys.executable, "-c", program, str(path)], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "go\n"
    time.sleep(0.013)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    rows = rows_of(path)
    assert max(row["step"] for row in rows["plots/clearance"] if "step" in row) >= 460  # at most 240 steps are buffered


def test_a_minute_at_60_hz_with_eighteen_moving_parts_stays_small(tmp_path):
    shape = pressing_scene()["rod"].shape
    parts = [Part(f"part {i}", shape, pin.SE3.Identity()) for i in range(18)]
    scene = Scene(parts)
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session(scene).scene)
    template = pressing_frames(2)[0]
    rng = np.random.default_rng(0)
    for step in range(3600):
        poses = {p.name: pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for p in parts}
        recorder.frame(template.__class__(**{**template.__dict__, "step": step, "time": step / 60, "poses": poses}))
    recorder.end()
    assert (tmp_path / "run.rrd").stat().st_size < 20e6


RED = [0xE6292400 | 0xFF]


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """A recording of more parts than have entities of their own, its scene and its frames: three of the rods move,
    some surfaces collide throughout, some later, some no longer."""
    rod = pressing_scene()["rod"].shape
    plate = pressing_scene()["plate"].shape
    parts = [
        Part(f"row/{i}", rod if i % 5 else plate, pin.SE3(np.eye(3), np.array([0.1 * i, 0, 0]))) for i in range(220)
    ]
    parts.append(Part("lone", box((0.1, 0.2, 0.3)), pin.SE3(np.eye(3), np.array([-1.0, 0, 0]))))
    scene = Scene(parts)
    template, frames = pressing_frames(2)[0], []
    poses = {part.name: part.pose for part in parts}
    for step in range(1, 31):
        if step > 3:
            poses = {**poses, "lone": pin.SE3(np.eye(3), np.array([-1.0, 0, 0.1 * step]))}
        moving = {7: step >= 1, 8: step > 10, 9: 5 < step < 9}
        for i in (i for i, moves in moving.items() if moves):
            poses = {
                **poses,
                f"row/{i}": pin.SE3(pin.exp3(np.array([0, 0, 0.01 * step])), np.array([0, 0.01 * step, 1])),
            }
        colliding = [[1, 0, 2, 1], [3, 2, 4, 0]] + [[11, 0, 12, 1]] * (step > 20)
        colliding += [[21, 1, 22, 0]] * (step < 15) + [[7, 2, 8, 2]] * (step == 12)
        views = tuple(quiet(id, (f"row/{id % 220}", f"row/{(id + 1) % 220}"), step) for id in range(500))
        frames.append(
            replace(
                template, step=step, time=step / 60, poses=poses, colliding=np.array(sorted(colliding), np.int32),
                constraints=views, held=("row/8",) if step > 10 else (), joint={}, events=(),
            )
        )  # fmt: skip
    path = tmp_path_factory.mktemp("crowd") / "run.rrd"
    recorder = RerunRecorder(path)
    recorder.begin(fake_session(scene).scene)
    for frame in frames:
        recorder.frame(frame)
    recorder.end()
    return scene, frames, path, rows_of(path)


def quiet(id, parts, step):
    """A constraint in force that nothing happens to, but for number 300, which is accepted in step 16."""
    state = "candidate" if id == 300 and step < 16 else "active"
    return ConstraintView(id, "against", parts, ((0,), (1,)), 0.0, state, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.01)


def test_a_crowd_is_drawn_where_and_as_each_of_its_parts_is(crowded):
    scene, frames, _, rows = crowded
    still = {e: r for e, r in rows.items() if e.startswith("still/")}
    members = {e: next(row["parts"] for row in r if "parts" in row) for e, r in still.items()}
    assert sum(map(len, members.values())) == 220  # all but the one that moved in the first step
    now, own, tints = {}, {}, {}
    for frame in (None, *frames):
        step = 0 if frame is None else frame.step
        for e, r in still.items():
            now[e] = next(
                (row for row in r if row.get("step") == step and "Mesh3D:vertex_positions" not in row), now.get(e)
            )
        for name in scene.names:
            entity = "parts/" + name.replace("/", "\\/")
            for row in rows.get(entity, ()):
                if row.get("step") == step and "Transform3D:translation" in row:
                    own[name] = (row["Transform3D:translation"][0], row["Transform3D:quaternion"][0])
            for s in range(scene[name].mesh.n_surfaces):
                for row in rows.get(f"{entity}/surfaces/{s}", ()):
                    if row.get("step") == step and "Mesh3D:albedo_factor" in row:
                        tints[name, s] = row["Mesh3D:albedo_factor"]
        drawn = [*own.items()]
        for e, row in now.items():
            there = [n for n in members[e] if n not in own]
            if "Clear:is_recursive" in row:
                assert not there
                continue
            places = zip(row["InstancePoses3D:translations"], row["InstancePoses3D:quaternions"], strict=True)
            drawn += zip(there, places, strict=True)
        assert sorted(name for name, _ in drawn) == sorted(scene.names), step
        for name, (place, turn) in drawn:
            pose = scene[name].pose if frame is None else frame.poses[name]
            np.testing.assert_allclose(place, pose.translation, atol=1e-6)
            np.testing.assert_allclose(pin.Quaternion(np.array(turn, float)).matrix(), pose.rotation, atol=1e-6)
        if frame is None:
            continue
        meeting = {(scene.names[o], s) for row in frame.colliding for o, s in (row[:2], row[2:])}
        red = {key for key, color in tints.items() if color == RED}
        for e in still:
            mesh = next(row for row in still[e] if "Mesh3D:vertex_positions" in row)
            shape = display_mesh(scene[members[e][0]].shape)
            colors = np.array(mesh.get("Mesh3D:vertex_colors", np.zeros(len(shape.positions))))
            marked = [
                s for s in range(shape.n_surfaces) if (colors[slice(*shape.vertex_start[s : s + 2])] == RED).all()
            ]
            np.testing.assert_array_equal(mesh["Mesh3D:vertex_positions"], shape.positions)
            red |= {(name, s) for name in members[e] if name not in own for s in marked}
        assert red == meeting, step


def test_what_leaves_a_crowd_is_drawn_from_then_on_with_its_geometry(crowded):
    scene, _, _, rows = crowded
    for name, step in (("row/7", 0), ("row/8", 11), ("row/9", 6), ("row/11", 21), ("row/12", 21), ("row/22", 15)):
        for s in range(scene[name].mesh.n_surfaces):
            entity = "parts/" + name.replace("/", "\\/") + f"/surfaces/{s}"
            (mesh,) = [row for row in rows[entity] if "Mesh3D:vertex_positions" in row]
            assert mesh["step"] == step
            true = scene[name].mesh.vertices[scene[name].mesh.triangles[scene[name].mesh.triangles_of(s)]]
            drawn = np.array(mesh["Mesh3D:vertex_positions"])[np.array(mesh["Mesh3D:triangle_indices"])]
            np.testing.assert_allclose(drawn, true, atol=1e-7)
    assert not any(r"row\/13" in e for e in rows)


def test_of_many_constraints_those_are_recorded_that_change_or_that_a_hand_has_to_do_with(crowded):
    *_, path, rows = crowded
    lanes = {int(e.rpartition("-")[2]): at_step(r, "StateChange:state") for e, r in rows.items() if "constraints/" in e}
    assert lanes == {
        **{id: {11: ["active"]} for id in (7, 8, 227, 228, 447, 448)},
        300: {16: ["active"]},
    }
    assert {int(e.rpartition("/")[2]) for e in rows if "symbols/constraint" in e} == set(lanes)
    (note,) = [line for line in replay.lines(path) if line.kind == "note"]
    assert (note.step, note.text.split()[1]) == (1, "500")


@pytest.mark.parametrize("content", [None, b"", b"not a recording", b"RRF2\x00)\x00\x00\x02\x00\x00\x00"])
def test_what_is_no_recording_is_said_in_one_line(tmp_path, content):
    path = tmp_path / "run.rrd"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LoadError) as raised:
        replay.replay(path, script=True)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_file_that_cannot_be_written_is_said_before_the_session(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(VpframeError, match=r"run\.rrd"):
        RerunRecorder(tmp_path / "file" / "run.rrd")
    with pytest.raises(VpframeError, match=re.escape(str(tmp_path))):
        RerunRecorder(tmp_path)


def test_what_stops_the_writer_stops_the_recorder_and_not_the_session(tmp_path, monkeypatch):
    from vpframe.view import recorder as module

    monkeypatch.setattr(module, "FLUSH_STEPS", 1)
    monkeypatch.setitem(module.COLUMNS, "scalar", lambda values: 1 / 0)
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session().scene)
    with pytest.raises(ZeroDivisionError):
        for _ in range(100):
            for frame in pressing_frames(20):
                recorder.frame(frame)
    with pytest.raises(ZeroDivisionError):
        recorder.end()


def test_a_recording_that_was_cut_off_is_opened_without_its_torn_end(recorded, tmp_path, monkeypatch):
    path, _, _ = recorded
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(path.read_bytes()[:-5])
    opened = []

    def run(arguments, env, check):
        opened.append((Path(arguments[-1]).read_bytes(), env["RERUN_ANALYTICS"]))
        return subprocess.CompletedProcess(arguments, 0)

    monkeypatch.setattr(replay.subprocess, "run", run)
    assert replay.replay(cut) == 0
    ((content, analytics),) = opened
    assert path.read_bytes().startswith(content)
    assert 0.2 * path.stat().st_size < len(content) < cut.stat().st_size  # the torn end is the file's index
    assert analytics == "0"
    assert replay.replay(path) == 0
    assert opened[1][0] == path.read_bytes()


def test_rerun_is_started_on_loopback_only(tmp_path):
    command = replay.command(tmp_path / "run.rrd")
    assert command[1:3] == ["--bind", "127.0.0.1"]
