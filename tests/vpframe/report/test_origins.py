"""Clashes of the initial assembly are told from those of the task."""

from dataclasses import replace

import pytest

from tests.vpframe.report.runs import by_origin, log_of, stacked
from tests.vpframe.watching import place
from vpframe.report import write


def test_what_stood_so_is_told_apart_from_what_the_task_caused(tmp_path):
    scene, frames = stacked([0.06, 0.05, 0.048, 0.047, 0.07])
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert list(found) == [
        ("task", "cube", "floor"),
        ("as it stands", "block", "floor"),
        ("as it stands", "block", "lid"),
    ]
    caused, stood, touching = found.values()
    assert (caused["kind"], stood["kind"], touching["kind"]) == ("clash", "clash", "contact")
    assert caused["depth"] == pytest.approx(0.003) and caused["steps"] >= 2
    assert stood["depth"] == pytest.approx(0.001) and stood["steps"] == 5
    assert stood["count"] == len(stood["surface_pairs"]) > 1
    assert {tuple(row["parts"]) for row in stood["surface_pairs"]} == {("block", "floor")}
    assert stood["point"] == stood["surface_pairs"][0]["point"]
    assert (caused["first_time"], caused["last_time"]) == (frames[1].time, frames[3].time), "flush, then in"


def test_what_met_before_the_first_step_stood_so_though_the_first_step_moved_it(tmp_path):
    scene, frames = stacked([0.049, 0.0495, 0.06], aside=0.01)
    scene["cube"].pose = place(x=0.3, z=0.0485)
    log = log_of(frames, scene)
    assert [clash.unmoved for key, clash in log.clashes.items() if key.part_a == "cube"] == [False] * 4
    found = by_origin(write(tmp_path, log))
    assert ("as it stands", "cube", "floor") in found and ("task", "cube", "floor") not in found


def test_what_the_task_pushes_deeper_is_the_tasks(tmp_path):
    scene, frames = stacked([0.049, 0.049, 0.040, 0.049])
    scene["cube"].pose = place(x=0.3, z=0.049)
    found = by_origin(write(tmp_path, log_of(frames, scene)))
    assert found["task", "cube", "floor"]["depth"] == pytest.approx(0.010)
    still, same = stacked([0.049, 0.049])
    still["cube"].pose = place(x=0.3, z=0.049)
    assert ("as it stands", "cube", "floor") in by_origin(write(tmp_path / "still", log_of(same, still)))


def test_parts_that_are_carried_together_stand_to_each_other_as_before(tmp_path):
    scene, frames = stacked([0.06] * 3)
    moved = []
    for step, frame in enumerate(frames):
        lift = place(z=0.1 * step)
        poses = {**frame.poses, "block": lift * frame.poses["block"], "lid": lift * frame.poses["lid"]}
        rows = frame.colliding[(frame.colliding[:, [0, 2]] == [1, 2]).all(axis=1)]
        moved.append(replace(frame, poses=poses, colliding=rows if step else rows[:0]))
    assert list(by_origin(write(tmp_path, log_of(moved, scene)))) == [("as it stands", "block", "lid")]
