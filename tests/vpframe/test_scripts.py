"""Scripts as modules, and what of their errors is shown."""

import sys
from pathlib import Path

import pytest

from tests.vpframe.tasks import SCENE, script
from tests.vpframe.verdicts import written
from vpframe.app import task_runner as study
from vpframe.errors import VpframeError


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


def test_a_script_may_define_dataclasses_with_postponed_annotations(tmp_path) -> None:
    body = """
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


def test_a_fault_of_the_script_is_shown_with_its_own_frames_only(tmp_path: Path, capsys, monkeypatch) -> None:
    path = written(tmp_path, "session.expect(deeper(session, 'axis') == 3)")
    assert study.run_task(path) == 1
    error = capsys.readouterr().err
    assert error.splitlines() == [
        "Traceback (most recent call last):",
        f'  File "{path}", line 9, in task',
        "    session.expect(deeper(session, 'axis') == 3)",
        "                   ^^^^^^^^^^^^^^^^^^^^^^^",
        f'  File "{path}", line 5, in deeper',
        "    return {}[what]",
        "           ~~^^^^^^",
        "KeyError: 'axis'",
        f"not decided: script error: {path}:5: KeyError: 'axis'",
    ]
    monkeypatch.setenv("VPFRAME_TRACEBACK", "1")
    assert study.run_task(path) == 1
    assert "vpframe/app/task_runner.py" in capsys.readouterr().err


def test_what_vpframe_calls_back_in_the_script_is_its_own_frame_too(tmp_path: Path, capsys) -> None:
    path = written(
        tmp_path,
        "from vpframe.hands import Condition",
        "late = Condition('late', lambda session, hand: 1 / 0)",
        "session.run_until(late)",
    )
    assert study.run_task(path) == 1
    error = capsys.readouterr().err
    assert [line.strip() for line in error.splitlines() if line.startswith("  File")] == [
        f'File "{path}", line 11, in task',
        f'File "{path}", line 10, in <lambda>',
    ]
    assert "raised inside" not in error


def test_an_error_raised_inside_says_how_to_see_more(tmp_path: Path, capsys) -> None:
    assert study.run_task(written(tmp_path, "session.run('long')")) == 1
    error = capsys.readouterr().err
    assert "raised inside vpframe; set VPFRAME_TRACEBACK=1" in error
    assert "session.py" not in error


def test_a_script_that_ends_python_while_it_is_read_is_bad_input(tmp_path: Path, capsys, vpframe) -> None:
    path = tmp_path / "task.py"
    path.write_text("import sys\nsys.exit(0)\n")
    with pytest.raises(VpframeError, match=r"task\.py:2: sys\.exit\(0\) before the end"):
        study.run_task(path)
    done = vpframe("run", path)
    assert done.returncode == 2
    assert vpframe("run", path, env={"VPFRAME_TRACEBACK": "1"}).returncode != 0
