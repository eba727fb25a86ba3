"""A hand that does the plan: in a recording and on the live page."""

from pathlib import Path

import pytest

from vpframe.app.cli import main


@pytest.mark.slow
def test_the_recording_shows_a_hand_that_does_it(model, tmp_path):
    record = tmp_path / "run.rrd"
    assert main(["disassemble", str(model), "--part", "nut", "--record", str(record)]) == 0
    assert record.stat().st_size > 10_000
    assert Path(model).exists()


@pytest.mark.slow
def test_the_live_page_plays_the_plan(model, monkeypatch, capsys):
    from vpframe.events import Frames
    from vpframe.view import meshcat_viewer

    shown = Frames()
    monkeypatch.setattr(meshcat_viewer, "watched", lambda wait: shown)
    assert main(["disassemble", str(model), "--part", "nut", "--view", "--no-wait"]) == 0
    heights = [float(frame.poses["nut"].translation[2]) for frame in shown.frames]
    assert heights[0] > -0.007 and heights[-1] < -0.016 and len(heights) > 10
    assert "nut comes out" in capsys.readouterr().out
