"""Long sessions, many pages, full disks: memory stays flat, nobody is refused, one line says what is wrong.

python -m tests.reliability.limits [--count N] [--results FILE] [steps|pages|disk|full ...]
"""

from __future__ import annotations

import argparse
import asyncio
import errno
import gc
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.reliability import results
from tests.reliability.kills import ROOT, TASK


def memory() -> int:
    """Bytes of memory that this process holds now."""
    gc.collect()
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def steps(count: int) -> dict[str, Any]:
    """Steps of a session with a part in hand that goes to and fro: how far its memory grows after the first tenth."""
    import numpy as np
    import pinocchio as pin

    import vpframe as vp
    from tests.vpframe.studies.scripts import cube

    scene = cube()
    away = pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.0]))
    parts = [vp.Part("cube", scene["cube"].shape, scene["cube"].pose), vp.Part("wall", scene["cube"].shape, away)]
    most = least = 0
    with vp.Session(vp.Scene(parts)) as session:
        session.scene["wall"].fixed = True
        hand = session.hand()
        hand.grab("cube")
        began = time.perf_counter()
        while session.step_count < count:
            for way in (0.02, -0.02):
                hand.move_by((way, 0.0, 0.0), duration=5.0)
            if session.step_count > count // 10:
                now = memory()
                least, most = min(least or now, now), max(most, now)
        seconds = time.perf_counter() - began
        made = session.step_count
    return {"count": made, "growth": most - least, "milliseconds": 1e3 * seconds / made}


def pages(count: int, together: int = 50) -> dict[str, Any]:
    """Pages that join a live session, take the first messages and go, `together` at a time: those refused, memory."""
    from tornado.websocket import websocket_connect

    from tests.vpframe.watching import pressing_frames, pressing_scene
    from vpframe.view.meshcat_viewer import MeshcatViewer

    viewer = MeshcatViewer(frames=60)
    viewer.begin(pressing_scene())
    url = viewer.url.replace("http://", "ws://")
    frames = pressing_frames(60)
    done = threading.Event()

    def run() -> None:
        while not done.is_set():
            for frame in frames:
                viewer.frame(frame)
                time.sleep(0.01)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    refused = heard = 0
    at: list[int] = []

    async def visit() -> int:
        head, _, query = url.partition("?")
        socket = await websocket_connect(f"{head}socket?{query}")
        message = await asyncio.wait_for(socket.read_message(), 30.0)
        socket.close()
        return len(message or "")

    async def crowd(number: int) -> list[Any]:
        return await asyncio.gather(*(visit() for _ in range(number)), return_exceptions=True)

    for begun in range(0, count, together):
        answers = asyncio.run(crowd(min(together, count - begun)))
        refused += sum(isinstance(answer, BaseException) or not answer for answer in answers)
        heard += len(answers)
        at.append(memory())
    done.set()
    thread.join()
    viewer.end()
    tenth = at[len(at) // 10 :]
    return {"count": heard, "refused": refused, "growth": tenth[-1] - tenth[0] if tenth else 0}


DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, resource.RLIM_INFINITY))  # no file longer than that
"""


MOUNTED = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c",
           'mount -t tmpfs -o size="$1" tmpfs "$2" && cd "$2" && shift 2 && exec "$@"', "sh"]  # fmt: skip
"""runs a command in a file system of a size (bytes), which is mounted on a folder and is gone when the command ends"""


def mountable() -> bool:
    """Whether a small file system can be mounted here: by Linux's user namespaces, or as root."""
    if shutil.which("unshare") is None:
        return False
    with tempfile.TemporaryDirectory(prefix="vpframe-disk-") as folder:
        return subprocess.run([*MOUNTED, "65536", folder, "true"], capture_output=True, check=False).returncode == 0


def disk(count: int) -> dict[str, Any]:
    """Runs whose files may grow to `count` different lengths: all end in one line, none in a traceback."""
    limits = [1000 + round(300_000 * i / max(count - 1, 1)) for i in range(count)]
    return _filled(limits, errno.EFBIG, lambda limit, out: ([], DISK.replace("MOST", str(limit))))


def full(count: int) -> dict[str, Any]:
    """Runs on file systems of `count` different sizes, which their files fill: each line says that it is full.

    Raises
    ------
    OSError: no file system can be mounted here.
    """
    if not mountable():
        raise OSError(errno.EPERM, "no file system can be mounted: this needs root, or user namespaces")
    sizes = [4096 * (1 + round(511 * i / max(count - 1, 1))) for i in range(count)]
    return _filled(sizes, errno.ENOSPC, lambda size, out: ([*MOUNTED, str(size), str(out)], ""))


def _filled(
    limits: Sequence[int], number: int, limited: Callable[[int, Path], tuple[list[str], str]]
) -> dict[str, Any]:
    """Run a task under each limit (bytes): how many were stopped by it, and what ended otherwise than in one line.

    number: the system's error. limited: what stands before the command, and before the script.
    """
    faults, stopped = [], 0
    for limit in limits:
        with tempfile.TemporaryDirectory(prefix="vpframe-disk-") as folder:
            script, out = Path(folder, "task.py"), Path(folder, "out")
            out.mkdir()
            prefix, before = limited(limit, out)
            script.write_text(before + TASK.replace("STEPS", "300").replace("0.01", "0.0"))
            outputs = ["--record", "run.rrd", "--checkpoint", "run.journal", "--report", "report"]
            done = subprocess.run(
                [*prefix, sys.executable, "-m", "vpframe", "run", script, *outputs], cwd=out, capture_output=True,
                text=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, timeout=300, check=False,
            )  # fmt: skip
        said = done.returncode == 2 and "cannot be written" in done.stderr and os.strerror(number) in done.stderr
        stopped += said
        if not (said or done.returncode == 0) or "Traceback" in done.stderr:
            faults.append({"limit": limit, "code": done.returncode, "said": done.stderr[-300:]})
    return {"count": len(limits), "errno": errno.errorcode[number], "stopped": stopped, "faults": faults}


MEASURES = {"steps": (steps, 10**6), "pages": (pages, 1000), "disk": (disk, 50), "full": (full, 50)}


def row(name: str, count: int, first: int = 0) -> dict[str, Any]:
    """The line of the table of one measure."""
    return {"what": name, "first": first, "count": count, "faults": []} | MEASURES[name][0](count)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(MEASURES))
    parser.add_argument("--count", type=int, help="steps, pages or limits; left out, those of the docs")
    results.arguments(parser)
    given = parser.parse_args()
    for name in given.names:
        count = given.count or MEASURES[name][1]
        results.run(row, [name], count, count, given)


if __name__ == "__main__":
    main()
