"""The reading process: one CAD file in, one pickled `RawScene` out. Run as `python -m vpframe.importers._reader`.

It runs apart because the kernel can crash on a damaged file and writes to standard output as it pleases. Its own
standard output carries nothing but lines of JSON: `{"fraction", "text", "shape"}` as it goes on, `{"error"}` when the
file cannot be used. It ends when its standard input is closed: then nobody waits for it any more.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import threading
from typing import Any, TextIO

from vpframe.importers.raw import UnreadableError


def main() -> None:
    """Read what the arguments (JSON) ask for; tell what happens on the channel that standard output was."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    request = json.loads(sys.argv[1])
    try:
        raw = _read(request, channel)
    except UnreadableError as error:
        _say(channel, error=str(error))
        return
    with open(request["out"], "wb") as out:
        pickle.dump(raw, out, protocol=pickle.HIGHEST_PROTOCOL)
    _say(channel, fraction=1.0, text="read", done=True)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


def _say(channel: TextIO, **message: Any) -> None:
    channel.write(json.dumps(message) + "\n")
    channel.flush()


def _read(request: dict[str, Any], channel: TextIO) -> Any:
    _say(channel, fraction=0.0, text="starting the CAD kernel")
    from vpframe.importers.document import read_document

    def progress(fraction: float, text: str, shape: int | None = None) -> None:
        _say(channel, fraction=fraction, text=text, shape=shape)

    return read_document(
        request["path"],
        request["format"],
        request["deflection"],
        request["angular"],
        frozenset(request["skip"]),
        progress,
    )


if __name__ == "__main__":
    main()
