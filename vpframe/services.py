"""Functions of higher floors that lower floors call by name: loading for `Scene.add`, the report for `Session.report`.

`vpframe/__init__.py`, which stands above all floors, provides them; they are imported at their first call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

_provided: dict[str, Callable[..., Any]] = {}


def provide(services: Mapping[str, Callable[..., Any]]) -> None:
    """Make services available under their names."""
    _provided.update(services)


def call(name: str, /, *given: Any, **options: Any) -> Any:
    """Call a service by its name."""
    return _provided[name](*given, **options)
