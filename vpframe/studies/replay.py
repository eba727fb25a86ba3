"""One variant of a study as a task script: the scripts of the worst variants call `replayed`."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace

from vpframe.errors import VpframeError
from vpframe.scripts import imported
from vpframe.studies.distributions import Value
from vpframe.studies.variants import Variant, bound, variables_of

_open = contextlib.ExitStack()
"""scripts that stay importable by name until the process ends"""


def opened(script: Path) -> ModuleType:
    """Return the module of a script, importable for the rest of this process. Raises VpframeError, in one line."""
    return _open.enter_context(imported(script))


def replayed(script: str | Path, index: int, seed: int, parameters: Mapping[str, Value]) -> SimpleNamespace:
    """Return `scene`, `task`, `OPTIONS` of one variant. Raises VpframeError if the script lacks a variable of it."""
    path = Path(script)
    module = opened(path)
    changed = set(variables_of(module, path)) ^ set(parameters)
    if changed:
        raise VpframeError(f"{path}: VARIANTS has changed since the study: {', '.join(sorted(changed))}; run it again")
    return bound(module, path, Variant(index, seed, dict(parameters)))
