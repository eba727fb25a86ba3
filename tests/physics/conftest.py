"""The physics tests use the meshes of the physics benchmark."""

import sys
from pathlib import Path

_benchmarks = str(Path(__file__).parents[1] / "benchmarks")
if _benchmarks not in sys.path:
    sys.path.insert(0, _benchmarks)
