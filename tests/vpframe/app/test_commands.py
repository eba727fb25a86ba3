"""Every command prints what a model lost, or what was guessed of it."""

import json
import re
from pathlib import Path

import pytest

import vpframe as vp
from collision.solid import is_closed
from vpframe.app import cli
from vpframe.scene import modelling as m

OPEN = "note: plate (and 1 more of its shape): open: at 72 edges, the first near ("


@pytest.fixture(scope="module")
def holed(tmp_path_factory) -> Path:
    """A pin in a plate whose bore lost its face: the shell does not list it, all statements are sound. Twice."""
    plate = m.box(0.1, 0.1, 0.01) - m.cylinder(0.004, 0.01).translated(0.05, 0.05)
    parts = {
        "plate": plate,
        "pin": m.cylinder(0.004, 0.03).translated(0.05, 0.05),
        "other": m.box(0.01, 0.01, 0.01).translated(0.3),
        "plate 2": (plate, m.pin.SE3(m.np.eye(3), m.np.array([0.0, 0.5, 0.0]))),
    }
    path = m.write_step(tmp_path_factory.mktemp("step") / "holed.step", parts)
    text = path.read_text().replace("\n  ", " ")
    bore = re.search(r"#(\d+) = CYLINDRICAL_SURFACE", text)[1]
    face = re.search(rf"(#\d+) = ADVANCED_FACE\('',\(#[\d,#]+\),#{bore},", text)[1]
    text, times = re.subn(rf"(CLOSED_SHELL\(''[^;]*?),?{face}(?=[,)])", r"\1", text)
    assert times == 1
    path.write_text(text)
    return path


def test_a_solid_that_lost_a_face_says_that_it_is_open_and_where(holed):
    scene = vp.load(holed)
    plate = scene["plate"].shape
    assert not plate.closed and not is_closed(plate.mesh)
    assert [part.shape.closed for part in scene.parts] == [False, True, True, False]
    (note,) = scene.all_notes()
    assert f"note: {note}".startswith(OPEN)
    x, y, z = map(float, re.search(r"near \((.*)\) mm", note)[1].split(", "))
    assert ((x - 50.0) ** 2 + (y - 50.0) ** 2) ** 0.5 == pytest.approx(4.0, abs=0.1) and z in (0.0, 10.0)
    assert 1e-4 - 3.15 * 0.004**2 * 0.01 < plate.volume < 1e-4


@pytest.mark.parametrize("command", ["clash", "mates", "view", "new", "run"])
def test_every_command_prints_every_note(command, holed, tmp_path, capsys):
    script = tmp_path / "task.py"
    script.write_text(f"FILE = {str(holed)!r}\ndef task(session):\n    session.run(0.01)\n")
    arguments = {
        "clash": ["clash", holed],
        "mates": ["mates", holed],
        "view": ["view", holed, "--html", tmp_path / "page.html"],
        "new": ["new", tmp_path / "new.py", "--from", holed],
        "run": ["run", script, "--report", tmp_path / "report"],
    }[command]
    assert cli.main([str(a) for a in arguments]) in (0, 1)
    printed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note: ")]
    assert len(printed) == 1 and printed[0].startswith(OPEN)
    if command == "run":
        assert json.loads((tmp_path / "report" / "report.json").read_text())["notes"] == [printed[0][6:]]
        assert "Notes on the model" in (tmp_path / "report" / "index.html").read_text()
    elif command in ("clash", "mates"):
        cli.main([*(str(a) for a in arguments), "--json"])
        assert json.loads(capsys.readouterr().out)["notes"] == [printed[0][6:]]
