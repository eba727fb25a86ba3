"""Task scripts through their real entry points: exit codes, one-line errors, Ctrl-C, kill and resume."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.vpframe.tasks import SCENE, script
from vpframe.app import task_runner as study
from vpframe.errors import VpframeError
from vpframe.session.checkpoint import CODEC, Journal

ROOT = Path(__file__).parents[3]
LONG = (
    SCENE
    + """
def task(session):
    hand = session.hand(at=(0.06, 0.0, 0.07))
    hand.speed = 0.02
    hand.grab("peg")
    hand.move_to(SEAT + [0.0001, 0.0, 0.018])
    hand.slide("down", until=constraint("concentric"))
    hand.slide("down", until=constraint("against"))
    hand.pull(along="axis", until="free")
    for _ in range({times}):
        hand.move_by((0.0, 0.0, 0.02))
        hand.move_by((0.0, 0.0, -0.02))
    hand.release()
"""
)


def start(*arguments: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "DISPLAY": ""}
    return subprocess.Popen(
        [sys.executable, "-m", "vpframe", "run", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip


def test_a_task_that_can_be_done_ends_with_0(tmp_path, capsys) -> None:
    path = script(tmp_path, SCENE + "def task(session):\n    session.run(0.1)\n    session.note('hello')\n")
    assert study.run_task(path) == 0
    out = capsys.readouterr().out
    assert "note        hello" in out
    assert out.splitlines()[-1].startswith("done: 0.10 s of the task in 6 steps")


def test_a_task_that_cannot_be_done_ends_with_1_and_says_where_and_why(tmp_path, capsys) -> None:
    path = script(tmp_path, SCENE + "def task(session):\n    session.run(0.1)\n    session.expect_freedom('peg', 2)\n")
    assert study.run_task(path, report=tmp_path / "report") == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "task.py:7: expected peg has 2 degrees of freedom (it has 6)" in error
    document = json.loads((tmp_path / "report" / "report.json").read_text())
    assert document["can_be_done"] is False
    assert "2 degrees of freedom" in document["reason"]


def test_missing_scripts_and_lone_resume_are_bad_usage(tmp_path) -> None:
    with pytest.raises(VpframeError, match="no such task script"):
        study.run_task(tmp_path / "none.py")
    with pytest.raises(VpframeError, match="needs --checkpoint"):
        study.run_task(script(tmp_path, SCENE), resume=True)


def test_access_is_asked_with_one_flag(tmp_path, capsys) -> None:
    path = tmp_path / "boxed.py"
    path.write_text(
        """
import vpframe.app.task_runner
from tests.vpframe.hands.test_access import boxed

def scene():
    return boxed(lid=True)

def task(session):
    session.hand().grab("cube")
"""
    )
    assert study.run_task(path) == 0
    assert study.run_task(path, access=True) == 1
    assert "no access to cube" in capsys.readouterr().err


def test_a_task_that_fails_before_its_first_step_is_reported_with_the_model_as_it_stands(tmp_path, capsys) -> None:
    path = script(tmp_path, SCENE + "def task(session):\n    session.hand().release()\n")
    assert study.run_task(path, report=tmp_path / "report") == 1
    assert "hand holds nothing" in capsys.readouterr().err
    document = json.loads((tmp_path / "report" / "report.json").read_text())
    assert document["steps"] == 1 and document["can_be_done"] is False and "holds nothing" in document["reason"]
    assert "data:image/png" in (tmp_path / "report" / "index.html").read_text()


def test_ctrl_c_ends_cleanly_with_recording_and_report_of_what_was_done(tmp_path) -> None:
    path = script(tmp_path, LONG.format(times=10_000))
    process = start(str(path), "--record", str(tmp_path / "run.rrd"), "--report", str(tmp_path / "report"))
    assert process.stdout is not None
    for line in process.stdout:
        if "removed" in line:
            break
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=200)
    assert process.returncode == 130
    # a first run also says that kernels are being compiled
    assert error.splitlines()[-1] == "interrupted; what was done so far is kept"
    assert "interrupted: " in out
    document = json.loads((tmp_path / "report" / "report.json").read_text())
    assert document["reason"] == "interrupted"
    assert any(e["kind"] == "accepted" for e in document["events"])
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def last_saved(journal: Path) -> list[bytes]:
    """Poses of all parts at the last save of a run."""
    _, _, state = CODEC.decode(Journal(journal, {}, resume=True).saved)
    return [pose.tobytes() for pose in state.poses]


@pytest.mark.slow
def test_a_killed_run_with_a_live_view_resumes_to_the_same_end(tmp_path) -> None:
    path = script(tmp_path, LONG.format(times=6))
    journal = tmp_path / "run.journal"
    process = start(str(path), "--checkpoint", str(journal), "--view", "--no-wait")
    until = time.monotonic() + 200
    while time.monotonic() < until and process.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"SAVE") >= 3:
            process.kill()
        time.sleep(0.01)
    process.communicate()
    assert process.returncode == -signal.SIGKILL, "it was to be killed in the middle"
    resumed = start(
        str(path), "--checkpoint", str(journal), "--resume", "--view", "--no-wait", "--report", str(tmp_path / "a")
    )
    out, error = resumed.communicate(timeout=200)
    assert resumed.returncode == 0, out + error
    assert "look at it at http://127.0.0.1:" in error
    other = tmp_path / "other.journal"
    whole = start(str(path), "--checkpoint", str(other), "--report", str(tmp_path / "b"))
    out, error = whole.communicate(timeout=200)
    assert whole.returncode == 0, out + error
    a, b = (json.loads((tmp_path / name / "report.json").read_text()) for name in "ab")
    for document in (a, b):
        document.pop("timings", None)
    assert a == b
    assert last_saved(journal) == last_saved(other), "bit for bit"
