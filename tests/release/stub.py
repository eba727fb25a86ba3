"""Writes the `__init__.pyi` of the packages: what type checkers and the reference see of names imported at first use.

python tests/release/stub.py
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from types import ModuleType

import collision
import constraints
import physics
import vpframe
from collision.lazy import modules

PACKAGES = collision, constraints, physics, vpframe


def path(package: ModuleType) -> Path:
    """The stub of a package."""
    assert package.__file__ is not None
    return Path(package.__file__).with_suffix(".pyi")


def text(package: ModuleType) -> str:
    """The text of the stub, of the names in the package's `__init__.py`."""
    lines = defaultdict(list)
    named = package._LAZY if package is vpframe else modules(package._NAMES)
    for name, module in named.items():
        lines[module].append(f"from {module} import {name} as {name}")
    for name, module in getattr(package, "_MODULES", {}).items():
        parent, _, last = module.rpartition(".")
        lines[module].append(f"from {parent} import {last} as {name}")
    body = "\n".join(line for module in sorted(lines) for line in sorted(lines[module]))
    unsorted = "# ruff: noqa: I001\n" if package in (physics, vpframe) else ""
    version = "\n\n__version__: str" if package is vpframe else ""
    return f"# written by tests/release/stub.py\n{unsorted}{body}{version}\n"


if __name__ == "__main__":
    for package in PACKAGES:
        path(package).write_text(text(package), encoding="utf-8")
