"""`--view`: the run waits for somebody to look, and shows its end until they have seen it."""

import asyncio
import json
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
import tornado.websocket

from tests.vpframe.browser import PROGRAM, Browser
from tests.vpframe.terminal import CTRL_C, Terminal

TASK = """
from tests.vpframe.watching import pressing_scene

def scene():
    return pressing_scene()

def task(session):
    for _ in range(12):
        session.step()
"""
ADDRESS = r"look at it at (http://\S+)"


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "task.py"
    path.write_text(TASK)
    return path


async def looked(url: str) -> list[dict]:
    """What a page is sent until it knows that the session is over."""
    socket = urllib.parse.urlsplit(url)._replace(scheme="ws", path="/socket").geturl()
    page = await tornado.websocket.websocket_connect(socket)
    messages = []
    while not messages or messages[-1]["type"] != "over":
        text = await asyncio.wait_for(page.read_message(), 60)
        assert text is not None
        messages.append(json.loads(text))
        await page.write_message('{"action": "drawn"}')
    return messages


def test_the_run_waits_for_the_first_browser_and_stays_open_at_its_end(task: Path) -> None:
    report = task.with_name("report")
    with Terminal("run", task, "--view", "--report", report, cwd=task.parent) as terminal:
        url = terminal.wait_for(ADDRESS)[1]
        terminal.wait_for("waiting for a browser to look; --no-wait does not")
        with pytest.raises(AssertionError, match="no 'done'"):
            terminal.wait_for("done", seconds=2.0)
        messages = asyncio.run(looked(url))
        steps = [message["step"] for message in messages if message["type"] == "frame"]
        assert steps[0] <= 2 and steps[-1] == 12, "from the beginning to the end"
        terminal.wait_for("the page stays open until Ctrl-C")
        assert (report / "index.html").exists() and "done: " in terminal.text, "all is written before"
        late = asyncio.run(looked(url))
        assert [m["step"] for m in late if m["type"] == "frame"] == [12], "who comes late sees the end"
        assert urllib.request.urlopen(url, timeout=5).status == 200
        terminal.press(CTRL_C)
        assert terminal.end() == 0


def test_ctrl_c_while_nobody_looks_ends_the_run(task: Path) -> None:
    with Terminal("run", task, "--view", cwd=task.parent) as terminal:
        terminal.wait_for("waiting for a browser")
        terminal.press(CTRL_C)
        assert terminal.end(60.0) == 130
        assert "stays open" not in terminal.text


def test_without_waiting_the_run_ends_by_itself(task: Path) -> None:
    with Terminal("run", task, "--view", "--no-wait", cwd=task.parent) as terminal:
        assert terminal.end() == 0
        assert "waiting" not in terminal.text and "stays open" not in terminal.text


@pytest.mark.browser
def test_the_page_says_that_the_session_is_over_and_still_shows_it(task: Path) -> None:
    if PROGRAM is None:
        pytest.skip("no Chromium on the PATH")
    with Terminal("run", task, "--view", cwd=task.parent) as terminal, Browser() as browser:
        browser.open(terminal.wait_for(ADDRESS)[1])
        browser.wait("document.querySelector('#status').textContent === 'session ended'")
        assert browser.run("document.querySelector('#step').textContent") == "step 12"
        assert browser.run("document.querySelector('#pause').disabled")
        browser.call("Page.reload")
        browser.wait("(document.querySelector('#status') || {}).textContent === 'session ended'")
        browser.wait("document.querySelector('#step').textContent === 'step 12'")
        assert browser.errors == []
        terminal.press(CTRL_C)
        assert terminal.end() == 0
