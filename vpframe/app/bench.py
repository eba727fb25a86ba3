"""Where the benchmark suites are: `tests/benchmarks/bench_<suite>.py`, in a checkout or inside an installed wheel."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from vpframe.errors import VpframeError

_PLACES = (Path(__file__).parents[2] / "tests" / "benchmarks", Path(__file__).parents[1] / "_benchmarks")


def suite(name: str) -> ModuleType:
    """Import one suite: a module with `run(quick) -> dict`, `table(result) -> str` and `plot(result, directory)`."""
    for folder in _PLACES:
        path = folder / f"bench_{name}.py"
        if path.is_file():
            # a suite imports its neighbours by name
            if str(folder) not in sys.path:
                sys.path.insert(0, str(folder))
            spec = importlib.util.spec_from_file_location(path.stem, path)
            assert spec is not None and spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            sys.modules[path.stem] = module
            spec.loader.exec_module(module)
            return module
    raise VpframeError(f"benchmark suite {name!r} is not part of this installation; run it from a checkout")
