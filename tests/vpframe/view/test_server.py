"""The live page's server against clients that mean no good: real sockets on the loopback address."""

import asyncio
import contextlib
import json
import os
import resource
import socket
import struct
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator

import pytest

from tests.vpframe.view.pages import answer, connect, of_type, receive, socket_answer, socket_of
from tests.vpframe.waiting import wait_until
from tests.vpframe.watching import fake_session
from vpframe.errors import VpframeError
from vpframe.view import server
from vpframe.view.meshcat_viewer import MeshcatViewer


@pytest.fixture
def viewer() -> Iterator[MeshcatViewer]:
    made = MeshcatViewer()
    made.begin(fake_session().scene)
    yield made
    made.end()


def dial(viewer: MeshcatViewer, timeout: float = 10.0) -> socket.socket:
    place = urllib.parse.urlsplit(viewer.url)
    return socket.create_connection((place.hostname, place.port), timeout=timeout)


def head(viewer: MeshcatViewer, method: str, path: str, *lines: str, token: bool = True) -> bytes:
    place = urllib.parse.urlsplit(viewer.url)
    target = f"{path}?{place.query if token else 'token=guess'}"
    return "\r\n".join((f"{method} {target} HTTP/1.1", f"Host: {place.netloc}", *lines, "", "")).encode()


UPGRADE = (
    "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
)  # fmt: skip


def status(made: socket.socket) -> int | None:
    """Status of the answer; None if the connection was closed without one."""
    text = b""
    with contextlib.suppress(ConnectionError):
        while b"\r\n" not in text and (more := made.recv(1 << 12)):
            text += more
    return int(text.split()[1]) if text else None


def is_closed(made: socket.socket, within: float) -> bool:
    """Whether the other side has closed; what it sent is dropped."""
    made.settimeout(within)
    try:
        while made.recv(1 << 16):
            continue
    except TimeoutError:
        return False
    except ConnectionError:
        return True
    return True


def memory() -> int:
    """Bytes that this process has taken at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def served(viewer: MeshcatViewer) -> bool:
    with urllib.request.urlopen(viewer.url, timeout=10) as got:
        return got.status == 200 and b"vpframe" in got.read()


@pytest.mark.parametrize("path", ["/", "/socket", "/nowhere"])
@pytest.mark.parametrize("token", [False, True], ids=["without the token", "with the token"])
@pytest.mark.parametrize("length", ["Content-Length: 90000000", "Transfer-Encoding: chunked"], ids=["long", "chunked"])
def test_bodies_are_not_read(viewer: MeshcatViewer, path: str, token: bool, length: str) -> None:
    """25 bodies of 90 MB, as in the report: none is kept, and whoever has the token is served meanwhile."""
    before, sent = memory(), []

    def pour() -> None:
        with contextlib.suppress(OSError), dial(viewer) as made:
            made.sendall(head(viewer, "POST", path, length, token=token))
            count = 0
            while count < 90_000_000:
                block = b"x" * (1 << 20)
                made.sendall(block if "Length" in length else b"100000\r\n" + block + b"\r\n")
                count += len(block)
                sent.append(len(block))

    threads = [threading.Thread(target=pour) for _ in range(25)]
    for thread in threads:
        thread.start()
    try:
        assert served(viewer)
    finally:
        for thread in threads:
            thread.join(60)
    assert sum(sent) < 25 * 9_000_000  # most was never taken from the sockets
    assert memory() - before < 150e6


@pytest.mark.parametrize(("token", "wanted"), [(False, 403), (True, 413)])
@pytest.mark.parametrize("path", ["/", "/socket"])
@pytest.mark.parametrize("length", ["Content-Length: 90000000", "Transfer-Encoding: chunked"])
def test_the_token_is_checked_before_the_body(
    viewer: MeshcatViewer, path: str, token: bool, wanted: int, length: str
) -> None:
    """The headers alone are answered, though the body that they announce never comes."""
    with dial(viewer) as made:
        made.sendall(head(viewer, "POST", path, length, token=token))
        assert status(made) == wanted
        assert is_closed(made, 4.0)


@pytest.mark.parametrize("lines", ["one", "many"])
def test_headers_are_bounded(viewer: MeshcatViewer, lines: str) -> None:
    long = "X: " + "x" * 10_000_000 if lines == "one" else "\r\n".join(f"X-{k}: {'x' * 100}" for k in range(100_000))
    before = memory()
    with dial(viewer) as made, contextlib.suppress(ConnectionError):
        made.sendall(head(viewer, "GET", "/", long))
        assert status(made) in (None, 400)
    assert memory() - before < 100e6
    assert served(viewer)


def test_those_who_show_no_token_give_way(viewer: MeshcatViewer) -> None:
    """More connections than there may be, all silent: pages and sockets are served as before."""
    with dial(viewer) as page, contextlib.ExitStack() as stack:
        page.sendall(head(viewer, "GET", "/socket", *UPGRADE))
        assert status(page) == 101
        silent = [stack.enter_context(dial(viewer)) for _ in range(server.MOST_CONNECTIONS + 40)]
        assert served(viewer)
        assert sum(is_closed(made, 0.05) for made in silent[:41]) == 41  # the oldest, for the page's sake too
        assert not is_closed(silent[-1], 0.05)
        assert viewer.clients == 1
        assert not is_closed(page, 0.05)


def test_pages_are_never_more_than_the_bound(viewer: MeshcatViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MOST_CONNECTIONS", 6)
    with contextlib.ExitStack() as stack:
        pages = [stack.enter_context(dial(viewer)) for _ in range(6)]
        for page in pages:
            page.sendall(head(viewer, "GET", "/socket", *UPGRADE))
            assert status(page) == 101
        assert is_closed(stack.enter_context(dial(viewer)), 5.0)
        pages[0].close()
        wait_until(lambda: viewer.clients <= 5, 10.0)
        assert served(viewer)


def stalled(viewer: MeshcatViewer, made: socket.socket) -> None:
    made.sendall(head(viewer, "GET", "/")[:-2])


def dripping(viewer: MeshcatViewer, made: socket.socket) -> None:
    """A header that goes on, a byte at a time."""

    def drip() -> None:
        with contextlib.suppress(OSError):
            made.sendall(head(viewer, "GET", "/")[:-2] + b"X: ")
            while True:
                made.sendall(b"x")
                time.sleep(0.05)

    threading.Thread(target=drip, daemon=True).start()


def deaf(viewer: MeshcatViewer, made: socket.socket) -> None:
    """Asks for the page and never reads it."""
    made.sendall(head(viewer, "GET", "/"))


@pytest.mark.parametrize("slow", [stalled, dripping, deaf], ids=lambda f: f.__name__)
def test_slow_clients_are_dropped(
    viewer: MeshcatViewer, monkeypatch: pytest.MonkeyPatch, slow: Callable[[MeshcatViewer, socket.socket], None]
) -> None:
    monkeypatch.setattr(server, "HEAD_PATIENCE", 0.2)
    monkeypatch.setattr(server, "PAGE_PATIENCE", 0.2)
    handles = "/proc/self/fd"
    if not os.path.isdir(handles):
        pytest.skip("handles are counted in /proc")
    with socket.socket() as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
        place = urllib.parse.urlsplit(viewer.url)
        made.connect((place.hostname, place.port))
        before = len(os.listdir(handles))  # the server may or may not have accepted yet
        slow(viewer, made)
        connections = viewer._server._connections  # type: ignore[union-attr]
        time.sleep(0.1)
        wait_until(lambda: not connections._until, 20.0)
        assert len(os.listdir(handles)) <= before
        assert served(viewer)


def frame_of(payload: bytes, opcode: int = 1, final: bool = True, length: int | None = None) -> bytes:
    """A masked web-socket frame; `length`: what it announces."""
    size = len(payload) if length is None else length
    return struct.pack(">BBQI", opcode | (0x80 if final else 0), 0x80 | 127, size, 0) + payload


@pytest.mark.parametrize(
    "frames",
    [
        [frame_of(b"", length=1 << 40)],
        [frame_of(b"x" * 5000)],
        [frame_of(b"x" * 1000, opcode=0 if k else 1, final=False) for k in range(6)],
    ],
    ids=["announced", "long", "in pieces"],
)
def test_messages_of_sockets_are_bounded(viewer: MeshcatViewer, frames: list[bytes]) -> None:
    before = memory()
    with dial(viewer) as made, dial(viewer) as other:
        for page in (made, other):
            page.sendall(head(viewer, "GET", "/socket", *UPGRADE))
            assert status(page) == 101
        for one in frames:
            with contextlib.suppress(ConnectionError):
                made.sendall(one)
        assert is_closed(made, 10.0)
        other.sendall(frame_of(json.dumps({"action": "pause"}).encode()))
        wait_until(lambda: viewer.controls.paused, 10.0)
    assert memory() - before < 50e6


def test_only_this_machine_is_listened_to(viewer):
    port = urllib.parse.urlsplit(viewer.url).port
    assert viewer.url.startswith("http://127.0.0.1:")
    with socket.socket() as other, pytest.raises(OSError):
        other.settimeout(2.0)
        other.connect((socket.gethostbyname(socket.gethostname()), port))
        if other.getpeername()[0].startswith("127."):
            raise OSError("this machine has no other address to try")


def test_another_sites_name_for_this_machine_is_refused(viewer):
    status, body = answer(viewer.url, Host="evil.example")
    assert (status, b"own names and addresses" in body) == (403, True)
    status, body = answer(viewer.url)
    assert (status, b"vpframe" in body) == (200, True)


def test_a_socket_from_another_site_is_refused(viewer):
    assert socket_answer(socket_of(viewer), Origin="http://evil.example") == 403


def test_a_socket_for_another_sites_name_is_refused(viewer):
    """The page of a site whose name was made to mean this machine: its Origin is its Host."""
    port = urllib.parse.urlsplit(viewer.url).port
    for name in ("evil.example", "127.0.0.1.evil.example", "localhost.evil.example"):
        host = f"{name}:{port}"
        assert socket_answer(socket_of(viewer), Host=host, Origin=f"http://{host}") == 403
        assert answer(viewer.url, Host=host)[0] == 403


def test_this_machine_may_be_called_by_its_names_and_addresses(viewer):
    port = urllib.parse.urlsplit(viewer.url).port
    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]", "192.0.2.7", socket.gethostname()):
        host = f"{name}:{port}"
        assert answer(viewer.url, Host=host)[0] == 200, name
        assert socket_answer(socket_of(viewer), Host=host, Origin=f"http://{host}") == "scene", name


@pytest.mark.parametrize("query", ["", "token=", "token=guess", "token=%00", "other=1", "token=%C3%A9"])
def test_without_the_token_nothing_is_served(viewer, query):
    status, body = answer(urllib.parse.urlsplit(viewer.url)._replace(query=query).geturl())
    assert (status, b"with its token" in body, b"meshcat" in body) == (403, True, False)
    assert socket_answer(socket_of(viewer, query=query)) == 403
    assert viewer.clients == 0


def test_tokens_are_long_and_not_used_twice():
    viewers = [MeshcatViewer(), MeshcatViewer()]
    for viewer in viewers:
        viewer.begin(fake_session().scene)
    try:
        tokens = [urllib.parse.parse_qs(urllib.parse.urlsplit(viewer.url).query)["token"][0] for viewer in viewers]
        assert len(set(tokens)) == 2 and all(len(token) >= 40 for token in tokens)
        assert answer(viewers[0].url.replace(tokens[0], tokens[1]))[0] == 403
    finally:
        for viewer in viewers:
            viewer.end()


def test_a_message_that_no_page_sends_ends_the_socket(viewer):
    async def shout():
        page = await connect(viewer)
        await receive(page, of_type("scene"))
        await page.write_message("x" * 100_000)
        return await asyncio.wait_for(page.read_message(), 10)

    assert asyncio.run(shout()) is None
    assert viewer.controls.take() == ()


def test_an_address_of_version_6_is_printed_in_brackets():
    viewer = MeshcatViewer(host="::1")
    try:
        viewer.begin(fake_session().scene)
    except VpframeError:
        pytest.skip("no IPv6 here")
    try:
        assert viewer.url.startswith("http://[::1]:") and viewer.outside is None
        assert answer(viewer.url)[0] == 200
        assert socket_answer(socket_of(viewer)) == "scene"
    finally:
        viewer.end()
