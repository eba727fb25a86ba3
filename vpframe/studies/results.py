"""`results.jsonl`: one line of JSON per finished variant, appended at once; a killed study resumes from it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from io import FileIO
from types import TracebackType
from typing import Any

from vpframe.errors import OutputError, VpframeError
from vpframe.outputs import OutputFolder, append
from vpframe.studies.distributions import is_number
from vpframe.studies.variants import Variant

FILE = "results.jsonl"
SYNC = 1.0
"""s between two syncs to disk: a power cut loses at most the lines since the last one, a killed process none"""
STATUSES = ("ok", "no", "error", "crashed", "timeout")
UNANSWERED = ("crashed", "timeout")
"""statuses without an answer, because a process was ended: another run may answer"""
ANSWER = ("status", "reason", "clearance", "measures", "time", "steps")
"""fields of a record that are the same, bit for bit, in every run of the variant on any machine"""
Record = dict[str, Any]


def record(key: str, variant: Variant, outcome: dict[str, Any], timeout: float, repeat: bool) -> Record:
    """Return the record of a variant: its key and values, then its outcome."""
    head = {"key": key, "index": variant.index, "parameters": dict(variant.parameters), "timeout": timeout}
    return head | ({"repeat": True} if repeat else {}) | outcome


def answer(one: Record) -> str:
    """Return the fields `ANSWER` of a record as text."""
    return json.dumps([one[name] for name in ANSWER], sort_keys=True)


class Results:
    """The records of a study, read from its folder and appended to there.

    Parameters
    ----------
    folder: claimed by the run that writes there.
    variants: by key, what the study consists of; records of others stay in the file and are not read.
    timeout: s; a variant that a smaller limit ended counts as missing.
    resume: take the records there as finished.

    Raises
    ------
    VpframeError: there are results and `resume` is false.
    OutputError: the file cannot be read or written.
    """

    def __init__(self, folder: OutputFolder, variants: Mapping[str, Variant], timeout: float, resume: bool) -> None:
        self.path = folder.file(FILE)
        self.records: dict[str, Record] = {}
        """first finished run of each variant, by key"""
        self.repeats: dict[str, Record] = {}
        """second runs of variants, by key"""
        self.unreadable = 0
        """number of lines that are no records: a killed study may leave its last line incomplete"""
        try:
            content = self.path.read_bytes() if self.path.exists() else b""
            if content and not resume:
                raise VpframeError(f"{self.path}: holds results; --resume runs what is missing, or give another --out")
            for line in filter(None, content.split(b"\n")):
                self._take(line, variants, timeout)
            self._file = FileIO(self.path, "a")
            if content and not content.endswith(b"\n"):
                append(self._file, b"\n")
        except OSError as error:
            raise self._unwritable(error) from None
        self._synced = time.monotonic()

    def add(self, one: Record) -> None:
        """Append a record. Raises OutputError: there is no room, for example."""
        (self.repeats if one.get("repeat") else self.records)[one["key"]] = one
        try:
            append(self._file, json.dumps(one, allow_nan=False).encode() + b"\n")
            if time.monotonic() - self._synced > SYNC:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            raise self._unwritable(error) from None

    def _take(self, line: bytes, variants: Mapping[str, Variant], timeout: float) -> None:
        one = _parsed(line)
        if one is None:
            self.unreadable += 1
        elif one["key"] in variants and not (one["status"] == "timeout" and one["timeout"] < timeout):
            variant = variants[one["key"]]
            one |= {"index": variant.index, "parameters": dict(variant.parameters)}
            (self.repeats if one.get("repeat") else self.records)[one["key"]] = one

    def _unwritable(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot be written: {error.strerror}", str(self.path))

    def __enter__(self) -> Results:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with self._file:
            os.fsync(self._file.fileno())


_TYPES: dict[str, tuple[type, ...]] = {
    "key": (str,), "status": (str,), "reason": (str,), "measures": (dict,), "worker": (str,), "attempts": (int,),
    "timeout": (int, float),
    **dict.fromkeys(("clearance", "time", "steps", "seconds", "memory"), (int, float, type(None))),
}  # fmt: skip


def _parsed(line: bytes) -> Record | None:
    """Return the record of a line; None if the line is incomplete or no record."""
    try:
        one = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(one, dict) or not all(isinstance(one.get(name), kinds) for name, kinds in _TYPES.items()):
        return None
    values = [*one["measures"].values(), *(one[name] for name in _TYPES if name not in ("measures", "timeout"))]
    plain = all(value is None or isinstance(value, str) or is_number(value) for value in values)
    return one if plain and one["status"] in STATUSES else None
