"""Packages whose names are imported at their first use, because kernels and CAD libraries take long to import."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any


def modules(names: Mapping[str, str]) -> dict[str, str]:
    """Return the module of each public name. names: by module, the names that it defines, separated by spaces."""
    return {name: module for module, listed in names.items() for name in listed.split()}


def attributes(package: str, places: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` for a package: `__getattr__, __dir__ = attributes(__name__, {…})`.

    places: by public name the module that defines it, or the module itself, which ends in ":".
    """

    class Package(ModuleType):
        """A package some of whose names are those of its modules (`classify`), and do not mean these."""

        def __setattr__(self, name: str, value: Any) -> None:
            if not isinstance(value, ModuleType) or places.get(name, ":").endswith(":"):
                super().__setattr__(name, value)

    def attribute(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, whole, _ = places[name].partition(":")
        found: Any = importlib.import_module(module)
        value = found if whole else getattr(found, name)
        setattr(sys.modules[package], name, value)
        return value

    sys.modules[package].__class__ = Package
    return attribute, lambda: sorted(sys.modules[package].__all__)
