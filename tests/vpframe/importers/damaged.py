"""Files that are damaged, and the line that says so."""

from pathlib import Path

import pytest

import vpframe as vp
from vpframe.importers import guarded


def fault(path: Path, **options) -> str:
    with pytest.raises(vp.LoadError) as error:
        vp.load(path, **options)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    assert error.value.path == str(path)
    return message


def written(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


READER = """
import json, os, signal, sys, time
request = json.loads(sys.argv[1])
def say(**message):
    print(json.dumps(message), flush=True)
say(fraction=0.1, text="meshing a", shape=0)
{body}
"""


def stand_in(tmp_path, monkeypatch, body: str) -> None:
    (tmp_path / "stand_in_reader.py").write_text(READER.format(body=body))
    monkeypatch.setattr(guarded, "READER", tmp_path / "stand_in_reader.py")
