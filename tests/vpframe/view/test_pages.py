"""The live page, the static page and the report in a real browser: what is drawn, and that the controls act."""

import base64
import json
import threading
import urllib.parse

import numpy as np
import pytest

from tests.vpframe.browser import PROGRAM, Browser
from tests.vpframe.watching import fake_session, hostile_frames, hostile_scene, pressing_frames, pressing_scene
from vpframe.report import SessionLog, write
from vpframe.session.controls import Request
from vpframe.text import plain
from vpframe.view import palette
from vpframe.view.meshcat_viewer import MeshcatViewer, write_page

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH"),
]

FRAMES = pressing_frames(60)
TOUCHING = [frame for frame in FRAMES if len(frame.colliding)]


@pytest.fixture(scope="module")
def browser(chromium):
    chromium.resize(1000, 700)
    return chromium


@pytest.fixture(scope="module")
def static_page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_page(pressing_scene(), [(frame, frame.events) for frame in FRAMES], path)
    return f"file://{path}"


def share(picture, color, within=0.1):
    """The share of the 3D pane (between the panels) whose hue is that of `color`."""
    pane = picture[:, 330:680].astype(float) / 255
    saturated = np.ptp(pane, axis=2) > 0.25
    unit = pane / np.maximum(np.linalg.norm(pane, axis=2, keepdims=True), 1e-9)
    return (saturated & (np.linalg.norm(unit - np.array(color) / np.linalg.norm(color), axis=2) < within)).mean()


def test_the_static_page_shows_the_collision_while_it_lasts(browser, static_page):
    browser.open(f"{static_page}?step={TOUCHING[2].step}")
    touching = browser.picture()
    assert share(touching, palette.COLLIDING) > 0.05
    assert browser.run("document.querySelector('#clash-count').textContent") == "1"
    assert browser.run("document.querySelector('#clashes').textContent") == "plate – rod"
    faces = "plate · face 5 · plane – rod · face 0 · shaft Ø20"
    assert browser.run("document.querySelector('#clashes .what').title") == faces
    browser.open(f"{static_page}?step=0")
    apart = browser.picture()
    assert share(apart, palette.COLLIDING) < 0.001
    assert browser.run("document.querySelector('#clash-count').textContent") == "0"
    assert browser.errors == []


def test_the_static_page_plays_and_scrubs(browser, static_page):
    browser.open(f"{static_page}?step=0")
    browser.run("document.querySelector('#play').click()")
    browser.wait(f"document.querySelector('#step').textContent === 'step {FRAMES[-1].step}'")
    assert browser.run("document.querySelectorAll('#events > div').length") == 3
    browser.run("{const s = document.querySelector('#scrub'); s.value = 5; s.dispatchEvent(new Event('input'))}")
    assert browser.run("document.querySelector('#step').textContent") == f"step {FRAMES[5].step}"
    assert browser.run("document.querySelectorAll('#events > div').length") == 0


def choose(browser, element, value, event="input"):
    browser.run(
        f"{{const e = document.querySelector('{element}'); e.value = '{value}'; e.dispatchEvent(new Event('{event}'))}}"
    )


def test_section_and_opacity_change_what_is_seen(browser, static_page):
    step = TOUCHING[2].step
    browser.open(f"{static_page}?step={step}")
    whole = share(browser.picture(), palette.COLLIDING)
    choose(browser, "#section-axis", "x", "change")
    half = share(browser.picture(), palette.COLLIDING)
    assert 0.2 * whole < half < 0.8 * whole
    browser.run("document.querySelector('#section-flip').click()")
    other = share(browser.picture(), palette.COLLIDING)
    assert 0.2 * whole < other < 0.95 * whole
    choose(browser, "#section-axis", "", "change")
    assert share(browser.picture(), palette.COLLIDING) == pytest.approx(whole, rel=0.02)
    choose(browser, "#opacity-part", "0", "change")
    choose(browser, "#opacity", "0")
    assert share(browser.picture(), palette.COLLIDING) < 0.5 * whole  # the plate is not drawn
    assert browser.errors == []


def test_symbols_can_be_hidden(browser, static_page):
    browser.open(f"{static_page}?step={TOUCHING[-1].step}")
    shown = share(browser.picture(), palette.FREEDOM, 0.15)
    assert shown > 0.002
    choose(browser, "#symbols", "", "change")
    assert share(browser.picture(), palette.FREEDOM, 0.15) < 0.1 * shown


def test_the_live_page_follows_the_session_and_its_controls_act(browser):
    viewer = MeshcatViewer()
    viewer.begin(fake_session().scene)
    try:
        browser.open(viewer.url)
        browser.wait("document.querySelector('#title').textContent === 'vpframe'")
        for frame in FRAMES[: FRAMES.index(TOUCHING[2]) + 1]:
            viewer.frame(frame)
        browser.wait(f"document.querySelector('#step').textContent === 'step {TOUCHING[2].step}'")
        assert share(browser.picture(), palette.COLLIDING) > 0.03
        assert browser.run("document.querySelector('#script').textContent") == TOUCHING[2].script
        assert browser.run("document.querySelectorAll('#constraints .row').length") == 1

        browser.run(
            "[...document.querySelectorAll('#constraints button')].find((b) => b.textContent === 'Accept').click()"
        )
        browser.run("document.querySelector('#pause').click()")
        threading.Event().wait(0.3)
        assert viewer.controls.paused
        assert viewer.controls.take() == (Request("accept", 0),)

        rest = FRAMES[FRAMES.index(TOUCHING[2]) + 1 :]
        runner = threading.Thread(target=lambda: [viewer.frame(frame) for frame in rest], daemon=True)
        runner.start()
        browser.wait(f"document.querySelector('#step').textContent === 'step {rest[0].step}'")
        browser.run("document.querySelector('#one').click()")
        browser.wait(f"document.querySelector('#step').textContent === 'step {rest[1].step}'")
        browser.run("document.querySelector('#play').click()")
        browser.wait(f"document.querySelector('#step').textContent === 'step {FRAMES[-1].step}'")
        runner.join(5)
        assert not runner.is_alive()
        assert share(browser.picture(), palette.COLLIDING) < 0.001
        viewer.end()
        browser.wait("document.querySelector('#status').textContent === 'session ended'")
        assert browser.errors == []
    finally:
        viewer.controls.put(Request("play"))
        viewer.end()


def test_a_page_that_joins_late_sees_what_the_others_see(browser):
    viewer = MeshcatViewer()
    viewer.begin(fake_session().scene)
    try:
        for frame in FRAMES[: FRAMES.index(TOUCHING[-1]) + 1]:
            viewer.frame(frame)
        browser.open(viewer.url)
        browser.wait(f"document.querySelector('#step').textContent === 'step {TOUCHING[-1].step}'")
        assert share(browser.picture(), palette.COLLIDING) > 0.03
        browser.wait("document.querySelectorAll('#events > div').length === 2")
    finally:
        viewer.end()


def test_the_report_is_seen_whole(browser, tmp_path):
    log = SessionLog()
    log.begin(fake_session().scene)
    for frame in FRAMES:
        log.frame(frame)
    folder = write(tmp_path, log)
    browser.open(f"file://{folder / 'index.html'}")
    assert browser.run("document.querySelector('h1').textContent") == "session"
    assert browser.run("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    assert browser.run("document.images.length") >= 3
    assert browser.run("document.querySelectorAll('svg polyline').length") >= 3
    browser.run("document.querySelector('.pictures').scrollIntoView()")
    assert browser.run("document.documentElement.scrollWidth <= window.innerWidth")
    red = browser.picture().astype(float) / 255
    unit = red / np.maximum(np.linalg.norm(red, axis=2, keepdims=True), 1e-9)
    close = np.linalg.norm(unit - np.array(palette.COLLIDING) / np.linalg.norm(palette.COLLIDING), axis=2) < 0.1
    assert close.mean() > 0.01  # the clash's picture
    assert browser.errors == []


ATTACK = """<!DOCTYPE html><title>another site</title><script>
window.found = new Promise((done) => {{
  const socket = new WebSocket("ws://" + location.host + "{path}");
  socket.onmessage = (event) => {{ socket.send('{{"action": "pause"}}'); done(JSON.parse(event.data).type); }};
  socket.onerror = () => done("refused");
}});
</script>"""

REBOUND = (
    "--host-resolver-rules=MAP rebound.example 127.0.0.1",
    # as browsers are that let a site reach this machine
    "--disable-features=LocalNetworkAccessChecks,LocalNetworkAccessChecksWebSockets",
)


@pytest.mark.parametrize("guessed", [False, True], ids=["no token", "even with the token"])
def test_a_name_that_another_site_makes_mean_this_machine_reaches_nothing(guessed):
    """DNS rebinding: the page came from the site, and now its name is this machine's, port and all."""
    viewer = MeshcatViewer()
    viewer.begin(fake_session().scene)
    place = urllib.parse.urlsplit(viewer.url)
    query = f"?{place.query}" if guessed else ""
    site = f"http://rebound.example:{place.port}"
    page = base64.b64encode(ATTACK.format(path=f"/socket{query}").encode()).decode()
    try:
        with Browser(flags=REBOUND) as browser:
            browser.answer_for(f"{site}/attack", page)
            browser.call("Page.navigate", url=f"{site}/attack")
            browser.wait("document.title === 'another site'")
            assert browser.run("window.found") == "refused"
            browser.call("Page.navigate", url=f"{site}/{query}")
            browser.wait("document.title.startsWith('403')")
        assert not viewer.controls.paused and viewer.clients == 0
    finally:
        viewer.end()


def test_a_page_reloaded_is_the_page_again(browser):
    viewer = MeshcatViewer()
    viewer.begin(fake_session().scene)
    shown = "document.querySelectorAll('#opacity-part option').length === 3"
    try:
        browser.open(viewer.url)
        browser.wait(shown)
        browser.call("Page.reload")
        browser.wait(shown)
        browser.call("Page.navigate", url=viewer.url.split("?")[0])
        browser.wait("document.title.startsWith('403')")
        assert "with its token" in browser.run("document.body.textContent")
    finally:
        viewer.end()


HOSTILE = "<img src=x onerror=window.harm=1>"
FALSE = "\x1b[2J\n<b>done"


@pytest.mark.parametrize("name", [HOSTILE, FALSE], ids=["markup", "escape codes"])
def test_names_are_text_on_every_page(browser, tmp_path, name):
    scene, log, viewer = hostile_scene(name), SessionLog(), MeshcatViewer()
    frames = hostile_frames(name)
    session = fake_session(scene)
    for observer in (log, viewer):
        observer.begin(session.scene)
        for frame in frames:
            observer.frame(frame)
    write(tmp_path, log, task=name, failure=f"{name} is in the way")
    shown = plain(name)
    try:
        for page in (viewer.url, f"file://{tmp_path}/scene.html", f"file://{tmp_path}/index.html"):
            browser.open(page)
            browser.wait(f"document.documentElement.textContent.includes({json.dumps(shown)})")
            assert browser.run("document.querySelectorAll('[onerror], b b, script + b').length") == 0
            assert browser.run("document.documentElement.outerHTML.includes('\\x1b')") is False
            assert browser.run("'harm' in window") is False
            assert browser.errors == []
    finally:
        viewer.end()


def test_a_page_that_has_not_looked_for_clashes_does_not_say_that_there_are_none(browser, tmp_path):
    path = write_page(pressing_scene(), [], tmp_path / "scene.html")
    browser.open(path.as_uri())
    assert browser.run("document.querySelector('#clash-count').textContent") == "–"
    assert browser.run("document.querySelector('#clash-note').textContent") == "not looked at"
    frames = [(frame, frame.events) for frame in pressing_frames()]
    browser.open(write_page(pressing_scene(), frames, tmp_path / "frames.html").as_uri())
    assert browser.run("document.querySelector('#clash-count').textContent") in ("0", "1")
    assert browser.run("document.querySelector('#clash-note').textContent") == ""
    assert browser.errors == []
