"""Compiled kernels on disk: a file for each kernel and signature, in a folder named by a hash of the sources.

numba's own cache checks only the file of the caller, so that old code answers after a change of a callee. Here the name
of the folder is a hash of all kernel sources of the kernel's package and of the packages before it, and of the versions
of Python, numba and llvmlite; the processor is part of the name of the file. A file begins with a checksum of the rest,
is written under another name and then renamed: no process reads half a file, and a damaged file counts as missing.
While one process compiles a kernel, other processes wait for it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import llvmlite
import numba
from numba.core import compiler
from numba.core.caching import _Cache
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

try:
    import fcntl
except ImportError:  # Windows: two processes may compile the same kernel at once, and the later file replaces the other
    fcntl = None  # type: ignore[assignment]

config: Any = numba.core.config
types: Any = numba.core.types  # numba's own annotations do not name all that its types have

PACKAGES: Final = ("collision", "constraints", "physics", "vpframe")
"""packages with kernels; a kernel may call kernels of its own package and of those before it"""
KEPT: Final = 8
"""number of folders of a package to keep, the last used"""
PATIENCE: Final = 120.0
"""s to wait for a kernel that another process compiles"""
_ROOT: Final = Path(__file__).resolve().parents[2]
_KERNEL_SOURCE: Final = re.compile(
    rb"^(?:from|import) (?:numba|llvmlite)|numeric\.kernel import .*kernel|^@\w*kernel\b", re.M
)
_CONSTANTS: Final = re.compile(rb"^from (\S+) import [^\n]*?(?:\([^)]*)?\b_?[A-Z][A-Z0-9_]+\b", re.M)


class KernelCache(_Cache):
    """The compiled forms of one function on disk: the interface of numba's `_Cache`."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._file = os.path.realpath(function.__code__.co_filename)
        self._locked: set[Path] = set()
        self._enabled = function.__closure__ is None

    @property
    def cache_path(self) -> str | None:
        """Folder of this kernel, None if kernels cannot be kept."""
        found = self._folder(())
        return None if found is None else str(found)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for a signature, None if there is none or it is damaged."""
        target_context.refresh()
        path = self._path(sig, target_context)
        data = None if path is None else _read(path)
        return None if data is None else compiler.CompileResult._rebuild(target_context, *pickle.loads(data))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel; print a line on standard error if that fails."""
        path = self._path(sig, data.target_context)
        if path is not None and not data.lifted and not data.library.has_dynamic_globals:
            _write(path, dumps(data._reduce()))

    def enable(self) -> None:
        """Use the cache."""
        self._enabled = True

    def disable(self) -> None:
        """Do not use the cache."""
        self._enabled = False

    def flush(self) -> None:
        """Remove all files of this kernel."""
        folder = self._folder(())
        for path in [] if folder is None else folder.glob(f"{self._name}-*.nbc"):
            path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def locked(self, sig: Any, target_context: Any) -> Iterator[None]:
        """Lock a signature for a `with` block, unless it is compiled; wait for a process that has the lock."""
        path = self._path(sig, target_context)
        if path is None or fcntl is None or path in self._locked or path.exists():
            yield
            return
        self._locked.add(path)
        lock = path.with_suffix(".lock")
        try:
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            descriptor = -1
        try:
            if descriptor >= 0:
                _wait_for(descriptor)
            yield
        finally:
            self._locked.discard(path)
            if descriptor >= 0:
                lock.unlink(missing_ok=True)
                os.close(descriptor)

    @property
    def _name(self) -> str:
        return f"{self._function.__module__}.{self._function.__qualname__}".replace("<", "").replace(">", "")

    def _folder(self, sig: Any) -> Path | None:
        """The folder for a signature: a type in it may bring code of a package after that of the kernel."""
        if not self._enabled or self._file not in _sources():
            return None
        packages = [_sources()[self._file][0], *(module.partition(".")[0] for module in _modules(sig))]
        return folder(max((p for p in packages if p in PACKAGES), key=PACKAGES.index))

    def _path(self, sig: Any, target_context: Any) -> Path | None:
        found = self._folder(sig)
        if found is None:
            return None
        flags = (config.OPT, config.BOUNDSCHECK, config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.DEBUGINFO_DEFAULT)
        key = repr((signature_text(sig), target_context.codegen().magic_tuple(), [str(flag) for flag in flags]))
        return found / f"{self._name}-{hashlib.sha256(key.encode()).hexdigest()[:24]}.nbc"


@cache
def folder(package: str) -> Path | None:
    """Return the folder for the kernels of a package; None, and one line on standard error, if none can be made.

    It is in `NUMBA_CACHE_DIR` if that is set, else in the user's cache folder (`XDG_CACHE_HOME`), else in a private
    folder among the temporary files.
    """
    name = f"{package}-{digest(package)}"
    reasons = []
    for root, private in _roots():
        try:
            root.mkdir(0o700 if private else 0o777, parents=True, exist_ok=True)
            if private and not _is_private(root):
                raise PermissionError(f"{root} belongs to somebody else")
            found = root / name
            fresh = not found.exists()
            found.mkdir(exist_ok=True)
            tempfile.TemporaryFile(dir=found).close()
            os.utime(found)
            if fresh:
                _prune(root, package)
            return found
        except OSError as error:
            reasons.append(f"{root}: {error.strerror or error}")
    _warn(f"compiled kernels cannot be kept and are compiled in every run ({'; '.join(reasons)})")
    return None


def kept() -> int:
    """Return the number of kernels on disk for the present sources, by whichever process."""
    folders = [found for package in PACKAGES if (found := folder(package)) is not None]
    return sum(name.endswith(".nbc") for found in folders if found.is_dir() for name in os.listdir(found))


def digest(package: str) -> str:
    """Return a hash of the kernel sources of a package and of those before it, and of the versions of the compiler."""
    known = PACKAGES[: PACKAGES.index(package) + 1]
    hashed = hashlib.sha256(repr((sys.version, platform.machine(), numba.__version__, llvmlite.__version__)).encode())
    for path, (owner, text) in sorted(_sources().items(), key=lambda item: (item[1][0], item[0])):
        if owner in known:
            hashed.update(os.path.relpath(path, _ROOT).encode() + b"\0" + hashlib.sha256(text).digest())
    return hashed.hexdigest()[:16]


def signature_text(sig: Any) -> str:
    """Return a text for a signature, the same in every process and different for different types."""
    if isinstance(sig, types.Dispatcher):
        function = sig.dispatcher.py_func
        return f"{function.__module__}.{function.__qualname__}"
    if isinstance(sig, types.BaseNamedTuple):
        made = sig.instance_class
        fields = ",".join(f"{name}:{signature_text(kind)}" for name, kind in zip(sig.fields, sig.types, strict=True))
        return f"{made.__module__}.{made.__qualname__}({fields})"
    if isinstance(sig, (tuple, types.BaseTuple)):
        return f"({','.join(signature_text(kind) for kind in sig)})"
    return str(sig)


def _modules(sig: Any) -> Iterator[str]:
    """The modules of the classes and functions that a signature names."""
    if isinstance(sig, types.Dispatcher):
        yield sig.dispatcher.py_func.__module__
    elif isinstance(sig, types.BaseNamedTuple):
        yield sig.instance_class.__module__
    if isinstance(sig, (tuple, types.BaseTuple)):
        for kind in sig:
            yield from _modules(kind)


@cache
def _sources() -> dict[str, tuple[str, bytes]]:
    """Package and text, by path, of every file that may contribute to a kernel: files that import numba or the
    decorators, and files from which such a file imports constants (names in capitals)."""
    texts: dict[str, tuple[str, str, bytes]] = {}
    for package in PACKAGES:
        for base, folders, names in os.walk(_ROOT / package):
            folders[:] = [name for name in folders if name != "__pycache__"]
            for name in names:
                if name.endswith(".py"):
                    path = os.path.join(base, name)
                    with open(path, "rb") as file:
                        module = os.path.relpath(path, _ROOT)[:-3].replace(os.sep, ".")
                        texts[module.removesuffix(".__init__")] = (path, package, file.read())
    found: dict[str, tuple[str, bytes]] = {}
    waiting = [module for module, (_, _, text) in texts.items() if _KERNEL_SOURCE.search(text)]
    while waiting:
        path, package, text = texts[waiting.pop()]
        if path not in found:
            found[path] = (package, text)
            imported = (name.decode() for name in _CONSTANTS.findall(text))
            waiting.extend(module for module in imported if module in texts)
    return found


def _roots() -> list[tuple[Path, bool]]:
    """Folders for kernels, in order of preference, and whether each must be private."""
    if config.CACHE_DIR:
        return [(Path(config.CACHE_DIR), False)]
    user = getattr(os, "getuid", lambda: "user")()
    return [
        (Path(AppDirs("vpframe", appauthor=False).user_cache_dir) / "kernels", False),
        (Path(tempfile.gettempdir()) / f"vpframe-kernels-{user}", True),
    ]


def _is_private(root: Path) -> bool:
    """Whether only this user can write to a folder: files of it are executed."""
    if not hasattr(os, "getuid"):
        return True
    found = os.lstat(root)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


def _prune(root: Path, package: str) -> None:
    """Remove all but the KEPT folders of a package that were last used."""
    olds = [path for path in root.glob(f"{package}-*") if re.fullmatch(r"[0-9a-f]{16}", path.name[len(package) + 1 :])]
    for old in sorted(olds, key=lambda path: -path.stat().st_mtime)[KEPT:]:
        shutil.rmtree(old, ignore_errors=True)


def _read(path: Path) -> bytes | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        _warn(f"{path}: damaged; the kernel is compiled again")
        return None
    return data[32:]


def _write(path: Path, data: bytes) -> None:
    beside = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(beside, "xb") as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(beside, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        _warn(f"compiled kernels cannot be kept in {path.parent}: {error.strerror or error}")


def _wait_for(descriptor: int) -> None:
    """Acquire a file's lock, or return without it after PATIENCE seconds."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            time.sleep(0.01)
        except OSError:
            return


_printed: set[str] = set()


def _warn(text: str) -> None:
    """Print one line on standard error, the first of its kind only."""
    kind = text.rpartition(":")[2] if ": damaged" in text else text
    if kind not in _printed:
        _printed.add(kind)
        print(f"vpframe: {text}", file=sys.stderr, flush=True)
