"""A disk without room: one line, exit 2, and what was written before can be read."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from tests.vpframe.watching import fake_session, pressing_frames
from vpframe.errors import OutputError
from vpframe.view import recorder as recorder_module
from vpframe.view.recorder import RerunRecorder
from vpframe.view.replay import lines

TASK = """
from tests.vpframe.watching import pressing_scene

{limit}
def scene():
    return pressing_scene()

def task(session):
    for step in range(1500):
        session.note("a long line " * 60)
        session.step()
"""
LIMIT = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))  # no file longer than that
"""
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no /dev/full, no limits on files")


@pytest.fixture
def full():
    """A device that never has room."""
    path = Path("/dev/full")
    if not path.exists():
        pytest.skip("the system has no /dev/full")
    return path


def script(folder, limit=""):
    path = folder / "task.py"
    path.write_text(TASK.format(limit=limit))
    return path


def only_line(done):
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("vpframe: "), done.stderr
    return done.stderr


@pytest.mark.parametrize("option", ["--record", "--checkpoint"])
def test_a_run_into_a_full_device(tmp_path, vpframe, full, option):
    done = vpframe("run", script(tmp_path), option, full, cwd=tmp_path, timeout=120)
    assert "/dev/full: cannot be written: No space left on device" in only_line(done)


def test_a_recording_that_meets_the_end_of_the_disk_can_be_replayed(tmp_path, vpframe):
    path = tmp_path / "run.rrd"
    done = vpframe("run", script(tmp_path, LIMIT), "--record", path, cwd=tmp_path, timeout=120)
    assert "run.rrd: cannot be written: File too large" in only_line(done)
    assert 100_000 < path.stat().st_size <= 200_000
    steps = [line.step for line in lines(path) if line.kind == "note"]
    assert steps == list(range(len(steps))) and len(steps) >= 240
    again = vpframe("replay", path, "--script", cwd=tmp_path, timeout=60)
    assert (again.returncode, again.stderr) == (0, "")


def test_a_checkpoint_that_meets_the_end_of_the_disk_is_gone_on_from(tmp_path, vpframe):
    path = tmp_path / "run.journal"
    task = script(tmp_path, LIMIT)
    done = vpframe("run", task, "--checkpoint", path, cwd=tmp_path, timeout=120)
    assert "run.journal: cannot be written: File too large" in only_line(done)
    assert 100_000 < path.stat().st_size <= 200_000
    done = vpframe("run", task, "--checkpoint", path, "--resume", cwd=tmp_path, timeout=120)
    assert "cannot be written" in only_line(done)  # it went on, and meets the same end
    assert 190_000 < path.stat().st_size <= 200_000


def test_a_disk_of_its_own_that_fills_up(tmp_path, vpframe):
    """The same on a file system of 256 kB, where one may be mounted."""
    disk = tmp_path / "disk"
    disk.mkdir()
    inside = f"mount -t tmpfs -o size=256k tmpfs {disk} && exec "
    if subprocess.run(["unshare", "-rm", "sh", "-c", inside + "true"], capture_output=True).returncode:
        pytest.skip("no file system may be mounted here")
    run = f"{sys.executable} -m vpframe run {script(tmp_path)} --record {disk}/run.rrd > {tmp_path}/out"
    read = f"{sys.executable} -m vpframe replay {disk}/run.rrd --script > {tmp_path}/events"
    root = Path(__file__).parents[3]
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", f"mount -t tmpfs -o size=256k tmpfs {disk} && ({run}; echo $?; {read})"],
        capture_output=True, text=True, cwd=root, timeout=120,
    )  # fmt: skip
    assert done.stdout == "2\n"
    assert done.stderr.count("\n") == 1 and "No space left on device" in done.stderr
    assert (tmp_path / "events").read_text().count("a long line") > 240


@pytest.mark.parametrize("arguments", [[], ["--json"]], ids=["text", "json"])
def test_standard_output_on_a_full_disk(tmp_path, full, arguments):
    from tests.vpframe.watching import pressing_scene
    from vpframe.scene.stl import write_stl

    mesh = pressing_scene()["rod"].mesh
    write_stl(tmp_path / "rod.stl", mesh.vertices, mesh.triangles)
    with full.open("w") as out:
        done = subprocess.run(
            [sys.executable, "-m", "vpframe", "clash", tmp_path / "rod.stl", *arguments],
            stdout=out, stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[3], timeout=120,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "vpframe: what was found cannot be printed: No space left on device"


def no_room(file, data):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_the_session_does_not_wait_for_a_disk_that_is_full(tmp_path, monkeypatch):
    """Every write fails, and much more is recorded than may wait for the writer."""
    monkeypatch.setattr(recorder_module, "append", no_room)
    monkeypatch.setattr(recorder_module, "FLUSH_STEPS", 1)
    recorder = RerunRecorder(tmp_path / "run.rrd")
    recorder.begin(fake_session().scene)
    with pytest.raises(OutputError, match="No space left on device"):
        for _ in range(100):
            for frame in pressing_frames(20):
                recorder.frame(frame)
    with pytest.raises(OutputError, match="No space left on device"):
        recorder.end()
    assert not (tmp_path / "run.rrd").exists(), "nothing could be written"
