"""A web server for the page, in its own thread. Nobody ever waits for a browser.

A page answers each message when it has drawn it. While it draws one frame the next is on its way, no more: what goes
out is the latest there is.
A page that does not answer for `PATIENCE` seconds is dropped.

Only who was given the address sees and controls a session: its token is required for every page and every
socket. Both are answered under this machine's own names and addresses only, so that another site's name that is made
to resolve to this machine (DNS rebinding) does not reach them.

Who has no token costs little: a request is refused by its headers, a body is never read, and what waits is bounded in
size (`LONGEST_HEAD`), number (`MOST_CONNECTIONS`) and time (`HEAD_PATIENCE`).
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import math
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import tornado.httpserver
import tornado.iostream
import tornado.netutil
import tornado.web
import tornado.websocket

from vpframe.errors import VpframeError
from vpframe.session.requests import Request

PATIENCE = 10.0
LONGEST_MESSAGE = 1 << 12
"""maximum size of a message from a page, bytes"""
LONGEST_HEAD = 1 << 15
"""maximum size of a request, which has headers alone, bytes; the cookies of all servers of this machine are in it"""
MOST_CONNECTIONS = 128
"""maximum number of open connections; for one more, the oldest that has shown no token is closed"""
HEAD_PATIENCE = 5.0
"""time limit of a connection to show the token, s"""
PAGE_PATIENCE = 30.0
"""time limit of a browser to read the page, s"""
EVERYWHERE = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}
"""hosts that mean every address of this machine, with the loopback address"""
MOST_MESSAGES = 300
"""maximum rate of messages from a page, 1/s; a page that sends more for long is dropped"""
AHEAD = 2
"""maximum number of times that a page is sent something before it has drawn it: with one, it would wait for the way
there and back; until it has drawn the scene, one"""
RATE = 90.0
"""maximum rate of frames to a page, 1/s: above 60, so that every frame of a 60 Hz session can pass"""


class Server:
    """Serves `page` at `url`, and what `opening` and `latest` return to each page that connects.

    `url` is the page's address on this machine, token included; `outside` the same for other machines, None where only
    this one is listened to.

    Parameters
    ----------
    page: the HTML document.
    opening: messages for a page that has just connected, by its number, each a JSON text, and a mark of what it has
        then seen.
    latest: called in the server's thread when a page can take more, with its mark; returns messages and the new mark.
    ask: takes a page's requests, with its mark, and returns the mark (in the server's thread: it must not wait).
    gone: called with the number of a page that has disconnected.
    host, port: the address to listen on; loopback by default; port 0 takes any that is free.
    """

    def __init__(
        self,
        page: str,
        opening: Callable[[int], tuple[list[str], Any]],
        latest: Callable[[Any], tuple[list[str], Any]],
        ask: Callable[[Request, Any], Any],
        host: str = "127.0.0.1",
        port: int = 0,
        gone: Callable[[int], None] = lambda client: None,
    ) -> None:
        self._page = page.encode()
        self._opening = opening
        self._latest = latest
        self._ask = ask
        self._gone = gone
        self._count = 0
        self._clients: set[_Socket] = set()
        self._news = threading.Event()
        self._sent = threading.Condition()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        try:
            self._sockets = tornado.netutil.bind_sockets(port, host)
        except OSError as error:
            raise VpframeError(f"cannot listen on {host}:{port}: {error}; give another host or port") from None
        self.port: int = self._sockets[0].getsockname()[1]
        self._token = secrets.token_urlsafe(32)
        here = socket.gethostname().lower()
        self._names = {"localhost", host.lower(), here, f"{here.split('.')[0]}.local"}
        self.url = self._address(EVERYWHERE.get(host, host))
        self.outside = self._address(here) if host in EVERYWHERE else None
        ready = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run(ready)), name="vpframe viewer", daemon=True
        )
        self._thread.start()
        ready.wait()

    def _address(self, host: str) -> str:
        """Return the page's address under a name or address of this machine."""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/?token={self._token}"

    def refusal(self, host: str, token: str) -> str:
        """Return why a request for `host` with `token` is refused; empty if it is accepted."""
        try:
            ipaddress.ip_address(host.strip("[]"))  # unlike a name, an address cannot be redirected to another machine
        except ValueError:
            if host.lower() not in self._names:
                return "served under this machine's own names and addresses only"
        if not hmac.compare_digest(token.encode(), self._token.encode()):
            return "open the whole address that vpframe printed, with its token"
        return ""

    @property
    def clients(self) -> int:
        """Return the connected pages."""
        return len(self._clients)

    def notify(self) -> None:
        """Announce new messages; return at once (any thread)."""
        if self._clients and not self._news.is_set() and self._loop is not None:
            self._news.set()
            self._loop.call_soon_threadsafe(self._pump)

    def wait_for(self, number: int, most: float) -> None:
        """Wait until a page was sent the latest frame, hence has drawn those before; at most `most` s."""

        def sent() -> bool:
            return not any(client.number == number and client.behind for client in list(self._clients))

        with self._sent:
            self._sent.wait_for(lambda: not self._news.is_set() and sent(), most)

    def close(self, linger: float = 1.0) -> None:
        """Wait until pages have drawn the last frame, at most `linger` s, and stop."""
        if self._loop is None or self._stop is None or not self._thread.is_alive():
            return
        until = time.monotonic() + linger
        while time.monotonic() < until and any(client.behind for client in list(self._clients)):
            time.sleep(0.01)
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout=5.0)

    async def _run(self, ready: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        handlers: list[Any] = [(r"/", _Page, {"server": self}), (r"/socket", _Socket, {"server": self})]
        application = tornado.web.Application(
            handlers, log_function=lambda _: None, websocket_max_message_size=LONGEST_MESSAGE
        )
        server = _Listener(
            application,
            max_header_size=LONGEST_HEAD,
            max_body_size=0,
            max_buffer_size=2 * LONGEST_HEAD,
        )
        self._connections = server.connections
        server.add_sockets(self._sockets)
        ready.set()
        while not self._stop.is_set():
            self._connections.drop_late()
            for client in list(self._clients):
                client.drop_if_gone()
            try:
                await asyncio.wait_for(self._stop.wait(), timeout=1.0)
            except TimeoutError:
                continue
        server.stop()
        for client in list(self._clients):
            client.close()
        await server.close_all_connections()

    def _pump(self) -> None:
        self._news.clear()
        for client in list(self._clients):
            client.send_latest()


class _Connections:
    """The open connections, each with the time until which it may stay; those without a token give way to others."""

    def __init__(self) -> None:
        self._until: dict[tornado.iostream.IOStream, tuple[bool, float]] = {}
        """by age: whether it has shown the token, and until when it may stay"""

    def admit(self, stream: tornado.iostream.IOStream) -> bool:
        """Count a new connection; return whether there is room for it."""
        self.drop_late()
        if len(self._until) >= MOST_CONNECTIONS:
            oldest = next((each for each, (known, _) in self._until.items() if not known), None)
            if oldest is None:
                return False
            del self._until[oldest]
            oldest.close()
        self._until[stream] = False, time.monotonic() + HEAD_PATIENCE
        return True

    def know(self, stream: tornado.iostream.IOStream, patience: float) -> None:
        """Let a connection that has shown the token stay for `patience` s."""
        self._until[stream] = True, time.monotonic() + patience

    def drop_late(self) -> None:
        """Close the connections whose time is over, and forget those that are closed."""
        now = time.monotonic()
        for stream, (_, until) in list(self._until.items()):
            if until < now:
                stream.close()
            if stream.closed():
                self._until.pop(stream, None)


class _Listener(tornado.httpserver.HTTPServer):
    """A server of a bounded number of connections."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        super().initialize(*args, **kwargs)
        self.connections = _Connections()

    def handle_stream(self, stream: tornado.iostream.IOStream, address: Any) -> None:
        if self.connections.admit(stream):
            super().handle_stream(stream, address)
        else:
            stream.close()


@tornado.web.stream_request_body  # it is prepared when the headers are there
class _Guarded(tornado.web.RequestHandler):
    """A request handler that answers only requests with the token, and reads no body."""

    def initialize(self, server: Server) -> None:
        self.server = server

    def prepare(self) -> None:
        refusal = self.server.refusal(self.request.host_name, self.get_query_argument("token", ""))
        if refusal:
            raise tornado.web.HTTPError(403, reason=refusal)
        headers = self.request.headers
        if "Transfer-Encoding" in headers or headers.get("Content-Length", "0") != "0":
            raise tornado.web.HTTPError(413, reason="requests have no body")
        self.stream: tornado.iostream.IOStream = self.request.connection.stream  # type: ignore[union-attr]
        self.server._connections.know(self.stream, PAGE_PATIENCE)


class _Page(_Guarded):
    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.set_header("Referrer-Policy", "no-referrer")  # the address contains the token
        self.write(self.server._page)


class _Socket(_Guarded, tornado.websocket.WebSocketHandler):
    def initialize(self, server: Server) -> None:
        super().initialize(server)
        self.seen: Any = None
        self.number = 0
        """number of the page, from 1; 0 before it is open"""
        self.allowed = float(MOST_MESSAGES)
        """number of messages that the page may send now"""
        self.counted = time.monotonic()
        self.owed: deque[int] = deque()
        """numbers of messages that the page has not drawn, of each time it was sent some"""
        self.drew = False
        """whether the page has drawn anything"""
        self.heard = time.monotonic()
        self.sent = 0.0
        self.behind = False

    def open(self, *args: str, **kwargs: str) -> None:
        self.server._connections.know(self.stream, math.inf)  # as long as it answers, see `drop_if_gone`
        self.server._count += 1
        self.number = self.server._count
        messages, self.seen = self.server._opening(self.number)
        self.server._clients.add(self)
        self._send(messages)

    def on_close(self) -> None:
        self.server._clients.discard(self)
        if self.number:
            self.server._gone(self.number)

    def on_message(self, message: str | bytes) -> None:
        now = self.heard = time.monotonic()
        try:
            content = json.loads(message)
        except (ValueError, RecursionError):
            content = None
        if self.owed and content == {"action": "drawn"}:
            self.owed[0] -= 1
            self.drew = True
            if self.owed[0] == 0:
                self.owed.popleft()
                if self.behind:
                    self.send_latest()
            return
        self.allowed = min(self.allowed + MOST_MESSAGES * (now - self.counted), MOST_MESSAGES) - 1.0
        self.counted = now
        if self.allowed < 0.0:
            self.server._clients.discard(self)
            self.close(1008, "too many messages")
            return
        request = Request.read(content, self.number)
        if request is not None:
            self.seen = self.server._ask(request, self.seen)
            if request.action == "look":
                self.send_latest()

    def send_latest(self) -> None:
        """Send new messages, now or when the page has drawn enough of the previous ones."""
        self.behind = True
        wait = self.sent + 1.0 / RATE - time.monotonic()
        if len(self.owed) >= (AHEAD if self.drew else 1):
            return
        if wait > 0:
            asyncio.get_running_loop().call_later(wait, self._send_later)
            return
        messages, self.seen = self.server._latest(self.seen)
        self.behind = False
        self.sent = time.monotonic()
        self._send(messages)
        with self.server._sent:
            self.server._sent.notify_all()

    def _send_later(self) -> None:
        if self.behind and self in self.server._clients:
            self.send_latest()

    def drop_if_gone(self) -> None:
        """Close the connection if the page has not answered for too long."""
        if self.owed and time.monotonic() - self.heard > PATIENCE:
            self.server._clients.discard(self)
            self.close(1001, "no answer")

    def _send(self, messages: list[str]) -> None:
        if messages and not self.owed:
            self.heard = time.monotonic()
        if messages:
            self.owed.append(len(messages))
        try:
            for message in messages:
                self.write_message(message).add_done_callback(self._written)
        except tornado.websocket.WebSocketClosedError:
            self.server._clients.discard(self)

    def _written(self, message: asyncio.Future[None]) -> None:
        if not message.cancelled() and message.exception() is not None:  # the page disconnected meanwhile
            self.server._clients.discard(self)
