"""The demo: the main job from a STEP file to recording and report."""

import json
import subprocess
import sys

from vpframe.app import demo


def test_the_demo_does_the_main_job(tmp_path, capsys) -> None:
    assert demo.run(tmp_path / "out") == 0
    out = capsys.readouterr().out
    assert "freedom    of the shaft: 6 -> 2 -> 1 -> 2 -> 6" in out
    assert "vpframe replay" in out
    assert "FAILS" not in out
    folder = tmp_path / "out"
    assert (folder / demo.MODEL).read_text().startswith("ISO-10303-21")
    assert (folder / demo.RECORDING).stat().st_size > 50_000
    document = json.loads((folder / demo.REPORT / "report.json").read_text())
    assert document["can_be_done"] is True
    assert [change["freedom"] for change in document["freedom"]["shaft"]] == [6, 2, 1, 2, 6]
    accepted = [e["text"].split()[0] for e in document["events"] if e["kind"] == "accepted"]
    assert accepted == ["concentric", "against"]
    assert (folder / demo.REPORT / "index.html").stat().st_size > 50_000


def test_a_demo_that_goes_otherwise_says_so(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(demo, "_EXPECTED", (6, 3))
    assert demo.run(tmp_path / "out") == 1
    assert "expected freedom (6, 3)" in capsys.readouterr().err


def test_the_file_of_the_model_does_not_say_when_it_was_written(tmp_path) -> None:
    """Else no run would find what an earlier one read. The kernel writes the colours in one of two orders."""
    heads = []
    for file in (tmp_path / "a.step", tmp_path / "b.step"):
        subprocess.run([sys.executable, "-m", demo.__name__, file], check=True)
        heads.append(file.read_text().split("DATA;")[0])
    assert heads[0] == heads[1] and "FILE_NAME" in heads[0]
