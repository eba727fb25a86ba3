"""What pages ask for is done by the session's verbs, kept as a script, and undone; no browser is needed for it."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.vpframe.desk import ask, drag, grab, in_bore, peg, replayed
from vpframe.app.workbench import Workbench
from vpframe.session.requests import Request


def said(bench: Workbench, client: int = 1) -> str:
    notice = bench.viewer._notices.get(f"say {client}")
    return "" if notice is None else notice[2]


def test_the_assembly_as_it_stands_is_shown_without_a_step(bench: Workbench) -> None:
    assert bench.session.frame is not None and bench.session.step_count == 0
    assert bench.session.frame.constraints == bench.session.constraints


def test_a_drag_slides_along_the_bore_and_is_blocked_at_its_wall(bench: Workbench) -> None:
    in_bore(bench)
    drag(bench, *((0.004 * k, -0.003 * k, 0.035 - 0.002 * k) for k in range(1, 12)))
    at = peg(bench)[:3, 3]
    assert np.abs(at[:2]).max() < 2e-5  # the mouse went 44 mm aside
    assert at[2] == pytest.approx(0.020, abs=3e-5)  # head on the block, not where the mouse is
    assert bench.hand.stopped_by or "blocked" in [event.kind for event in bench.session.events]
    assert [c.kind for c in bench.session.constraints if c.state == "active"] == ["concentric"]
    drag(bench, (0.0, 0.0, 0.030))
    assert peg(bench)[2, 3] == pytest.approx(0.030, abs=1e-6)


def test_along_its_freedom_a_drag_breaks_nothing_and_a_free_one_what_a_pull_breaks(bench: Workbench) -> None:
    in_bore(bench)
    drag(bench, (0.0, 0.0, 0.0201))
    offer = next(c for c in bench.session.candidates if c.kind == "against")
    ask(bench, "accept", offer.id)
    assert sorted(c.kind for c in bench.session.constraints) == ["against", "concentric"]
    drag(bench, *((0.0, 0.0, 0.020 + 0.002 * k) for k in range(12)))
    assert peg(bench)[2, 3] == pytest.approx(0.020, abs=1e-6)
    assert len(bench.session.constraints) == 2
    drag(bench, *((0.0, 0.0, 0.020 + 0.002 * k) for k in range(6)), free=True)
    assert [c.kind for c in bench.session.constraints] == ["concentric"]
    assert peg(bench)[2, 3] == pytest.approx(0.030, abs=1e-6)


def test_where_steps_take_long_a_drag_goes_less_far_in_each_and_arrives(
    bench: Workbench, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vpframe.app.workbench.STEP_SECONDS", 0.0)  # every step takes longer
    grab(bench)
    start = peg(bench)[:3, 3].copy()
    end = start + np.array([0.02, -0.01, 0.03])
    drag(bench, tuple(end))
    (poses,) = bench.done[-1].statements[0].given
    way = np.linalg.norm(np.diff([start, *(pose[:3] for pose in poses)], axis=0), axis=1)
    assert way[0] == pytest.approx(bench.snap, abs=1e-6) and way[1:].max() < 0.5 * bench.snap + 1e-6
    assert len(poses) == pytest.approx(np.linalg.norm(end - start) / (0.5 * bench.snap), abs=2)
    assert np.abs(peg(bench)[:3, 3] - end).max() < 1e-6
    ends = {part.name: part.pose.homogeneous for part in bench.session.scene.parts}
    again = replayed(bench, model, tmp_path)
    assert all(again[name].tobytes() == pose.tobytes() for name, pose in ends.items())
    monkeypatch.setattr("vpframe.app.workbench.STEP_SECONDS", 10.0)  # every step takes less
    drag(bench, tuple(start))
    assert len(bench.done[-1].statements[0].given[0]) <= 6


def test_undo_and_redo_are_exact_and_redo_ends_with_the_next_deed(bench: Workbench) -> None:
    grab(bench)
    before = bench.session.save()
    drag(bench, (0.01, 0.0, 0.05), (0.02, 0.0, 0.06))
    after = bench.session.save()
    ask(bench, "undo")
    assert bench.session.save() == before
    assert bench.session.frame is not None and bench.session.frame.poses["peg"].homogeneous[0, 3] == 0.0
    ask(bench, "redo")
    assert bench.session.save() == after
    ask(bench, "undo")
    ask(bench, "release")
    ask(bench, "redo")
    assert "nothing to redo" in said(bench)
    for _ in range(2):
        ask(bench, "undo")
    assert bench.hand.held is None and bench.holder == 0
    ask(bench, "undo")
    assert "nothing to undo" in said(bench)


def test_what_is_undone_is_in_no_script_event_timeline_or_report(bench: Workbench, tmp_path: Path) -> None:
    grab(bench)
    drag(bench, (0.0, 0.0, 0.04))

    def told() -> tuple[object, ...]:
        """What script, events, timeline (but for states shown twice) and report say."""
        bench.session.show()
        folder = tmp_path / f"report {len(list(tmp_path.iterdir()))}"  # one that knows of no earlier run
        bench.session.report(folder)
        report = json.loads((folder / "report.json").read_text())
        frames = [(frame.step, [e.kind for e in events]) for frame, events in bench.viewer._history]
        frames = [f for f, before in zip(frames, [(-1, []), *frames], strict=False) if f != (before[0], [])]
        kept = {name: report[name] for name in ("events", "constraints", "clashes", "freedom", "duration", "steps")}
        return bench.source(tmp_path), bench.session.events, frames, kept

    before = told()
    in_the_bore = len(bench.done)
    drag(bench, (0.0, 0.0, 0.0352))
    ask(bench, "accept", next(c for c in bench.session.candidates if c.kind == "concentric").id)
    drag(bench, *((0.0, 0.0, 0.035 - 0.003 * k) for k in range(12)))  # onto the block
    after = told()
    assert {"accepted", "blocked"} <= {event.kind for event in bench.session.events}
    while len(bench.done) > in_the_bore:
        ask(bench, "undo")
    assert told() == before
    for _ in range(3):
        ask(bench, "redo")
    assert told() == after
    assert bench.viewer._history.events == bench.session.events


def test_as_much_is_undone_as_there_is_room_for(bench: Workbench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vpframe.app.workbench.MOST_UNDO", 3)
    grab(bench)
    for _ in range(5):
        ask(bench, "slide", along="z", distance=0.001)
    assert [done.before is not None for done in bench.done] == [False] * 3 + [True] * 3
    for _ in range(4):
        ask(bench, "undo")
    assert "cannot be undone any more" in said(bench) and len(bench.done) == 3
    assert peg(bench)[2, 3] == pytest.approx(0.0375, abs=1e-9)
    for _ in range(3):
        ask(bench, "redo")
    assert peg(bench)[2, 3] == pytest.approx(0.0405, abs=1e-9) and len(bench.done) == 6
    monkeypatch.setattr("vpframe.app.workbench.MOST_BYTES", 1000)
    ask(bench, "slide", along="z", distance=0.001)
    assert [done.before is not None for done in bench.done] == [False] * 6 + [True]
    ask(bench, "undo")
    assert len(bench.done) == 6


def test_what_fails_leaves_no_trace(bench: Workbench) -> None:
    before = bench.session.save()
    ask(bench, "grab", part=99, level=0, surface=-1)
    assert "no such part" in said(bench)
    ask(bench, "grab", part=1, level=0, surface=99)
    assert "no surface" in said(bench)
    ask(bench, "slide", along="z", distance=0.01)
    assert "no part is held" in said(bench)
    ask(bench, "accept", 77)
    assert "not there any more" in said(bench)
    grab(bench)
    assert len(bench.done) == 1
    ask(bench, "slide", along="axis", distance=0.01)  # nothing holds it: there is no axis
    assert len(bench.done) == 1
    ask(bench, "slide", along="z", distance=9999.999)
    assert "9999999 mm is " in said(bench) and "metres" not in said(bench) and len(bench.done) == 1
    ask(bench, "undo")
    assert bench.session.save() == before


def test_one_page_holds_at_a_time_and_a_page_that_goes_lets_go(bench: Workbench) -> None:
    grab(bench, client=1)
    grab(bench, client=2)
    assert "another page holds peg" in said(bench, 2) and bench.holder == 1
    here = peg(bench).copy()
    ask(bench, "drag", client=2, point=(0.0, 0.0, 0.0), to=(0.0, 0.0, 0.08), free=False)
    assert np.array_equal(peg(bench), here)
    bench._gone(2)  # a page that holds nothing
    bench.do(bench._requests.popleft())
    assert bench.hand.held == "peg"
    bench._gone(1)
    bench.do(bench._requests.popleft())
    assert bench.hand.held is None
    grab(bench, client=2)
    assert bench.holder == 2


def test_only_the_latest_of_a_pages_moves_waits_and_no_more_than_a_bound(bench: Workbench) -> None:
    for k in range(1000):
        bench.ask(Request("drag", None, {"point": (0, 0, 0), "to": (k, 0, 0), "free": False}, 1))
    assert [request.given["to"][0] for request in bench._requests] == [999]
    for _ in range(1000):
        bench.ask(Request("undo", client=2))
    assert len(bench._requests) == 200
    for _ in range(3):
        bench._gone(2)
    assert [request.action for request in bench._requests][-2:] == ["undo", "release"]  # a page that goes is heard
