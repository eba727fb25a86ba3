"""A person at the page in a real browser, with real mouse events: pick, drag, accept, undo, save, replay, look back."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

import vpframe as vp
from tests.vpframe.bench_model import write_bench
from tests.vpframe.browser import PROGRAM, Browser
from vpframe.app.workbench import Workbench
from vpframe.scene import modelling as m
from vpframe.session.session import Session

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH"),
]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bench(tmp_path_factory.mktemp("model") / "bench.step")


@pytest.fixture(scope="module")
def browser(chromium: Browser) -> Browser:
    chromium.resize(1300, 800)
    return chromium


@pytest.fixture
def bench(model: Path, browser: Browser) -> Iterator[Workbench]:
    with served(model, browser) as made:
        yield made


@contextlib.contextmanager
def served(model: Path, browser: Browser) -> Iterator[Workbench]:
    """A bench on a model, with its page open."""
    made = Workbench(vp.load(model), model, {})
    runner = threading.Thread(target=made.run)
    runner.start()
    try:
        browser.open(made.viewer.url)
        browser.wait("world.last !== null", 120)
        yield made
        assert browser.errors == []
    finally:
        made.stop()
        runner.join(60)
    assert not runner.is_alive()


def place(browser: Browser, part: str, local: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[float, float]:
    """Where a point of a part is on the screen."""
    x, y = browser.run(
        f"""(() => {{
            const part = world.parts.find((p) => p.name === {part!r});
            viewer.scene.updateMatrixWorld();
            const at = part.solid.localToWorld(new THREE.Vector3(...{list(local)})).project(viewer.camera);
            return onScreen(at);
        }})()"""
    )
    return x, y


HEAD = (0.0, 0.0, 0.005)


def take(browser: Browser) -> None:
    """Click on the peg's head, and take it."""
    browser.press(*place(browser, "peg", HEAD))
    browser.wait("selection.parts.length === 1")
    browser.click("#grab")
    browser.wait("holding()")


def accept_concentric(browser: Browser, bench: Workbench) -> None:
    """Bring the peg nearer until the mate is offered, and accept it beside the cursor."""
    x, y = place(browser, "peg", HEAD)
    browser.drag((x, y), (x, y + 1), (x, y + 2))
    browser.wait("!document.querySelector('#offer').hidden")
    assert browser.text("#offer-text") == "concentric with block?"
    browser.click("#offer-accept")
    browser.wait("world.last.constraints.some((c) => c.kind === 'concentric' && c.state === 'active')")


def peg(bench: Workbench) -> np.ndarray:
    return bench.session.scene["peg"].pose.homogeneous


def test_hover_names_part_and_face_and_a_click_selects(bench: Workbench, browser: Browser) -> None:
    before = browser.picture().astype(int)
    browser.mouse("Moved", *place(browser, "peg", HEAD))
    browser.wait("!document.querySelector('#hover').hidden")
    name = browser.text("#hover")
    face = next(k for k in range(9) if f"face {k} " in name)
    assert name == f"peg · {vp_face_words(bench, 'peg', face)}"
    changed = np.abs(browser.picture().astype(int) - before).max(axis=2) > 60
    assert 0.0005 < changed.mean() < 0.1  # the outline and the face, no more
    browser.press(*place(browser, "peg", HEAD))
    browser.wait("selection.parts.length === 1")
    assert browser.text("#selected") == name
    assert browser.run("document.querySelector('#tree .chosen').textContent").startswith("▾peg"[1:])
    browser.press(30, 780)  # beside everything
    browser.wait("selection.parts.length === 0")


def test_alt_and_click_selects_what_is_behind(bench: Workbench, browser: Browser) -> None:
    x, y = browser.run(
        """(() => {
            for (let x = 400; x < 900; x += 4) for (let y = 50; y < 700; y += 4)
                if (picks(x, y).map(({ part }) => part.name).join() === "peg,block") return [x, y];
        })()"""
    )
    for alt, part in ((False, "peg"), (True, "block"), (True, "peg"), (False, "peg")):
        browser.press(x, y, alt=alt)
        browser.wait(f"selection.parts.map((part) => part.name).join() === '{part}'")
        assert browser.text("#selected").startswith(f"{part} · face ")
    browser.press(*browser.run("onScreen({ x: -0.98, y: 0.98 })"), alt=True)  # nothing is there
    browser.wait("selection.parts.length === 0")


def vp_face_words(bench: Workbench, part: str, face: int) -> str:
    from vpframe.scene.names import face_words

    return face_words(bench.session.scene[part], face)


def test_drag_along_the_bore_blocked_at_its_wall_undone_saved_and_replayed(
    bench: Workbench, browser: Browser, tmp_path: Path
) -> None:
    take(browser)
    accept_concentric(browser, bench)
    x, y = place(browser, "peg", HEAD)
    browser.drag((x, y), *((x + 12.0 * k, y + 30.0 * k) for k in range(1, 9)))  # down and far aside
    browser.wait("desk.undo === 4")
    at = peg(bench)[:3, 3]
    assert np.abs(at[:2]).max() < 2e-5
    assert at[2] == pytest.approx(0.020, abs=3e-5)  # the head on the block: the mouse went farther
    assert "blocked" in [event.kind for event in bench.session.events]
    end = peg(bench).copy()
    browser.key("z", ctrl=True)
    browser.wait("desk.redo === 1")
    assert peg(bench)[2, 3] > 0.030
    browser.wait("world.parts[1].group.parent.matrix.elements[14] > 0.030")
    browser.click("#redo")
    browser.wait("desk.redo === 0")
    assert np.array_equal(peg(bench), end)
    browser.click("#save")
    browser.wait("Boolean(world.script)")
    module = ModuleType("task")
    script = browser.run("world.script")
    exec(compile(script, "task.py", "exec"), module.__dict__)
    scene = vp.load(bench._model)
    with Session(scene, **module.OPTIONS) as session:
        module.task(session)
    assert scene["peg"].pose.homogeneous.tobytes() == end.tobytes()


def test_the_gizmo_moves_along_one_axis_and_typed_numbers_are_exact(bench: Workbench, browser: Browser) -> None:
    take(browser)
    browser.wait("gizmo !== null")
    tip = """(() => { const g = gizmo.group, h = gizmo.handles.find((m) => m.userData.name === 'z' && !m.userData.ring);
        const at = h.localToWorld(new THREE.Vector3(0, h.geometry.boundingSphere.center.y, 0)).project(viewer.camera);
        return onScreen(at); })()"""
    browser.run("gizmo.handles.forEach((h) => h.geometry.computeBoundingSphere()); 1")
    x, y = browser.run(tip)
    browser.drag((x, y), (x + 3, y - 20), (x + 6, y - 60))
    browser.wait("desk.undo === 2")
    at = peg(bench)[:3, 3]
    assert at[2] > 0.0375 and np.abs(at[:2]).max() < 1e-6
    assert np.allclose(peg(bench)[:3, :3], np.eye(3), atol=1e-8)
    browser.run("$('exact-axis').value = 'x'; $('exact-by').value = '12.5'; 1")
    browser.click("#exact-go")
    browser.wait("desk.undo === 3")
    assert peg(bench)[0, 3] - at[0] == pytest.approx(0.0125, abs=1e-9)


def on_ring(browser: Browser, name: str, angle: float) -> tuple[float, float]:
    """Where a point of a ring of the gizmo is on the screen; of z's from the x axis, rad."""
    x, y = browser.run(
        f"""(() => {{
            const ring = gizmo.handles.find((m) => m.userData.ring && m.userData.name === {name!r});
            const far = ring.geometry.parameters.radius, center = gizmo.group.position;
            const at = toThree([center.x + far * Math.cos({angle}), center.y + far * Math.sin({angle}), center.z]);
            at.project(viewer.camera);
            return onScreen(at);
        }})()"""
    )
    return x, y


def test_a_ring_of_the_gizmo_turns_and_a_typed_turn_is_exact(bench: Workbench, browser: Browser) -> None:
    take(browser)
    browser.wait("gizmo !== null")
    start = -0.9  # towards the eye, beside the arrows
    browser.drag(*(on_ring(browser, "z", start + 0.1 * k) for k in range(7)))
    browser.wait("desk.undo === 2")
    turned = peg(bench)
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.5, abs=0.06)  # from the first move on
    assert turned[2, 2] == pytest.approx(1.0, abs=1e-9)
    assert np.allclose(turned[:3, 3], [0.0, 0.0, 0.0355], atol=1e-6), "about its middle"
    browser.run("$('exact-axis').value = 'y'; $('exact-by').value = '-30'; $('exact-unit').value = '°'; 1")
    browser.click("#exact-go")
    browser.wait("desk.undo === 3")
    about = peg(bench)[:3, :3] @ turned[:3, :3].T
    assert np.allclose(about, pin.exp3(np.array([0.0, np.radians(-30.0), 0.0])), atol=1e-9)


def test_the_gizmo_is_of_the_views_size_and_a_drag_selects_no_text(bench: Workbench, browser: Browser) -> None:
    take(browser)
    browser.wait("gizmo !== null")
    across = """(() => {
        const size = new THREE.Box3().setFromObject(gizmo.group).getSize(new THREE.Vector3());
        return Math.max(size.x, size.y, size.z) / (viewer.camera.position.distanceTo(viewer.controls.target)
            * Math.tan(viewer.camera.fov * Math.PI / 360)); })()"""
    for zoom in (600, 600, 600, -600, -600, -600, -600, -600):
        x, y = place(browser, "peg", HEAD)
        browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=zoom)
        browser.settle()
        assert 0.2 < browser.run(across) < 1.6, "seen whole, and large enough to be taken"
    browser.click("#home")
    browser.drag((600, 60), (300, 300), (100, 400))
    assert browser.run("String(window.getSelection())") == ""


def test_typed_numbers_about_the_axis_of_a_fit(bench: Workbench, browser: Browser) -> None:
    take(browser)
    accept_concentric(browser, bench)
    before = peg(bench).copy()
    browser.run("$('exact-axis').value = 'axis'; $('exact-by').value = '90'; $('exact-unit').value = '°'; 1")
    browser.click("#exact-go")
    browser.wait("desk.undo === 4")
    about = before[:3, :3].T @ peg(bench)[:3, :3]
    assert abs(pin.log3(about) @ [0.0, 0.0, 1.0]) == pytest.approx(np.pi / 2, abs=1e-6)
    assert np.allclose(peg(bench)[:3, 3], before[:3, 3], atol=1e-6)


def test_rows_show_the_place_with_all_else_faded(bench: Workbench, browser: Browser) -> None:
    take(browser)
    accept_concentric(browser, bench)
    browser.run("world.parts.push({...world.parts[0], index: 99, faded: false}); 1")  # a third one, only to be faded
    browser.click("#constraints .place")
    browser.wait("marker !== null")
    assert browser.run("world.parts.map((part) => Boolean(part.faded))") == [False, False, True]
    browser.run("world.parts.pop(); focusOn(null); 1")
    mates = "[...world.symbols.keys()].filter((name) => name.startsWith('constraint')).length"
    for hidden, seen in (([0], True), ([0, 1], False), ([], True)):  # a symbol is hidden with the last of its parts
        browser.run(f"setHidden(world.parts, false); setHidden({hidden}.map((k) => world.parts[k]), true); 1")
        assert bool(browser.run(mates)) == seen


def test_the_tree_hides_isolates_and_colours(bench: Workbench, browser: Browser) -> None:
    browser.click("#tree .node input")
    browser.wait("!world.parts[0].group.visible")
    browser.click("#all")
    browser.wait("world.parts[0].group.visible")
    browser.run("document.querySelectorAll('#tree .node')[1].querySelector('button').click(); 1")
    assert browser.run("world.parts.map((p) => p.group.visible)") == [False, True]
    browser.click("#all")
    browser.wait("world.freedom.size === 2")
    plain = browser.picture().astype(int)
    browser.click("#by-freedom")
    assert (np.abs(browser.picture().astype(int) - plain).max(axis=2) > 25).mean() > 0.01


def test_an_exploded_view_moves_no_part(bench: Workbench, browser: Browser) -> None:
    def height(part: str) -> float:
        return place(browser, part)[1]

    before, apart = peg(bench).copy(), height("block") - height("peg")
    browser.click("#explode")  # its middle
    browser.wait("world.parts[1].group.position.length() > 0.001")
    browser.settle()
    assert height("block") - height("peg") > apart + 20
    assert np.array_equal(peg(bench), before)
    eye = "viewer.camera.position.toArray()"
    seen = """world.parts.flatMap((part) => { const { min, max } = boxOf([part]), ends = [];
        for (let k = 0; k < 8; k++) ends.push(new THREE.Vector3(k & 1 ? min.x : max.x, k & 2 ? min.y : max.y,
            k & 4 ? min.z : max.z).project(viewer.camera)); return ends.flatMap((end) => [end.x, end.y]); })"""
    middle = "world.parts.map((part) => boxOf([part]).getCenter(new THREE.Vector3()).project(viewer.camera).y)"
    for zoom in (0, 3):  # from afar and from near: the camera steps back until all is seen, and comes back
        for _ in range(zoom):
            x, y = place(browser, "peg", HEAD)
            browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-120)
            browser.settle()
        browser.run("$('explode').value = 0; $('explode').oninput(); 1")
        before_it = browser.run(eye)
        browser.run("$('explode').value = 1; $('explode').oninput(); 1")
        assert np.abs(browser.run(middle)).max() <= 0.78
        assert zoom or np.abs(browser.run(seen)).max() < 1.0
        assert zoom == 0 or browser.run(eye) != before_it
        browser.run("$('explode').value = 0; $('explode').oninput(); 1")
        assert browser.run(eye) == pytest.approx(before_it, rel=1e-9)
    browser.click("#home")
    assert height("block") - height("peg") == pytest.approx(apart, abs=0.5)


def test_looking_back_while_the_session_goes_on(bench: Workbench, browser: Browser) -> None:
    take(browser)
    browser.run("$('exact-axis').value = 'z'; $('exact-by').value = '20'; 1")
    browser.click("#exact-go")
    browser.wait("desk.undo === 2")
    browser.wait("timeline.shown === timeline.newest && world.last.time > 0.1")
    top = browser.run("world.parts[1].group.parent.matrix.elements[14]")
    browser.run("{const s = $('scrub'); s.value = 0; s.dispatchEvent(new Event('input'))}")
    browser.wait("world.last.step === 0")
    assert browser.text("#status") == "looking back"
    browser.wait(f"world.parts[1].group.parent.matrix.elements[14] < {top} - 0.015")
    assert peg(bench)[2, 3] == pytest.approx(0.0555, abs=1e-6)  # the session is where it was
    browser.click("#later")
    browser.wait("world.last.step > 0")
    browser.click("#now")
    browser.wait("timeline.shown === timeline.newest")
    assert browser.text("#status") == ""


def test_two_faces_are_measured(bench: Workbench, browser: Browser) -> None:
    names = bench.session.scene["block"].surfaces
    tops = [s.index for s in names if type(s.geometry).__name__ == "Plane" and abs(s.geometry.normal[2]) > 0.9]
    assert len(tops) == 2
    browser.click("#measure")
    browser.run(
        f"""for (const surface of {tops}) measure({{part: world.parts[0], surface, point: new THREE.Vector3()}}); 1"""
    )
    assert "angle 0°" in browser.text("#measured")
    assert "distance 20 mm (along the normal)" in browser.text("#measured")
    browser.press(*place(browser, "peg", HEAD))
    browser.wait("measured.length === 1")
    browser.click("#measure")
    assert browser.text("#measured") == ""
    assert browser.run("[2e-17, 0.0205, 1.2345678912].map(mm)") == ["0 mm", "20.5 mm", "1234.568 mm"]


def test_two_faces_are_measured_with_the_mouse(bench: Workbench, browser: Browser) -> None:
    browser.click("#measure")
    browser.press(*place(browser, "peg", (0.006, 0.0, 0.005)))  # the head's top
    browser.wait("measured.length === 1")
    browser.press(*place(browser, "block", (-0.012, -0.012, 0.02)))
    browser.wait("measured.length === 2")
    assert "angle 0°" in browser.text("#measured")
    assert "distance 20.5 mm (along the normal)" in browser.text("#measured")  # 35.5 + 5 - 20
    browser.press(*place(browser, "peg", (0.0, -0.008, 0.0025)))  # the head's side
    browser.wait("measured.length === 1")
    assert "diameter 16 mm" in browser.text("#measured")
    browser.click("#measure")


def test_a_section_is_cut_and_what_is_cut_away_is_not_picked(bench: Workbench, browser: Browser) -> None:
    at = place(browser, "block", (0.02, -0.01, 0.01))  # its side towards the eye
    browser.press(*at)
    browser.wait("selection.surface >= 0")
    whole = browser.text("#selected")
    browser.press(30, 780)
    before = browser.picture().astype(int)
    browser.run("$('section-axis').value = 'x'; $('section-axis').onchange(); 1")
    browser.click("#section")  # its middle: through the axis
    browser.wait("viewer.renderer.localClippingEnabled && clip() !== null")
    assert (np.abs(browser.picture().astype(int) - before).max(axis=2) > 25).mean() > 0.005
    browser.press(*at)
    browser.wait("selection.surface >= 0 || selection.parts.length === 0")
    assert browser.text("#selected") != whole
    browser.run("$('section-axis').value = ''; $('section-axis').onchange(); 1")
    browser.press(30, 780)
    assert np.abs(browser.picture().astype(int) - before).mean() < 0.5


def test_the_picture_is_what_is_seen(bench: Workbench, browser: Browser, tmp_path: Path) -> None:
    browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    seen = browser.picture()
    browser.click("#picture")
    browser.wait("world.downloaded === 'vpframe.png'")
    saved = tmp_path / "vpframe.png"
    until = time.monotonic() + 20.0
    while not saved.exists() and time.monotonic() < until:
        time.sleep(0.05)
    picture = np.asarray(Image.open(saved).convert("RGB")).astype(int)
    left, top = map(round, browser.run("onScreen({ x: -1, y: 1 })"))
    right, bottom = map(round, browser.run("onScreen({ x: 1, y: -1 })"))
    canvas = seen[top:bottom, left:right].astype(int)
    assert picture.shape == canvas.shape
    assert np.abs(picture - canvas).mean() < 1.0
    assert picture.std() > 10.0


def test_nothing_is_painted_while_nothing_changes(bench: Workbench, browser: Browser) -> None:
    browser.wait("painter.rested")
    count = browser.run("painter.count")
    browser.run("viewer.set_dirty(); 1")
    time.sleep(0.7)
    assert browser.run("painter.count") == count
    browser.mouse("Moved", *place(browser, "peg", HEAD))
    browser.wait(f"painter.count > {count}")
    browser.wait("painter.rested")
    count = browser.run("painter.count")
    time.sleep(0.5)
    assert browser.run("painter.count") == count


def test_what_moves_is_painted_where_all_would_be(bench: Workbench, browser: Browser) -> None:
    """Over the picture of what stands, with its depth, comes to the same pixels as all drawn at once."""
    browser.wait("painter.rested")
    same = browser.run(
        """(() => {
            const pixels = () => {
                const { width, height } = canvas.domElement, made = new Uint8Array(4 * width * height);
                const gl = canvas.getContext();
                gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, made);
                return made;
            };
            const unlike = (a, b) => a.reduce((n, value, k) => n + (Math.abs(value - b[k]) > 4), 0) / a.length;
            const peg = world.parts.find((part) => part.name === "peg"), found = [], still = pixels();
            for (const height of [0.004, 0.012, -0.006]) { // the last one inside the block
                painter.level = PLAIN;
                painter.coarsened = performance.now(); // finer frames are not tried now
                peg.group.position.set(0, 0, height);
                repaint(performance.now());
                const layered = pixels(), loose = painter.loose.size;
                for (const object of painter.known.keys()) object.layers.set(0);
                drawAll();
                found.push([loose, unlike(layered, pixels()), unlike(layered, still)]);
                painter.stale = true;
            }
            peg.group.position.set(0, 0, 0);
            painter.level = FINE;
            return found;
        })()"""
    )
    for loose, off, moved in same:
        assert 0 < loose < browser.run("painter.known.size")
        assert off < 1e-5 and moved > 1e-3


def test_a_click_on_a_clash_shows_its_place_and_the_timeline_jumps_to_one(tmp_path: Path, browser: Browser) -> None:
    model = m.write_step(
        tmp_path / "clash.step",
        {
            "base": (m.box(0.04, 0.04, 0.02), pin.SE3.Identity()),
            "wedge": (m.box(0.01, 0.01, 0.01), pin.SE3(np.eye(3), np.array([0.035, 0.01, 0.005]))),
            "free": (m.box(0.01, 0.01, 0.01), pin.SE3(np.eye(3), np.array([0.01, 0.01, 0.03]))),
        },
    )
    with served(model, browser) as bench:
        browser.wait("world.found && world.found.done", 120)
        assert browser.text("#clash-count") == "1"
        assert "base – wedge" in browser.text("#clashes .row") and "5 mm" in browser.text("#clashes .row")
        browser.click("#clashes .row .what")
        browser.wait("marker !== null")
        assert browser.run("world.parts.map((part) => Boolean(part.faded))") == [False, False, True]
        x, y, z = browser.run("marker.position.toArray()")
        assert 0.0349 < x < 0.0401 and 0.0099 < y < 0.0201 and 0.0049 < z < 0.0151
        assert " · face " in browser.text("#selected")
        browser.wait("painter.rested")
        assert (np.abs(browser.picture()[:, 320:960].astype(int) - [224, 27, 36]).max(axis=2) < 60).any(), "the dot"
        browser.press(330, 30)
        browser.wait("marker === null && !world.parts[2].faded")
        browser.click("#home")
        browser.press(*place(browser, "free", (0.005, 0.005, 0.01)))
        browser.wait("selection.parts.length === 1")
        browser.click("#grab")
        browser.wait("holding()")
        browser.run("$('free').checked = true; $('exact-axis').value = 'z'; $('exact-by').value = '-15'; 1")
        browser.click("#exact-go")
        browser.wait("desk.undo === 2")
        clashed = next(event for event in bench.session.events if event.kind in ("collided", "blocked"))
        browser.click("#earlier")
        browser.wait("timeline.back === true")
        assert clashed.parts
        browser.click("#to-clash")
        browser.wait("world.last.step > 0")
        browser.click("#now")
        browser.wait("!looking() && elsewhere().size === 1")
        browser.click("#events .place")
        browser.wait("looking() && timeline.shown < timeline.newest")
        browser.click("#now")
        for undo in (1, 0):
            browser.key("z", ctrl=True)
            browser.wait(f"desk.undo === {undo}")
        browser.wait("world.last.moved.length === 1 && elsewhere().size === 0")  # clashes as found hold for it again


def test_what_is_undone_leaves_the_pages_events_and_timeline(bench: Workbench, browser: Browser) -> None:
    take(browser)
    browser.wait("timeline.newest === timeline.shown")
    newest = browser.run("timeline.newest")
    accept_concentric(browser, bench)
    assert browser.run("timeline.newest") > newest
    browser.wait("$('events').textContent.includes('accepted')")
    with Browser(800, 600) as other:
        other.open(bench.viewer.url)
        other.wait("$('events').textContent.includes('accepted')")
        for undo in (2, 1):
            browser.key("z", ctrl=True)
            browser.wait(f"desk.undo === {undo}")
        assert [event.kind for event in bench.session.events] == ["grabbed"]
        for page in (browser, other):
            page.wait("!$('events').textContent.includes('accepted')")
            page.wait("$('events').childElementCount === 1")
            page.wait(f"timeline.newest === {newest} && Number($('scrub').max) === {newest}")
            assert page.run("timeline.events.every((event) => event.kind !== 'accepted')")
        assert other.errors == []


def test_the_wheel_keeps_what_is_under_the_cursor_and_f_frames_the_part(bench: Workbench, browser: Browser) -> None:
    x, y = place(browser, "peg", HEAD)
    far = browser.run("viewer.camera.position.distanceTo(viewer.controls.target)")
    browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-300)
    browser.wait(f"viewer.camera.position.distanceTo(viewer.controls.target) < 0.8 * {far}")
    assert place(browser, "peg", HEAD) == pytest.approx((x, y), abs=3.0)
    browser.press(*place(browser, "peg", HEAD))
    browser.wait("selection.parts.length === 1")
    browser.key("f")
    browser.settle()
    middle = browser.run("onScreen({ x: 0, y: 0 })")  # of what the panels leave free
    assert place(browser, "peg", (0.0, 0.0, -0.005)) == pytest.approx(middle, abs=12)
    browser.key("Home")
    browser.settle()
    assert browser.run("viewer.camera.position.distanceTo(viewer.controls.target)") == pytest.approx(far)


def test_a_long_part_is_seen_whole_beside_the_panels(tmp_path: Path, browser: Browser) -> None:
    model = m.write_step(tmp_path / "bar.step", {"bar": (m.box(0.3, 0.03, 0.02), pin.SE3.Identity())})
    with served(model, browser):
        browser.run(
            "hear([{ frame: 0, time: 0, kind: 'note', tone: 'dim', text: 'a note', parts: [] }]); tell(world.last); 1"
        )
        try:
            for size in ((1300, 800), (1120, 900)):
                browser.resize(*size)
                browser.settle()
                browser.click("#home")
                browser.wait("isWhole(world.parts[0])")
                apart = """[...document.querySelectorAll('header, aside, footer')].every((panel) => {
                    const a = panel.getBoundingClientRect(), b = canvas.domElement.getBoundingClientRect();
                    return a.right <= b.left || a.left >= b.right || a.top >= b.bottom; })"""
                assert browser.run(apart), size
                assert browser.run("$('events').textContent.includes('a note')")
        finally:
            browser.resize(1300, 800)


def test_a_page_that_lost_its_connection_does_not_say_that_the_session_ended(
    bench: Workbench, browser: Browser
) -> None:
    browser.run("socket.close(); 1")
    browser.wait("document.querySelector('#status').textContent === 'connection lost: reload the page'")
    browser.open(bench.viewer.url)
    browser.wait("world.last !== null")
    assert browser.text("#status") == ""


def test_two_pages_see_the_same_and_one_holds(bench: Workbench, browser: Browser) -> None:
    take(browser)
    with Browser(1000, 700) as other:
        other.open(bench.viewer.url)
        other.wait("world.last !== null")
        other.wait("document.querySelector('#in-hand').textContent === 'peg held by another page'")
        assert other.run("document.querySelector('#grab').disabled")
        browser.run("$('exact-axis').value = 'z'; $('exact-by').value = '15'; 1")
        browser.click("#exact-go")
        shown = "world.parts[1].group.parent.matrix.elements[14]"
        browser.wait(f"{shown} > 0.0504")
        other.wait(f"{shown} > 0.0504")
        other.run("send({action: 'release'}); send({action: 'undo'}); 1")
        other.wait("document.querySelector('#say').textContent.includes('another page holds peg')")
        assert bench.hand.held == "peg"
        browser.click("#release")
        other.wait("document.querySelector('#in-hand').textContent === 'nothing in hand'")
        assert other.errors == []


def cover_on_its_screws() -> vp.Scene:
    """A cover on a block, held by two screws through it."""
    block = m.box(0.06, 0.04, 0.02)
    cover = m.box(0.06, 0.04, 0.005)
    for x in (0.015, 0.045):
        block = block - m.cylinder(0.002, 0.012).translated(x, 0.02, 0.008)
        cover = cover - m.cylinder(0.0022, 0.005).translated(x, 0.02, 0.0)
    screw = m.cylinder(0.002, 0.012) + m.cylinder(0.0035, 0.003).translated(0.0, 0.0, 0.012)
    parts = {"block": (block, pin.SE3.Identity()), "cover": (cover, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.02])))}
    for k, x in enumerate((0.015, 0.045), start=1):
        parts[f"screw_{k}"] = (screw, pin.SE3(np.eye(3), np.array([x, 0.02, 0.013])))
    made = m.scene(parts)
    made["block"].fixed = True
    return made


def test_a_pull_that_mates_forbid_says_what_holds_and_takes_it_out(browser: Browser, tmp_path: Path) -> None:
    made = Workbench(cover_on_its_screws(), tmp_path / "cover.step", {})
    runner = threading.Thread(target=made.run)
    runner.start()
    try:
        browser.open(made.viewer.url)
        browser.wait("world.last !== null", 120)
        at = place(browser, "cover", (0.03, 0.02, 0.005))
        browser.press(*at)
        browser.wait("selection.parts.length === 1")
        browser.click("#grab")
        browser.wait("holding()")
        browser.drag(at, *((at[0], at[1] - 12 * k) for k in range(1, 8)))
        browser.wait("!document.querySelector('#why').hidden")
        words = browser.text("#why-text")
        assert words.startswith("held by against: cover – ") and "block" not in words
        assert "screw_1" in words and "screw_2" in words
        assert not browser.run("document.querySelector('#why-free').hidden")
        browser.click("#why-loosen")
        browser.wait("holding() && desk.script.some((line) => line.includes('hand.remove'))", 60)
        assert not any("screw" in name for c in made.session.constraints_of("cover") for name in c.parts)
        assert browser.errors == []
    finally:
        made.stop()
        runner.join(60)
    assert not runner.is_alive()
