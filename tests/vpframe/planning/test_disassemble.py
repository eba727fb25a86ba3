"""`vpframe disassemble`: its document, its files, its exit codes, and a script that does the plan."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import vpframe as vp
from tests.vpframe.planning import cases
from tests.vpframe.waiting import is_gone, wait_until
from vpframe.app import task_runner
from vpframe.app.cli import main
from vpframe.hands.paths import read_track
from vpframe.planning import tree
from vpframe.scene.modelling import box, torus, write_step


def test_the_document(model, capsys):
    assert main(["disassemble", str(model), "--json", "--budget", "10min", "--seed", "7"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "removable" and document["seed"] == 7 and document["budget"]["seconds"] == 600.0
    assert [step["parts"] for step in document["steps"]] == [["nut"], ["bolt"], ["plate"]]
    nut = document["steps"][0]
    assert (nut["motion"], nut["turns"], nut["level"]) == ("screw", pytest.approx(8.0), 0)
    assert np.allclose(nut["direction"], [0, 0, -1]) and nut["length"] > 0.01
    assert set(nut["least_clearance"]) == {"distance", "surfaces", "at"}
    assert document["precedence"]["plate"] == ["bolt"]
    assert document["levels"] == [["nut"], ["bolt"], ["plate"]]
    assert document["minimal"] == {"proven": False, "bound": None, "over": ""}
    assert document["tolerance"] == 1e-6 and document["interrupted"] is False


def test_what_overlaps_is_a_line_a_pair_of_parts(tmp_path, capsys):
    room = box(0.02, 0.02, 0.02) - box(0.01, 0.01, 0.01).translated(0.005, 0.005, 0.005)
    pressed = pin.SE3(np.eye(3), np.array([0.0049, 0.006, 0.006]))  # both its ends in the walls around it
    path = write_step(tmp_path / "pressed.step", {"a": room, "a key": (box(0.0102, 0.008, 0.008), pressed)})
    main(["disassemble", str(path), "--base", "a", "--motion", "straight", "--budget", "20s"])
    (line,) = (line for line in capsys.readouterr().out.splitlines() if "overlap" in line)
    assert line.startswith("  overlap from the start, never deepened: a – a key, ")
    assert "; if that is meant: --authorise 'a:a key'; " in line
    assert line.endswith("if they may pass through each other: --ignore 'a:a key'")


def test_a_model_of_one_part_is_not_taken_apart(tmp_path, capsys):
    path = write_step(tmp_path / "one.step", {"block": box(0.02, 0.02, 0.02)})
    assert main(["disassemble", str(path)]) == 0
    assert "nothing to take apart: block is the whole model" in capsys.readouterr().out


def held(count):
    """Cubes in a closed case."""
    balls = {f"ball {k}": (box(0.002, 0.002, 0.002), cases.at(0.004 + 0.003 * k, 0.01, 0.01)) for k in range(count)}
    return {"case": box(0.05, 0.02, 0.02) - box(0.046, 0.016, 0.016).translated(0.002, 0.002, 0.002), **balls}


def test_parts_that_stay_for_one_reason_are_one_line_with_few_names(tmp_path, capsys):
    path = write_step(tmp_path / "held.step", held(9))
    assert main(["disassemble", str(path), "--motion", "straight", "--budget", "60s"]) == 1
    out = capsys.readouterr().out
    (line,) = (line for line in out.splitlines() if "(proof)" in line)
    assert line == "  " + ", ".join(f"ball {k}" for k in range(6)) + " and 3 more are enclosed while case stays (proof)"
    assert out.startswith("enclosed: ball 0, ")


def test_a_group_of_many_parts_is_named_by_few_of_them(tmp_path, capsys):
    cubes = {f"cube {k}": (box(0.01, 0.01, 0.01), cases.at(0.02 * k, 0.0, 0.02)) for k in range(9)}
    path = write_step(tmp_path / "cubes.step", {"plate": box(0.2, 0.02, 0.02), **cubes})
    assert main(["disassemble", str(path), "--carry", ",".join(cubes), "--report", str(tmp_path / "page")]) == 0
    captured = capsys.readouterr()
    page = (tmp_path / "page" / "index.html").read_text()
    for text in (captured.out, page):
        assert "cube 5 and 3 more" in text and "cube 5, cube 6" not in text
    assert json.loads((tmp_path / "page" / "plan.json").read_text())["steps"][0]["parts"] == list(cubes)


def test_one_part_the_fewest_removals_and_a_no(model, capsys):
    assert main(["disassemble", str(model), "--part", "nut", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [step["parts"] for step in document["steps"]] == [["nut"]]
    assert document["minimal"] == {"proven": True, "bound": 1, "over": "all plans: nothing has to go before it"}
    assert main(["disassemble", str(model), "--part", "bolt", "--motion", "straight"]) == 1
    assert "in the way: nut" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--part", "nutt"], "did you mean 'nut'"),
        (["--part", "base", "--base", "base"], "name another base"),
        (["--budget", "soon"], "write a number with one of s, ms, min, h"),
        (["--authorise", "nut"], "as A:B"),
        (["--ignore", "nut:nutt"], "did you mean 'nut'"),
        (["--ignore", "nut:nut"], "name two different ones"),
        (["--carry", "nut"], "two parts or more"),
        (["--carry", "nut,bolt", "--carry", "bolt,plate"], "in two groups"),
        (["--clearance", "0.1"], "unit"),
        (["--thread", "nut"], "PART=PITCH"),
        (["--thread", "nut=0mm"], "not zero"),
        (["--motion", "sideways"], "invalid choice"),
        (["--resume"], "--tracks or --report"),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(model, capsys, options, words):
    assert main(["disassemble", str(model), *options]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and words in captured.err and captured.err.count("\n") == 1


@pytest.mark.slow
def test_tracks_script_and_report_are_written_and_the_script_does_it(model, tmp_path, capsys):
    tracks, report, script = tmp_path / "tracks", tmp_path / "report", tmp_path / "apart.py"
    written = ["--tracks", str(tracks), "--report", str(report), "--task", str(script)]
    assert main(["disassemble", str(model), *written]) == 0
    plan = json.loads((tracks / "plan.json").read_text())
    assert plan == json.loads((report / "plan.json").read_text()) and plan["version"] == vp.__version__
    scene = vp.load(model)
    for step in plan["steps"]:
        for name in step["parts"]:
            track = read_track(tracks / step["track"][name])
            assert track.pose(0.0).isApprox(scene[name].pose, 1e-9)
    page = (report / "index.html").read_text()
    assert page.count("<figure>") == 4 and "comes out" in page
    assert 'name="generator" content="vpframe"' in page
    assert task_runner.run_task(script) == 0
    # again, over what it wrote itself; the script is a person's by now
    assert main(["disassemble", str(model), *written[:4], "--resume"]) == 0
    capsys.readouterr()
    assert main(["disassemble", str(model), "--task", str(script)]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["{}", "nonsense", '{"steps": [{"parts": ["nut"]}]}', '{"steps": 3}'])
def test_a_plan_that_is_none_is_not_resumed(model, tmp_path, capsys, text):
    (tmp_path / "plan.json").write_text(text)
    assert main(["disassemble", str(model), "--tracks", str(tmp_path), "--resume", "--force"]) == 2
    assert "plan.json" in capsys.readouterr().err


def test_a_known_way_is_swept_anew_before_it_is_used(capsys, tmp_path):
    """A way through the wall, written by somebody else: nothing of it is believed."""
    scene = cases.ball_in_shell()
    identity, out = [0, 0, 0, 0, 0, 0, 1], [0, 0, 0.1, 0, 0, 0, 1]
    forged = {
        "steps": [{"parts": ["ball"], "motion": "free", "direction": [0, 0, 1], "turns": 0, "knots": [identity, out]}]
    }
    from vpframe.planning.document import known_ways

    known = known_ways(json.dumps(forged), "plan.json")
    plan = vp.planning.disassembly(scene, "ball", known=known, budget=60.0)
    assert not plan and plan.stuck["ball"].verdict == "enclosed"


def rings(tmp_path):
    """Two links of a chain, which never come apart, and cubes that do."""
    turned = pin.SE3(pin.exp3(np.array([0.5 * np.pi, 0.0, 0.0])), np.array([0.02, 0.0, 0.0]))
    cubes = {f"cube {k}": (box(0.01, 0.01, 0.01), cases.at(0.02 * k, 0.1)) for k in range(3)}
    return write_step(
        tmp_path / "rings.step", {"one": torus(0.02, 0.003), "two": (torus(0.02, 0.003), turned), **cubes}
    )


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_ends_the_search_and_what_was_found_is_written(tmp_path, capsys, monkeypatch, number, code):
    search = tree._Search.run

    def signalled(self):
        os.kill(os.getpid(), number)
        return search(self)

    monkeypatch.setattr(tree._Search, "run", signalled)
    before = signal.getsignal(signal.SIGTERM)
    given = [
        "disassemble",
        str(rings(tmp_path)),
        "--base",
        "one",
        "--tracks",
        str(tmp_path / "tracks"),
        "--budget",
        "1h",
    ]
    assert main(given) == code
    assert signal.getsignal(signal.SIGTERM) == before
    out = capsys.readouterr().out
    assert "interrupted; these are the steps found until then" in out and "cube 2: straight" in out
    plan = json.loads((tmp_path / "tracks" / "plan.json").read_text())
    assert plan["interrupted"] and [step["parts"] for step in plan["steps"]] == [[f"cube {k}"] for k in range(3)]
    assert (tmp_path / "tracks" / "cube_1.csv").exists()


def children(pid):
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def command_of(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGKILL, -9), (signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_workers_end_with_the_command(tmp_path, number, code):
    given = ["disassemble", str(rings(tmp_path)), "--jobs", "2", "--base", "one", "--budget", "1h", "--json"]
    parent = subprocess.Popen(
        [sys.executable, "-m", "vpframe", *given], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        workers = lambda: [pid for pid in children(parent.pid) if b"vpframe.planning.workers" in command_of(pid)]  # noqa: E731
        wait_until(lambda: len(workers()) == 2, 300.0)
        started = workers()
        parent.send_signal(number)
        parent.communicate(timeout=300.0)
        assert parent.returncode == code
        wait_until(lambda: all(map(is_gone, started)), 300.0)
    finally:
        parent.kill()
        parent.wait()
