"""What pages ask for is done by the session's verbs, kept as a script, and undone; no browser is needed for it."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import tornado.websocket

import vpframe as vp
from tests.vpframe.bench_model import write_bench
from vpframe.app.task_runner import run_task
from vpframe.app.workbench import Workbench
from vpframe.outputs import SCRIPT, Output
from vpframe.session.requests import Request
from vpframe.session.session import Session


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bench(tmp_path_factory.mktemp("model") / "bench.step")


@pytest.fixture
def bench(model: Path) -> Iterator[Workbench]:
    made = Workbench(vp.load(model), model, {})
    made.session.show()
    yield made
    made.session.close()


def ask(bench: Workbench, action: str, number: int | None = None, client: int = 1, **given: Any) -> None:
    bench.do(Request(action, number, given, client))


def said(bench: Workbench, client: int = 1) -> str:
    notice = bench.viewer._notices.get(f"say {client}")
    return "" if notice is None else notice[2]


def peg(bench: Workbench) -> np.ndarray:
    return bench.session.scene["peg"].pose.homogeneous


def grab(bench: Workbench, name: str = "peg", client: int = 1) -> None:
    ask(bench, "grab", client=client, part=bench.session.scene.names.index(name), level=0, surface=-1)


def drag(bench: Workbench, *places: tuple[float, float, float], point=(0.0, 0.0, 0.0), free=False, client=1) -> None:
    """A gesture of the mouse: a point of the held part taken to places one after another."""
    bench.hand.held or grab(bench)
    moves = [Request("drag", None, {"point": point, "to": to, "free": free}, client) for to in places]
    bench._requests.extend([*moves[1:], Request("rest", client=client)])
    bench.do(moves[0])
    bench._requests.clear()


def in_bore(bench: Workbench) -> None:
    """The peg in hand, concentric with its bore."""
    grab(bench)
    drag(bench, (0.0, 0.0, 0.0352))
    offer = next(c for c in bench.session.candidates if c.kind == "concentric")
    ask(bench, "accept", offer.id)
    assert [c.kind for c in bench.session.constraints] == ["concentric"]


def replayed(bench: Workbench, model: Path, folder: Path) -> dict[str, np.ndarray]:
    """Poses at the end of the written script, run on a model that is read anew."""
    script = folder / "task.py"
    script.write_text(bench.source(folder))
    module = ModuleType("task")
    exec(compile(script.read_text(), str(script), "exec"), module.__dict__)
    scene = vp.load(folder / module.FILE)
    with Session(scene, **module.OPTIONS) as session:
        module.task(session)
    return {part.name: part.pose.homogeneous for part in scene.parts}


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


def test_the_script_gives_the_same_poses_to_the_bit(bench: Workbench, model: Path, tmp_path: Path) -> None:
    in_bore(bench)
    drag(bench, *((0.001 * k, 0.002, 0.035 - 0.0007 * k) for k in range(1, 9)))
    ask(bench, "turn", about="axis", angle=0.3)
    ask(bench, "slide", along="z", distance=0.0031)
    pose = bench.session.scene["peg"].pose
    turned = pose * vp.pose_from([0.001, 0.0, 0.002, 0.0, 0.0, 0.1, 1.0])
    quaternion = [*turned.translation, 0.0, 0.0, 0.2, 0.9]
    bench._requests.append(Request("rest", client=1))
    ask(bench, "place", pose=tuple(quaternion), free=False)
    ask(bench, "undo")
    ask(bench, "redo")
    ask(bench, "release")
    live = {part.name: part.pose.homogeneous for part in bench.session.scene.parts}
    again = replayed(bench, model, tmp_path)
    assert {name: pose.tobytes() for name, pose in again.items()} == {n: p.tobytes() for n, p in live.items()}
    assert "required=False" in bench.source(tmp_path) and "session.accept(" in bench.source(tmp_path)


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


def test_the_script_is_written_after_each_statement(model: Path, tmp_path: Path) -> None:
    with Output(tmp_path / "task.py", SCRIPT) as output:
        bench = Workbench(vp.load(model), model, {}, output)
        runner = threading.Thread(target=bench.run)
        runner.start()
        bench.ask(Request("grab", None, {"part": 1, "level": 0, "surface": -1}, 1))
        bench.ask(Request("slide", None, {"along": "z", "distance": 0.02}, 1))
        until = threading.Event()
        for _ in range(600):
            if len(bench.done) == 2:
                break
            until.wait(0.1)
        bench.stop()
        runner.join(30)
    assert not runner.is_alive()
    end = bench.session.scene["peg"].pose.translation[2]
    assert end == pytest.approx(0.0555, abs=1e-9)
    assert run_task(tmp_path / "task.py") == 0


@pytest.mark.slow
def test_view_saves_what_is_done_ends_with_ctrl_c_and_its_script_runs(model: Path, tmp_path: Path) -> None:
    script = tmp_path / "done" / "task.py"
    script.parent.mkdir()
    command = [sys.executable, "-m", "vpframe", "view", str(model), "--save", str(script)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            address = process.stdout.readline().split()[0]
            deeds = [{"action": "grab", "part": 1, "level": 0, "surface": -1}]
            deeds += [
                {"action": "slide", "along": "z", "distance": 0.01},
                {"action": "turn", "about": "z", "angle": 0.5},
            ]
            end = asyncio.run(asyncio.wait_for(_deeds(address, deeds), 200))
            process.send_signal(signal.SIGINT)
            assert process.wait(60) == 0
            assert "Traceback" not in process.stderr.read()
        finally:
            process.kill()
    assert end == 3
    deeds_of = script.read_text().split("\n    hand.")[1:]  # the assist, and what was done
    assert len(deeds_of) == 1 + 3 or (
        len(deeds_of) == 1 + 4 and deeds_of[-1].startswith("release()")
    )  # the page's going
    assert run_task(script) == 0
    again = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert again.returncode == 2 and "--force" in again.stderr  # no script is written over


async def _deeds(address: str, deeds: list[dict[str, Any]]) -> int:
    """Send requests as a page does; how many can be undone in the end."""
    page = await tornado.websocket.websocket_connect(address.replace("http", "ws").replace("/?", "/socket?"))
    undo = 0
    while undo < len(deeds):
        message = json.loads(str(await page.read_message()))
        await page.write_message('{"action": "drawn"}')
        if message["type"] == "desk":
            undo = message["undo"]
            if undo < len(deeds):
                await page.write_message(json.dumps(deeds[undo]))
    page.close()
    return undo
