"""Files replaced as a whole: whoever reads one finds the old content or the new, never a part of either."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from vpframe.errors import OutputError


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside `path` that takes its place when the block ends without an error.

    The content is on the disk before the file takes its name. A symbolic link stays one, and an old file keeps its
    permissions; a device or pipe is written to as it is.

    Raises
    ------
    OutputError: the file cannot be written (no such folder, no permission, no room); the old one is untouched.
    """
    target = os.path.realpath(path)
    temporary = ""
    try:
        mode = _mode(target)
        if mode is not None and not stat.S_ISREG(mode):
            with open(target, "wb") as file:
                yield file
            return
        temporary = os.path.join(os.path.dirname(target), f".{os.path.basename(target)}.{secrets.token_hex(4)}.tmp")
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            if mode is not None:
                os.chmod(temporary, stat.S_IMODE(mode))
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}", str(path)) from None
    finally:
        if temporary:
            with contextlib.suppress(OSError):  # gone where it has taken its place
                os.unlink(temporary)


def replace(path: str | Path, content: str | bytes) -> None:
    """Write a whole file, text as UTF-8, in the way of `replacing`."""
    with replacing(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def _mode(path: str) -> int | None:
    """Kind and permissions of a file; None if there is none."""
    try:
        return os.stat(path).st_mode
    except FileNotFoundError:
        return None
