"""Task scripts that the tests of studies run."""

import contextlib
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe.importers.build import shape
from vpframe.importers.raw import RawFace, RawShape
from vpframe.scene.scene import Part, Scene
from vpframe.studies.variants import Variant


def variant(how: str, index: int = 0) -> Variant:
    return Variant(index, 0, {"how": how, "x": 2.0})


ROOT = Path(__file__).parents[3]
HEAD = """
import os, sys, time
from pathlib import Path
from vpframe.studies import Choice, Normal, Uniform
from tests.vpframe.studies.scripts import cube

def scene(v):
    return cube()

"""
ENDINGS = (
    HEAD
    + """
VARIANTS = {"how": Choice("ok", "no", "error", "crash", "exit", "hang"), "x": Normal(1.0, 0.1)}

def task(session, v):
    session.run(0.04)
    print("printed by a script")
    if v["how"] == "no":
        session.expect(v["x"] < 0.0, "x is negative")
    if v["how"] == "error":
        {}["missing"]
    if v["how"] == "crash":
        os.kill(os.getpid(), 11)
    if v["how"] == "exit":
        os._exit(0)
    while v["how"] == "hang":
        time.sleep(0.1)
    if v["how"] == "abort":
        os.abort()
    if v["how"] == "input":
        input()
    return {"square": v["x"] ** 2, "random": float(v.rng.random()), "name": v["how"]}
"""
)
SLOW = (
    HEAD
    + """
VARIANTS = {"x": Uniform(0.0, 1.0)}

def task(session, v):
    session.run(0.02)
    Path(__file__).with_name("running").touch()
    time.sleep(SECONDS)
    session.expect(v["x"] < 0.7, "x is small")
    return {"square": v["x"] ** 2}
"""
)


def cube() -> Scene:
    """A scene of one loose cube, made without the CAD kernel, whose import takes a second."""
    vertices = 0.01 * np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    faces = [RawFace(f"face {i}") for i in range(6)]
    raw = RawShape(vertices, triangles, np.repeat(np.arange(6, dtype=np.int32), 2), faces)
    return Scene([Part("cube", shape(raw, "cube"), pin.SE3.Identity())])


def written(folder: Path, text: str, name: str = "task.py") -> Path:
    """A script in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(text)
    return path


def slow(folder: Path, seconds: float) -> Path:
    """A script whose variants take some seconds; three in ten fail."""
    return written(folder, SLOW.replace("SECONDS", repr(seconds)))


def environment() -> dict[str, str]:
    """For programs that the tests start."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path, "DISPLAY": ""}


def start(*arguments: object, module: str = "vpframe") -> subprocess.Popen[str]:
    """Start `python -m vpframe …` (or another module), in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(), start_new_session=True,
    )  # fmt: skip


def lines(out: Path) -> list[dict[str, Any]]:
    """The records that are written so far, torn ones left out."""
    path = out / "results.jsonl"
    found = []
    for line in path.read_text().split("\n") if path.exists() else []:
        with contextlib.suppress(ValueError):
            found.append(json.loads(line))
    return found


def firsts(out: Path) -> list[dict[str, Any]]:
    """Records of first runs, by index."""
    return sorted((one for one in lines(out) if not one.get("repeat")), key=lambda one: one["index"])


def children(script: Path) -> list[int]:
    """Processes that run variants of a script."""
    return [pid for pid, words in _processes() if "vpframe.studies.runner" in words and str(script) in words]


def below(parent: int) -> list[int]:
    """Processes that a process has started, and those that they have."""
    direct = [pid for pid, _ in _processes() if _parent(pid) == parent]
    return [*direct, *(each for pid in direct for each in below(pid))]


def _processes() -> Iterator[tuple[int, str]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                yield int(entry.name), (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()


def _parent(pid: int) -> int:
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def study(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vpframe", "study", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=280, env=environment(), cwd=cwd)
