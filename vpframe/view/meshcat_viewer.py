"""`MeshcatViewer`: a session live in the browser, on meshcat's viewer, and as a page without a server."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import time
import webbrowser
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pinocchio as pin

from vpframe import files
from vpframe.console import warn
from vpframe.errors import VpframeError
from vpframe.events import Event, Frame
from vpframe.outputs import PAGE, may_write
from vpframe.scene.scene import Scene
from vpframe.session.controls import Controls
from vpframe.session.history import History
from vpframe.session.requests import ABOUT_CONSTRAINTS, OF_THE_RUN, Request
from vpframe.view.camera import first_view, frame_scene
from vpframe.view.page import html
from vpframe.view.page_protocol import Encoder, Message, event_message
from vpframe.view.screen import has_screen

if TYPE_CHECKING:
    from vpframe.view.server import Server

BROWSER_SECONDS = 8.0
"""s that a session waits for the browser that it has opened"""
LOOK = 0.05
"""s between two checks whether the browser has connected"""
EVENTS = 1000
"""number of past events sent to a page that connects late"""
MAX_PAUSE = 0.25
"""s, the longest wait between two frames that `pace` can ask for"""


class Cursor(NamedTuple):
    """The state of a page: what it has received."""

    client: int
    strips: int = 0
    events: int = 0
    over: bool = False
    notices: int = 0
    look: int = -1
    """number of the past frame that a person views; -1: the newest"""
    shown: int = -1
    """the past frame that the page was sent"""
    undone: int = 0
    """number of undos of the session that the page knows"""


class MeshcatViewer:
    """An observer that shows a session in the browser.

    `frame` costs the session's loop a few microseconds: drawing happens in another thread, from the latest frame only.
    It waits in two cases: for `pace`, and when a person pressed "Pause". `controls` has the requests of pages.

    Parameters
    ----------
    open_browser: open the page in the user's browser when the session begins, and wait for it for some seconds; without
        a screen its address is printed instead.
    host, port: where to listen; only this machine can reach the page unless `host` says otherwise. Port 0 is any free.
    frames: how many frames `static_html` can play back; a longer run is thinned evenly.
    pace: s of the session a second of the clock, at most, while a page is looking; None lets the session run freely.
    wait: the session waits for the first page, or until it is interrupted, and after its end is served on until `stay`
        returns or `close` is called.
    ask: takes the pages' requests for the hand and about what was done, any thread; None: pages have no hand.
    gone: called with the number of a page that has disconnected.
    """

    def __init__(
        self,
        open_browser: bool = False,
        host: str = "127.0.0.1",
        port: int = 0,
        frames: int = 1200,
        pace: float | None = None,
        wait: bool = False,
        ask: Callable[[Request], None] | None = None,
        gone: Callable[[int], None] = lambda client: None,
    ) -> None:
        self.controls = Controls()
        self._ask = ask
        self._gone = gone
        self._open_browser = open_browser
        self._address = (host, port)
        self._pace = pace
        self._wait = wait
        self._over = False
        self._last = (0.0, 0.0)
        self._history = History(frames)
        self._undone = 0
        self._lock = threading.Lock()
        self._count = 0
        self._notices: dict[str, tuple[int, int, str]] = {}
        """by type and page: number, page (0: all), message"""
        self._server: Server | None = None
        self._scene: Scene | None = None

    @property
    def url(self) -> str:
        """Address of the page after the session has begun; whoever has it can view and control the session."""
        if self._server is None:
            raise VpframeError("the viewer has no address before the session begins")
        return self._server.url

    @property
    def outside(self) -> str | None:
        """The address for other machines; None if only this machine is served."""
        return self._server.outside if self._server else None

    @property
    def clients(self) -> int:
        """Number of connected pages."""
        return self._server.clients if self._server else 0

    def show(self, scene: Scene) -> None:
        """Start to serve a scene without a session."""
        from vpframe.view.server import Server

        if self._server is not None:
            return
        self._scene = scene
        self._encoder = Encoder(scene, camera=first_view(scene))
        self._opening = _json({**self._encoder.begin(), "hand": self._ask is not None})
        self._strips: list[str] = []
        self._encoded: tuple[Frame, str] | None = None
        self._server = Server(html(), self._open, self._latest, self._asked, *self._address, gone=self._left)
        opened = self._open_browser and has_screen() and webbrowser.open(self._server.url, new=2)
        if self._open_browser and not opened:
            warn(f"look at it at {self._server.url}")
        if self._wait:
            warn("waiting for a browser to look; --no-wait does not")
        until = time.monotonic() + (math.inf if self._wait else BROWSER_SECONDS if opened else 0.0)
        while not self.clients and time.monotonic() < until and not self.controls.asked_to_go(LOOK):
            continue

    begin = show

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

    def wait_for(self, client: int, most: float) -> None:
        """Wait until a page has drawn all frames but the latest, at most `most` s."""
        if self._server is not None:
            self._server.wait_for(client, most)

    def rewind(self, last: Frame | None, events: int) -> None:
        """Forget the frames after `last` and the events after the first `events`; pages do so with the next frame."""
        with self._lock:
            self._history.rewind(last, events)
            self._undone += 1

    def end(self) -> None:
        """Show the last frame and stop the server, at once or in `close`."""
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
        """Stop the server."""
        if self._server is not None:
            self._server.close()

    def static_html(self, path: str | os.PathLike[str]) -> Path:
        """Write one file that plays back everything shown so far, without a server or external resources.

        Raises OutputError where there is something that vpframe did not write.
        """
        if self._scene is None:
            raise VpframeError("there is nothing to write before the session begins")
        with self._lock:
            frames = list(self._history)
        return write_page(self._scene, frames, may_write(path, PAGE), self._encoder.start)

    def publish(self, message: Message, client: int = 0) -> None:
        """Show a message to all pages (the latest of its type to those that come later), or to one (any thread)."""
        with self._lock:
            self._count += 1
            self._notices[f"{message['type']} {client}"] = (self._count, client, _json(message))
        if self._server is not None:
            self._server.notify()

    def _asked(self, request: Request, cursor: Cursor) -> Cursor:
        """Pass on a page's request (in the server's thread)."""
        if request.action == "look":
            return cursor._replace(look=max(request.given["frame"], -1), shown=-1)
        if self._ask is not None and request.action not in OF_THE_RUN:
            self._ask(request)
        elif self._ask is None and request.action in (*OF_THE_RUN, *ABOUT_CONSTRAINTS):
            self.controls.put(request)
        return cursor

    def _left(self, client: int) -> None:
        """Remove the messages to a page that has disconnected (in the server's thread)."""
        with self._lock:
            self._notices = {key: notice for key, notice in self._notices.items() if notice[1] != client}
        self._gone(client)

    def _open(self, client: int) -> tuple[list[str], Cursor]:
        """Return the first messages for a page (in the server's thread)."""
        first = Cursor(client, events=self._recent(), undone=self._undone)
        messages, cursor = self._latest(first)
        you = [_json({"type": "you", "client": client})] if self._ask is not None else []
        return [self._opening, *you, *messages], cursor

    def _latest(self, cursor: Cursor) -> tuple[list[str], Cursor]:
        """Return the messages that a page at `cursor` does not have yet (in the server's thread)."""
        messages: list[str] = []
        with self._lock:
            if cursor.undone != self._undone:
                cursor = cursor._replace(undone=self._undone, events=self._recent(), shown=-1)
                messages.append(_json({"type": "undone", "frame": len(self._history) - 1}))
            count, events = len(self._history), self._history.events_since(cursor.events)
            known = (count - 1, self._history.last) if cursor.look < 0 else self._history.at(cursor.look)
            news = sorted(n for n in self._notices.values() if n[0] > cursor.notices and n[1] in (0, cursor.client))
            noticed = self._count
        messages += [text for _, _, text in news]
        number, frame = known or (-1, None)
        back = cursor.look >= 0
        if frame is not None and not (back and cursor.shown == number):
            message = self._frame_message(number, frame, back)
            messages += [*self._strips[cursor.strips :], message]
            cursor = cursor._replace(strips=len(self._strips))
        if back:
            messages.append(_json({"type": "newest", "frame": count - 1}))
        if events:
            rows = [event_message(event, frame=at) for at, event in events]
            messages.append(_json({"type": "events", "events": rows}))
        if self._over and not cursor.over:
            messages.append(_json({"type": "over"}))
        return messages, cursor._replace(
            events=cursor.events + len(events), over=self._over, notices=noticed, shown=number
        )

    def _recent(self) -> int:
        """Return the number of events that a new page is not sent."""
        return max(len(self._history.events) - EVENTS, 0)

    def _frame_message(self, number: int, frame: Frame, back: bool) -> str:
        if not back and self._encoded is not None and self._encoded[0] is frame:
            return self._encoded[1]
        fresh, message = self._encoder.frame(frame)
        self._strips.extend(_json(strips) for strips in fresh)
        text = _json({**message, "number": number, "back": back})
        if not back:
            self._encoded = frame, text
        return text


def watched(wait: bool = False) -> MeshcatViewer:
    """Return a viewer in the browser that runs in real time; `wait`: see `MeshcatViewer`."""
    return MeshcatViewer(open_browser=True, pace=1.0, wait=wait)


def page_of(
    scene: Scene,
    frames: Iterable[tuple[Frame, tuple[Event, ...]]],
    start: Mapping[str, pin.SE3] | None = None,
) -> str:
    """Return one self-contained page that shows a scene and plays `frames`, each with the events since the one before.

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
        messages += [*fresh, news]  # other poses stay those of the frame before
        before = message
    return html(messages)


def write_page(
    scene: Scene,
    frames: Iterable[tuple[Frame, tuple[Event, ...]]],
    path: str | Path,
    start: Mapping[str, pin.SE3] | None = None,
) -> Path:
    """Write `page_of` into a file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.replace(path, page_of(scene, frames, start))
    return path


def _json(message: Message) -> str:
    return json.dumps(message, separators=(",", ":"))
