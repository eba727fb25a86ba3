"""STEP and IGES through OpenCascade in a process of its own, so that nothing the kernel does can end ours."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from vpframe.errors import LoadError
from vpframe.importers.raw import RawScene
from vpframe.importers.step_text import StepText, scan

Progress = Callable[[float, str], None]
READER = "vpframe.importers._reader"


def read(
    path: Path, form: str, deflection: float, angular: float, timeout: float, progress: Progress | None
) -> RawScene:
    """The file's raw scene. `form` is "step" or "iges".

    A shape that crashes the kernel while it is meshed is left out, and named in the notes, by reading again
    without it. Raises LoadError when the file as a whole cannot be read, or not within `timeout` seconds.
    """
    with ThreadPoolExecutor(1) as pool:  # the text is read here while the kernel starts up there
        text = pool.submit(scan, path.read_bytes() if form == "step" else b"DATA;")
        raw = _read_without_crashing(path, form, deflection, angular, timeout, progress, text)
    if form == "step":
        if text.result().damage:
            raw.notes.append(f"damaged: {text.result().damage_summary()}: faces or parts may be missing")
        raw.notes.extend(_missing_files(path, text.result()))
        raw.notes.extend(text.result().lost(raw.instances, raw.faces))
    return raw


def _missing_files(path: Path, text: StepText) -> list[str]:
    return [
        f"{name}, which it refers to, does not lie beside it: put it there"
        for name in text.external
        if not (path.parent / name).exists()
    ]


def _read_without_crashing(
    path: Path,
    form: str,
    deflection: float,
    angular: float,
    timeout: float,
    progress: Progress | None,
    text: Future[StepText],
) -> RawScene:
    skip: list[int] = []
    while True:
        with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
            out = os.path.join(folder, "scene.pickle")
            request = {
                "path": str(path.resolve()),
                "format": form,
                "deflection": deflection,
                "angular": angular,
                "skip": skip,
                "out": out,
            }
            outcome = _run(request, folder, timeout, progress)
            if outcome.done:
                with open(out, "rb") as file:
                    raw: RawScene = pickle.load(file)
                return raw
        where = "; ".join(filter(None, [text.result().damage_summary(), *_missing_files(path, text.result())]))
        if outcome.error is not None:
            raise LoadError(f"{path}: {outcome.error}{f' ({where})' if where else ''}", str(path))
        if outcome.shape is None or outcome.shape in skip:
            damage = f"it is damaged: {where}" if where else "it is probably damaged"
            mend = "open it in a CAD program and export it again"
            message = f"{path}: {_how_it_ended(outcome)} while {outcome.text}; {damage}; {mend}"
            raise LoadError(message, str(path))
        skip.append(outcome.shape)


class _Outcome:
    """What the reading process last said, and how it ended."""

    def __init__(self) -> None:
        self.text = "starting the CAD kernel"
        self.shape: int | None = None
        self.error: str | None = None
        self.done = False
        self.code = 0
        self.timeout: float | None = None
        self.words = ""


def _how_it_ended(outcome: _Outcome) -> str:
    if outcome.timeout is not None:
        return f"no answer within {outcome.timeout:g} s"
    if outcome.code < 0:
        return f"the CAD kernel crashed ({signal.Signals(-outcome.code).name})"
    last = outcome.words.strip().splitlines()[-1:]
    return f"the CAD kernel gave up ({last[0] if last else f'exit code {outcome.code}'})"


def _run(request: dict[str, Any], folder: str, timeout: float, progress: Progress | None) -> _Outcome:
    outcome = _Outcome()
    root = str(Path(__file__).resolve().parents[2])
    environment = dict(os.environ)
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [root, environment.get("PYTHONPATH")]))
    command = [sys.executable, "-m", READER, json.dumps(request)]
    with open(os.path.join(folder, "words"), "w+", encoding="utf-8", errors="replace") as words:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=words,
            env=environment,
            cwd=Path(request["path"]).parent,  # external references resolve against the working directory
            encoding="utf-8",
        )
        watch = threading.Timer(timeout, _give_up, (process, outcome, timeout))
        watch.daemon = True  # Ctrl-C can come anywhere: what it leaves behind must not keep us from ending
        try:
            watch.start()
            assert process.stdout is not None
            for line in process.stdout:
                _hear(json.loads(line), outcome, progress)
            outcome.code = process.wait()
        finally:
            watch.cancel()
            process.kill()
            process.communicate()
        words.seek(0)
        outcome.words = words.read()
    return outcome


def _give_up(process: subprocess.Popen[str], outcome: _Outcome, timeout: float) -> None:
    outcome.timeout = timeout
    process.kill()


def _hear(message: dict[str, Any], outcome: _Outcome, progress: Progress | None) -> None:
    outcome.error = message.get("error")
    outcome.done = message.get("done", False)
    outcome.shape = message.get("shape")
    if "text" in message:
        outcome.text = message["text"]
        if progress is not None:
            progress(message["fraction"], message["text"])
