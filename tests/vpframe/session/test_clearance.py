"""`run` measures the clearance of what moves; a session that measures gives the brute-force least of every step."""

import json
from pathlib import Path

import numpy as np
import pytest

import vpframe as vp
from tests.vpframe.bench_scene import scene
from vpframe.app.task_runner import run_task

SCRIPT = """
from tests.vpframe.bench_scene import scene
{options}
def task(session):
    hand = session.hand(at=(0.06, 0.0, 0.07))
    hand.grab("peg")
    hand.move_by((0.0, 0.0, 0.05))
"""


@pytest.mark.parametrize(("options", "measured"), [("", True), ("OPTIONS = {'clearance': False}", False)])
def test_the_report_of_a_run_has_the_least_clearance(tmp_path: Path, options: str, measured: bool) -> None:
    path = tmp_path / "task.py"
    path.write_text(SCRIPT.format(options=options))
    assert run_task(path, report=tmp_path / "report") == 0
    document = json.loads((tmp_path / "report" / "report.json").read_text())
    page = (tmp_path / "report" / "index.html").read_text()
    assert (document["clearance"] is not None) == measured
    assert ("not measured" in page) != measured


def test_the_clearance_of_every_step_is_that_of_all_pairs() -> None:
    """Against distances of all other parts, without boxes: while parts move, are carried, and after a way back."""

    def brute() -> float:
        session.engine.start()
        find, held = session.engine.collision.clearance, session.engine.held
        mates = {b for c in session.constraints for b in c.parts}
        others = [j for j, name in enumerate(session.scene.names) if j not in held and name not in mates - {"peg"}]
        return min(float(find(i, j)["distance"][0]) for i in held for j in others)

    with vp.Session(scene(), clearance=True, rule=lambda candidate: None) as session:
        hand = session.hand(at=(0.06, 0.0, 0.07))
        hand.grab("peg")
        mark = session.mark()
        for way in ((0.0, 0.0, 0.03), (0.02, 0.01, 0.0), (-0.05, 0.0, 0.02)):
            hand.move_by(way, duration=0.1)
            assert session.frame is not None and session.frame.clearance == brute()
        session.undo(mark)
        hand.move_by((0.0, 0.0, 0.01), duration=0.1)
        assert session.frame.clearance == brute() and np.isfinite(brute())
