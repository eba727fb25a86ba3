"""Output files of a run: only files written by vpframe are replaced, by one run at a time, and never its inputs.

An `Output` is claimed before the work begins, which changes nothing in the file. A file is recognised by its content,
not its name; empty files may be replaced, devices and pipes are written directly. The lock is a kernel lock on the file
or folder and ends with the process. Systems and network drives without such locks are not locked.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import stat
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Self

from vpframe.errors import OutputError
from vpframe.text import csv_text

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

GENERATOR = "vpframe"
"""name of the generator in file formats that state one"""
HEAD = 4096
"""bytes at the start of a file that are checked"""


@dataclass(frozen=True)
class Kind:
    """A kind of file: name in messages, and test whether vpframe wrote it."""

    name: str
    recognise: Callable[[Path], bool]


def _begins(pattern: bytes) -> Callable[[Path], bool]:
    begin = re.compile(pattern, re.DOTALL)

    def recognise(path: Path) -> bool:
        with path.open("rb") as file:
            return begin.match(file.read(HEAD)) is not None

    return recognise


def _holds(mark: bytes) -> Callable[[Path], bool]:
    """Recognise a mark anywhere in the file, for binary formats with a generator at varying positions."""
    return lambda path: mark in path.read_bytes()


def _is_status(path: Path) -> bool:
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        return False
    return isinstance(content, dict) and "clashes" in content and content.keys() <= {"clashes", "authorised", "version"}


RECORDING = Kind("a recording", _begins(rb"RRF.{,200}\x0a\x07vpframe"))
CHECKPOINT = Kind("a checkpoint", _begins(rb"vpframe \w+"))
STATUS = Kind("a clash status file", _is_status)
URDF = Kind("a URDF file", _begins(rb"(<\?xml[^>]*>\s*)?<!-- vpframe"))
MESH = Kind("a mesh", _begins(rb"vpframe[^\n]{73}"))
MODEL = Kind("a model", _begins(rb"ISO-10303-21;.*'vpframe'"))
GLB = Kind("a GLB file", _begins(rb'glTF.{16}\{"asset":\{"generator":"vpframe"'))
MJCF = Kind("an MJCF file", _begins(rb"<!-- vpframe"))
USD = Kind("a USD file", _holds(b"vpframe"))
POSES = Kind("a table of poses", _begins(rb"part,t,x,y,z,qx,"))
PARQUET = Kind("a table", _holds(b"vpframe"))
BCF = Kind("a BCF file", _holds(b"vpframe"))
PAGE = Kind("a page", _begins(rb'<!DOCTYPE html>.*<meta name="generator" content="vpframe">'))
REPORT = Kind("a report", _begins(rb'\{\s*"generator": "vpframe"'))
CLASHES = Kind("a list of clashes", _begins(rb"status,part_a,surface_a,part_b,surface_b,"))
RESULTS = Kind("results of a study", _begins(rb'\{"key": "'))
TABLE = Kind("a table of a study", _begins(rb"index,status,reason,clearance,"))
VARIANT = Kind("the script of a variant", _begins(rb"# Variant \d+ of a study"))
RULES = Kind("", lambda path: False)
SCRIPT = Kind("", lambda path: False)
"""users edit rules and scripts, so that they are replaced only with `force`"""

REPORT_FILES = {
    "index.html": PAGE,
    "report.json": REPORT,
    "scene.html": PAGE,
    "clashes.csv": CLASHES,
    "clashes.json": STATUS,
}
"""files in a report folder"""
STUDY_FILES = {"results.jsonl": RESULTS, "results.csv": TABLE, "index.html": PAGE, "study.json": REPORT}
"""files in a study's folder, besides scripts of variants in `worst/`"""


def table_of(columns: Iterable[str]) -> Kind:
    """Return the kind of a table with these columns."""
    return Kind("a table of these columns", _begins(re.escape(csv_text([columns]).rstrip("\n").encode())))


def may_write(path: str | os.PathLike[str], kind: Kind, force: bool = False) -> Path:
    """Return the path if it does not exist, was written by vpframe as `kind`, or with `force`.

    Raises
    ------
    OutputError: another file exists, or it cannot be read.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise OutputError(f"{path}: is a folder; give the name of a file", str(path))
        if force or not stat.S_ISREG(mode) or path.stat().st_size == 0 or kind.recognise(path):
            return path
    except FileNotFoundError:
        return path
    except OSError as error:
        raise _unwritable(path, error) from None
    what = f"exists and is not {kind.name} that vpframe wrote" if kind.name else "exists already"
    raise OutputError(f"{path}: {what}; give another name, or replace it with --force", str(path))


class _Claim:
    """A run's claim on a path, until `close`. Can be used as the path.

    path: the file or folder. inputs: files that the run reads.
    """

    def __init__(self, path: str | os.PathLike[str], force: bool, inputs: Iterable[str | os.PathLike[str]]) -> None:
        self.path = Path(path)
        self.force = force
        self.inputs = tuple(inputs)
        self._fd = -1
        self._made = False

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def _files(self) -> Iterable[Path]:
        """Return the files that the run writes."""
        return (self.path,)

    def spare(self, *inputs: str | os.PathLike[str]) -> None:
        """Raise OutputError if a file that the run writes is one of its inputs."""
        self.inputs += inputs
        for file in self._files():
            _spare(file, inputs)

    def close(self) -> None:
        """Release the claim."""
        if self._fd >= 0:
            if fcntl is not None:
                with contextlib.suppress(OSError):
                    fcntl.flock(self._fd, fcntl.LOCK_UN)  # a forked child may still have it open
            os.close(self._fd)
            self._fd = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_fd"):
            self.close()


class Output(_Claim):
    """A run's claim on an output file. Can be used as a path.

    Parameters
    ----------
    path: the file. A missing file is created empty, with its folders; what is empty at the end is removed again.
    kind: kind of the output.
    force: replace any existing file.
    inputs: files that the run reads; they are never replaced.

    Raises
    ------
    OutputError: the file is not ours, an input, locked by another run, or cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        kind: Kind,
        force: bool = False,
        inputs: Iterable[str | os.PathLike[str]] = (),
    ) -> None:
        super().__init__(path, force, inputs)
        self._folders: list[Path] = []
        _spare(self.path, self.inputs)
        may_write(self.path, kind, force)  # before opening it for writing
        try:
            missing = [folder for folder in self.path.parents if not folder.exists()]
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._folders = missing
            self._lock()
            self.ours = os.fstat(self._fd).st_size > 0 and kind.recognise(self.path)
            """whether it has content from an earlier run"""
            may_write(self.path, kind, force)  # again, now with the lock
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unwritable(self.path, error) from None
            raise

    def _lock(self) -> None:
        """Open and lock the file; repeat if another run removed it in between."""
        while True:
            made = True
            try:
                self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
            except FileExistsError:
                made = False
                self._fd = os.open(self.path, os.O_RDWR)
            if not stat.S_ISREG(os.fstat(self._fd).st_mode):
                return
            _lock(self._fd, self.path)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(self._fd), os.stat(self.path)):
                    self._made = made
                    return
            os.close(self._fd)

    def open(self, keep: int = 0) -> FileIO:
        """Open the file for writing after its first `keep` bytes; close it before the claim."""
        try:
            file = FileIO(os.dup(self._fd), "r+")
            if stat.S_ISREG(os.fstat(self._fd).st_mode):
                file.truncate(keep)
                file.seek(keep)
        except OSError as error:
            raise _unwritable(self.path, error) from None
        return file

    def close(self) -> None:
        """Release the claim."""
        if self._fd >= 0:
            with contextlib.suppress(OSError):
                here = os.fstat(self._fd)
                if self._made and here.st_size == 0 and os.path.samestat(here, os.stat(self.path)):
                    os.unlink(self.path)
        super().close()
        with contextlib.suppress(OSError):  # not empty
            while self._folders:
                self._folders.pop(0).rmdir()
        self._folders = []


class OutputFolder(_Claim):
    """A run's claim on an output folder. Can be used as a path.

    A missing folder is created, and removed again if it stays empty.

    Parameters
    ----------
    path: the folder.
    files: kinds of files that the run will write, by name; each is checked by `may_write`.
    force, inputs: as in `Output`, for every file.

    Raises
    ------
    OutputError: a file is not ours, the folder is locked by another run, or it cannot be created.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        files: Mapping[str, Kind],
        force: bool = False,
        inputs: Iterable[str | os.PathLike[str]] = (),
    ) -> None:
        super().__init__(path, force, inputs)
        self._kinds = files
        self._made = not self.path.exists()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._fd = os.open(self.path, os.O_RDONLY) if fcntl is not None else -1
        except OSError as error:
            raise OutputError(f"{path}: cannot be made a folder: {error.strerror}", str(path)) from None
        try:
            _lock(self._fd, self.path)
            for name, kind in files.items():
                self.file(name, kind)
        except BaseException:
            self.close()
            raise

    def _files(self) -> Iterable[Path]:
        return (self.path / name for name in self._kinds)

    def file(self, name: str, kind: Kind | None = None) -> Path:
        """Return the path of a file that may be written; `kind`: if it is not in `files`.

        Raises OutputError as `may_write` does.
        """
        path = self.path / name
        _spare(path, self.inputs)
        return may_write(path, kind or self._kinds[name], self.force)

    def close(self) -> None:
        """Release the claim."""
        if self._made:
            with contextlib.suppress(OSError):  # not empty
                self.path.rmdir()
        self._made = False
        super().close()


class Claims(contextlib.ExitStack):
    """The outputs that a run was given, released together. force, inputs: as in `Output`, for each of them."""

    def __init__(self, force: bool, *inputs: str | os.PathLike[str]) -> None:
        super().__init__()
        self._given = force, inputs

    def file(self, path: str | os.PathLike[str] | None, kind: Kind) -> Output | None:
        """Claim a file; None without a path."""
        return None if path is None else self.enter_context(Output(path, kind, *self._given))

    def folder(self, path: str | os.PathLike[str] | None, files: Mapping[str, Kind]) -> OutputFolder | None:
        """Claim a folder; None without a path."""
        return None if path is None else self.enter_context(OutputFolder(path, files, *self._given))


def append(file: FileIO, data: bytes | memoryview) -> None:
    """Append all of the data to a file, or nothing. Raises OSError as the system does (no space on the disk)."""
    left, before = memoryview(data), file.tell() if file.seekable() else None
    try:
        while left:
            left = left[file.write(left) :]
    except OSError:
        if before is not None:
            with contextlib.suppress(OSError):
                file.truncate(before)
        raise


def claimed(path: str | os.PathLike[str], kind: Kind) -> Output:
    """Return a claim as it is, or a new claim on a path."""
    return path if isinstance(path, Output) else Output(path, kind)


def claimed_folder(path: str | os.PathLike[str], files: Mapping[str, Kind]) -> OutputFolder:
    """Return a claim as it is, or a new claim on a folder."""
    return path if isinstance(path, OutputFolder) else OutputFolder(path, files)


def _spare(path: Path, inputs: Iterable[str | os.PathLike[str]]) -> None:
    for given in inputs:
        with contextlib.suppress(OSError):
            if os.path.samefile(path, given):
                raise OutputError(f"{path}: is what this run reads; give another name to write to", str(path))


def _lock(fd: int, path: Path) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        text = f"{path}: is being written by another run; wait for its end or give another name"
        raise OutputError(text, str(path)) from None
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EBADF, errno.EINVAL):
            raise


def _unwritable(path: str | os.PathLike[str], error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written: {error.strerror}; give another name", str(path))
