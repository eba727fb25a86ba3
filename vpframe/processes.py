"""Child processes: started so that they end with their parent, however it ends, and observed while they run.

    start("package.module", stdin=subprocess.PIPE, ...)

starts `python -m package.module` bound to this process before the module is imported.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
_SYNCHRONIZE = 0x00100000  # <winnt.h>
LOOK = 0.2
"""s between two looks at the parent, where the system has no death signal"""


def with_parent(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of this Python in a child process that ends with this process."""
    return [sys.executable, "-P", os.path.abspath(__file__), str(os.getpid()), module, *arguments]


def start(module: str, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
    """Start a module in a child process that ends with this process; options: of `Popen`, pipes are null by default."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    return subprocess.Popen(with_parent(module, *arguments), **{**pipes, "env": environment(), **options})


def environment() -> dict[str, str]:
    """Return the environment for a child process that imports the packages beside this one."""
    root = str(Path(__file__).resolve().parents[1])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))}


def end_with(parent: int) -> None:
    """End this process as soon as its parent `parent` ends, also during a C call that holds the interpreter (Linux).

    Elsewhere a thread looks for the parent, which needs the interpreter.
    """
    import ctypes

    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if sys.platform != "win32" and os.getppid() != parent:  # it ended before the line above
        os._exit(1)


def _watch(parent: int) -> None:
    if sys.platform == "win32":
        import ctypes

        handle = ctypes.windll.kernel32.OpenProcess(_SYNCHRONIZE, False, parent)
        ctypes.windll.kernel32.WaitForSingleObject(handle, -1)
    else:
        while os.getppid() == parent:
            time.sleep(LOOK)
    os._exit(1)


def kill(process: subprocess.Popen[Any]) -> None:
    """Kill a process and its descendants, as far as the system names them (/proc); it is still to be waited for."""
    if process.returncode is None:  # else another process may have its number
        for pid in [*family(process.pid)][::-1]:
            with contextlib.suppress(OSError):  # it has ended
                os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))


def how_it_ended(code: int) -> str:
    """`killed by SIGSEGV` or `ended with exit code 3`, of a return code."""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
    return f"ended with exit code {abs(code)}"


@contextlib.contextmanager
def ctrl_c_blocked() -> Iterator[None]:
    """Block Ctrl-C for processes and threads that are started inside, and for this thread until the block ends."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Usage(NamedTuple):
    """What a process and its descendants use."""

    seconds: float
    """of processor time"""
    memory: int
    """resident bytes"""


def usage(pid: int) -> Usage | None:
    """Return what a process and its descendants use; None where the system does not report it."""
    seconds, memory = 0.0, 0
    for member in family(pid):
        with contextlib.suppress(OSError, IndexError):  # it has ended
            fields = stat_of(f"/proc/{member}/stat")
            seconds += sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")  # its own, and of ended children
            memory += int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    return Usage(seconds, memory) if os.path.exists("/proc/self/stat") else None


def sleeps(pid: int) -> bool:
    """Whether no thread of a process and its descendants is running or ready to run."""
    for member in family(pid):
        with contextlib.suppress(OSError, IndexError):  # it has ended
            for task in os.listdir(f"/proc/{member}/task"):
                if stat_of(f"/proc/{member}/task/{task}/stat")[0] not in "SZ":
                    return False
    return True


def stat_of(path: str) -> list[str]:
    """Return the fields of a process or thread from its state on (proc_pid_stat(5))."""
    return Path(path).read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()


def family(pid: int) -> Iterator[int]:
    """Yield a process and its descendants."""
    yield pid
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            for child in Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split():
                yield from family(int(child))


if __name__ == "__main__":
    import runpy

    end_with(int(sys.argv[1]))
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
