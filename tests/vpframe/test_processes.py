"""Child processes end with their parent, also while they work."""

import os
import signal
import subprocess
import sys
import time

import pytest

from vpframe.processes import with_parent

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")

BUSY = """
import sys
print("busy", flush=True)
while True:
    sum(range(10**7))  # listens to nobody
"""
STARTS = """
import subprocess, sys, time
from vpframe.processes import with_parent
child = subprocess.Popen(with_parent("busy"), stdout=subprocess.PIPE, start_new_session=True)
if sys.argv[1] == "after":
    child.stdout.readline()
print(child.pid, flush=True)
time.sleep(600)
"""


def is_gone(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return subprocess.run(["ps", "-p", str(pid)], capture_output=True, check=False).returncode != 0


def wait_until_gone(pid, seconds=60.0):
    """Whether a process ends within a time that is long for this machine and short for what it does."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if is_gone(pid):
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize("killed", ["after", "before"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_busy_child_ends_with_its_parent(tmp_path, killed, number):
    (tmp_path / "busy.py").write_text(BUSY)
    path = os.pathsep.join([str(tmp_path), os.getcwd()])
    parent = subprocess.Popen(
        [sys.executable, "-c", STARTS, killed],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        child = int(parent.stdout.readline())
        assert killed == "before" or not is_gone(child)
        parent.send_signal(number)
        parent.wait()
        assert wait_until_gone(child)
    finally:
        parent.kill()
        parent.wait()


def test_a_child_whose_parent_is_gone_already_ends(tmp_path):
    (tmp_path / "busy.py").write_text(BUSY)
    command = with_parent("busy")
    command[3] = "1" if os.getpid() != 1 else "2"  # another parent
    child = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, timeout=60, check=False
    )
    assert child.returncode == 1 and child.stdout == b""


def test_the_module_runs_as_a_program_with_its_arguments(tmp_path):
    (tmp_path / "told.py").write_text("import sys\nprint(__name__, sys.argv[1:])\n")
    command = with_parent("told", "a", "b")
    child = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True
    )
    assert child.stdout == "__main__ ['a', 'b']\n"
