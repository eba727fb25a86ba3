"""Child processes end with their parent, also while they work."""

import os
import signal
import subprocess
import sys

import pytest

from tests.vpframe.waiting import is_gone, wait_until
from vpframe.processes import family, kill, start, with_parent

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
        wait_until(lambda: is_gone(child))
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


@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")
def test_a_killed_process_takes_its_descendants_with_it(tmp_path):
    forks = "if os.fork() == 0:\n    os.fork()\nos.write(1, b'%d\\n' % os.getpid())\ntime.sleep(600)\n"
    (tmp_path / "forks.py").write_text(f"import os, time\n{forks}")
    child = start("forks", stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(tmp_path)})
    others = [int(child.stdout.readline()) for _ in range(3)]
    assert child.pid in others and set(others) == set(family(child.pid))
    kill(child)
    child.communicate(timeout=60)  # nobody holds the pipe
    wait_until(lambda: all(is_gone(pid) for pid in others))
    kill(child)  # does nothing
