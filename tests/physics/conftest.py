"""Helper meshes for all physics tests, by fixture (test files share no package)."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

_path = Path(__file__).with_name("shapes_for_tests.py")
_spec = importlib.util.spec_from_file_location("shapes_for_tests", _path)
assert _spec is not None and _spec.loader is not None
_module = importlib.util.module_from_spec(_spec)
sys.modules["shapes_for_tests"] = _module
_spec.loader.exec_module(_module)
