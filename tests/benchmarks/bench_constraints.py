"""The constraints suite: the solver's part and, where it is there, the recognition's."""

from __future__ import annotations

import importlib.util
import platform
from pathlib import Path
from types import ModuleType
from typing import Any

from vpframe.app.progress import report

HERE = Path(__file__).parent


def _parts() -> list[ModuleType]:
    found = []
    for name in ("bench_constraints_solver", "bench_constraints_recognition"):
        path = HERE / f"{name}.py"
        if path.exists():
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            found.append(module)
    return found


def run(quick: bool = False) -> dict[str, Any]:
    """Rows and ratios of all parts; each part's own result is under "parts" by its suite's name."""
    parts, results = _parts(), []
    for number, part in enumerate(parts):
        report(number / len(parts), part.__name__)
        results.append(part.run(quick=quick))
    return {
        "suite": "constraints",
        "machine": platform.platform(),
        "rows": [row for r in results for row in r["rows"]],
        "ratios": {name: value for r in results for name, value in r["ratios"].items()},
        "parts": results,
    }


def table(result: dict[str, Any]) -> str:
    """The parts' tables, one after another."""
    pairs = zip(_parts(), result["parts"], strict=True)
    return "\n\n".join(part.table(r) for part, r in pairs)


def plot(result: dict[str, Any], directory: str | Path) -> None:
    """The parts' plots."""
    for part, r in zip(_parts(), result["parts"], strict=True):
        part.plot(r, directory)
