"""Functions of higher floors that lower floors call by name: loading for `Scene.add`, the report for `Session.report`.

`vpframe/__init__.py`, which stands above all floors, provides them; they are imported at their first call.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

_provided: dict[str, tuple[str, str]] = {}


def provide(services: Mapping[str, tuple[str, str]]) -> None:
    """Make services available under their names; each is a function, by module and name."""
    _provided.update(services)


def call(name: str, /, *given: Any, **options: Any) -> Any:
    """Call a service by its name."""
    module, function = _provided[name]
    return getattr(importlib.import_module(module), function)(*given, **options)
