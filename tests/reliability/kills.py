"""Runs killed at random moments (SIGKILL): nothing that was written is lost, and what goes on has the same future.

python -m tests.reliability.kills --count 25 --jobs 2 --results FILE [record|checkpoint|study|accept ...]
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.reliability import results

ROOT = Path(__file__).parents[2]
SHARD = 5
"""kills of a line of the results file, at most"""
TASK = """
import time
from tests.vpframe.watching import pressing_scene

def scene():
    return pressing_scene()

def task(session):
    for step in range(STEPS):
        session.note(f"step {step}")
        session.step()
        time.sleep(0.01)
"""
STUDY = """
from vpframe.studies import Uniform
from tests.vpframe.studies.scripts import cube

VARIANTS = {"x": Uniform(0.0, 1.0)}

def scene(v):
    return cube()

def task(session, v):
    session.run(0.05)
    session.expect(v["x"] < 0.7, "x is small")
    return {"square": v["x"] ** 2}
"""
STEPS, VARIANTS = 600, 40
LATE = 2.5
"""s before a kill: what was printed by then must be in the recording, which is written every two seconds"""


def start(*words: object, cwd: Path) -> subprocess.Popen[str]:
    """Start `python -m vpframe …` in a session of its own."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return subprocess.Popen(
        [sys.executable, "-m", "vpframe", *map(str, words)], cwd=cwd, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip


def finished(*words: object, cwd: Path) -> tuple[int, str, str]:
    """Exit code, standard output and error of a run that nobody kills."""
    process = start(*words, cwd=cwd)
    out, error = process.communicate(timeout=600)
    return process.returncode, out, error


def killed(
    words: tuple[object, ...], cwd: Path, there: Callable[[], bool], rng: random.Random, spread: float
) -> list[str] | None:
    """Run and kill at a random moment of `spread` seconds after its output is `there`; None if it was over.

    Returned are the lines that it had printed `LATE` seconds before.
    """
    process = start(*words, cwd=cwd)
    heard: list[tuple[float, str]] = []

    def hear() -> None:
        assert process.stdout is not None
        heard.extend((time.monotonic(), line) for line in process.stdout)

    listener = threading.Thread(target=hear, daemon=True)
    listener.start()
    try:
        until = time.monotonic() + 300.0
        while process.poll() is None and not there():
            assert time.monotonic() < until, f"{words} writes nothing"
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, spread))
        alive, now = process.poll() is None, time.monotonic()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        listener.join()
    return [line for when, line in heard if when < now - LATE] if alive else None


def notes(out: str) -> list[str]:
    """The notes of the steps that a run prints or a recording holds."""
    return [line.split("step ")[-1] for line in out.splitlines() if " note" in line]


def record(folder: Path, rng: random.Random) -> str:
    """A recording holds all steps up to the kill, but for the last two seconds; "" if that is so."""
    (folder / "task.py").write_text(TASK.replace("STEPS", str(STEPS)))
    path = folder / "run.rrd"
    printed = killed(("run", "task.py", "--record", path), folder, lambda: size(path) > 0, rng, 6.0)
    if printed is None:
        return "over"
    code, out, error = finished("replay", path, "--script", cwd=folder)
    found, wanted = notes(out), notes("".join(printed))
    whole = found == [str(n) for n in range(len(found))] and len(found) >= len(wanted)
    return "" if code == 0 and whole else f"{len(found)} of {len(wanted)} steps, exit {code}, {error[-300:]}"


def checkpoint(folder: Path, rng: random.Random) -> str:
    """A run that goes on from its checkpoint ends with the report of one that nobody killed."""
    (folder / "task.py").write_text(TASK.replace("STEPS", str(STEPS)))
    path = folder / "run.journal"
    words = ("run", "task.py", "--checkpoint", path)
    if killed(words, folder, lambda: size(path) > 0, rng, 6.0) is None:
        return "over"
    code, _, error = finished(*words, "--resume", "--report", "resumed", cwd=folder)
    if code:
        return f"exit {code}, {error[-300:]}"
    code, _, error = finished("run", "task.py", "--report", "whole", cwd=folder)
    mine, other = (json.loads((folder / name / "report.json").read_text()) for name in ("resumed", "whole"))
    same = all(mine[name] == other[name] for name in ("verdict", "reason", "clashes", "events") if name in other)
    return "" if code == 0 and same else "the report of the resumed run differs"


def study(folder: Path, rng: random.Random) -> str:
    """Results that were written stay, and a resumed study has the answers of one that nobody killed."""
    (folder / "task.py").write_text(STUDY)
    path = folder / "runs" / "results.jsonl"
    words = ("study", "task.py", "--samples", VARIANTS, "--jobs", 1)
    if killed(words, folder, lambda: size(path) > 0, rng, 2.0) is None:
        return "over"
    before = path.read_bytes()
    whole = before[: before.rfind(b"\n") + 1]
    code, out, error = finished(*words, "--resume", "--json", cwd=folder)
    if code != 1:
        return f"exit {code}, {error[-300:]}"
    code, other, _ = finished(*words, "--json", "--out", "other", cwd=folder)
    same = all(json.loads(out)[name] == json.loads(other)[name] for name in ("statuses", "rate", "outcomes", "worst"))
    kept = path.read_bytes().startswith(whole)
    return "" if same and kept else f"results kept: {kept}, answers the same: {same}"


def accept(folder: Path, rng: random.Random) -> str:
    """The file of clashes is the one before or the one after, never half of one."""
    from tests.vpframe.studies.scripts import cube
    from vpframe.scene.stl import write_stl

    mesh = cube()["cube"].mesh
    for i in range(2):
        write_stl(folder / f"{'ab'[i]}.stl", mesh.vertices + 0.003 * i, mesh.triangles)
    status = folder / "status.json"
    words = ("clash", "a.stl", "b.stl", "--status", status)
    finished(*words, cwd=folder)
    before = json.loads(status.read_text())
    killed(("clash", "accept", status, "a:b", "--remark", "x" * 100_000), folder, lambda: True, rng, 1.5)
    after = json.loads(status.read_text())
    code, _, error = finished(*words, cwd=folder)
    accepted = "x" * 100_000 in json.dumps(after)
    same = after == before or accepted
    return "" if same and code == (0 if accepted else 1) else f"exit {code}, {error[-300:]}"


def size(path: Path) -> int:
    """Bytes of a file, 0 if there is none."""
    return path.stat().st_size if path.exists() else 0


KINDS: dict[str, Callable[[Path, random.Random], str]] = {
    "record": record, "checkpoint": checkpoint, "study": study, "accept": accept,
}  # fmt: skip


def row(kind: str, count: int, first: int = 0) -> dict[str, Any]:
    """The line of the table: kills, those that came too late, and what was lost."""
    found: dict[str, Any] = {"what": kind, "first": first, "count": count, "over": 0, "faults": []}
    for seed in range(first, first + count):
        with tempfile.TemporaryDirectory(prefix="vpframe-kills-") as folder:
            said = KINDS[kind](Path(folder), random.Random(f"{kind} {seed}"))
        if said == "over":
            found["over"] += 1
        elif said:
            found["faults"].append({"seed": seed, "why": said})
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--count", type=int, default=25, help="kills of each kind")
    results.arguments(parser)
    given = parser.parse_args()
    results.run(row, given.kinds, given.count, SHARD, given)


if __name__ == "__main__":
    main()
