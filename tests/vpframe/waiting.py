"""Waiting for a condition, and for processes to end."""

import subprocess
import time
from collections.abc import Callable


def wait_until(holds: Callable[[], bool], seconds: float = 120.0) -> None:
    """Return once it holds; fail if it has not within a time that is long for any machine."""
    until = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < until, "it did not come to be"
        time.sleep(0.02)


def is_gone(pid: int) -> bool:
    """Whether a process has ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return subprocess.run(["ps", "-p", str(pid)], capture_output=True, check=False).returncode != 0
