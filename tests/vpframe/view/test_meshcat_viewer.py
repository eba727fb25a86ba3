"""The viewer as a page sees it: through its web server and its socket."""

import asyncio
import contextlib
import gc
import json
import os
import random
import socket
import struct
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
import tornado.websocket

from tests.vpframe.view.pages import answer, connect, of_type, receive, socket_answer, socket_of
from tests.vpframe.waiting import wait_until
from tests.vpframe.watching import fake_session, pressing_frames, pressing_scene
from vpframe.errors import VpframeError
from vpframe.session.controls import Controls, Request
from vpframe.view.meshcat_viewer import MeshcatViewer, write_page
from vpframe.view.page_protocol import Encoder


def test_a_wait_for_a_page_ends_when_it_has_drawn_or_with_its_time(viewer):
    async def waited(client, most):
        began = time.monotonic()
        await asyncio.to_thread(viewer.wait_for, client, most)
        return time.monotonic() - began

    async def look():
        page = await connect(viewer)
        await receive(page, of_type("scene"), answer=False)
        viewer.frame(pressing_frames(2)[0])
        assert await waited(1, 0.2) >= 0.2  # the scene is not drawn yet
        assert await waited(2, 20.0) < 10.0  # there is no such page
        await page.write_message('{"action": "drawn"}')
        assert await waited(1, 20.0) < 10.0

    asyncio.run(look())


def test_a_page_that_does_not_answer_gets_no_more_and_holds_nobody_up(viewer):
    frames = pressing_frames(300)

    async def look():
        page = await connect(viewer)
        await receive(page, of_type("scene"), answer=False)
        for frame in frames:
            viewer.frame(frame)
        got = []
        while True:
            try:
                got.append(json.loads(await asyncio.wait_for(page.read_message(), 0.3)))
            except TimeoutError:
                return got

    assert asyncio.run(look()) == []


def test_a_page_is_sent_one_frame_while_it_draws_another(viewer):
    frames = pressing_frames(300)

    async def look():
        page = await connect(viewer)
        await receive(page, of_type("scene"))
        await asyncio.sleep(0.1)
        for frame in frames:
            viewer.frame(frame)
            await asyncio.sleep(0.001)
        got = []
        while True:
            try:
                got.append(json.loads(await asyncio.wait_for(page.read_message(), 0.1)))
            except TimeoutError:
                return [message["step"] for message in got if message["type"] == "frame"]

    steps = asyncio.run(look())
    assert len(steps) == 2 and steps == sorted(steps), steps


def test_a_page_that_is_gone_is_forgotten(viewer):
    async def look():
        page = await connect(viewer)
        await receive(page, of_type("scene"))
        page.close()

    asyncio.run(look())
    wait_until(lambda: viewer.clients == 0, 5.0)
    viewer.frame(pressing_frames(2)[0])


async def come_and_go(viewer, kind):
    """A client that goes in the middle of something."""
    place = urllib.parse.urlsplit(viewer.url)
    chance = random.Random(kind)
    await asyncio.sleep(2.0 * chance.random())
    if kind % 4 < 2:  # before its page or its socket was answered, or soon after
        asked = f"GET {'/' if kind % 4 else '/socket'}?{place.query} HTTP/1.1\r\nHost: {place.netloc}\r\n"
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        _, writer = await asyncio.open_connection(place.hostname, place.port)
        writer.write(f"{asked}Connection: Upgrade\r\nUpgrade: websocket\r\n{key}\r\n".encode())
        await writer.drain()
        await asyncio.sleep(0.02 * chance.random())
        now = struct.pack("ii", 1, 0)
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, now)
        writer.transport.abort()
        return
    page = await connect(viewer)
    for _ in range(chance.randrange(6)):
        if await page.read_message() is None:
            break
        if kind % 4 == 2:
            await page.write_message('{"action": "drawn"}')
    page.close()


@pytest.mark.slow
def test_two_hundred_clients_come_and_go_and_leave_nothing(viewer, caplog):
    frames, done = pressing_frames(2000), threading.Event()

    def run():
        while not done.is_set():
            for frame in frames:
                viewer.frame(frame)
                if done.wait(5e-4):
                    return

    def handles():
        return len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0

    async def all_of_them():
        await asyncio.wait_for(asyncio.gather(*(come_and_go(viewer, kind) for kind in range(200))), 60)

    runner = threading.Thread(target=run)
    gc.collect()  # of what other tests left
    before = handles()
    runner.start()
    try:
        asyncio.run(all_of_them())
        wait_until(lambda: not viewer.clients and handles() <= before, 20.0)
    finally:
        done.set()
        runner.join()
    gc.collect()  # an error that nobody heard of is said when its task goes
    assert [record.getMessage() for record in caplog.records] == []
    assert viewer.clients == 0 and handles() <= before


def test_a_silent_page_is_dropped(viewer, monkeypatch):
    from vpframe.view import server

    monkeypatch.setattr(server, "PATIENCE", 0.05)

    async def look():
        page = await connect(viewer)
        return await receive(page, lambda message: False, answer=False)

    assert [m["type"] for m in asyncio.run(look())] == ["scene"]
    assert viewer.clients == 0


def without_token(address):
    return urllib.parse.urlsplit(address)._replace(query="").geturl()


def other_address():
    """An address of this machine that is not loopback; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            address = probe.getsockname()[0]
        except OSError:
            pytest.skip("this machine has no network")
    if address.startswith("127."):
        pytest.skip("this machine has no other address")
    return address


def test_served_to_the_network_other_machines_see_and_act():
    viewer = MeshcatViewer(host="0.0.0.0")
    viewer.begin(fake_session().scene)
    try:
        port = urllib.parse.urlsplit(viewer.url).port
        assert viewer.url.startswith("http://127.0.0.1:")
        assert urllib.parse.urlsplit(viewer.outside).hostname == socket.gethostname().lower()
        for name in (other_address(), "127.0.0.1"):
            place = f"{name}:{port}"
            assert answer(urllib.parse.urlsplit(viewer.url)._replace(netloc=place).geturl())[0] == 200
            assert socket_answer(socket_of(viewer, netloc=place), Origin=f"http://{place}") == "scene"
            assert answer(f"http://{place}/")[0] == 403
            assert socket_answer(socket_of(viewer, netloc=place, query="")) == 403
        assert answer(viewer.url, Host="evil.example")[0] == 403
    finally:
        viewer.end()


def test_what_a_person_does_on_the_page_reaches_the_session(viewer):
    async def act():
        page = await connect(viewer)
        for message in ({"action": "accept", "id": 3}, {"action": "refuse", "id": 4}):
            await page.write_message(json.dumps(message))
        for nonsense in ("{", "[]", '{"action": "erase"}', '{"action": "accept"}', '{"action": "accept", "id": true}'):
            await page.write_message(nonsense)
        await page.write_message('{"action": "pause"}')  # what was sent before has been read when this has
        while not viewer.controls.paused:
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(act(), 10))
    assert viewer.controls.take() == (Request("accept", 3), Request("refuse", 4))
    assert viewer.controls.take() == ()


def test_pause_holds_a_frame_until_play_and_step_lets_one_through(viewer):
    frames, passed = pressing_frames(6), []
    viewer.controls.put(Request("pause"))

    def run():
        for frame in frames:
            viewer.frame(frame)
            passed.append(frame.step)

    def settled(count):
        until = time.monotonic() + 5.0
        while len(passed) < count and time.monotonic() < until:
            time.sleep(0.005)
        time.sleep(0.03)
        return len(passed)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert settled(0) == 0
    viewer.controls.put(Request("step"))
    assert settled(1) == 1
    viewer.controls.put(Request("play"))
    thread.join(5.0)
    assert passed == [frame.step for frame in frames]


def test_pace_holds_the_session_to_the_clock_only_while_a_page_looks(monkeypatch):
    from vpframe.view import meshcat_viewer

    frames, slept = pressing_frames(30), []
    viewer = MeshcatViewer(pace=0.5)
    monkeypatch.setattr(meshcat_viewer.time, "sleep", slept.append)
    for frame in frames:
        viewer.frame(frame)
    assert slept == []
    monkeypatch.setattr(MeshcatViewer, "clients", 1)
    for frame in frames[1:]:
        viewer.frame(frame)
    assert max(slept) <= 2 / 60  # twice the step, less what has passed
    assert len(slept) >= 25


def test_waiting_gives_up_after_its_timeout():
    controls = Controls()
    assert controls.wait(0.0)
    controls.put(Request("pause"))
    assert not controls.wait(0.01)
    controls.put(Request("step"))
    assert controls.wait(0.01)
    assert not controls.wait(0.01)


def test_a_taken_port_is_one_clear_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(VpframeError, match=f"127.0.0.1:{port}"):
            MeshcatViewer(port=port).show(pressing_scene())


def test_before_the_session_there_is_no_address_and_nothing_to_write(tmp_path):
    with pytest.raises(VpframeError):
        _ = MeshcatViewer().url
    with pytest.raises(VpframeError):
        MeshcatViewer().static_html(tmp_path / "page.html")


def embedded(page):
    """The messages in a static page, each frame with what it takes from the one before."""
    messages, before = [], {}
    for message in json.loads(page.split(' id="embedded">', 1)[1].split("</script>", 1)[0]):
        if message["type"] == "frame":
            message = before = {**before, **message}
        messages.append(message)
    return messages


def test_the_static_page_needs_nothing_from_outside(viewer, tmp_path):
    frames = pressing_frames(40)
    for frame in frames:
        viewer.frame(frame)
    page = viewer.static_html(tmp_path / "deep" / "page.html").read_text()
    head = page.split("<script>", 1)[0]
    assert "src=" not in head
    assert '<link rel="stylesheet"' not in page
    messages = embedded(page)
    assert [m["step"] for m in messages if m["type"] == "frame"] == [frame.step for frame in frames]
    assert sum(len(m["events"]) for m in messages if m["type"] == "frame") == 3
    encoder = Encoder(pressing_scene())
    whole = [json.loads(json.dumps(encoder.frame(frame, frame.events)[1])) for frame in frames]
    assert [m for m in messages if m["type"] == "frame"] == whole


def test_the_static_page_survives_names_that_look_like_markup(tmp_path):
    from vpframe.scene.scene import Part, Scene

    name = "</script><script>alert(1)</script>"
    scene = Scene([Part(name, pressing_scene()["rod"].shape, pressing_scene()["rod"].pose)])
    page = tmp_path / "page.html"
    assert write_page(scene, (), page) == page
    assert "alert(1)</script>" not in page.read_text()
    assert embedded(page.read_text())[0]["parts"][0]["name"] == name


def raw_page(address):
    """A socket of a page that the test can break off without a word."""
    place = urllib.parse.urlsplit(address)
    made = socket.create_connection((place.hostname, place.port), timeout=10)
    lines = (
        f"GET /socket?{place.query} HTTP/1.1",
        f"Host: {place.netloc}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    )
    made.sendall("\r\n".join((*lines, "", "")).encode())
    return made


def test_200_pages_that_come_and_go_leave_no_handle_and_no_traceback(caplog, capfd):
    viewer = MeshcatViewer()
    viewer.begin(pressing_scene())
    frames = pressing_frames(60)
    handles = Path("/proc/self/fd")
    if not handles.is_dir():
        pytest.skip("handles are counted in /proc")
    gone = []
    viewer._gone = gone.append
    viewer.frame(frames[0])
    before = len(list(handles.iterdir()))
    try:
        for k in range(200):
            page = raw_page(viewer.url)
            if k % 4:
                assert page.recv(12) == b"HTTP/1.1 101"
            if k % 4 == 2:  # break off while it is written to
                page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            viewer.frame(frames[k % len(frames)])
            page.close()
            viewer.frame(frames[(k + 1) % len(frames)])
        until = time.monotonic() + 20.0
        while time.monotonic() < until and (viewer.clients or len(list(handles.iterdir())) > before):
            viewer.frame(frames[1])
            time.sleep(0.05)
        assert viewer.clients == 0
        assert len(list(handles.iterdir())) <= before
        assert len(gone) == len(set(gone)) and len(gone) >= 150
        assert viewer._notices == {}
    finally:
        viewer.end()
    gc.collect()  # exceptions that nobody asked for are told when they are collected
    assert "Traceback" not in caplog.text + "".join(capfd.readouterr())


def test_a_page_that_sends_too_much_is_dropped(viewer):
    async def flood():
        page = await tornado.websocket.websocket_connect(socket_of(viewer))
        for _ in range(2000):
            await page.write_message('{"action": "pause"}')
            if page.close_code is not None:
                break
        while await asyncio.wait_for(page.read_message(), 10) is not None:
            continue
        return page.close_code, page.close_reason

    with contextlib.suppress(tornado.websocket.WebSocketClosedError):
        assert asyncio.run(flood()) == (1008, "too many messages")
    assert viewer.clients == 0


def test_without_a_hand_requests_for_it_are_not_heard(viewer):
    async def ask():
        page = await tornado.websocket.websocket_connect(socket_of(viewer))
        for message in ({"action": "undo"}, {"action": "grab", "part": 0, "level": 0, "surface": -1}):
            await page.write_message(json.dumps(message))
        await page.write_message(json.dumps({"action": "accept", "id": 4}))
        while not (heard := viewer.controls.take()):
            await asyncio.sleep(0.01)
        return heard

    assert asyncio.run(asyncio.wait_for(ask(), 10)) == (Request("accept", 4),)
