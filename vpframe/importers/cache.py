"""What was read of a model, kept in the user's cache folder under the content it was read from.

An entry is an archive: numbers and text, nothing that runs. It is written beside its place and then moved there, so
that two processes do not meet half of it; a damaged one is read anew. The oldest entries go when there are too many.
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

from vpframe import __version__
from vpframe.importers import archive
from vpframe.importers.raw import RawScene

VARIABLE = "VPFRAME_CACHE"
"""environment variable: another folder for it; empty for none"""
LARGEST = 1 << 30
"""bytes of all entries together"""
_CODE = ("vpframe/codec.py", "vpframe/importers/**/*.py", "constraints/**/*.py", "collision/tolerance.py")
_PACKAGES = ("cadquery-ocp-novtk", "trimesh", "numpy")


def folder() -> Path | None:
    """Where entries lie; None where there is no cache."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return Path(given) if given else None
    with contextlib.suppress(RuntimeError):  # nobody's home
        if sys.platform == "win32":
            home = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        elif sys.platform == "darwin":
            home = Path.home() / "Library" / "Caches"
        else:
            home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(home) / "vpframe" / "models"
    return None


def key_of(files: Iterable[Path], *options: object) -> str:
    """The name of the entry for these files, the first of which is loaded with `options`: content, names, versions."""
    digest = hashlib.sha256(_versions())
    digest.update(repr(options).encode())
    for file in files:
        data = file.read_bytes()
        digest.update(f"{file.name}\0{len(data)}\0".encode())
        digest.update(data)
    return digest.hexdigest()


@functools.cache
def _versions() -> bytes:
    """What the result depends on besides the file: the code that reads, and the packages it calls."""
    digest = hashlib.sha256(f"{__version__} {sys.version}".encode())
    root = Path(__file__).parents[2]
    for file in sorted(file for pattern in _CODE for file in root.glob(pattern)):
        digest.update(file.read_bytes())
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            digest.update(f"{package} {importlib.metadata.version(package)}\0".encode())
    return digest.digest()


def find(key: str) -> RawScene | None:
    """The entry of that name; None when there is none that can be read."""
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
        os.utime(path)  # used just now
    return raw


def keep(key: str, raw: RawScene) -> None:
    """Write an entry, and remove the oldest if all are larger than `LARGEST`. Where nothing can be written, nothing
    is."""
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
    """Remove the entries used longest ago until the others are within `LARGEST`, half-written ones too."""
    found = []
    for file in place.iterdir():
        if file.suffix in (".archive", ".tmp"):
            with contextlib.suppress(OSError):  # another process removes too
                status = file.stat()
                found.append((status.st_mtime, status.st_size, file))
    total = 0
    for _, size, file in sorted(found, reverse=True):
        total += size
        if total > LARGEST:
            with contextlib.suppress(OSError):
                file.unlink()
