"""ReadingLimits of reading processes: they count what the process uses, not what the clock shows."""

import os
import subprocess
import sys
import time

import pytest
import trimesh

import vpframe as vp
from tests.vpframe.importers.guarding import ended
from vpframe.importers import guarded
from vpframe.importers.limits import ReadingLimits

pytestmark = pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")
SPIN = "end = time.process_time() + {}\nwhile time.process_time() < end: pass"


@pytest.mark.parametrize(
    "body",
    [
        SPIN.format(60),
        "time.sleep(60)",
        f"threading.Thread(target=exec, args=({SPIN.format(60)!r}, globals())).start()\ntime.sleep(60)",
        f"if os.fork() == 0:\n    exec({SPIN.format(3)!r})\nos.wait()",
        "os.mkfifo('pipe')\nopen('pipe')",
    ],
    ids=["computes", "sleeps", "thread", "child", "waits for a pipe"],
)
def test_a_process_ends_at_its_limit_of_processor_time(tmp_path, monkeypatch, body):
    outcome = ended(tmp_path, monkeypatch, body, ReadingLimits(0.5, 1e9))
    assert outcome.late and not outcome.done and not outcome.memory
    assert outcome.how_it_ended() == "no answer within 0.5 s of processor time"


@pytest.mark.parametrize(
    "body", [SPIN, "if os.fork() == 0:\n    exec({!r})\n    os._exit(0)\nos.wait()"], ids=["own", "child"]
)
def test_a_process_that_ends_between_two_samples_is_held_to_its_limit(tmp_path, monkeypatch, body):
    monkeypatch.setattr(guarded, "SAMPLING", 60.0)
    work = SPIN.format(0.3) if body is SPIN else body.format(SPIN.format(0.3))
    outcome = ended(tmp_path, monkeypatch, work, ReadingLimits(0.1, 1e9))
    assert outcome.late and not outcome.done
    (tmp_path / "more").mkdir()
    assert ended(tmp_path / "more", monkeypatch, work, ReadingLimits(20.0, 1e9)).done


def test_a_mesh_that_is_read_between_two_samples_is_late(tmp_path, monkeypatch):
    monkeypatch.setattr(guarded, "SAMPLING", 60.0)
    monkeypatch.setenv("VPFRAME_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "a.obj"
    trimesh.creation.box((0.01, 0.02, 0.03)).export(path)
    with path.open("a", encoding="ascii") as file:  # some 0.2 s of reading: /proc counts in steps of 0.01 s
        file.write("# a comment\n" * 1_000_000)
    with pytest.raises(vp.LoadError, match=r"no answer within 0\.\d+ s of processor time"):
        vp.load(path, timeout=1e-3)
    assert len(vp.load(path, timeout=20.0)) == 1


def test_a_process_among_busy_ones_has_its_whole_processor_time(tmp_path, monkeypatch):
    """With three others a core it takes longer by the clock than its limit, and ends well."""
    command = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(command) for _ in range(3 * (os.cpu_count() or 1))]
    try:
        began = time.monotonic()
        outcome = ended(tmp_path, monkeypatch, SPIN.format(0.3), ReadingLimits(0.6, 1e9))
    finally:
        for other in others:
            other.kill()
            other.wait()
    if time.monotonic() - began <= 0.6:
        pytest.skip("it had a core of its own")
    assert outcome.done and not outcome.late


@pytest.mark.parametrize(
    "body", ["x = bytearray(300_000_000)", "x = [bytes([1]) * 50_000_000 for _ in range(8)]"], ids=["one", "many"]
)
def test_a_process_ends_at_its_limit_of_memory(tmp_path, monkeypatch, body):
    outcome = ended(tmp_path, monkeypatch, f"{body}\ntime.sleep(60)", ReadingLimits(20.0, 1e8))
    assert outcome.memory and not outcome.done and not outcome.late
    assert outcome.how_it_ended() == "more than 0.1 GB of memory are needed"


def test_reserved_memory_that_is_not_used_does_not_count(tmp_path, monkeypatch):
    body = "import mmap\nx = mmap.mmap(-1, 1 << 30)"
    assert ended(tmp_path, monkeypatch, body, ReadingLimits(20.0, 2e8)).done


def test_what_was_understood_until_a_limit_is_told(tmp_path, monkeypatch):
    body = "say(found={'shapes': 3, 'faces': 40, 'forked': 9})\nsay(ready=2)\nsay(fraction=0.5, text='meshing a')\n"
    outcome = ended(tmp_path, monkeypatch, body + SPIN.format(60), ReadingLimits(0.3, 1e9))
    assert outcome.late
    assert outcome.where_it_ended() == "while meshing a (understood until then: 3 shapes, 40 faces, 1 shapes made)"


def test_the_last_words_of_a_process_are_told(tmp_path, monkeypatch):
    outcome = ended(tmp_path, monkeypatch, "raise SystemExit('out of order')", ReadingLimits(20.0, 1e9))
    assert outcome.how_it_ended() == "the reader gave up (out of order)"
    assert outcome.code == 1
