"""A variant in a process of its own: how it may end, and what it costs the others."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vpframe.studies.scripts import ENDINGS, HEAD, children, environment, slow, variant, written
from tests.vpframe.waiting import wait_until
from vpframe.processes import how_it_ended
from vpframe.studies.child import Children


@pytest.mark.slow
def test_every_ending_has_its_status_and_costs_one_variant(tmp_path: Path) -> None:
    script = written(tmp_path, ENDINGS)
    pool = Children(script, 5.0, 0)
    try:
        fine = pool.run(variant("ok"))
        assert (fine["status"], fine["reason"], fine["steps"]) == ("ok", "", 2)
        assert fine["measures"]["square"] == 4.0 and fine["measures"]["name"] == "ok"
        assert fine["memory"] > 1e7 and fine["seconds"] > 0.0

        no = pool.run(variant("no"))
        assert (no["status"], no["reason"]) == ("no", "task.py:17: expected x is negative")
        error = pool.run(variant("error"))
        assert (error["status"], error["reason"]) == ("error", "script error: task.py:19: KeyError: 'missing'")
        assert "printed by a script" in error["output"]
        assert no["worker"] == error["worker"] == fine["worker"], "one process as long as it lives"

        asks = pool.run(variant("input"))
        assert asks["reason"].startswith("script error: task.py:29: EOFError"), (
            "what variants come by is not the script's"
        )

        crashed = pool.run(variant("crash"))
        assert (crashed["status"], crashed["reason"]) == ("crashed", "task.py:21: killed by SIGSEGV")
        aborted = pool.run(variant("abort"))
        assert (aborted["status"], aborted["reason"]) == ("crashed", "task.py:27: killed by SIGABRT")
        late = pool.run(variant("hang"))
        assert (late["status"], late["reason"]) == ("timeout", "task.py:25: no answer within 5 s")
        assert 5.0 <= late["seconds"] < 10.0

        again = pool.run(variant("ok"))
        assert again["measures"] == fine["measures"]
        assert len({fine["worker"], crashed["worker"], late["worker"], again["worker"]}) == 3
        assert [each["attempts"] for each in (fine, no, error, crashed, late, again)] == [1] * 6
    finally:
        pool.close()
    wait_until(lambda: not children(script))


FLAKY = (
    HEAD
    + """
VARIANTS = {"how": Choice("exit", "error")}

def task(session, v):
    mark = Path(__file__).with_name("attempts")
    with mark.open("a") as file:
        file.write("x")
    if v["how"] == "error":
        raise ValueError("always")
    if len(mark.read_text()) < 3:
        os._exit(4)
"""
)


@pytest.mark.slow
def test_only_crashes_are_tried_again(tmp_path: Path) -> None:
    pool = Children(written(tmp_path, FLAKY), 60.0, 2)
    try:
        flaky = pool.run(variant("exit"))
        assert (flaky["status"], flaky["attempts"]) == ("ok", 3)
        assert pool.run(variant("error"))["attempts"] == 1
    finally:
        pool.close()
    (tmp_path / "attempts").unlink()
    pool = Children(tmp_path / "task.py", 60.0, 1)
    try:
        flaky = pool.run(variant("exit"))
        assert (flaky["status"], flaky["attempts"]) == ("crashed", 2)
        assert flaky["reason"] == "ended with exit code 4"
    finally:
        pool.close()


PARENT = """
import sys
from pathlib import Path
from vpframe.studies.child import Children
from vpframe.studies.variants import Variant
Children(Path(sys.argv[1]), 600.0, 0).run(Variant(0, 0, {"x": 0.1}))
"""


def test_children_end_with_their_parent_even_when_it_is_killed(tmp_path: Path) -> None:
    script = slow(tmp_path, 300.0)
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(script)], env=environment())
    try:
        wait_until((tmp_path / "running").exists)
        assert len(children(script)) == 1
    finally:
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    wait_until(lambda: not children(script), 10.0)


@pytest.mark.slow
def test_the_memory_of_a_variant_is_not_that_of_who_started_it(tmp_path: Path) -> None:
    text = PARENT.replace("import sys\n", "import sys\nballast = bytearray(b'x' * 900_000_000)\n")
    text = text.replace("Children(", "print(Children(").replace('{"x": 0.1}))', '{"x": 0.1}))["memory"])')
    done = subprocess.run(
        [sys.executable, "-c", text, slow(tmp_path, 0.0)], capture_output=True, text=True, env=environment(), check=True
    )
    assert 5e7 < float(done.stdout) < 8e8


def test_how_a_process_ended() -> None:
    assert how_it_ended(-9) == "killed by SIGKILL"
    assert how_it_ended(-250) == "ended with exit code 250"
    assert how_it_ended(0) == "ended with exit code 0"
