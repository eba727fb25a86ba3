"""Import of benchmark suites: `tests/benchmarks/bench_<suite>.py`, of a clone; what is installed has none."""

from __future__ import annotations

import importlib
import inspect
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from vpframe.errors import VpframeError

T = TypeVar("T")
FOLDER = Path(__file__).parents[2] / "tests" / "benchmarks"


def suite(name: str) -> ModuleType:
    """Import a suite: a module with `run(quick) -> dict`, `table(result) -> str` and `plot(result, directory)`.

    "page" is the module that writes results of suites as a page.
    """
    if str(FOLDER) not in sys.path:  # a suite imports its neighbours by name
        sys.path.insert(0, str(FOLDER))
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
