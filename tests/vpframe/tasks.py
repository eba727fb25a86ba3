"""Task scripts and their runs."""

from pathlib import Path

SCENE = """
import vpframe.app.task_runner
from tests.vpframe.bench_scene import SEAT, scene
from vpframe.hands import constraint
"""


def script(tmp_path: Path, body: str) -> Path:
    path = tmp_path / "task.py"
    path.write_text(body)
    return path
