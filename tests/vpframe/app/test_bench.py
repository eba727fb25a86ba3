"""`vpframe bench --html`: every suite on one page, with plots, machine and versions."""

import json
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import bench_run
import numpy as np
import pytest

from vpframe.app import cli
from vpframe.errors import VpframeError


def made(name: str, plots: bool = True) -> SimpleNamespace:
    """A suite that has measured already."""

    def plot(result: dict[str, Any], directory: str) -> None:
        if not plots:
            raise ModuleNotFoundError("No module named 'matplotlib'")
        (Path(directory) / f"{name}.png").write_bytes(b"\x89PNG " + name.encode())

    result = {"suite": name, "machine": "two cores", "rows": [], "ratios": {"ours over <theirs>": 0.25}}
    return SimpleNamespace(run=lambda quick: result, table=lambda result: f"table of {name} & more\nrow", plot=plot)


def test_what_json_has_no_number_for_is_null() -> None:
    given = {
        "rows": [{"error": float("nan"), "n": 3}],
        "ratios": {"slower": float("inf")},
        "peak": (-float("inf"), 0.5),
    }
    assert json.loads(json.dumps(bench_run.finite(given), allow_nan=False)) == {
        "rows": [{"error": None, "n": 3}], "ratios": {"slower": None}, "peak": [None, 0.5],
    }  # fmt: skip


@pytest.fixture
def suites(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the suites are instead."""
    given: dict[str, Any] = {name: made(name) for name in cli.SUITES}

    real = bench_run.suite

    def suite(name: str) -> ModuleType:
        if name == "page":
            return real(name)
        if isinstance(given[name], Exception):
            raise given[name]
        return given[name]

    monkeypatch.setattr(bench_run, "suite", suite)
    return given


def test_all_suites_are_on_the_page(suites, tmp_path: Path, capsys) -> None:
    path = tmp_path / "bench.html"
    assert cli.main(["bench", "--all", "--html", str(path)]) == 0
    page = path.read_text(encoding="utf-8")
    for name in cli.SUITES:
        assert f"<h2 id='{name}'>" in page and f"<pre>table of {name} &amp; more\nrow</pre>" in page
    assert page.count("<img ") == len(cli.SUITES) and "src='data:image/png;base64," in page
    assert (
        "<script" not in page
        and "ours over &lt;theirs&gt;" in page
        and "measured in 0 s on two cores" in page
        and "numba " in page
    )
    assert cli.main(["bench", "study", "--html", str(path)]) == 0, "a page of ours is written over"
    assert "table of session" not in path.read_text(encoding="utf-8")
    path.write_text("mine")
    assert cli.main(["bench", "study", "--html", str(path)]) == 2
    assert path.read_text() == "mine" and "--force" in capsys.readouterr().err


def test_a_suite_without_its_peers_costs_itself_alone(suites, tmp_path: Path, capsys) -> None:
    suites["physics"] = VpframeError("needs models")
    suites["planning"] = made("planning", plots=False)
    suites["service"] = SimpleNamespace(run=lambda quick: 1 / 0)
    suites["session"].plot = lambda result, folder: 1 / 0
    path = tmp_path / "bench.html"
    assert cli.main(["bench", "--html", str(path)]) == 2
    told = sorted(capsys.readouterr().err.splitlines())
    assert told == ["vpframe: physics: needs models", "vpframe: service: ZeroDivisionError: division by zero"]
    page = path.read_text(encoding="utf-8")
    assert "table of study" in page and "table of physics" not in page and "measured in 0 s" in page
    assert "<h2 id='physics'>physics</h2><p class='dim'>No result: needs models</p>" in page
    assert "No result: ZeroDivisionError: division by zero" in page
    assert "table of session" in page and "No plots: ZeroDivisionError: division by zero" in page
    assert "<th>without</th>" in page, "peers that are not installed are named"
    assert "No plots: No module named &#x27;matplotlib&#x27; (pip install matplotlib)" in page
    assert cli.main(["bench", "physics"]) == 2
    assert cli.main(["bench", "physics", "--all"]) == 2


def test_cases_and_numbers_are_given_to_the_suite_that_takes_them(suites, capsys) -> None:
    given: dict[str, Any] = {}

    def run(quick: bool = False, only: tuple[str, ...] = (), segments: int | None = None) -> dict[str, Any]:
        given.update(quick=quick, only=only, segments=segments)
        return {"suite": "planning", "machine": "", "rows": [], "ratios": {}}

    suites["planning"] = SimpleNamespace(run=run, table=lambda result: "")
    assert cli.main(["bench", "planning", "--only", "peg", "--only", "clip", "--number", "segments=7"]) == 0
    assert given == {"quick": False, "only": ("peg", "clip"), "segments": 7}
    for wrong, said in (
        (["planning", "--number", "legs=7"], "--number legs=7: suite planning counts segments"),
        (["planning", "--number", "segments=few"], "--number segments=few: write segments=N"),
        (["physics", "--only", "peg"], "--only peg: suite physics is run as a whole"),
        (["--only", "peg"], "--only, --number and --corpus choose within one suite; name it"),
    ):
        capsys.readouterr()
        assert cli.main(["bench", *wrong]) == 2
        assert said in capsys.readouterr().err


def test_what_was_not_reached_has_no_error_in_json(suites, capsys) -> None:
    rows = [{"error": float("inf"), "seconds": np.float64("nan"), "n": 3}, {"error": 0.5}]
    result = {"suite": "service", "machine": "", "rows": rows, "ratios": {}}
    suites["service"] = SimpleNamespace(run=lambda quick: result, table=lambda result: "")
    assert cli.main(["bench", "service", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == [{"error": None, "seconds": None, "n": 3}, {"error": 0.5}]


def test_a_text_that_no_case_has_is_named() -> None:
    cases = {"pairs: peg": 1, "pairs: clip": 2, "segments": 3}
    assert bench_run.chosen(cases, ["clip", "seg"]) == {"pairs: clip": 2, "segments": 3}
    assert bench_run.chosen(cases, []) == cases
    with pytest.raises(VpframeError, match="--only pin: no case is called so; there are pairs: peg, pairs: clip"):
        bench_run.chosen(cases, ["pin"])


def test_a_corpus_is_a_folder_and_only_suites_that_read_files_take_one(tmp_path: Path) -> None:
    load, physics = bench_run.suite("load"), bench_run.suite("physics")
    assert bench_run.options("load", load, (), (), str(tmp_path)) == {"corpus": tmp_path}
    assert bench_run.options("planning", bench_run.suite("planning"), (), (), str(tmp_path)) == {"corpus": tmp_path}
    with pytest.raises(VpframeError, match="reads no files"):
        bench_run.options("physics", physics, (), (), str(tmp_path))
    with pytest.raises(VpframeError, match="no such folder"):
        bench_run.options("load", load, (), (), str(tmp_path / "none"))
    with pytest.raises(VpframeError, match="holds no STEP file"):
        load.cases((100,), tmp_path)
    for name in ("a.step", "deep/b.STP", "c.stl"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert list(load.cases((100,), tmp_path)) == ["a.step", "deep/b.STP"]
