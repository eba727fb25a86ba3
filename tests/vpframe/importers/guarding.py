"""A reading process that ends."""

from pathlib import Path

import pytest

from vpframe.importers import guarded
from vpframe.importers.guarded import Reading
from vpframe.importers.limits import ReadingLimits


def ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, limits: ReadingLimits) -> Reading:
    """How a process that runs `body` ends."""
    script = tmp_path / "reader.py"
    head = "import json, os, sys, threading, time\ndef say(**message):\n    print(json.dumps(message), flush=True)\n"
    script.write_text(f"{head}{body}\nsay(done=True)\n")
    monkeypatch.setattr(guarded, "READER", script)
    folder = tmp_path / "out"
    folder.mkdir()
    return guarded.run({}, str(folder), Reading(limits, "the reader"))
