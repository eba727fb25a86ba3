"""Atomic replacement of files: a reader sees the old content or the new, never a mixture."""

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
    """Open a temporary file beside `path` that replaces it if the block ends without an error.

    The content is flushed to disk before the replacement. Symbolic links and the permissions of an old file are kept;
    devices and pipes are written directly.

    Raises
    ------
    OutputError: the file cannot be written (no such folder, no permission, no space); the old one is untouched.
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
            with contextlib.suppress(OSError):  # it does not exist after the replacement
                os.unlink(temporary)


def replace(path: str | Path, content: str | bytes) -> None:
    """Write a whole file atomically, text as UTF-8."""
    with replacing(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def _mode(path: str) -> int | None:
    """File type and permissions; None if there is no file."""
    try:
        return os.stat(path).st_mode
    except FileNotFoundError:
        return None
