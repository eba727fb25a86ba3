"""Messages to the page."""

import asyncio
import base64
import threading

import numpy as np

from tests.vpframe.view.pages import connect, of_type, receive
from tests.vpframe.watching import pressing_frames, pressing_scene
from vpframe.view.display import display_mesh


def floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_a_page_gets_the_scene_and_then_the_latest_frame(viewer):
    frames = pressing_frames(40)
    for frame in frames[:21]:
        viewer.frame(frame)

    async def look():
        page = await connect(viewer)
        return await receive(page, of_type("events"))

    messages = asyncio.run(look())
    scene = messages[0]
    assert scene["type"] == "scene"
    assert [part["name"] for part in scene["parts"]] == ["plate", "rod"]
    mesh = display_mesh(pressing_scene()["rod"].shape)
    shape = scene["shapes"][scene["parts"][1]["shape"]]
    np.testing.assert_array_equal(floats(shape["positions"]).reshape(-1, 3), mesh.positions)
    frame = next(m for m in messages if m["type"] == "frame")
    last = frames[20]
    assert frame["step"] == last.step
    assert frame["colliding"] == last.colliding.tolist()
    assert frame["moved"] == [1]
    matrix = floats(frame["poses"]).reshape(4, 4).T
    np.testing.assert_allclose(matrix, last.poses["rod"].homogeneous, atol=1e-7)
    known = {m["number"] for m in messages if m["type"] == "strips"}
    assert {symbol["strips"] for symbol in frame["symbols"]} <= known
    assert [e["kind"] for e in messages[-1]["events"]] == ["collided", "recognised"]


def test_every_event_arrives_once_however_many_frames_are_skipped(viewer):
    frames = pressing_frames(2000)

    async def look():
        page = await connect(viewer)
        await receive(page, of_type("scene"))
        thread = threading.Thread(target=lambda: [viewer.frame(frame) for frame in frames])
        thread.start()
        got = []
        while not any(m["type"] == "frame" and m["step"] == frames[-1].step for m in got):
            got += await receive(page, of_type("frame"))
        while sum(len(m["events"]) for m in got if m["type"] == "events") < 3:  # those of the last frame follow it
            got += await receive(page, of_type("events"))
        thread.join()
        return got

    messages = asyncio.run(look())
    steps = [m["step"] for m in messages if m["type"] == "frame"]
    assert steps == sorted(set(steps))
    assert len(steps) < len(frames)  # a page gets the latest, not all
    kinds = [e["kind"] for m in messages if m["type"] == "events" for e in m["events"]]
    assert kinds == ["collided", "recognised", "parted"]
