"""`vpframe study` as a whole: same answers whatever runs them, the report, exit codes, bad input."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vpframe.studies.scripts import ENDINGS, HEAD, environment, firsts, lines, slow, study, written
from tests.vpframe.terminal import CTRL_C, Terminal
from vpframe.studies.results import answer


def test_one_json_document_tells_all(endings) -> None:
    _, out, done = endings
    assert done.returncode == 1, done.stderr
    document = json.loads(done.stdout)
    assert document == json.loads((out / "study.json").read_text())
    records = firsts(out)
    assert [one["index"] for one in records] == list(range(10))
    counts = {s: sum(one["status"] == s for one in records) for s in document["statuses"]}
    assert document["statuses"] == counts
    assert counts["ok"] and counts["no"] and counts["error"] and counts["crashed"], "the seed gives some of each"
    rate = document["rate"]
    assert (rate["ok"], rate["of"], document["variants"]) == (counts["ok"], 10, 10)
    assert rate["low"] < rate["value"] == counts["ok"] / 10 < rate["high"]
    assert document["importance"]["can be done"]["how"]["first_order"] == pytest.approx(1.0)
    assert sum(document["outcomes"]["square"]["histogram"]["counts"]) == counts["ok"]
    assert document["outcomes"]["name"]["values"] == {"ok": counts["ok"]}
    assert document["repeated"] == {"variants": 1, "different": [], "unanswered": []}
    assert not document["interrupted"]


@pytest.mark.slow
def test_two_workers_give_the_same_answers_to_the_last_bit(endings, tmp_path: Path) -> None:
    script, out, _ = endings
    done = study(script, "--samples", 10, "--seed", 5, "--jobs", 2, "--retries", 0, "--out", tmp_path / "two", "--json")
    assert done.returncode == 1, done.stderr
    assert done.stderr == ""
    one, two = firsts(out), firsts(tmp_path / "two")
    assert [a["key"] for a in one] == [b["key"] for b in two]
    assert [answer(a) for a in one] == [answer(b) for b in two]
    assert len({b["address"] for b in two}) == 2, "two workers"
    first, second = (
        next(b for b in lines(tmp_path / "two") if b["index"] == 0 and b.get("repeat") is r) for r in (None, True)
    )
    assert first["worker"] != second["worker"]
    mine, theirs = (json.loads(text) for text in (done.stdout, (out / "study.json").read_text()))
    for name in ("statuses", "rate", "outcomes", "importance", "reasons", "worst", "variables"):
        assert mine[name] == theirs[name]


FORGETFUL = (
    HEAD
    + """
VARIANTS = {"x": Uniform(0.0, 1.0)}

def task(session, v):
    return {"process": os.getpid()}
"""
)


def test_a_task_that_does_not_repeat_itself_is_found_out(tmp_path: Path) -> None:
    done = study(written(tmp_path, FORGETFUL), "--samples", 2, "--jobs", 1, "--out", tmp_path / "runs")
    assert done.returncode == 0, done.stderr
    assert "variants [0] gave another answer when they were run again" in done.stderr
    assert "2 of 2 variants can be done: 100.00 %" in done.stdout
    assert "the task does not repeat itself" in (tmp_path / "runs" / "index.html").read_text()


IGNORING = """
import numpy as np, pinocchio as pin
from vpframe.studies import Uniform
from vpframe.scene.scene import Part, Scene
from tests.vpframe.studies.scripts import cube

VARIANTS = {"x": Uniform(0.0, 1.0)}

def scene(v):
    one = cube().parts[0]
    return Scene([one.copy("hose"), one.copy("clamp", pin.SE3(np.eye(3), np.array([0.005, 0.0, 0.0])))])

def task(session, v):
    session.ignore("hose", "clamp")
    session.run(0.04)
"""


def test_pairs_that_may_pass_through_each_other_are_named(tmp_path: Path) -> None:
    done = study(written(tmp_path, IGNORING), "--samples", 3, "--jobs", 1, "--out", tmp_path / "runs")
    assert done.returncode == 0, done.stderr
    assert "3 of 3 variants can be done: 100.00 %" in done.stdout
    assert "; 3 of them: ignores hose–clamp" in done.stdout
    assert "ignores hose–clamp" in (tmp_path / "runs" / "index.html").read_text()
    assert "ignores hose–clamp" in (tmp_path / "runs" / "results.csv").read_text()


HANGS_AGAIN = (
    HEAD
    + """
VARIANTS = {"x": Uniform(0.0, 1.0)}

def task(session, v):
    mark = Path(__file__).with_name(f"ran {v.index}")
    if mark.exists():
        time.sleep(1000.0)
    mark.touch()
"""
)


@pytest.mark.slow
def test_a_second_run_without_an_answer_is_told_and_counts_as_no_difference(tmp_path: Path) -> None:
    script, out = written(tmp_path, HANGS_AGAIN), tmp_path / "runs"
    given = (script, "--samples", 2, "--jobs", 1, "--timeout", "2s", "--out", out, "--json")
    done = study(*given)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["statuses"]["ok"] == 2
    assert document["repeated"] == {"variants": 0, "different": [], "unanswered": [0]}
    assert done.stderr == "variants [0] crashed or timed out when they were run again\n"
    assert "0, all equal to the last bit; 1 crashed or timed out then: 0" in (out / "index.html").read_text()
    (tmp_path / "ran 0").unlink()
    assert json.loads(study(*given, "--resume").stdout)["repeated"] == document["repeated"], "its time was no shorter"
    longer = json.loads(study(*given[:6], "3s", *given[7:], "--resume").stdout)
    assert longer["repeated"] == {"variants": 1, "different": [], "unanswered": []}


COMPILES = (
    HEAD
    + """
VARIANTS = {"x": Uniform(0.0, 1.0)}

def task(session, v):
    return {"began": time.time()}
"""
)


@pytest.mark.slow
def test_kernels_are_compiled_before_the_first_variant(tmp_path: Path) -> None:
    script, out = written(tmp_path, COMPILES), tmp_path / "runs"
    command = [sys.executable, "-m", "vpframe", "study", script, "--samples", "2", "--jobs", "2", "--out", out]
    kept = {**environment(), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=280, env=kept)
    assert done.returncode == 0, done.stderr
    notes = list((tmp_path / "kernels").rglob("session-*.done"))
    assert len(notes) == 2
    first = min(one["measures"]["began"] - one["seconds"] for one in firsts(out))
    assert max(note.stat().st_mtime for note in notes) <= first


def test_a_study_resumed_runs_what_is_missing_alone(endings, tmp_path: Path) -> None:
    script, out, _ = endings
    there = tmp_path / "runs"
    there.mkdir()
    content = (out / "results.jsonl").read_text().splitlines(keepends=True)
    (there / "results.jsonl").write_text("".join(content[:5]) + content[5][:30])
    done = study(
        script, "--samples", 10, "--seed", 5, "--jobs", 1, "--retries", 0, "--out", there, "--resume", "--json"
    )
    assert done.returncode == 1, done.stderr
    assert (there / "results.jsonl").read_text().startswith("".join(content[:5]))
    assert [answer(a) for a in firsts(there)] == [answer(b) for b in firsts(out)]
    assert len({one["worker"] for one in firsts(there)[:5]} & {one["worker"] for one in firsts(there)[5:]}) == 0
    before = (there / "results.jsonl").read_bytes()
    again = study(
        script, "--samples", 10, "--seed", 5, "--jobs", 1, "--retries", 0, "--out", there, "--resume", "--json"
    )
    assert again.stdout == done.stdout
    assert (there / "results.jsonl").read_bytes() == before, "nothing was missing"


@pytest.mark.slow
def test_ctrl_c_keeps_and_reports_what_is_finished(tmp_path: Path) -> None:
    script = slow(tmp_path, 0.3)
    with Terminal("study", script, "--samples", "500", "--jobs", "2", "--out", "runs", cwd=tmp_path) as terminal:
        terminal.wait_for(r"\d+ of 500, \d+ without success, [\d.]+ a second")
        terminal.press(CTRL_C)
        assert terminal.end() == 130, terminal.text[-2000:]
        assert "Traceback" not in terminal.text
        assert "interrupted; what was finished is kept, --resume runs what is missing" in terminal.lines()
        finished = firsts(tmp_path / "runs")
        assert 0 < len(finished) < 500
        assert re.search(rf"of {len(finished)} variants can be done", terminal.text)
        assert f"{500 - len(finished)} not run" in terminal.text
    document = json.loads((tmp_path / "runs" / "study.json").read_text())
    assert document["interrupted"] and document["finished"] == len(finished)


BAD = [
    ("def task(session, v): pass", (), "says not what varies; write VARIANTS = "),
    ("VARIANTS = {}\ndef task(session, v): pass", (), "says not what varies; write VARIANTS = "),
    ("VARIANTS = {'x': 3}\ndef task(session, v): pass", (), "VARIANTS['x'] is 3; give a Normal, Uniform"),
    (HEAD + "VARIANTS = {'x': Uniform(0, 1)}\ndef task(session): pass", (), "write `def task(session, v): …`"),
    ("from vpframe.studies import *\nVARIANTS = {'x': Uniform(0, 1)}\nFILE = 'no.step'\ndef task(s, v): pass", (),
     "its model no.step does not exist"),
    ("from vpframe.studies import *\nVARIANTS = {'x': Uniform(1, 0)}", (), "py:2: Uniform(low=1, high=0): low must"),
    (ENDINGS, ("--samples", 0), "0 variants; a study has at least one, and at most 1,000,000"),
    (ENDINGS, ("--seed", -1), "--seed -1: give none below 0"),
    (ENDINGS, ("--grid", "0"), "0 variants; a study has at least one"),
    (ENDINGS, ("--grid", 10**9), "6,000,000,000 variants; a study has at least one, and at most 1,000,000"),
    (ENDINGS, ("--retries", "-1"), "--timeout and --jobs must be positive, --retries not negative"),
    (ENDINGS, ("--timeout", "soon"), "'soon' is not a time; write a number with one of s, ms, min, h: 120s"),
    (ENDINGS, ("--timeout", "0"), "--timeout: time '0': give more than 0"),
    (ENDINGS, ("--jobs", "0"), "--timeout and --jobs must be positive, --retries not negative"),
    (ENDINGS, ("--sobol", "--grid"), "--sobol is a way to sample; leave out --grid"),
    (ENDINGS, ("--samples", 3, "--grid"), "not allowed with argument"),
    (ENDINGS, ("--cluster", "tcp://127.0.0.1:1", "--jobs", 2), "leave out --cluster"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "arguments", "words"), BAD)
def test_bad_input_is_one_line_and_makes_no_folder(tmp_path: Path, capsys, monkeypatch, text, arguments, words) -> None:
    from vpframe.app.cli import main

    monkeypatch.chdir(tmp_path)
    written(tmp_path, text)
    assert main(["study", "task.py", *map(str, arguments)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and words in told, told
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", ["index.html", "results.csv", "study.json", "results.jsonl"])
def test_what_vpframe_did_not_write_stays(tmp_path: Path, capsys, name: str) -> None:
    from vpframe.app.cli import main

    own = written(tmp_path / "runs", "index, mine\n", name)
    assert main(["study", str(written(tmp_path, ENDINGS)), "--out", str(tmp_path / "runs")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and f"{name}: exists and is not " in told and "--force" in told
    assert own.read_text() == "index, mine\n" and list((tmp_path / "runs").iterdir()) == [own]


@pytest.mark.slow
def test_a_program_without_a_guard_is_not_started_again_by_its_workers(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("import sys\nprint('started')\nfrom vpframe.app.cli import main\nsys.exit(main())\n")
    script = written(tmp_path, FORGETFUL)
    done = subprocess.run(
        [sys.executable, program, "study", script, "--samples", "4", "--jobs", "2", "--out", tmp_path / "runs"],
        capture_output=True, text=True, timeout=200, env=environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("started") == 1


def test_help_and_one_job_do_without_dask(tmp_path: Path) -> None:
    code = "import sys; sys.modules['distributed'] = None\nfrom vpframe.app.cli import main\nsys.exit(main())"
    command = [sys.executable, "-c", code, "study"]
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True, env=environment(), timeout=100)
    assert helped.returncode == 0 and "--cluster" in helped.stdout
    script = written(tmp_path, FORGETFUL)
    given = [script, "--samples", "1", "--out", tmp_path / "runs"]
    run = subprocess.run(
        [*command, *given, "--jobs", "1"], capture_output=True, text=True, env=environment(), timeout=200
    )
    assert run.returncode == 0, run.stderr
    given[-1] = tmp_path / "more"
    more = subprocess.run(
        [*command, *given, "--jobs", "2"], capture_output=True, text=True, env=environment(), timeout=200
    )
    assert more.returncode == 2
    assert (
        more.stderr.count("\n") == 1
        and "several jobs need Dask (pip install distributed); or give --jobs 1" in more.stderr
    )
