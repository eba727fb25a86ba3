"""?"""

import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.vpframe.view.recordings import at_step, rows_of
from tests.vpframe.watching import fake_session, pressing_frames, pressing_scene
from vpframe.errors import VpframeError
from vpframe.scene.scene import Part, Scene
from vpframe.view import replay
from vpframe.view.recorder import RerunRecorder

ROOT = Path(__file__).parents[3]


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
