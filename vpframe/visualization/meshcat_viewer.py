"""`MeshcatViewer`: a session live in the browser, on meshcat's viewer, and as a page without a server."""

from __future__ import annotations

import json
import sys
import threading
import time
import webbrowser
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import pinocchio as pin

from vpframe.errors import VpframeError
from vpframe.events import Event, Frame
from vpframe.scene import Scene
from vpframe.visualization.camera import first_view, frame_scene
from vpframe.visualization.controls import Controls
from vpframe.visualization.history import History
from vpframe.visualization.page import html
from vpframe.visualization.screen import has_screen
from vpframe.visualization.wire import Encoder, Message, event_message

if TYPE_CHECKING:
    from vpframe.session import Session
    from vpframe.visualization.server import Server

BROWSER_SECONDS = 8.0
"""how long a session waits for the browser it has opened"""
MAX_PAUSE = 0.25
"""s, the longest wait between two frames that `pace` can ask for"""

Cursor = tuple[int, int]
"""how many strips and how many events a page has seen"""


class MeshcatViewer:
    """An observer that shows a session in the browser.

    Parameters
    ----------
    open_browser: open the page in the user's browser when the session begins, and wait for it for some seconds; without
        a screen its address is printed instead.
    host, port: where to listen; only this machine can reach the page unless `host` says otherwise. Port 0 is any free.
    frames: how many frames `static_html` can play back; a longer run is thinned evenly.
    pace: s of the session a second of the clock, at most, while a page is looking; None lets the session run freely.

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
    ) -> None:
        self.controls = Controls()
        self._open_browser = open_browser
        self._address = (host, port)
        self._pace = pace
        self._last = (0.0, 0.0)
        self._history = History(frames)
        self._lock = threading.Lock()
        self._server: Server | None = None
        self._scene: Scene | None = None

    @property
    def url(self) -> str:
        """Where the page is, once the session has begun."""
        if self._server is None:
            raise VpframeError("the viewer has no address before the session begins")
        return self._server.url

    @property
    def clients(self) -> int:
        """How many pages are looking."""
        return self._server.clients if self._server else 0

    def begin(self, session: Session) -> None:
        """Start to serve."""
        self.show(session.scene)

    def show(self, scene: Scene) -> None:
        """Start to serve a scene as it stands."""
        from vpframe.visualization.server import Server

        self._scene = scene
        self._encoder = Encoder(scene, camera=first_view(scene))
        self._opening = _json(self._encoder.begin())
        self._strips: list[str] = []
        self._encoded: tuple[int, str] | None = None
        self._server = Server(html(), self._open, self._latest, self.controls, *self._address)
        if self._open_browser:
            if has_screen() and webbrowser.open(self._server.url, new=2):
                until = time.monotonic() + BROWSER_SECONDS
                while not self.clients and time.monotonic() < until:
                    time.sleep(0.05)
            else:
                print(f"look at it at {self._server.url}", file=sys.stderr, flush=True)

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
        """Show the last frame and stop to serve."""
        if self._server is not None:
            self._server.close()

    def static_html(self, path: str | Path) -> Path:
        """Write one file that shows and plays back what was shown so far, without a server or any outside part."""
        if self._scene is None:
            raise VpframeError("there is nothing to write before the session begins")
        with self._lock:
            frames = list(self._history)
        return write_page(self._scene, frames, path, self._encoder.start)

    def _open(self) -> tuple[list[str], Cursor]:
        """What a page needs first (in the server's thread)."""
        messages, cursor = self._latest((0, max(len(self._history.events) - 100, 0)))
        return [self._opening, *messages], cursor

    def _latest(self, cursor: Cursor) -> tuple[list[str], Cursor]:
        """What a page that has seen `cursor` does not know yet (in the server's thread)."""
        with self._lock:
            frame, count, events = self._history.last, len(self._history), self._history.events_since(cursor[1])
        if frame is None:
            return [], cursor
        if self._encoded is None or self._encoded[0] != count:
            fresh, message = self._encoder.frame(frame)
            self._strips.extend(_json(strips) for strips in fresh)
            self._encoded = (count, _json(message))
        messages = [*self._strips[cursor[0] :], self._encoded[1]]
        if events:
            messages.append(_json({"type": "events", "events": [event_message(event) for event in events]}))
        return messages, (len(self._strips), cursor[1] + len(events))


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
    path.write_text(html(messages), encoding="utf-8")
    return path


def view(
    scene: Scene,
    static: str | Path | None = None,
    wait: bool = True,
    host: str = "127.0.0.1",
    open_browser: bool = True,
) -> str:
    """Look at a scene in the browser, or write it as one file when `static` names one. Returns where it is.

    `wait`: stay until Ctrl-C; without it the page is served as long as the program runs.
    """
    if static is not None:
        return str(write_page(scene, (), static))
    viewer = MeshcatViewer(open_browser=open_browser and has_screen(), host=host)
    viewer.show(scene)
    print(f"{viewer.url}  (Ctrl-C ends)" if wait else viewer.url, flush=True)
    if wait:
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            viewer.end()
    return viewer.url


def _json(message: Message) -> str:
    return json.dumps(message, separators=(",", ":"))
