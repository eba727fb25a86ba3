"""Every control of the live page, pressed with the mouse in a browser, acts on the session that it shows."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from tests.vpframe.bench_scene import SEAT, scene
from tests.vpframe.browser import PROGRAM, Browser
from vpframe.events import Frame
from vpframe.hands.conditions import candidate
from vpframe.session.rules import leave_all
from vpframe.session.session import Session
from vpframe.view.meshcat_viewer import MeshcatViewer

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH"),
]


@pytest.fixture(scope="module")
def browser(chromium: Browser) -> Browser:
    chromium.resize(1200, 700)  # both panels are there
    return chromium


@pytest.fixture
def offered(browser: Browser) -> Iterator[tuple[Session, Browser]]:
    """A session in which concentric is on offer, and the page that shows it."""
    viewer = MeshcatViewer()
    with Session(scene(), viewer=viewer, rule=leave_all) as session:
        session.step()
        browser.open(viewer.url)
        hand = session.hand(at=(0.06, 0.0, 0.08))
        hand.grab("peg")
        hand.move_to(SEAT + np.array([0.0, 0.0, 0.02]), duration=0.5)
        hand.slide("down", until=candidate("concentric"))
        browser.wait("document.querySelectorAll('#constraints button').length >= 2")
        yield session, browser
        assert browser.errors == []


def row(browser: Browser, number: int, text: str) -> str:
    """Selector of a button in the row of a constraint; -1 if the row has none of that text."""
    browser.run(
        f"""for (const b of document.querySelectorAll("#constraints button")) b.removeAttribute("id");
        for (const r of document.querySelectorAll("#constraints .row")) for (const b of r.querySelectorAll("button"))
            if (r.dataset.id === "{number}" && b.textContent === "{text}") b.id = "wanted";"""
    )
    browser.wait("document.querySelector('#wanted') !== null")
    return "#wanted"


def steps_until(session: Session, holds: Callable[[], bool]) -> None:
    """Step until what was clicked has arrived."""
    for _ in range(200):
        session.step()
        if holds():
            return
        threading.Event().wait(0.01)
    raise AssertionError("the click did not reach the session")


def state(session: Session, number: int) -> str:
    assert session.frame is not None
    return next((c.state for c in session.frame.constraints if c.id == number), "gone")


def test_accept_then_remove(offered: tuple[Session, Browser]) -> None:
    session, browser = offered
    offer = next(c for c in session.candidates if c.kind == "concentric")
    browser.click(row(browser, offer.id, "Accept"))
    steps_until(session, lambda: state(session, offer.id) == "active")
    browser.wait("[...document.querySelectorAll('#constraints button')].some((b) => b.textContent === 'Remove')")
    browser.click(row(browser, offer.id, "Remove"))
    steps_until(session, lambda: state(session, offer.id) != "active")
    assert "removed" in [event.kind for event in session.events]


def test_refuse_then_accept_after_all(offered: tuple[Session, Browser]) -> None:
    session, browser = offered
    offer = next(c for c in session.candidates if c.kind == "concentric")
    browser.click(row(browser, offer.id, "Refuse"))
    steps_until(session, lambda: state(session, offer.id) == "refused")
    browser.wait(f"document.querySelector('#constraints .row[data-id=\"{offer.id}\"]').textContent.includes('refused')")
    browser.click(row(browser, offer.id, "Accept"))
    steps_until(session, lambda: state(session, offer.id) == "active")
    assert [c.kind for c in session.constraints] == ["concentric"]


def test_pause_step_play(offered: tuple[Session, Browser]) -> None:
    session, browser = offered
    seen: list[Frame] = []
    go = threading.Event()

    def run() -> None:
        while not go.is_set():
            seen.append(session.step())

    start = session.step_count
    runner = threading.Thread(target=run, daemon=True)
    runner.start()
    shown = "Number(document.querySelector('#step').textContent.slice(5))"
    browser.wait(f"{shown} > {start}")
    browser.click("#pause")
    browser.wait("document.querySelector('#status').textContent === 'paused'")
    threading.Event().wait(0.3)
    held = session.step_count
    threading.Event().wait(0.3)
    assert session.step_count == held
    browser.click("#one")
    browser.wait(f"{shown} === {held + 1}")
    assert session.step_count == held + 1
    browser.click("#play")
    browser.wait(f"{shown} > {held + 5}")
    assert browser.run("document.querySelector('#status').textContent") == ""
    go.set()
    runner.join(10)
    assert not runner.is_alive()
    assert [f.step for f in seen] == list(range(start + 1, start + 1 + len(seen)))


def test_what_is_seen_changes_with_the_mouse(offered: tuple[Session, Browser]) -> None:
    _, browser = offered

    def changes(share: float, selector: str, more: str = "") -> bool:
        """Whether a click changes this share of the pixels of the middle, within ten pictures."""
        before = browser.picture()[:, 420:780].astype(int)
        browser.click(selector)
        if more:
            browser.run(more)
        pictures = (browser.picture()[:, 420:780].astype(int) for _ in range(10))
        return any((np.abs(picture - before).max(axis=2) > 20).mean() > share for picture in pictures)

    assert changes(0.002, "#edges")
    unseen = "{const e = document.querySelector('#symbols'); e.value = ''; e.dispatchEvent(new Event('change'))}"
    assert changes(0.001, "#edges", unseen)
    assert changes(0.0001, "#trail")  # a line one pixel wide
    assert changes(0.02, "#opacity")  # the middle of the slider: half transparent
    pick = "{const e = document.querySelector('#section-axis'); e.value = 'x'; e.dispatchEvent(new Event('change'))}"
    assert changes(0.02, "#section", pick)
    assert changes(0.02, "#section-flip")
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=500, y=350, deltaX=0, deltaY=600)  # farther away
    assert changes(0.02, "#home")
    browser.click("#home")  # and again: it makes nothing anew
