"""Writes `vpframe/__init__.pyi`: what type checkers and the reference see of names that are imported at first use.

python tests/release/stub.py
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import vpframe

PATH = Path(vpframe.__file__).with_suffix(".pyi")


def text() -> str:
    """The stub, of the names in `vpframe/__init__.py`."""
    lines = defaultdict(list)
    for module, names in vpframe._NAMES.items():
        lines[module] += [f"from {module} import {name} as {name}" for name in names]
    for name, module in vpframe._MODULES.items():
        package, _, last = module.rpartition(".")
        lines[module].append(f"from {package} import {last} as {name}")
    body = "\n".join(line for module in sorted(lines) for line in sorted(lines[module]))
    return f"# written by tests/release/stub.py\n# ruff: noqa: I001\n{body}\n\n__version__: str\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
