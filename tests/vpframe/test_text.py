"""Names out of files are shown as text: on the terminal, in scripts, in URDF. In pages: see `test_pages`."""

import ast
import csv
import io
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physics import Gravity
from tests.vpframe.waiting import wait_until
from tests.vpframe.watching import box, fake_session, hostile_frames, hostile_scene, place
from vpframe import report
from vpframe.analysis import clash, mates
from vpframe.app import scaffold as first_task
from vpframe.app.progress import WIPE, Progress, Terminal
from vpframe.exporters.motion import read_motion
from vpframe.exporters.tables import write_table
from vpframe.report import SessionLog
from vpframe.scene import modelling
from vpframe.scene.names import with_part_names
from vpframe.scene.scene import Part, Scene
from vpframe.session.session import Session
from vpframe.studies import report as study_report
from vpframe.studies.distributions import Uniform
from vpframe.text import csv_text, escape, plain, plain_lines, uncell
from vpframe.view import replay
from vpframe.view.recorder import RerunRecorder

NAMES = {
    "clear": "\x1b[2J\x1b[Hrod",
    "title": "\x1b]0;owned\x07rod",
    "lines": "rod\nvpframe: done",
    "back": "rod\r\x9b1A",
    "turned": "rod\u202egpj.exe",
    "half": "rod\ud800",
    "quotes": 'rod"""\\',
}
hostile = pytest.mark.parametrize("name", NAMES.values(), ids=NAMES.keys())


def harmless(text):
    """Whether a terminal only prints the text."""
    return all(line.isprintable() for line in text.split("\n"))


@given(st.text())
def test_plain_text_is_printed_and_printable_text_is_left(text):
    shown = plain(text)
    assert shown.isprintable()
    assert (shown == text) == text.isprintable()
    assert ast.literal_eval(first_task.quoted(text)) == text


@given(st.text())
def test_markup_is_text(text):
    shown = escape(text)
    assert not re.search("[<>\"']|&(?!amp;|lt;|gt;|quot;|#x27;)", shown) and shown.isprintable()
    assert ElementTree.fromstring(f'<a b="{shown}">{shown}</a>').text in (plain(text), None)


def test_lines_stay_lines():
    assert plain_lines("a\n\tb\x07\nc") == "a\n    b\\x07\nc"


@hostile
def test_what_is_said_cannot_order_the_terminal(name, capsys):
    Terminal().say(f"holds {name}")
    Terminal().warn(f"failed: {name}")
    told = capsys.readouterr()
    assert harmless(told.out) and harmless(told.err) and "rod" in told.out and "rod" in told.err


class Screen(io.StringIO):
    """What a terminal is sent."""

    def isatty(self):
        return True


def test_a_line_of_progress_is_plain_but_for_its_wiping():
    screen = Screen()
    with Progress("load", screen, delay=0.0) as progress:
        progress(0.5, "part \x1b[2J\x1b[H")
        wait_until(lambda: "part" in screen.getvalue())
    sent = screen.getvalue()
    assert "part \\x1b[2J" in sent
    assert harmless(sent.replace(WIPE, ""))


def at(x):
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


@hostile
def test_tables_print_names_as_text_and_a_row_a_line(name):
    scene = Scene([Part("plate", box((0.02, 0.02, 0.02)), at(0.0)), Part(name, box((0.02, 0.02, 0.02)), at(0.019))])
    for table, document in ((clash.table, clash.clash(scene)), (mates.table, mates.mates(scene))):
        shown = table(document)
        assert harmless(shown)
        assert plain(name) in shown


def test_the_clash_table_gives_the_reason_in_part_names():
    scene = Scene([Part("housing", box((0.04, 0.04, 0.04)), at(0.0)), Part("bolt", box((0.01, 0.01, 0.01)), at(0.0))])
    rows = clash.clash(scene)
    assert [row.why for row in rows] == ["bolt lies wholly inside housing"]
    assert clash.table(rows).endswith("bolt lies wholly inside housing")
    twice = Scene([Part(name, box((0.04, 0.04, 0.04)), at(0.0)) for name in ("one", "two")])
    shown = clash.table(clash.clash(twice))
    assert "one and two have material in common" in shown and "object" not in shown


def test_a_fit_gives_its_reason():
    block = modelling.box(0.04, 0.04, 0.03).translated(-0.02, -0.02, 0.0) - modelling.cylinder(0.010, 0.03)
    shaft = modelling.cylinder(0.01002, 0.06).translated(0.0, 0.0, -0.015)
    parts = {"block": (block, pin.SE3.Identity()), "shaft": (shaft, pin.SE3.Identity())}
    shown = clash.table(clash.clash(modelling.scene(parts)))
    assert "radial interference" in shown


@hostile
def test_the_mechanism_is_xml(name, tmp_path):
    scene = Scene([Part("plate", box((0.02, 0.02, 0.02)), at(0.0)), Part(name, box((0.02, 0.02, 0.02)), at(0.02))])
    mates.write_urdf(scene, tmp_path / "a.urdf")
    links = [link.get("name") for link in ElementTree.parse(tmp_path / "a.urdf").getroot().iter("link")]
    assert plain(name) in links


@hostile
def test_a_first_script_is_python_whatever_parts_and_model_are_called(name, tmp_path):
    scene = Scene([Part("plate", box((0.02, 0.02, 0.02)), at(0.0), fixed=True), Part(name, box((0.01,) * 3), at(0.05))])
    first_task.new_task(tmp_path / "task.py", scene, tmp_path / f"{name.replace('/', '_')}.step")
    text = (tmp_path / "task.py").read_text()
    assert harmless(text)
    grabbed = [
        node.args[0].value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "grab"
    ]
    assert grabbed == [name]


@hostile
def test_the_events_of_a_recording_are_printed_as_text(name, tmp_path, capsys):
    if name == NAMES["half"]:
        pytest.skip("rerun keeps Unicode only")
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session(hostile_scene(name)).scene)
    for frame in hostile_frames(name):
        recorder.frame(frame)
    recorder.end()
    replay.replay(tmp_path / "run.rrd", script=True)
    printed = capsys.readouterr().out
    assert harmless(printed) and f"plate and {plain(name)} collide" in printed


@pytest.mark.slow
def test_a_model_with_such_names_on_the_command_line(tmp_path, vpframe):
    cube = modelling.box(0.02, 0.02, 0.02)
    name = "\x1b[2Jcube<img onerror>"
    model = modelling.write_step(tmp_path / "m.step", {"plate": (cube, at(0.0)), name: (cube, at(0.02))})
    for command in ("clash", "mates"):
        done = vpframe(command, model, cwd=tmp_path)
        assert "cube<img onerror>" in done.stdout
        assert harmless(done.stdout) and harmless(done.stderr)
        document = json.loads(vpframe(command, model, "--json", cwd=tmp_path).stdout)
        (found,) = {part for row in document.get("pairs", document.get("constraints")) for part in row["parts"]} - {
            "plate"
        }
        assert found.endswith("cube<img onerror>"), "documents keep names as they are"


def test_errors_of_the_packages_below_name_parts(tmp_path):
    scene = Scene(
        [Part("plate", box((0.1, 0.1, 0.01)), place(), fixed=True), Part("bolt_2", box((0.01,) * 3), place(z=1))]
    )

    class Broken(Gravity):
        def wrench(self, view):
            return "strange"

    class Late(Gravity):
        constant = False

        def wrench(self, view):
            return np.zeros(6) if view.time < 0.05 else "strange"

    with Session(scene) as session:
        with pytest.raises(ValueError, match=r"^bolt_2: 3 is no Behaviour"):
            session.behave("bolt_2", 3)
        with pytest.raises(ValueError, match=r"^bolt_2: Broken\.wrench returned 'strange'"):
            session.behave("bolt_2", Broken())
        session.behave("bolt_2", Late())
        with pytest.raises(ValueError, match=r"^bolt_2: Late\.wrench returned 'strange'"):
            session.run(0.1)


def test_numbers_of_objects_become_names_and_other_numbers_stay():
    scene = Scene([Part("plate", box(name="slab"), place()), Part("rod (2)", box(name="bar (x)"), place(z=3))])
    for text, named in (
        ("object 1 (bar (x)): bad", "rod (2): bad"),
        ("objects 0 and 1 meet", "plate and rod (2) meet"),
        ("the pose of body 0 is odd", "the pose of plate is odd"),
        ("no object 7; ids are 0 … 1", "no object 7; ids are 0 … 1"),
        ("12 objects, 1 body", "12 objects, 1 body"),
    ):
        assert with_part_names(text, scene) == named


FORMULAS = [
    "=1+1", "+cmd|' /C calc'!A0", "-2+3+cmd|' /C calc'!A0", "@SUM(1+1)*9", "\t=1", "\r=1", "\n=1", " =1", "'=1", "''@x",
    "＝1", "+", "-", "-5 mm", "--5", "-5", "+1.5e3", ".5", "a=1", "'a", "", "=\x1b[2J\x00", "a\x00b", "\ud800",
]  # fmt: skip


def is_no_formula(text: str) -> bool:
    """Whether spreadsheets take a cell for text or a number, and a terminal prints it as it stands."""
    number = re.fullmatch(r"[-+]?[0-9.]+(e[-+]?\d+)?", text)
    return bool(number) or (text.isprintable() and text.lstrip()[:1] not in tuple("=+-@＝＋－＠"))


@given(st.one_of(st.text(), st.sampled_from(FORMULAS), st.from_regex(r"'*\s*[-=+@].*")))
def test_no_cell_is_a_formula_and_each_can_be_read_back(text: str) -> None:
    ((shown,),) = csv.reader(io.StringIO(csv_text([[text]]), newline="")) if text else (("",),)
    number = re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text)
    assert shown == text if number else is_no_formula(shown) or shown[:1] == "'"
    assert uncell(shown) == plain(text)


@given(st.one_of(st.floats(allow_nan=False), st.integers(), st.booleans(), st.none()))
def test_numbers_in_cells_stay_numbers(value: Any) -> None:
    shown = csv_text([["x", value]]).strip().removeprefix("x,")
    assert shown == ("" if value is None else repr(value))
    assert not isinstance(value, float) or float(shown) == value


@pytest.mark.parametrize("name", FORMULAS[:14])
def test_no_table_that_is_written_has_a_formula(name: str, tmp_path: Path) -> None:
    log = SessionLog()
    log.begin(fake_session(hostile_scene(name)).scene)
    for frame in hostile_frames(name):
        log.frame(frame)
    report.write(tmp_path / "report", log)
    one = {
        "index": 0, "status": "no", "reason": name, "clearance": -1.5, "time": 0.0, "steps": 1, "seconds": 0.1,
        "parameters": {name: -2.5}, "measures": {f"{name} text": name, "depth": -0.5}, "attempts": 1, "key": "k",
    }  # fmt: skip
    (tmp_path / "study.csv").write_text(study_report.table({name: Uniform(-3.0, 0.0)}, [one]), newline="")
    for _ in range(2):  # our own is written over
        write_table(tmp_path / "rows.csv", [{name: name, "depth": -0.25}, {name: -1, "depth": None}])
        write_table(tmp_path / "events.csv", [event for frame in hostile_frames(name) for event in frame.events])
        scene = hostile_scene(name)
        scene.export(tmp_path / "poses.csv")
    for table in ("report/clashes.csv", "study.csv", "rows.csv", "events.csv", "poses.csv"):
        rows = list(csv.reader((tmp_path / table).open(newline="")))
        assert len(rows) > 1 and all(is_no_formula(shown) or shown[:1] == "'" for row in rows for shown in row), table
        assert any(plain(name) in shown for row in rows for shown in row), table
    assert "-2.5" in (tmp_path / "study.csv").read_text() and ",-0.25" in (tmp_path / "rows.csv").read_text()
    assert set(read_motion(tmp_path / "poses.csv").keys) == {plain(part) for part in scene.names}
