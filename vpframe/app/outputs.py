"""What a run may write: files that vpframe itself wrote before, one run at a time, and never what the run reads.

An `Output` is claimed before the work begins and changes nothing by itself. Its content tells whose a file is, not its
name; an empty file is anybody's, and a device or pipe is written to as it is.
The lock is the kernel's, on the file or folder itself: it ends with the process, however that ends. Where the system
or a network drive has no such locks, there is none.
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

from vpframe.errors import OutputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

GENERATOR = "vpframe"
"""what files that can say so name as their maker"""
HEAD = 4096
"""bytes at the beginning of a file that tell whose it is"""


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name in messages, and how one is known that vpframe wrote."""

    name: str
    recognise: Callable[[Path], bool]


def _begins(pattern: bytes) -> Callable[[Path], bool]:
    begin = re.compile(pattern, re.DOTALL)

    def recognise(path: Path) -> bool:
        with path.open("rb") as file:
            return begin.match(file.read(HEAD)) is not None

    return recognise


def _holds(mark: bytes) -> Callable[[Path], bool]:
    """Known by its mark anywhere: of binary formats that keep the maker's name at a place of their own."""
    return lambda path: mark in path.read_bytes()


def _is_status(path: Path) -> bool:
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        return False
    return isinstance(content, dict) and "clashes" in content and content.keys() <= {"clashes", "authorised"}


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
SCRIPT = Kind("", lambda path: False)
"""a person goes on from it, so that an old one is never replaced unasked"""

REPORT_FILES = {
    "index.html": PAGE,
    "report.json": REPORT,
    "scene.html": PAGE,
    "clashes.csv": CLASHES,
    "clashes.json": STATUS,
}
"""what every report folder holds"""
STUDY_FILES = {"results.jsonl": RESULTS, "results.csv": TABLE, "index.html": PAGE, "study.json": REPORT}
"""what the folder of a study holds, and scripts of variants in `worst/`"""


def table_of(columns: Iterable[str]) -> Kind:
    """A table with these columns."""
    return Kind("a table of these columns", _begins(re.escape(",".join(columns).encode())))


def may_write(path: str | os.PathLike[str], kind: Kind, force: bool = False) -> Path:
    """The path, if there is nothing at it that vpframe did not write as `kind`, or with `force`.

    Raises
    ------
    OutputError: there is something else, or it cannot be read.
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


class Output:
    """The claim of one run on a file that it will write. A path itself, wherever one is wanted.

    Parameters
    ----------
    path: the file. It is made, empty, if there is none, and removed again if nothing was written to it.
    kind: what it will be.
    force: replace whatever it is.
    inputs: files that the run reads; none of them is ever replaced.

    Raises
    ------
    OutputError: it is not ours, an input, being written by another run, or cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        kind: Kind,
        force: bool = False,
        inputs: Iterable[str | os.PathLike[str]] = (),
    ) -> None:
        self.path = Path(path)
        self.force = force
        self.inputs = tuple(inputs)
        self._fd = -1
        self._made = False
        _spare(self.path, self.inputs)
        may_write(self.path, kind, force)  # what is not ours is not opened for writing
        try:
            self._lock()
            self.ours = os.fstat(self._fd).st_size > 0 and kind.recognise(self.path)
            """whether there is something in it to go on from"""
            may_write(self.path, kind, force)  # now that nobody else writes
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unwritable(self.path, error) from None
            raise

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def spare(self, *inputs: str | os.PathLike[str]) -> None:
        """Raise OutputError if this is one of the files that the run reads."""
        self.inputs += inputs
        _spare(self.path, inputs)

    def _lock(self) -> None:
        """Open the file and lock it; another run may remove the one that it made, and then there is a new one."""
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
        """The file, cut to its first `keep` bytes, to be written from there on; close it before the claim."""
        try:
            file = FileIO(os.dup(self._fd), "r+")
            if stat.S_ISREG(os.fstat(self._fd).st_mode):
                file.truncate(keep)
                file.seek(keep)
        except OSError as error:
            raise _unwritable(self.path, error) from None
        return file

    def close(self) -> None:
        """Let others have it."""
        if self._fd < 0:
            return
        with contextlib.suppress(OSError):
            here = os.fstat(self._fd)
            if self._made and here.st_size == 0 and os.path.samestat(here, os.stat(self.path)):
                os.unlink(self.path)
        _close(self._fd)
        self._fd = -1

    def __enter__(self) -> Output:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_fd"):
            self.close()


class OutputFolder:
    """The claim of one run on a folder, which is made if there is none. A path itself, wherever one is wanted.

    Like a file, a folder that was made for it and stayed empty is removed again.

    Parameters
    ----------
    path: the folder.
    files: those that the run will surely write, by name; each is `may_write`.
    force, inputs: as of `Output`, for every file in it.

    Raises
    ------
    OutputError: a file is not ours, the folder is being written by another run, or it cannot be made.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        files: Mapping[str, Kind],
        force: bool = False,
        inputs: Iterable[str | os.PathLike[str]] = (),
    ) -> None:
        self.path = Path(path)
        self._files = files
        self._force = force
        self._inputs = tuple(inputs)
        self._fd = -1
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

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def spare(self, *inputs: str | os.PathLike[str]) -> None:
        """Raise OutputError if one of the files is one that the run reads."""
        self._inputs += inputs
        for name in self._files:
            _spare(self.path / name, inputs)

    def file(self, name: str, kind: Kind | None = None) -> Path:
        """The path of a file in it that may be written; `kind` where it is none of `files`.

        Raises OutputError as `may_write` does.
        """
        path = self.path / name
        _spare(path, self._inputs)
        return may_write(path, kind or self._files[name], self._force)

    def close(self) -> None:
        """Let others have it."""
        if self._made:
            with contextlib.suppress(OSError):  # something was written
                self.path.rmdir()
        self._made = False
        if self._fd >= 0:
            _close(self._fd)
            self._fd = -1

    def __enter__(self) -> OutputFolder:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_fd"):
            self.close()


def append(file: FileIO, data: bytes | memoryview) -> None:
    """Write all of the data at the end of a file, or nothing: what is there stays readable.

    Raises OSError as the system does (no room on the disk).
    """
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
    """The claim itself, if it is one already; otherwise a claim on a path."""
    return path if isinstance(path, Output) else Output(path, kind)


def claimed_folder(path: str | os.PathLike[str], files: Mapping[str, Kind]) -> OutputFolder:
    """The same of a folder."""
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


def _close(fd: int) -> None:
    if fcntl is not None:
        with contextlib.suppress(OSError):
            fcntl.flock(fd, fcntl.LOCK_UN)  # a forked child may have it open still
    os.close(fd)


def _unwritable(path: str | os.PathLike[str], error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot be written: {error.strerror}; give another name", str(path))
