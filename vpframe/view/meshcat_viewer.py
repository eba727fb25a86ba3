"""`MeshcatViewer`: a session live in the browser, on meshcat's viewer, and as a page without a server."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import time
import webbrowser
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import pinocchio as pin

from vpframe import files
from vpframe.app.outputs import PAGE, claimed, may_write
from vpframe.app.progress import warn
from vpframe.errors import VpframeError
from vpframe.scene.scene import Scene
from vpframe.session.events import Event, Frame
from vpframe.view.camera import first_view, frame_scene
from vpframe.view.controls import Controls
from vpframe.view.history import History
from vpframe.view.page import html
from vpframe.view.page_protocol import Encoder, Message, event_message
from vpframe.view.screen import has_screen

if TYPE_CHECKING:
    from vpframe.view.server import Server

BROWSER_SECONDS = 8.0
"""how long a session waits for the browser it has opened"""
LOOK = 0.05
"""s between two looks whether it is there"""
MAX_PAUSE = 0.25
"""s, the longest wait between two frames that `pace` can ask for"""

Cursor = tuple[int, int, bool]
"""how many strips and how many events a page has seen, and whether it knows that the session is over"""


class MeshcatViewer:
    """An observer that shows a session in the browser.

    Parameters
    ----------
    open_browser: open the page in the user's browser when the session begins, and wait for it for some seconds; without
        a screen its address is printed instead.
    host, port: where to listen; only this machine can reach the page unless `host` says otherwise. Port 0 is any free.
    frames: how many frames `static_html` can play back; a longer run is thinned evenly.
    pace: s of the session a second of the clock, at most, while a page is looking; None lets the session run freely.
    wait: the session waits for the first page, or until it is interrupted, and after its end is served on until `stay`
        returns or `close` is called.

    `frame` costs the session's loop a few microseconds: drawing happens in another thread, from the latest frame only.
    It waits in two cases: for `pace`, and when a person pressed "Pause". `controls` carries what they asked for.
    """

    def __init__(
        self,
        open_browser: bool = False,
        host: str = "127.0.0.1",
        port: int = 0,
        frames: int = 1200,
        pace: float | None = None,
        wait: bool = False,
    ) -> None:
        self.controls = Controls()
        self._open_browser = open_browser
        self._address = (host, port)
        self._pace = pace
        self._wait = wait
        self._over = False
        self._last = (0.0, 0.0)
        self._history = History(frames)
        self._lock = threading.Lock()
        self._server: Server | None = None
        self._scene: Scene | None = None

    @property
    def url(self) -> str:
        """Where the page is, once the session has begun; who has this address can see the session and act on it."""
        if self._server is None:
            raise VpframeError("the viewer has no address before the session begins")
        return self._server.url

    @property
    def outside(self) -> str | None:
        """The same for other machines; None where only this one is listened to."""
        return self._server.outside if self._server else None

    @property
    def clients(self) -> int:
        """How many pages are looking."""
        return self._server.clients if self._server else 0

    def begin(self, scene: Scene) -> None:
        """Start to serve."""
        self.show(scene)

    def show(self, scene: Scene) -> None:
        """Start to serve a scene as it stands."""
        from vpframe.view.server import Server

        self._scene = scene
        self._encoder = Encoder(scene, camera=first_view(scene))
        self._opening = _json(self._encoder.begin())
        self._strips: list[str] = []
        self._encoded: tuple[int, str] | None = None
        self._server = Server(html(), self._open, self._latest, self.controls, *self._address)
        opened = self._open_browser and has_screen() and webbrowser.open(self._server.url, new=2)
        if self._open_browser and not opened:
            warn(f"look at it at {self._server.url}")
        if self._wait:
            warn("waiting for a browser to look; --no-wait does not")
        until = time.monotonic() + (math.inf if self._wait else BROWSER_SECONDS if opened else 0.0)
        while not self.clients and time.monotonic() < until and not self.controls.asked_to_go(LOOK):
            continue

    def frame(self, frame: Frame) -> None:
        """Show this frame when a page is ready for it; wait here only while a person holds the session."""
        with self._lock:
            self._history.add(frame)
        if self._server is not None:
            self._server.notify()
        if self.controls.paused:
            self.controls.wait()
        if self._pace is not None and self.clients:
            seconds, clock = self._last
            ahead = (frame.time - seconds) / self._pace - (time.monotonic() - clock)
            if ahead > 0.0:
                time.sleep(min(ahead, MAX_PAUSE))
        self._last = (frame.time, time.monotonic())

    def end(self) -> None:
        """Show the last frame and stop to serve, at once or in `close`."""
        self._over = True
        if self._server is not None:
            self._server.notify()
            if not self._wait:
                self.close()

    def stay(self) -> None:
        """Serve the last frame until Ctrl-C."""
        warn(f"the page stays open until Ctrl-C: {self.url}")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()
        self.close()

    def close(self) -> None:
        """Stop to serve."""
        if self._server is not None:
            self._server.close()

    def static_html(self, path: str | os.PathLike[str]) -> Path:
        """Write one file that shows and plays back what was shown so far, without a server or any outside part.

        Raises OutputError where there is something that vpframe did not write.
        """
        if self._scene is None:
            raise VpframeError("there is nothing to write before the session begins")
        with self._lock:
            frames = list(self._history)
        return write_page(self._scene, frames, may_write(path, PAGE), self._encoder.start)

    def _open(self) -> tuple[list[str], Cursor]:
        """What a page needs first (in the server's thread)."""
        messages, cursor = self._latest((0, max(len(self._history.events) - 100, 0), False))
        return [self._opening, *messages], cursor

    def _latest(self, cursor: Cursor) -> tuple[list[str], Cursor]:
        """What a page that has seen `cursor` does not know yet (in the server's thread)."""
        with self._lock:
            frame, count, events = self._history.last, len(self._history), self._history.events_since(cursor[1])
        over = [_json({"type": "over"})] if self._over and not cursor[2] else []
        if frame is None:
            return over, (*cursor[:2], self._over)
        if self._encoded is None or self._encoded[0] != count:
            fresh, message = self._encoder.frame(frame)
            self._strips.extend(_json(strips) for strips in fresh)
            self._encoded = (count, _json(message))
        messages = [*self._strips[cursor[0] :], self._encoded[1]]
        if events:
            messages.append(_json({"type": "events", "events": [event_message(event) for event in events]}))
        return messages + over, (len(self._strips), cursor[1] + len(events), cursor[2] or bool(over))


def watched(wait: bool = False) -> MeshcatViewer:
    """A viewer in the browser, at the pace of the clock; `wait` as `MeshcatViewer` has it."""
    return MeshcatViewer(open_browser=True, pace=1.0, wait=wait)


def write_page(
    scene: Scene,
    frames: Iterable[tuple[Frame, tuple[Event, ...]]],
    path: str | Path,
    start: Mapping[str, pin.SE3] | None = None,
) -> Path:
    """Write one self-contained file that shows a scene and plays `frames`, each with the events since the one before.

    `start`: poses before the first frame, where they are not the scene's present ones.
    """
    shown = list(frames)
    poses = [frame.poses for frame, _ in shown[:: max(len(shown) // 40, 1)]]
    encoder = Encoder(scene, start, frame_scene(scene, start or {}, *poses))
    messages = [encoder.begin()]
    before: Message = {}
    for frame, events in shown:
        fresh, message = encoder.frame(frame, events)
        news = {k: v for k, v in message.items() if k == "type" or k not in before or before[k] != v}
        messages += [*fresh, news]  # the page takes the rest from the frame before
        before = message
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.replace(path, html(messages))
    return path


def view(
    scene: Scene,
    static: str | os.PathLike[str] | None = None,
    wait: bool = True,
    host: str = "127.0.0.1",
    open_browser: bool = True,
) -> str:
    """Look at a scene in the browser, or write it as one file when `static` names one. Returns where it is.

    `wait`: stay until Ctrl-C; without it the page is served as long as the program runs.
    """
    if static is not None:
        with claimed(static, PAGE) as output:
            return str(write_page(scene, (), output.path))
    viewer = MeshcatViewer(open_browser=open_browser and has_screen(), host=host)
    viewer.show(scene)
    print(f"{viewer.url}  (Ctrl-C ends)" if wait else viewer.url, flush=True)
    if viewer.outside:
        print(f"from other machines: {viewer.outside}", flush=True)
    if wait:
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            viewer.end()
    return viewer.url


def _json(message: Message) -> str:
    return json.dumps(message, separators=(",", ":"))
