"""Clash status over the runs of a task."""

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from vpframe import __version__
from vpframe.analysis.clash_status import (
    WHOLE,
    ClashKey,
    accept,
    accept_named,
    accepted_words,
    read,
    read_authorised,
    updated,
    write,
)
from vpframe.app import task_runner as study
from vpframe.app.cli import main
from vpframe.errors import VpframeError
from vpframe.outputs import STATUS
from vpframe.scene import modelling

A, B, C = ClashKey("bolt", "plate", 1, 2), ClashKey("bolt", "plate", 3, 2), ClashKey("nut", "plate", 0, 0)


def statuses(records) -> dict[ClashKey, str]:
    return {r.key: r.status for r in records}


def test_a_key_does_not_depend_on_the_order_of_the_parts() -> None:
    assert ClashKey.of("plate", 2, "bolt", 1) == ClashKey.of("bolt", 1, "plate", 2) == A


def test_the_life_of_a_clash() -> None:
    first = updated((), [B, A])
    assert statuses(first) == {A: "new", B: "new"}
    marked = accept(first, [B], "press fit")
    second = updated(marked, [A, B, C])
    assert statuses(second) == {A: "persistent", B: "accepted", C: "new"}
    third = updated(second, [C])
    assert statuses(third) == {A: "resolved", B: "resolved", C: "persistent"}
    fourth = updated(third, [A, C])
    assert statuses(fourth) == {A: "new", B: "resolved", C: "persistent"}
    assert {r.key: r.runs for r in fourth} == {A: 3, B: 2, C: 3}
    assert {r.key: r.remark for r in fourth}[B] == "press fit"


def test_the_file_keeps_everything(tmp_path) -> None:
    records = accept(updated((), [A, C]), [A], "as built")
    write(tmp_path / "clashes.json", records)
    assert read(tmp_path / "clashes.json") == records
    assert read(tmp_path / "none.json") == ()


def test_what_cannot_be_is_one_line(tmp_path) -> None:
    with pytest.raises(VpframeError, match="no clash between nut 0 and plate 0"):
        accept(updated((), [A]), [C])
    file = tmp_path / "clashes.json"
    file.write_text('{"clashes": [{"part_a": "a", "part_b": "b", "surface_a": 0, "surface_b": 0, "status": "odd"}]}')
    with pytest.raises(VpframeError, match="status 'odd'"):
        read(file)
    file.write_text('{"clashes": [{"part_a": "a"}]}')
    with pytest.raises(VpframeError, match="clash 0"):
        read(file)
    file.write_text("[]")
    with pytest.raises(VpframeError, match="not a clash status file"):
        read(file)


def test_clashes_are_accepted_by_name(tmp_path) -> None:
    file = tmp_path / "clashes.json"
    write(file, updated((), [A, B, C]))
    keys = accept_named(tmp_path, ["plate:bolt"], "press fit", authorise=True)
    assert keys == (A, B)
    assert statuses(read(file)) == {A: "accepted", B: "accepted", C: "new"}
    assert {r.remark for r in read(file) if r.status == "accepted"} == {"press fit"}
    assert read_authorised(file) == (("bolt", "plate"),)
    assert accept_named(file, ["nut:0:plate:0"]) == (C,)
    assert read_authorised(file) == (("bolt", "plate"),), "kept"
    for text, message in (
        ("bolt", "write two part names"),
        ("bolt:x:plate:1", "write two part names"),
        ("nut:bolt", "no clash nut:bolt is known; there is bolt:plate, nut:plate"),
        ("nut:1:plate:0", "no clash nut:1:plate:0 is known"),
    ):
        with pytest.raises(VpframeError, match=message):
            accept_named(file, [text])
    with pytest.raises(VpframeError, match="no such file"):
        accept_named(tmp_path / "nowhere", ["nut:plate"])


def test_a_subassembly_stands_for_its_parts(tmp_path) -> None:
    inner, outer = ClashKey("fan/base", "fan/rotor", 0, 1), ClashKey("fan/base", "shroud", 2, 3)
    other = ClashKey("fan_2/base", "shroud", 2, 3)
    write(tmp_path / "clashes.json", updated((), [inner, outer, other]))
    assert accept_named(tmp_path, ["shroud:fan"], authorise=True) == (outer,)
    assert accept_named(tmp_path, ["fan:fan"]) == (inner,)
    assert read_authorised(tmp_path / "clashes.json") == (("fan/base", "shroud"),)


def test_what_was_accepted_is_a_line_a_pair_of_parts() -> None:
    assert accepted_words([A, B, C]) == ["bolt with plate, 2 pairs of surfaces", "nut · face 0 with plate · face 0"]
    assert accepted_words([ClashKey("a", "b", WHOLE, WHOLE)]) == ["a with b"]


def test_a_file_of_before_is_read(tmp_path) -> None:
    file = tmp_path / "clashes.json"
    rows = [{"part_a": "a", "part_b": "b", "surface_a": 0, "surface_b": 1, "status": "accepted", "remark": "glued"}]
    file.write_text(json.dumps({"clashes": rows, "authorised": [["a", "b"]]}, indent=2) + "\n")
    assert statuses(read(file)) == {ClashKey("a", "b", 0, 1): "accepted"}
    write(file, read(file), read_authorised(file))
    written = json.loads(file.read_text())
    assert written == {"clashes": [{**rows[0], "runs": 1}], "authorised": [["a", "b"]], "version": __version__}
    assert STATUS.recognise(file), "it may be replaced"
    write(file, ())
    assert read(file) == () and read_authorised(file) == ()


@pytest.mark.slow
def test_the_command_line_keeps_the_status_over_runs(tmp_path, vpframe) -> None:
    size, apart = (0.01, 0.01, 0.01), {"a": 0.0, "b": 0.008, "c": 0.016}
    parts = {
        n: (modelling.box(*size), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), (0.5,) * 3) for n, x in apart.items()
    }
    model, status = modelling.write_step(tmp_path / "m.step", parts, name="m"), tmp_path / "status.json"

    def clash(*arguments: str) -> tuple[int, dict[tuple[str, ...], set[str]]]:
        done = vpframe("clash", model, "--json", "--status", status, *arguments, cwd=tmp_path)
        found: dict[tuple[str, ...], set[str]] = {}
        for pair in json.loads(done.stdout)["pairs"]:
            if pair["kind"] == "clash":
                found.setdefault(tuple(pair["parts"]), set()).add(pair["status"])
        return done.returncode, found

    assert clash() == (1, {("a", "b"): {"new"}, ("b", "c"): {"new"}})
    assert vpframe("clash", "accept", status, "b:a", "--remark", "glued", cwd=tmp_path).returncode == 0
    assert clash() == (1, {("a", "b"): {"accepted"}, ("b", "c"): {"persistent"}})
    assert vpframe("clash", "accept", status, "b:c", cwd=tmp_path).returncode == 0
    assert clash() == (0, {("a", "b"): {"accepted"}, ("b", "c"): {"accepted"}})
    assert {r.remark for r in read(status)} == {"glued", ""}
    table = vpframe("clash", model, "--status", status, cwd=tmp_path)
    assert "accepted, glued" in table.stdout
    bad = vpframe("clash", "accept", status, "a:c", cwd=tmp_path)
    assert bad.returncode == 2 and bad.stderr.count("\n") == 1 and "no clash a:c is known" in bad.stderr
    assert vpframe("clash", "accept", tmp_path / "none.json", "a:b", cwd=tmp_path).returncode == 2


TASK = """
import numpy as np, pinocchio as pin
from vpframe.scene import modelling
from vpframe.app import task_runner as study
from vpframe.outputs import STATUS
from vpframe.app.cli import main
from vpframe.scene.scene import Part, Scene

def scene():
    cube = modelling.shape(modelling.box(0.02, 0.02, 0.02), name="cube")
    at = lambda x: pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))
    return Scene([Part("floor", cube, at(-0.018), fixed=True), Part("cube", cube, at(0.0))])

def task(session):
    session.run(0.05)
"""


def test_what_a_person_accepts_or_authorises_holds_for_the_next_run(tmp_path) -> None:
    (tmp_path / "task.py").write_text(TASK)
    report = tmp_path / "report"

    def run() -> dict[str, Any]:
        assert study.run_task(tmp_path / "task.py", report=report) == 0
        return json.loads((report / "report.json").read_text())

    first = run()["clashes"]
    assert {c["status"] for c in first} == {"new"}
    assert {(c["origin"], c["kind"]) for c in first} == {("as it stands", "clash")}
    accept_named(report, ["cube:floor"], "as built")
    after = run()
    assert {(c["status"], c["remark"]) for c in after["clashes"]} == {("accepted", "as built")}
    assert after["authorised"] == []
    assert main(["clash", "accept", str(report), "floor:cube", "--authorise"]) == 0
    last = run()
    assert {c["status"] for c in last["clashes"]} == {"resolved"}
    assert last["authorised"] == [["floor", "cube"]]
    assert run()["authorised"] == [["floor", "cube"]], "kept"


def test_a_run_that_was_cut_off_changes_no_status(tmp_path) -> None:
    known = accept(updated((), [A, B]), [B], "press fit")
    cut = updated(known, [C], complete=False)
    assert statuses(cut) == {A: "new", B: "accepted", C: "new"}
    assert updated(known, [A], complete=False) == known, "nor the number of runs"
    assert statuses(updated(updated(known, []), [B], complete=False)) == {A: "resolved", B: "resolved"}


@pytest.mark.parametrize(
    ("end", "code"),
    [
        ("1 / 0", 1),
        ("session.expect(False, 'no')", 1),
        ("session.hand().release()", 1),
        ("raise KeyboardInterrupt", 130),
        ("import sys; sys.exit(0)", 1),
    ],
)
def test_an_accepted_clash_outlives_a_run_that_ends_early(tmp_path, end: str, code: int) -> None:
    """The clash is there from the first step on: a run that ends before it has not seen it."""
    path, report = tmp_path / "task.py", tmp_path / "report"
    path.write_text(TASK)
    assert study.run_task(path, report=report) == 0
    accept_named(report, ["cube:floor"], "as built")
    accepted = (report / "clashes.json").read_bytes()
    path.write_text(TASK.replace("    session.run(0.05)", f"    {end}"))
    assert study.run_task(path, report=report) == code
    assert (report / "clashes.json").read_bytes() == accepted
    document = json.loads((report / "report.json").read_text())
    assert {c["status"] for c in document["clashes"]} == {"accepted"}
    path.write_text(TASK)
    assert study.run_task(path, report=report) == 0
    assert {r.status for r in read(report / "clashes.json")} == {"accepted"}


def test_a_report_before_the_end_changes_no_status(tmp_path) -> None:
    path, report = tmp_path / "task.py", tmp_path / "report"
    path.write_text(TASK)
    assert study.run_task(path, report=report) == 0
    accept_named(report, ["cube:floor"], "as built")
    accepted = (report / "clashes.json").read_bytes()
    path.write_text(TASK.replace("    session.run(0.05)", f"    session.report({str(report)!r}); session.run(0.05)"))
    assert study.run_task(path) == 0
    assert (report / "clashes.json").read_bytes() == accepted


def test_what_a_run_saw_first_before_it_was_cut_off_can_be_accepted(tmp_path) -> None:
    """A part that is stopped by an overlap is why people authorise it: the run that failed tells its name."""
    path, report = tmp_path / "task.py", tmp_path / "report"
    path.write_text(TASK + "    session.expect(False, 'no')\n")
    assert study.run_task(path, report=report) == 1
    assert {r.status for r in read(report / "clashes.json")} == {"new"}
    assert accept_named(report, ["cube:floor"], authorise=True)
    path.write_text(TASK)
    assert study.run_task(path, report=report) == 0
    assert read_authorised(report / "clashes.json") == (("cube", "floor"),)


def test_no_room_leaves_the_statuses_as_they_were(tmp_path) -> None:
    file = tmp_path / "clashes.json"
    write(file, updated((), [A]))
    before = file.read_bytes()
    code = f"""
import resource, signal
from vpframe.analysis.clash_status import ClashKey, updated, write
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
try:
    write({str(file)!r}, updated((), [ClashKey("a", "b", i, i) for i in range(1000)]))
except Exception as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == f"{file}: cannot be written: File too large\n", done.stderr
    assert file.read_bytes() == before
