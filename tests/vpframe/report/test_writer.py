"""?"""

import csv
import itertools
import json
import re

import numpy as np
import pytest

from tests.vpframe.report.runs import Page, by_origin, document, log_of, stacked
from tests.vpframe.watching import pressing_frames
from vpframe.errors import VpframeError
from vpframe.report import write
from vpframe.scene.scene import Shape


def test_the_verdict_and_the_numbers_of_the_run(written):
    folder, frames = written
    found = document(folder)
    assert found["task"] == "press"
    assert found["can_be_done"] is True
    assert found["duration"] == frames[-1].time
    assert found["steps"] == frames[-1].step
    assert [(e["step"], e["kind"], e["text"]) for e in found["events"]] == [
        (e.step, e.kind, e.text) for f in frames for e in f.events
    ]


def test_freedom_and_clearance_are_those_of_the_frames(written):
    folder, frames = written
    found = document(folder)
    changes = found["freedom"]["rod"]
    assert [c["freedom"] for c in changes] == [6, 3, 6]
    touching = [f.time for f in frames if len(f.colliding)]
    assert changes[1]["time"] == touching[0]
    least = min(frames, key=lambda f: f.clearance)
    assert found["clearance"]["least"] == least.clearance
    assert found["clearance"]["step"] == least.step
    assert found["clearance"]["parts"] == ["plate", "rod"]
    assert found["clearance"]["poses"]["rod"]["translation"] == least.poses["rod"].translation.tolist()


def test_stages_follow_the_scripts_lines_without_gaps(written):
    folder, frames = written
    stages = document(folder)["stages"]
    assert [s["text"] for s in stages] == [text for text, _ in itertools.groupby(f.script for f in frames)]
    assert all(a["end"] == b["start"] for a, b in itertools.pairwise(stages))
    assert stages[-1]["end"] == frames[-1].time


def test_constraints_tell_their_states_with_times(written):
    folder, frames = written
    (constraint,) = document(folder)["constraints"]
    assert constraint["kind"] == "against"
    assert [s["state"] for s in constraint["states"]] == ["candidate", "active"]
    for state in constraint["states"]:
        times = [f.time for f in frames if f.constraints and f.constraints[0].state == state["state"]]
        assert (state["from"], state["to"]) == (times[0], times[-1])


def test_the_clash_is_told_with_depth_place_and_times(written):
    folder, frames = written
    (clash,) = document(folder)["clashes"]
    touching = [f for f in frames if len(f.colliding)]
    assert clash["parts"] == ["plate", "rod"]
    assert clash["surfaces"] == [5, 0]
    assert clash["faces"] == ["face 5 · plane", "face 0 · shaft Ø20"]
    assert clash["status"] == "new"
    assert clash["first_time"] == touching[0].time
    assert clash["last_time"] == touching[-1].time
    assert clash["steps"] == len(touching)
    # the rod's end at z - 25 mm stands below the plate's top at 5 mm
    assert clash["depth"] == pytest.approx(max(0.030 - f.poses["rod"].translation[2] for f in touching), abs=2e-7)
    assert np.linalg.norm(clash["point"][:2]) <= 0.0101


def test_shapes_that_are_meshes_without_faces_have_a_report(tmp_path):
    scene, frames = stacked([0.06, 0.048])
    for part in scene.parts:
        part.shape = Shape(part.mesh, (), ())
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert found["task", "cube", "floor"]["faces"] == ["face 0", "face 5"]


def test_csv_has_a_row_a_clash(written):
    folder, _ = written
    with (folder / "clashes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    (clash,) = document(folder)["clashes"]
    assert len(rows) == 1
    assert rows[0]["part_a"] == "plate" and rows[0]["surface_b"] == "0" and rows[0]["status"] == "new"
    assert float(rows[0]["depth_m"]) == clash["depth"]
    assert float(rows[0]["first_time_s"]) == clash["first_time"]
    assert (rows[0]["origin"], rows[0]["kind"], rows[0]["surface_pairs"]) == ("task", "clash", "1")
    assert rows[0]["face_b"] == "face 0 · shaft Ø20"


def test_a_failed_task_says_why_and_markup_in_names_stays_text(tmp_path):
    reason = 'the <script>bolt</script> & "nut" do not part'
    folder = write(tmp_path / "out", log_of(pressing_frames(10)), failure=reason)
    assert document(folder)["can_be_done"] is False
    assert document(folder)["reason"] == reason
    page = Page((folder / "index.html").read_text())
    assert f"The task cannot be done: {reason}" in "".join(page.text)


def test_a_session_that_never_stepped_has_a_report(tmp_path):
    folder = write(tmp_path, log_of([]))
    found = document(folder)
    assert (found["steps"], found["clashes"], found["clearance"]) == (0, [], None)
    assert Page((folder / "index.html").read_text()).open == []


def test_status_is_kept_from_run_to_run(tmp_path):
    def run(frames):
        folder = write(tmp_path, log_of(frames))
        return {tuple(c["surfaces"]): c["status"] for c in document(folder)["clashes"]}

    frames = pressing_frames(60)
    apart = [f for f in frames if not len(f.colliding)]
    assert run(frames) == {(5, 0): "new"}
    assert run(frames) == {(5, 0): "persistent"}
    status = json.loads((tmp_path / "clashes.json").read_text())
    status["clashes"][0].update(status="accepted", remark="press fit")
    (tmp_path / "clashes.json").write_text(json.dumps(status))
    assert run(frames) == {(5, 0): "accepted"}
    assert document(tmp_path)["clashes"][0]["remark"] == "press fit"
    assert run(apart) == {(5, 0): "resolved"}
    assert run(frames) == {(5, 0): "new"}


def test_a_spoilt_status_file_is_named_before_anything_is_overwritten(tmp_path):
    (tmp_path / "clashes.json").write_text("{")
    with pytest.raises(VpframeError, match=re.escape(str(tmp_path / "clashes.json"))):
        write(tmp_path, log_of(pressing_frames(10)))
    assert not (tmp_path / "report.json").exists()


def test_a_file_where_the_folder_should_be_is_named(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(VpframeError, match="out"):
        write(tmp_path / "out", log_of([]))
