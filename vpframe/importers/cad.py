"""STEP and IGES through OpenCascade in a separate process, so that a crash of the kernel cannot end this one.

The process is isolated: it imports nothing from the folders of file, script or user, has limits of memory and time, and
ends with its parent.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from vpframe.errors import LoadError
from vpframe.importers import archive
from vpframe.importers.checks import FORMATS, iges_damage
from vpframe.importers.raw import RawScene, RawShape
from vpframe.importers.step_text import StepText, scan

Progress = Callable[[float, str], None]
READER = Path(__file__).with_name("_reader.py")
MEGABYTE = 1e6
MEMORY = 1_750_000_000
"""memory for reading, bytes, plus MEMORY_OF_SIZE times the size of the files: below 2 GB with the kernel's code. The
idle kernel takes 0.25 GB; measured models took below 80 bytes for each byte (um2_head: 0.05 GB for 2.6 MB)."""
MEMORY_OF_SIZE = 200
CROWDED = 0.4
"""fraction of the memory above which a crash counts as lack of memory, since growing arrays are copied to twice
their size"""

_THRIFTY = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "8"}
"""keeps idle threads on machines with many cores from taking memory"""
SAMPLING = 0.02
"""s between two looks at the memory of the process"""
_PEAK = re.compile(r"VmHWM:\s+(\d+) kB")
_EXTERNAL = re.compile(rb"DOCUMENT_FILE\s*\(\s*'((?:[^']|'')+)'")


def files_of(path: Path, form: str) -> list[Path]:
    """Return the file and all existing files that a STEP assembly refers to, directly or indirectly."""
    found = [path]
    for file in found:
        if form == "step":
            names = (name.replace(b"''", b"'").decode("utf-8", "replace") for name in _EXTERNAL.findall(_bytes(file)))
            beside = (file.parent / name for name in dict.fromkeys(names))
            found.extend(other for other in beside if other not in found and other.is_file())
    return found


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise LoadError(f"{file}: cannot be read ({error.strerror}); check its permissions", str(file)) from None


def time_limit(size: int) -> float:
    """Default time limit for reading `size` bytes, s: one minute for each megabyte, at least one."""
    return 60.0 * max(1.0, size / MEGABYTE)


def read(
    files: Sequence[Path],
    form: str,
    deflection: float,
    angular: float,
    timeout: float | None,
    progress: Progress | None,
    settle: Callable[[RawShape], RawShape],
    given: Sequence[Any] = (),
) -> RawScene:
    """Return the raw scene of a file; `form` is "step", "iges", "brep" or "mjcf"; `files`: it and those it refers to.

    "given" is a tree of B-reps in `files`: `given` are its roots in the form of `_reader`. `settle` is called with each
    shape while the kernel process continues.

    A shape that crashes the kernel or exceeds time or memory is left out by reading again without it, and named in the
    notes. Raises LoadError if the file cannot be read within `timeout` seconds (default `time_limit`), or its unit of
    length is unknown.
    """
    path = files[0]
    with ThreadPoolExecutor(1) as pool:  # reads the text while the kernel starts
        texts = pool.submit(lambda: [scan(_bytes(file)) for file in files] if form == "step" else [])
        faults = _Faults(files, texts)
        raw = _read_without_crashing(path, form, deflection, angular, timeout, progress, settle, faults, given)
    if form == "iges" and (damage := iges_damage(_bytes(path))):
        raw.notes.append(f"{damage}: faces or parts may be missing")
    if form == "step":
        text = texts.result()[0]
        if text.damage:
            raw.notes.append(f"damaged: {text.damage_summary()}: faces or parts may be missing")
        if any(t.no_unit for t in texts.result()):
            raw.notes.append("names no length unit for some of its shapes: millimetres are taken")
        for file, own in zip(files, texts.result(), strict=True):
            raw.notes.extend(_missing_files(file, own))
        raw.notes.extend(text.lost(raw.instances, raw.faces))
    return raw


class _Faults:
    """The files of a model, and the faults that their text reveals."""

    def __init__(self, files: Sequence[Path], texts: Future[list[StepText]]) -> None:
        self.files = files
        self.size = sum(file.stat().st_size for file in files)
        self._texts = texts

    def check_units(self) -> None:
        """Raise LoadError for a unit of length that the kernel would misread."""
        for file, text in zip(self.files, self._texts.result(), strict=False):
            if text.unit_fault:
                raise LoadError(f"{file}: {text.unit_fault}; export it again, in millimetres", str(self.files[0]))

    def end_if_refused(self, process: subprocess.Popen[str]) -> None:
        """Kill the reading process as soon as the text shows a refused unit of length, since it may take long."""

        def look(texts: Future[list[StepText]]) -> None:
            if not texts.cancelled() and texts.exception() is None and any(t.unit_fault for t in texts.result()):
                process.kill()

        self._texts.add_done_callback(look)

    def damage(self) -> str:
        """Describe damaged or missing data in one line; empty if there is none."""
        if not self._texts.result():
            return ""
        text = self._texts.result()[0]
        missing = (
            line
            for file, own in zip(self.files, self._texts.result(), strict=True)
            for line in _missing_files(file, own)
        )
        return "; ".join(filter(None, [text.damage_summary(), *missing]))


def _missing_files(path: Path, text: StepText) -> list[str]:
    """Return a line for each referenced file that is missing or no STEP file."""
    lines = []
    for name in dict.fromkeys(text.external):
        if not (path.parent / name).exists():
            lines.append(f"{name}, which {path.name} refers to, does not lie beside it: put it there")
        elif FORMATS.get(Path(name).suffix.lower()) != "step":
            lines.append(f"{name}, which {path.name} refers to, is no STEP file: what it holds is left out")
    return lines


def _read_without_crashing(
    path: Path,
    form: str,
    deflection: float,
    angular: float,
    timeout: float | None,
    progress: Progress | None,
    settle: Callable[[RawShape], RawShape],
    faults: _Faults,
    given: Sequence[Any],
) -> RawScene:
    limit = time_limit(faults.size) if timeout is None else timeout
    memory = MEMORY + MEMORY_OF_SIZE * faults.size
    skip: dict[int, str] = {}
    late = False
    while True:
        request = {
            "path": str(path.resolve()),
            "format": form,
            "deflection": deflection,
            "angular": angular,
            "skip": skip,
            "memory": memory,
            "folders": _package_folders(path.resolve().parent),
            "given": given,
        }
        outcome, raw = _read_once(request, limit, progress, settle, faults)
        if raw is not None:
            raw.whole = not skip
            return raw
        where = faults.damage()
        if outcome.error is not None:
            raise LoadError(f"{path}: {outcome.error}{f' ({where})' if where else ''}", str(path))
        if outcome.shape is None or outcome.shape in skip or (outcome.late and late):
            damage = f"it is damaged: {where}" if where else "it is probably damaged"
            mend = "open it in a CAD program and export it again"
            how = outcome.how_it_ended(limit, memory)
            if outcome.late and timeout is None:
                how += f", the limit for {faults.size / MEGABYTE:.1f} MB,"
            if (outcome.late or outcome.memory) and not where:
                damage = f"it is damaged, or takes a coarser deflection{' or a longer timeout' if outcome.late else ''}"
            raise LoadError(f"{path}: {how} while {outcome.text}; {damage}; {mend}", str(path))
        late |= outcome.late
        skip[outcome.shape] = outcome.what_is_wrong(limit, memory)


def _read_once(
    request: dict[str, Any],
    limit: float,
    progress: Progress | None,
    settle: Callable[[RawShape], RawShape],
    faults: _Faults,
) -> tuple[_Outcome, RawScene | None]:
    """Run the process once; return its outcome, and on success the raw scene. Shapes are settled meanwhile."""
    worker = ThreadPoolExecutor(1)
    shapes: list[Future[RawShape]] = []
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:

        def ready(number: int) -> None:
            archived = os.path.join(folder, f"{number}.archive")
            shapes.append(worker.submit(lambda: settle(archive.read(archived).shapes[0])))

        try:
            outcome = _run({**request, "out": folder}, folder, limit, progress, ready, faults.end_if_refused)
            faults.check_units()
            if not outcome.done:
                return outcome, None
            raw = archive.read(os.path.join(folder, "scene.archive"))
            raw.shapes = [shape.result() for shape in shapes]
            return outcome, _without_empty(raw, faults.files[0])
        finally:
            worker.shutdown(cancel_futures=True)


def _without_empty(raw: RawScene, path: Path) -> RawScene:
    """Return the scene without parts that lost all faces (triangles of zero area); its notes name them."""
    empty = [not shape.faces for shape in raw.shapes]
    if not any(empty):
        return raw
    lost = [part.name for part in raw.parts if empty[part.shape]]
    raw.notes.extend(f"part {name} is lost: it has no triangle of positive area" for name in lost)
    raw.parts = [part for part in raw.parts if not empty[part.shape]]
    if not raw.parts:
        raise LoadError(f"{path}: holds no triangle of positive area; check it in a CAD program", str(path))
    place = np.cumsum([not each for each in empty]) - 1
    for part in raw.parts:
        part.shape = int(place[part.shape])
    raw.shapes = [shape for shape in raw.shapes if shape.faces]
    return raw


def _package_folders(beside: Path) -> list[str]:
    """Return the folders of the packages that reading needs, for a Python that does not find them by itself.

    The file's own folder is never included.
    """
    folders = []
    for name in ("OCP", "numpy"):
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            folder = Path(spec.origin).resolve().parent.parent
            if folder != beside and str(folder) not in folders:
                folders.append(str(folder))
    return folders


class _Outcome:
    """Last message of the reading process, and how it ended."""

    def __init__(self) -> None:
        self.text = "starting the CAD kernel"
        self.shape: int | None = None
        self.error: str | None = None
        self.done = self.late = self.memory = False
        self.code = self.peak = 0
        self.words = ""

    def hear(self, message: dict[str, Any], progress: Progress | None, ready: Callable[[int], None]) -> None:
        """Process one message of the process."""
        if "ready" in message:
            ready(message["ready"])
            return
        if message.get("memory"):
            self.memory = True
            return
        self.error = message.get("error")
        self.done = message.get("done", False)
        self.shape = message.get("shape")
        if "text" in message:
            self.text = message["text"]
            if progress is not None:
                progress(message["fraction"], message["text"])

    def how_it_ended(self, limit: float, memory: float) -> str:
        """Describe how the process ended; `limit` in s, `memory` in bytes."""
        if self.late:
            return f"no answer within {limit:g} s"
        if self.memory:
            return f"more than {memory / 1e9:.1f} GB of memory are needed"
        if self.code < 0:
            return f"the CAD kernel crashed ({signal.Signals(-self.code).name})"
        last = self.words.strip().splitlines()[-1:]
        return f"the CAD kernel gave up ({last[0] if last else f'exit code {self.code}'})"

    def what_is_wrong(self, limit: float, memory: float) -> str:
        """Describe why the shape being meshed failed."""
        if self.late:
            return f"is not meshed within {limit:g} s"
        return f"takes more than {memory / 1e9:.1f} GB to mesh" if self.memory else "crashes the CAD kernel"


def _run(
    request: dict[str, Any],
    folder: str,
    limit: float,
    progress: Progress | None,
    ready: Callable[[int], None],
    begun: Callable[[subprocess.Popen[str]], None],
) -> _Outcome:
    outcome = _Outcome()
    command = [sys.executable, "-I", str(READER), json.dumps(request)]
    empty = os.path.join(folder, "empty")
    os.mkdir(empty)
    with open(os.path.join(folder, "words"), "w+", encoding="utf-8", errors="replace") as words:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=words,
            cwd=empty,
            env={**os.environ, **_THRIFTY},
            encoding="utf-8",
        )
        watch = threading.Timer(limit, _give_up, (process, outcome))
        watch.daemon = True  # so that an interrupt at any point cannot keep this process alive
        try:
            watch.start()
            threading.Thread(target=_watch_memory, args=(process.pid, outcome), daemon=True).start()
            begun(process)
            assert process.stdout is not None
            for line in process.stdout:
                outcome.hear(json.loads(line), progress, ready)
            process.wait()
            outcome.code = process.returncode
        finally:
            watch.cancel()
            process.kill()
            process.communicate()
        words.seek(0)
        outcome.words = words.read()
    outcome.memory |= "bad_alloc" in outcome.words
    outcome.memory |= outcome.code < 0 and not outcome.late and outcome.peak > CROWDED * request["memory"]
    return outcome


def _watch_memory(pid: int, outcome: _Outcome) -> None:
    """Keep the peak memory of a process until it ends; on Linux.

    What the system tells at its end begins with the peak of the process that started it.
    """
    with contextlib.suppress(OSError):
        while found := _PEAK.search(Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")):
            outcome.peak = 1024 * int(found[1])
            time.sleep(SAMPLING)


def _give_up(process: subprocess.Popen[str], outcome: _Outcome) -> None:
    outcome.late = True
    process.kill()


def in_kernel(request: dict[str, Any], folder: str, limit: float, size: int) -> str:
    """Run a request other than reading in the process; return the reason of a failure, "" on success.

    folder: temporary folder for its output. limit: s. size: of its input, bytes.
    """
    memory = MEMORY + MEMORY_OF_SIZE * size
    whole = {**request, "memory": memory, "folders": _package_folders(Path(folder))}
    outcome = _run(whole, folder, limit, None, lambda number: None, lambda process: None)
    if outcome.done:
        return ""
    return outcome.error or outcome.how_it_ended(limit, memory)
