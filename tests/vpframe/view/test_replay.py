"""Recordings that are opened, and listed as events."""

import subprocess
from pathlib import Path

import pytest

from vpframe.errors import LoadError
from vpframe.view import replay


def test_replay_script_prints_the_events(recorded, capsys):
    path, _, _ = recorded
    assert replay.replay(path, script=True) == 0
    printed = capsys.readouterr().out
    assert "collided" in printed and "plate and rod collide" in printed and "hand.move_to(z=0.050)" in printed


@pytest.mark.parametrize("content", [None, b"", b"not a recording", b"RRF2\x00)\x00\x00\x02\x00\x00\x00"])
def test_what_is_no_recording_is_said_in_one_line(tmp_path, content):
    path = tmp_path / "run.rrd"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LoadError) as raised:
        replay.replay(path, script=True)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


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
