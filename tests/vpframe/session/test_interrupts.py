"""Ctrl-C on a real terminal, in whatever a command is at: exit 130, one line, what was done is kept, nobody left."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from collision.numeric import kernel_cache
from tests.vpframe.terminal import CTRL_C, Terminal
from tests.vpframe.waiting import wait_until
from vpframe.scene import modelling
from vpframe.view.replay import lines

TASK = """
import numpy as np, pinocchio as pin
from vpframe.scene import modelling
from vpframe.scene.scene import Part, Scene

def scene():
    table = modelling.shape(modelling.box(0.3, 0.3, 0.01).translated(-0.15, -0.15, -0.01), name="table")
    cube = modelling.shape(modelling.box(0.02, 0.02, 0.02), name="cube")
    lift = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05]))
    return Scene([Part("table", table, pin.SE3.Identity(), fixed=True), Part("cube", cube, lift)])

def task(session):
    hand = session.hand()
    hand.grab("cube")
    session.note("in the hand")
    hand.move_by((0.0, 0.0, 0.2), duration=100000.0)
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A plate of many bores: it takes a moment to read."""
    plate = modelling.box(0.42, 0.22, 0.01)
    for k in range(60):
        plate = plate - modelling.cylinder(0.005, 0.01).translated(0.02 + 0.02 * (k % 20), 0.04 + 0.06 * (k // 20), 0.0)
    names = {f"plate_{n}": (plate, (0.0, 0.0, 0.02 * n)) for n in range(2)}
    parts = {name: (solid, pin.SE3(np.eye(3), np.array(at)), (0.5, 0.5, 0.5)) for name, (solid, at) in names.items()}
    return modelling.write_step(tmp_path / "plates.step", parts, name="plates")


def ended(terminal: Terminal) -> None:
    """It ended as one expects of Ctrl-C."""
    assert terminal.end() == 130, terminal.text[-2000:]
    assert "Traceback" not in terminal.text
    assert "Exception ignored" not in terminal.text
    wait_until(lambda: terminal.relatives() == [], 10.0)


def test_while_a_file_is_read(tmp_path: Path, model: Path) -> None:
    out = tmp_path / "out.json"
    with Terminal("clash", model, "--json", cwd=tmp_path, stdout=out) as terminal:
        wait_until(lambda: any("_reader" in words for words in terminal.relatives()), 60.0)
        terminal.press(CTRL_C)
        ended(terminal)
        assert terminal.lines() == ["vpframe: interrupted"]
    assert out.read_text() == ""


@pytest.mark.slow
@pytest.mark.parametrize("command", ["clash", "mates"])
def test_while_kernels_are_compiled(tmp_path: Path, model: Path, command: str) -> None:
    folder = tmp_path / "cache" / f"vpframe-{kernel_cache.digest('vpframe')}"
    folder.mkdir(parents=True)
    for share in (0, 1):  # no other process compiles for this one
        (folder / f"{command}-{share}.done").touch()
    with Terminal(command, model, cwd=tmp_path, NUMBA_CACHE_DIR=str(folder.parent)) as terminal:
        told = terminal.wait_for(r"compiling kernels, once: ([1-9]\d*) so far")
        assert int(told[1]) < 200
        terminal.press(CTRL_C)
        ended(terminal)
        *loaded, last = terminal.lines()
        assert last == "vpframe: interrupted" and all(line.startswith("plates.step: ") for line in loaded)


def test_while_a_task_runs(tmp_path: Path) -> None:
    (tmp_path / "task.py").write_text(TASK)
    given = ("run", "task.py", "--record", "run.rrd", "--report", "report", "--checkpoint", "run.journal")
    with Terminal(*given, cwd=tmp_path) as terminal:
        terminal.wait_for(r"s of the task  hand\(cube\)\.move_by\(.*\) 0 %, .* left|hand.* 0 %, .* left")
        terminal.press(CTRL_C)
        ended(terminal)
        assert "interrupted; what was done so far is kept" in terminal.lines()
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["reason"] == "interrupted" and not report["can_be_done"]
    assert report["steps"] > 0
    assert "in the hand" in [line.text for line in lines(tmp_path / "run.rrd")]
    assert (tmp_path / "run.journal").stat().st_size > 0


@pytest.mark.slow
def test_while_the_demo_compiles(tmp_path: Path) -> None:
    with Terminal("demo", cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")) as terminal:
        terminal.wait_for("compiling kernels, once: .* so far")
        terminal.press(CTRL_C)
        ended(terminal)
    assert (tmp_path / "vpframe-demo" / "report" / "index.html").exists()
    assert (tmp_path / "vpframe-demo" / "demo.rrd").exists()


@pytest.mark.slow
def test_while_a_benchmark_runs(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    with Terminal("bench", "physics", "--quick", "--json", cwd=tmp_path, stdout=out) as terminal:
        terminal.wait_for("benchmark physics")
        terminal.press(CTRL_C)
        ended(terminal)
        assert terminal.lines() == ["vpframe: interrupted"]
    assert out.read_text() == ""
