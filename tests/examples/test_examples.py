"""Each example runs without a screen, does what it expects of itself, and ends with code 0."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = ("shaft_and_housing", "digger_pin")
REAL = ("printer_head",)
"""on models of the folder that VPFRAME_DATA names"""
TASKS = tuple(sorted(p.stem for p in EXAMPLES.glob("*.py") if "def task(" in p.read_text() and p.stem not in REAL))


def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "DISPLAY": ""}
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=280, env=environment, cwd=cwd
    )


REAL_MARKS = (
    pytest.mark.slow,
    pytest.mark.skipif("VPFRAME_DATA" not in os.environ, reason="VPFRAME_DATA names no folder of real models"),
)


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in TASKS]
    + [pytest.param(name, marks=REAL_MARKS) for name in REAL],
)
def test_an_example_does_what_it_expects_of_itself(name: str, tmp_path: Path) -> None:
    done = run(str(EXAMPLES / f"{name}.py"), cwd=tmp_path)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "expectation holds" in done.stdout
    assert "FAILS" not in done.stdout
    assert done.stdout.splitlines()[-1].startswith("done: ")


def test_an_example_of_a_real_model_says_what_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VPFRAME_DATA", raising=False)
    done = run(str(EXAMPLES / "printer_head.py"), cwd=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "set VPFRAME_DATA" in done.stderr


@pytest.mark.slow
def test_the_formats_go_out_and_come_back(tmp_path: Path) -> None:
    done = run(str(EXAMPLES / "formats.py"), str(tmp_path))
    assert done.returncode == 0, done.stderr[-2000:]
    assert "moved.step: " in done.stdout and "left out: nothing" in done.stdout
    assert "concentric of base/block and base/pin" in done.stdout
    assert {p.name for p in tmp_path.iterdir()} >= {"moved.step", "moved.glb", "moved.urdf", "moved.mjcf", "events.csv"}


def test_the_first_task_of_the_readme_runs_on_the_model_of_the_demo(tmp_path: Path) -> None:
    from vpframe.app.demo import MODEL, build

    (tmp_path / "vpframe-demo").mkdir()
    build(tmp_path / "vpframe-demo" / MODEL)
    blocks = (EXAMPLES.parent / "README.md").read_text().split("```python\n")[1:]
    (script,) = (text for text in (block.split("```")[0] for block in blocks) if text.startswith("# take_out.py"))
    (tmp_path / "take_out.py").write_text(script)
    done = run("take_out.py", cwd=tmp_path)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert done.stdout.splitlines()[-1].startswith("done: ")


def test_each_example_has_its_section_and_its_picture() -> None:
    page = (EXAMPLES / "README.md").read_text()
    named = [*TASKS, *(p.stem for p in EXAMPLES.glob("physics_*.py"))]
    assert len(named) == 17
    for name in named:
        assert f"examples/{name}.py`" in page
        assert f"(pictures/{name}.png)" in page
        data = (EXAMPLES / "pictures" / f"{name}.png").read_bytes()
        assert data.startswith(b"\x89PNG")
        assert 2_000 < len(data) < 30_000


@pytest.mark.slow
def test_a_picture_is_drawn_of_the_examples_own_frames(tmp_path: Path) -> None:
    name = "digger_pin"
    kept = (EXAMPLES / "pictures" / f"{name}.png").read_bytes()
    done = run(str(EXAMPLES / "pictures.py"), name, "--to", str(tmp_path))
    assert done.returncode == 0, done.stderr[-2000:]
    drawn = (tmp_path / f"{name}.png").read_bytes()
    assert drawn[:33] == kept[:33], "one size and format"
    assert abs(len(drawn) - len(kept)) < 0.1 * len(kept), "the same frames (to the last bit only on one machine)"


@pytest.mark.slow
def test_an_example_runs_by_the_command_line_with_recording_and_report(tmp_path: Path) -> None:
    done = run(
        "-m", "vpframe", "run", str(EXAMPLES / "shaft_and_housing.py"),
        "--record", str(tmp_path / "run.rrd"), "--report", str(tmp_path / "report"),
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
    assert (tmp_path / "report" / "index.html").exists()
    assert list((tmp_path / "report").glob("*.stl")), "the swept volume of the shaft"
