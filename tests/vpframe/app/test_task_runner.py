"""Task scripts through their real entry points: exit codes, one-line errors, Ctrl-C, kill and resume."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from vpframe.app import scaffold as first_task
from vpframe.app import task_runner as study
from vpframe.app.options import load
from vpframe.errors import VpframeError
from vpframe.session.checkpoint import CODEC, Journal

ROOT = Path(__file__).parents[3]
SCENE = """
import vpframe.app.task_runner
from tests.vpframe.bench_scene import SEAT, scene
from vpframe.hands import constraint
"""
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


def script(tmp_path: Path, body: str) -> Path:
    path = tmp_path / "task.py"
    path.write_text(body)
    return path


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


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("def task(session:\n", "task.py:5: "),
        ("import nowhere\n", "ModuleNotFoundError: No module named 'nowhere'"),
        ("x = 1\n", "defines no task"),
        ("scene = None\ndef task(session): pass\n", "defines no model"),
        ("scene = None\nFILE = 'missing.step'\ndef task(session): pass\n", "missing.step"),
        ("OPTIONS = {'dt': -1.0}\ndef task(session): pass\n", "dt is -1.0"),
        ("OPTIONS = {'speed': 1.0}\ndef task(session): pass\n", "speed"),
    ],
)
def test_a_script_that_is_wrong_is_one_line(tmp_path, body: str, words: str) -> None:
    with pytest.raises(VpframeError) as caught:
        study.run_task(script(tmp_path, SCENE + body))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_scripts_and_lone_resume_are_bad_usage(tmp_path) -> None:
    with pytest.raises(VpframeError, match="no such task script"):
        study.run_task(tmp_path / "none.py")
    with pytest.raises(VpframeError, match="needs --checkpoint"):
        study.run_task(script(tmp_path, SCENE), resume=True)


def test_a_new_task_runs_and_is_not_overwritten(tmp_path) -> None:
    from vpframe.scene import modelling as m

    m.write_step(
        tmp_path / "two.step",
        {"base": m.box(0.1, 0.1, 0.01), "knob": m.cylinder(0.01, 0.02).translated(0.05, 0.05, 0.05)},
    )
    assert study.new_task(tmp_path / "first.py", tmp_path / "two.step") == ""
    text = (tmp_path / "first.py").read_text()
    assert 'FILE = "two.step"' in text
    assert '"knob": 3 surfaces' in text
    assert study.run_task(tmp_path / "first.py") == 0
    with pytest.raises(VpframeError, match="exists already"):
        study.new_task(tmp_path / "first.py", tmp_path / "two.step")


def test_a_new_task_takes_a_part_out_by_the_axis_that_holds_it(tmp_path) -> None:
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.005, 0.02)
    peg = m.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.02), (0.008, 0.02), (0.008, 0.025), (0.0, 0.025)])
    m.write_step(tmp_path / "pegged.step", {"block": block, "peg": peg})
    assert study.new_task(tmp_path / "first.py", tmp_path / "pegged.step") == ""
    assert 'hand.pull("axis", until="free")' in (tmp_path / "first.py").read_text()
    assert study.run_task(tmp_path / "first.py") == 0


def test_a_new_task_of_which_nothing_comes_out_says_what_to_change(tmp_path) -> None:
    from vpframe.scene import modelling as m

    shell = m.box(0.04, 0.04, 0.04) - m.box(0.02, 0.02, 0.02).translated(0.01, 0.01, 0.01)
    m.write_step(
        tmp_path / "shut.step", {"shell": shell, "cube": m.box(0.018, 0.018, 0.018).translated(0.011, 0.011, 0.011)}
    )
    scene = load(tmp_path / "shut.step")
    scene["shell"].fixed = True
    stops = first_task.new_task(tmp_path / "first.py", scene, tmp_path / "shut.step")
    assert "cube" in stops
    text = (tmp_path / "first.py").read_text()
    assert "# cube did not come out: " in text and "give another direction" in text
    assert study.run_task(tmp_path / "first.py") == 0, "what is written runs"
    tried = text.partition(f"# {first_task.REMEDY}\n")[2].partition("\n\n")[0]
    (tmp_path / "tried.py").write_text(text.replace(tried, tried.replace("# ", "")))
    assert study.run_task(tmp_path / "tried.py") == 1, "and what was tried fails"


ODD = (
    'M3 "pan" {0}', "a\\b'c", "100 % # x", "'''", "<b>{part}</b>", "ключ №5", "-rf", "$x", "hand",
    "e\u0301 \u202e", "cube", "x",
)  # fmt: skip


@pytest.mark.parametrize("named", [pytest.param(None, marks=pytest.mark.slow), 0, 4], ids=["any", "quotes", "braces"])
@pytest.mark.parametrize("kind", ["enclosed", "pressed", "loose"])
def test_a_new_task_of_many_parts_with_odd_names_runs(tmp_path, kind: str, named: int | None) -> None:
    """Twelve shapes in a block: in closed pockets, drawn into it, or on top; what is written ends well in any case."""
    from vpframe.scene import modelling as m

    block = m.box(0.16, 0.05, 0.04)
    parts = {}
    for k, name in enumerate(ODD):
        size, (x, y) = 0.008 + 1e-4 * k, (0.02 * (k % 6) + 0.01, 0.02 * (k // 6) + 0.005)
        if kind == "enclosed":
            block = block - m.box(0.012, 0.012, 0.012).translated(x, y, 0.01)
        z = {"enclosed": 0.011, "pressed": 0.036, "loose": 0.04}[kind]
        parts[name] = m.box(size, size, size).translated(x + 0.001, y + 0.001, z)
    m.write_step(tmp_path / "odd.step", {"block": block, **parts})
    part = None if named is None else list(load(tmp_path / "odd.step").names)[named + 1]
    stops = study.new_task(tmp_path / "first.py", tmp_path / "odd.step", part=part, budget=2.0)
    assert bool(stops) == (kind == "enclosed") or kind == "pressed"
    assert study.run_task(tmp_path / "first.py") == 0
    expected = [line for line in (tmp_path / "first.py").read_text().splitlines() if "session.expect_free(" in line]
    assert [line.lstrip().startswith("#") for line in expected] == [bool(stops)]


def test_a_named_part_for_which_planning_finds_nothing_is_slid_straight(tmp_path, monkeypatch) -> None:
    from vpframe import planning
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0)
    m.write_step(
        tmp_path / "slot.step",
        {
            "block": block - m.box(0.01, 0.04, 0.02).translated(-0.005, -0.02, 0.01),
            "key": m.box(0.01, 0.04, 0.01).translated(-0.005, -0.02, 0.01),
        },
    )
    whole = planning.removal

    def nothing(*given, **named):
        return replace(whole(*given, **named), verdict="not found", way=None)

    monkeypatch.setattr(planning, "removal", nothing)
    path = tmp_path / "first.py"
    assert study.new_task(path, tmp_path / "slot.step", part="key") == ""
    assert "hand.slide(" in path.read_text()
    assert study.run_task(path) == 0


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


def test_a_new_task_for_a_named_part_outlines_the_scene(tmp_path) -> None:
    from vpframe.scene import modelling as m

    block = m.box(0.04, 0.04, 0.02).translated(-0.02, -0.02, 0.0) - m.cylinder(0.005, 0.02)
    peg = m.revolve([(0.0, 0.0), (0.005, 0.0), (0.005, 0.02), (0.008, 0.02), (0.008, 0.025), (0.0, 0.025)])
    knob = m.cylinder(0.004, 0.01).translated(0.015, 0.015, 0.0205)
    m.write_step(
        tmp_path / "pegged.step", {"block": block, "peg": peg, "kit": {"knob": knob, "cap": knob.translated(0.1)}}
    )
    path = tmp_path / "first.py"
    assert study.new_task(path, tmp_path / "pegged.step", part="peg") == ""
    text = path.read_text()
    assert 'hand.grab("peg")' in text
    assert '"block": 7 surfaces, 40 x 40 x 20 mm around (0, 0, 10) mm; ' in text
    (line,) = (line for line in text.splitlines() if line.startswith('#   "peg"'))
    assert "16 x 16 x 25 mm around (0, 0, 12.5) mm; " in line
    assert "concentric" in line and "against" in line and line.endswith(" to block")
    (line,) = (line for line in text.splitlines() if line.startswith('#   "kit/knob"'))
    assert line.endswith("; beside block")
    assert study.run_task(path) == 0
    for name, words in (("pegg", "peg"), ("kit", "kit has 2 parts"), ("", "no part")):
        with pytest.raises(VpframeError, match=words):
            study.new_task(tmp_path / "other.py", tmp_path / "pegged.step", part=name)
    assert not (tmp_path / "other.py").exists()


def test_a_new_task_removes_what_stands_in_the_way_of_a_named_part(tmp_path) -> None:
    from vpframe.scene import modelling as m

    cup = m.box(0.04, 0.04, 0.04) - m.box(0.03, 0.03, 0.035).translated(0.005, 0.005, 0.005)
    m.write_step(
        tmp_path / "cup.step",
        {"cup": cup, "cube": m.box(0.01, 0.01, 0.01).translated(0.015, 0.015, 0.005),
         "lid": m.box(0.04, 0.04, 0.004).translated(0.0, 0.0, 0.04)},
    )  # fmt: skip
    path = tmp_path / "first.py"
    scene = load(tmp_path / "cup.step")
    scene["cup"].fixed = True
    assert first_task.new_task(path, scene, tmp_path / "cup.step", "cube") == ""
    assert '    hand.remove(["lid", "cube"])\n    session.expect_free("cube")' in path.read_text()
    assert study.run_task(path) == 0
    told = first_task.new_task(tmp_path / "short.py", scene, tmp_path / "cup.step", "cube", budget=0.01)
    assert told.endswith("used up its budget of 0.01 s: give more with --budget 0.02s")
    assert f"# cube did not come out: {told}\n" in (tmp_path / "short.py").read_text()
    assert study.run_task(tmp_path / "short.py") == 0


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


def test_a_script_may_define_dataclasses_with_postponed_annotations(tmp_path) -> None:
    body = """
from __future__ import annotations
from dataclasses import dataclass, field
from typing import ClassVar
from tests.vpframe.bench_scene import scene

@dataclass
class Stop:
    part: str
    heights: list[float] = field(default_factory=list)
    seen: ClassVar[int] = 0

def task(session):
    session.expect(Stop("peg").heights == [] and Stop.seen == 0)
"""
    assert study.run_task(script(tmp_path, body)) == 0
    assert not [name for name in sys.modules if name.startswith("vpframe_task_")]


def test_what_lies_beside_a_script_is_imported_in_its_task_too(tmp_path) -> None:
    (tmp_path / "beside_the_script.py").write_text("SECONDS = 0.05\n")
    body = "def task(session):\n    import beside_the_script\n    session.run(beside_the_script.SECONDS)\n"
    before = list(sys.path)
    assert study.run_task(script(tmp_path, SCENE + body)) == 0
    assert sys.path == before
