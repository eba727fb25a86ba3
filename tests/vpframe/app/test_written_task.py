"""Statements of a person on the page, and the script that repeats them to the bit."""

import asyncio
import json
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import tornado.websocket

import vpframe as vp
from tests.vpframe.desk import ask, drag, in_bore, replayed
from vpframe.app.task_runner import run_task
from vpframe.app.workbench import Workbench
from vpframe.outputs import SCRIPT, Output
from vpframe.session.requests import Request


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
