"""Reports of tasks and their verdicts."""

import json
from pathlib import Path

from vpframe.session.session import Session

SCRIPT = """
from tests.vpframe.bench_scene import scene

def deeper(session, what):
    return {}[what]

def task(session):
    session.run(0.05)
"""


def written(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "task.py"
    path.write_text(SCRIPT + "".join(f"    {line}\n" for line in lines))
    return path


def report_of(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text())


# ---- sessions that no task runner looks after


def verdict(session: Session, folder: Path) -> tuple[str, bool, str]:
    document = report_of(session.report(folder))
    return document["verdict"], document["can_be_done"], document["reason"]
