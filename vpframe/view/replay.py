"""Open a recording: in rerun's viewer, or as a list of its events."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from vpframe.errors import LoadError
from vpframe.text import plain
from vpframe.view.screen import has_screen

HEADER = 12
"""bytes of a recording before its first message"""


@dataclass(frozen=True)
class EventLine:
    """A line of a recording's log: an event, or the script's line ("script")."""

    step: int
    time: float
    """s"""
    kind: str
    text: str


def replay(path: str | Path, script: bool = False) -> int:
    """Open a recording in rerun's viewer, or with `script` print its events and the script's lines.

    Without a screen the viewer is served to the browser, on this machine only. Returns an exit code.

    Raises LoadError when the file is missing or is not a recording.
    """
    path = Path(path)
    if script:
        for line in lines(path):
            print(f"{line.time:10.3f} s  step {line.step:6d}  {plain(line.kind):11s} {plain(line.text)}")
        return 0
    _check(path)
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        shown = _whole(path, Path(folder))
        return subprocess.run(command(shown), env={**os.environ, "RERUN_ANALYTICS": "0"}, check=False).returncode


def command(path: Path) -> list[str]:
    """Return rerun's command: a window if there is a screen, else a server; both listen to loopback only."""
    beside = Path(sys.executable).with_name("rerun")
    program = str(beside) if beside.exists() else (shutil.which("rerun") or "rerun")
    where = ["--port", "auto"] if has_screen() else ["--serve-web", "--web-viewer-port", "0"]
    return [program, "--bind", "127.0.0.1", *where, str(path)]


def lines(path: str | Path) -> list[EventLine]:
    """Return events and the script's lines of a recording, in order; of an incomplete one, those it has."""
    found: list[EventLine] = []
    order = {"events": 0, "script": 1}
    for entity, rows in tables(path, tuple(order)):
        for row in rows:
            if "TextLog:text" in row:
                kind, _, text = row["TextLog:text"][0].partition(": ")
                found.append(EventLine(row["step"], row["time"], kind, text))
            elif row.get("TextDocument:text"):
                found.append(EventLine(row["step"], row["time"], entity, row["TextDocument:text"][0]))
    return sorted(found, key=lambda line: (line.step, line.kind != "script"))


def tables(path: str | Path, entities: tuple[str, ...] | None = None) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Rows of each chunk of a recording, in the file's order: entity path (without the first slash) and dictionaries.

    A row has "step" and "time" (s) unless it is static, and its components by name ("Scalars:scalars", …).
    `entities` keeps only those named.

    Raises LoadError when the file is missing or is not a recording.
    """
    path = Path(path)
    _check(path)
    from rerun.chunk import RrdReader

    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an incomplete recording has no index at its end
        try:
            for chunk in RrdReader(_whole(path, Path(folder))).stream():
                entity = str(chunk.entity_path).lstrip("/")
                if entities is None or entity in entities:
                    yield entity, _rows(chunk.to_record_batch())
        except (RuntimeError, ValueError, OSError) as error:
            raise LoadError(f"{path}: rerun cannot read it: {_first_line(error)}", str(path)) from None


def _whole(path: Path, folder: Path) -> Path:
    """Return the recording, or a copy without its incomplete last message, which rerun cannot read."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - 12, 0))
        if file.read(8) == b"RRF2FOOT":
            return path
        end = messages_end(file)
    if end == size or end <= HEADER:
        return path
    copy = folder / path.name
    shutil.copyfile(path, copy)
    os.truncate(copy, end)
    return copy


def messages_end(file: BinaryIO) -> int:
    """Return the end of a recording's last complete message, in bytes, without the index of messages.

    The format (RRF2): 12 bytes of header; messages that begin with 16 bytes, their kind and how many bytes follow; and,
    when rerun closed the stream itself, the index, of kind 0, with 32 bytes behind it that end in RRF2FOOT and a
    version. Recordings without an index are read just as well.
    """
    size, end = file.seek(0, os.SEEK_END), HEADER
    while end + 16 <= size:
        file.seek(end)
        kind, length = struct.unpack("<QQ", file.read(16))
        if kind == 0 or end + 16 + length > size:
            break
        end += 16 + length
    return end


def _rows(batch: Any) -> list[dict[str, Any]]:
    names, columns = [], []
    for name, column in zip(batch.schema.names, batch.columns, strict=True):
        if name == "time":
            columns.append([ns * 1e-9 for ns in column.cast("int64").to_pylist()])
        else:
            columns.append(column.to_pylist())
        names.append(name)
    rows = [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
    return [{name: value for name, value in row.items() if value is not None} for row in rows]


def _check(path: Path) -> None:
    try:
        with path.open("rb") as file:
            start = file.read(4)
    except OSError as error:
        raise LoadError(f"{path}: cannot be read: {error.strerror}", str(path)) from None
    if start[:3] != b"RRF":
        raise LoadError(f"{path}: not a rerun recording; give a file that --record wrote", str(path))


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
