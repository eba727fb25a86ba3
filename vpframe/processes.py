"""Child processes that end with their parent, however the parent ends.

    subprocess.Popen(with_parent("package.module"), stdin=subprocess.PIPE, ...)

starts `python -m package.module` bound to this process before the module is imported.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from pathlib import Path

_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
_SYNCHRONIZE = 0x00100000  # <winnt.h>
LOOK = 0.2
"""s between two looks at the parent, where the system has no death signal"""


def with_parent(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of this Python in a child process that ends with this process."""
    return [sys.executable, "-P", os.path.abspath(__file__), str(os.getpid()), module, *arguments]


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


if __name__ == "__main__":
    import runpy

    end_with(int(sys.argv[1]))
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
