"""Cache of imported models in the user's cache folder, by content of their files.

An entry is an archive: numbers and text, no code. Entries are written atomically; damaged ones are read again from the
model. The least recently used entries are removed beyond a total size.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpframe import __version__
from vpframe.importers import archive
from vpframe.importers.raw import RawScene

VARIABLE = "VPFRAME_CACHE"
"""environment variable for another cache folder; empty for none"""
LARGEST = 1 << 30
"""maximum total size, bytes"""
_CODE = ("vpframe/codec.py", "vpframe/importers/**/*.py", "constraints/**/*.py", "collision/tolerance.py")
_PACKAGES = ("cadquery-ocp-novtk", "manifold3d", "trimesh", "numpy")


def folder() -> Path | None:
    """Return the cache folder; None if there is none."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return Path(given) if given else None
    with contextlib.suppress(RuntimeError):  # no home folder
        if sys.platform == "win32":
            home = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        elif sys.platform == "darwin":
            home = Path.home() / "Library" / "Caches"
        else:
            home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(home) / "vpframe" / "models"
    return None


def key_of(files: Iterable[Path], *options: object) -> str:
    """Return the cache key of files, the first of which is loaded with `options`: content, names and versions."""
    digest = hashlib.sha256(_versions())
    digest.update(repr(options).encode())
    for file in files:
        data = file.read_bytes()
        digest.update(f"{file.name}\0{len(data)}\0".encode())
        digest.update(data)
    return digest.hexdigest()


def key_of_arrays(*arrays: NDArray[Any]) -> str:
    """Return the cache key of what is computed from arrays: content, shapes, types and versions."""
    digest = hashlib.sha256(_versions())
    for array in arrays:
        digest.update(f"{array.shape} {array.dtype}\0".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@functools.cache
def _versions() -> bytes:
    """Digest of the code and packages that determine the result."""
    digest = hashlib.sha256(f"{__version__} {sys.version}".encode())
    root = Path(__file__).parents[2]
    for file in sorted(file for pattern in _CODE for file in root.glob(pattern)):
        digest.update(file.read_bytes())
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            digest.update(f"{package} {importlib.metadata.version(package)}\0".encode())
    return digest.digest()


def find(key: str) -> RawScene | None:
    """Return the entry of a key; None if it is missing or unreadable."""
    place = folder()
    if place is None:
        return None
    path = place / f"{key}.archive"
    try:
        raw = archive.read(path)
    except archive.ArchiveError:
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    except OSError:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # last use
    return raw


def keep(key: str, raw: RawScene) -> None:
    """Write an entry, and remove the oldest ones beyond `LARGEST`. Errors are ignored."""
    place = folder()
    if place is None:
        return
    with contextlib.suppress(OSError):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(suffix=".tmp", dir=place)
        os.close(handle)
        try:
            archive.write(raw, name)
            os.replace(name, place / f"{key}.archive")
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(name)
            raise
        _tidy(place)


def _tidy(place: Path) -> None:
    """Remove the least recently used entries beyond `LARGEST`, and incomplete files."""
    found = []
    for file in place.iterdir():
        if file.suffix in (".archive", ".tmp"):
            with contextlib.suppress(OSError):  # another process may remove it too
                status = file.stat()
                found.append((status.st_mtime, status.st_size, file))
    total = 0
    for _, size, file in sorted(found, reverse=True):
        total += size
        if total > LARGEST:
            with contextlib.suppress(OSError):
                file.unlink()
