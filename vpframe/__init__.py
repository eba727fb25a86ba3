"""vpframe: load a CAD assembly, take a part in hand, and find out whether it can be serviced."""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

# name -> module; imported at first use so that `import vpframe` and `vpframe --help` answer at once
_LAZY = {
    "load": "vpframe.importers",
    "Scene": "vpframe.scene.scene",
    "Part": "vpframe.scene.scene",
    "Shape": "vpframe.scene.scene",
    "Surface": "vpframe.scene.scene",
    "Session": "vpframe.session.session",
    "VpframeError": "vpframe.errors",
    "LoadError": "vpframe.errors",
    "UnknownPartError": "vpframe.errors",
    "TaskError": "vpframe.errors",
}

__all__ = ["__version__", *_LAZY]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'vpframe' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
