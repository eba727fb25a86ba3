"""The script of a study with all that its answers depend on (paths, digests, bytes), and the machines that run it."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from vpframe import __version__
from vpframe.errors import VpframeError
from vpframe.scripts import PACKAGES, imported
from vpframe.studies.distributions import Distribution
from vpframe.studies.variants import Variant, bound, nominal, variables_of


@dataclass(frozen=True)
class Machines:
    """Machines that run a study."""

    jobs: int
    """worker processes on this machine; one needs no Dask"""
    cluster: str | None = None
    """address of a Dask scheduler to use instead of workers on this machine"""
    dashboard: bool = False
    """whether Dask shows its dashboard, on this machine"""


@dataclass(frozen=True)
class Job:
    """A script that was read once, with its limits."""

    script: Path
    variables: dict[str, Distribution]
    code: tuple[Path, ...]
    """the script, and modules beside it that it imports"""
    models: tuple[Path, ...]
    """`FILE` and `FILES` of the script"""
    digest: str
    """SHA-256 of code, models and version"""
    timeout: float
    """time limit of a variant, s, without the compilation of kernels"""
    retries: int
    """maximum number of repeats of a variant that crashed"""
    token: str = field(default_factory=lambda: secrets.token_hex(4))
    """identifier of this run of the study"""

    def key(self, variant: Variant) -> str:
        """Return the SHA-256 of all that the answer for a variant depends on: script, model, parameters and version."""
        depends = [self.digest, variant.seed, variant.index, dict(variant.parameters)]
        return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()

    def bundle(self) -> tuple[str, dict[str, bytes]]:
        """Return the script's name and the bytes of all its files, by their paths under a common folder."""
        files = [path.resolve() for path in (*self.code, *self.models)]
        root = Path(os.path.commonpath([path.parent for path in files]))
        contents = {path.relative_to(root).as_posix(): path.read_bytes() for path in files}
        return self.script.resolve().relative_to(root).as_posix(), contents


def read_job(script: str | Path, timeout: float, retries: int) -> Job:
    """Read a study's script.

    Raises
    ------
    VpframeError: no such file, an error in it, no VARIANTS, a model that is not there; the message names the place.
    """
    path = Path(script)
    with imported(path) as module:
        variables = variables_of(module, path)
        bound(module, path, nominal(variables))
        code = (path.resolve(), *_beside(path))
        models = tuple(_models(module, path))
    digest = hashlib.sha256(__version__.encode())
    for file in (*code, *models):
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return Job(path, variables, code, models, digest.hexdigest(), timeout, retries)


def _beside(script: Path) -> list[Path]:
    """Return the imported Python files under the script's folder, sorted, without libraries and this program."""
    folder, own = script.resolve().parent, script.resolve()
    found = set()
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if not file or name.partition(".")[0] in PACKAGES or not file.endswith(".py"):
            continue
        path = Path(file).resolve()
        if path == own or not path.is_relative_to(folder) or not path.is_file():
            continue
        if not any(part.startswith(".") or part == "site-packages" for part in path.relative_to(folder).parts):
            found.add(path)
    return sorted(found)


def _models(module: ModuleType, script: Path) -> Iterable[Path]:
    file, files = getattr(module, "FILE", None), getattr(module, "FILES", ())
    given = [file] if isinstance(file, str | Path) else []
    for each in [*given, *([files] if isinstance(files, str | Path) else files)]:
        path = (script.parent / each).resolve()
        if not path.is_file():
            raise VpframeError(f"{script}: its model {each} does not exist: {path}")
        yield path
