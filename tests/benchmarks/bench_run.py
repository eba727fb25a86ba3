"""`vpframe bench`: runs benchmark suites, `bench_<suite>.py` in this folder; what is installed has none."""

from __future__ import annotations

import importlib
import inspect
import math
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from vpframe import console
from vpframe.app.options import BAD, OK, document
from vpframe.errors import VpframeError
from vpframe.outputs import PAGE, Claims

T = TypeVar("T")


def run(arguments: Namespace, suites: Sequence[str]) -> int:
    """Run the suite of the arguments, by default all; return the exit code."""
    with document(arguments.json) as emit, Claims(arguments.force) as claims:
        page = claims.file(arguments.html, PAGE)
        results: dict[str, Any] = {}
        for name in [arguments.suite] if arguments.suite else suites:
            try:
                module = suite(name)
                given = options(name, module, arguments.only, arguments.number, arguments.corpus)
                began = time.monotonic()
                with console.progress(f"benchmark {name}"):
                    found = module.run(quick=arguments.quick, **given)
                spent, text = time.monotonic() - began, module.table(found)
            except Exception as error:
                if arguments.suite:
                    raise
                known = isinstance(error, VpframeError | ImportError)
                results[name] = str(error) if known else f"{type(error).__name__}: {error}"
                console.warn(f"vpframe: {name}: {results[name]}")  # continue with the other suites
            else:
                results[name] = module, found, spent
                if not arguments.json:
                    print(text, end="\n\n", flush=True)
                if arguments.plot:
                    module.plot(found, arguments.plot)
            if page is not None:  # after each suite, so that an interrupted run keeps its results
                page.path.write_text(suite("page").page(results), encoding="utf-8")
        documents = [finite(result[1]) for result in results.values() if not isinstance(result, str)]
        emit(documents[0] if arguments.suite else {"suites": documents})
    return BAD if len(documents) < len(results) else OK


def suite(name: str) -> ModuleType:
    """Import a suite: a module with `run(quick) -> dict`, `table(result) -> str` and `plot(result, directory)`.

    "page" is the module that writes results of suites as a page.
    """
    return importlib.import_module(f"bench_{name}")


def chosen(cases: Mapping[str, T], only: Sequence[str]) -> dict[str, T]:
    """Return the cases whose names contain any of the texts, by default all; VpframeError if a text matches none."""
    for text in only:
        if not any(text in name for name in cases):
            raise VpframeError(f"--only {text}: no case is called so; there are {', '.join(cases)}")
    return {name: case for name, case in cases.items() if not only or any(text in name for text in only)}


def options(
    suite: str, module: ModuleType, only: Sequence[str], numbers: Sequence[str], corpus: str | None = None
) -> dict[str, Any]:
    """Return the arguments of a suite's `run` for `--only TEXT`, `--number WHAT=N` and `--corpus DIR`.

    Raises VpframeError for what the suite does not support, and for a folder that does not exist.
    """
    known = [name for name in inspect.signature(module.run).parameters if name != "quick"]
    out: dict[str, Any] = {}
    if only:
        if "only" not in known:
            raise VpframeError(f"--only {only[0]}: suite {suite} is run as a whole; leave it out")
        out["only"] = tuple(only)
    if corpus is not None:
        if "corpus" not in known:
            raise VpframeError(f"--corpus {corpus}: suite {suite} reads no files; leave it out")
        if not Path(corpus).is_dir():
            raise VpframeError(f"--corpus {corpus}: there is no such folder")
        out["corpus"] = Path(corpus)
    counted = [name for name in known if name not in ("only", "corpus")]
    for text in numbers:
        what, _, count = text.partition("=")
        if what not in counted:
            raise VpframeError(f"--number {text}: suite {suite} counts {', '.join(counted) or 'nothing'}")
        if not (count.isdecimal() and int(count) > 0):
            raise VpframeError(f"--number {text}: write {what}=N, N a whole number above 0")
        out[what] = int(count)
    return out


def finite(value: Any) -> Any:
    """Return a result with None for infinite numbers and NaN, which JSON has not: what was not reached has no error."""
    if isinstance(value, Mapping):
        return {name: finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
