"""A headless Chromium, driven through its DevTools protocol, for tests that look at pages as people do."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import io
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from typing import Any

import numpy as np
import tornado.websocket
from PIL import Image

PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0", "--hide-scrollbars", "--no-first-run", "--disable-background-networking",
)  # fmt: skip


class LeftPageError(Exception):
    """The browser went to another page before it answered."""


class Browser:
    """One window. Close it, or use it as a context manager. `flags`: more of Chromium's."""

    def __init__(self, width: int = 1000, height: int = 700, flags: tuple[str, ...] = ()) -> None:
        assert PROGRAM is not None
        self.folder = tempfile.mkdtemp(prefix="vpframe-browser-")
        size = f"--window-size={width},{height}"
        self.process = subprocess.Popen(
            [PROGRAM, *FLAGS, *flags, size, f"--user-data-dir={self.folder}", "about:blank"],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        self.loop = asyncio.new_event_loop()
        self.socket: Any = None
        self.number = 0
        self.errors: list[str] = []
        self.answers: dict[str, str] = {}
        try:
            self._begin(width, height)
        except BaseException:
            self.close()
            raise

    def _begin(self, width: int, height: int) -> None:
        assert self.process.stderr is not None
        line = next(line for line in self.process.stderr if "DevTools listening on" in line)
        port = line.rsplit(":", 1)[1].split("/")[0]
        pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=10))
        address = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")
        self.socket = self.loop.run_until_complete(self._connect(address))
        self.call("Page.enable")
        self.call("Runtime.enable")
        self.resize(width, height)

    def resize(self, width: int, height: int) -> None:
        """Make the page as large as that, pixels."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    @staticmethod
    async def _connect(address: str) -> Any:
        return await tornado.websocket.websocket_connect(address, max_message_size=1 << 28)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the protocol and its answer; page errors met on the way are kept in `errors`."""
        return self.loop.run_until_complete(asyncio.wait_for(self._call(method, parameters), 60))

    async def _call(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        number = await self._send(method, parameters)
        while True:
            message = json.loads(await self.socket.read_message())
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(str(message["params"]["exceptionDetails"].get("exception", {}).get("description")))
            if message.get("method") == "Fetch.requestPaused":
                request, body = message["params"]["requestId"], self.answers[message["params"]["request"]["url"]]
                await self._send("Fetch.fulfillRequest", {"requestId": request, "responseCode": 200, "body": body})
            if message.get("id") == number:
                if "navigated" in message.get("error", {}).get("message", ""):
                    raise LeftPageError
                assert "error" not in message, message
                return message["result"]

    async def _send(self, method: str, parameters: dict[str, Any]) -> int:
        self.number += 1
        await self.socket.write_message(json.dumps({"id": self.number, "method": method, "params": parameters}))
        return self.number

    def answer_for(self, address: str, body: str) -> None:
        """Answer requests for an address with a page (base64), as a site that is not there would."""
        self.answers[address] = body
        self.call("Fetch.enable", patterns=[{"urlPattern": known} for known in self.answers])

    def open(self, address: str) -> None:
        """Go to a page and wait until its first frame is on the screen."""
        self.errors.clear()
        self.call("Page.navigate", url=address)
        self.wait("document.readyState === 'complete'")
        self.settle()

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def click(self, selector: str) -> None:
        """Press the mouse on the middle of an element, as a person does, when it is there; nothing may cover it."""
        self.wait(f"Boolean(document.querySelector({json.dumps(selector)}))")
        place = self.run(
            f"""(() => {{
                const e = document.querySelector({json.dumps(selector)});
                e.scrollIntoView({{block: "nearest"}});
                const r = e.getBoundingClientRect();
                const x = r.left + r.width / 2, y = r.top + r.height / 2;
                return [x, y, e.contains(document.elementFromPoint(x, y)), !e.disabled];
            }})()"""
        )
        x, y, seen, enabled = place
        assert seen, f"{selector} is covered by something else"
        assert enabled, f"{selector} is disabled"
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def mouse(self, kind: str, x: float, y: float, button: str = "none", clicks: int = 1, alt: bool = False) -> None:
        """One event of the mouse: "Moved", "Pressed" or "Released"; `button` is held, or changes."""
        held = {"none": 0, "left": 1, "right": 2}[button] if kind != "Released" else 0
        self.call(
            "Input.dispatchMouseEvent",
            type=f"mouse{kind}",
            x=x,
            y=y,
            button=button,
            buttons=held,
            clickCount=clicks,
            modifiers=int(alt),
        )

    def press(self, x: float, y: float, clicks: int = 1, alt: bool = False) -> None:
        """Click with the left button at a place of the window."""
        self.mouse("Moved", x, y, alt=alt)
        self.mouse("Pressed", x, y, "left", clicks, alt)
        self.mouse("Released", x, y, "left", clicks, alt)

    def drag(self, *places: tuple[float, float]) -> None:
        """Press the left button at the first place, move to the others, let go at the last."""
        self.mouse("Moved", *places[0])
        self.mouse("Pressed", *places[0], "left")
        for x, y in places[1:]:
            self.mouse("Moved", x, y, "left")
            self.settle()
        self.mouse("Released", *places[-1], "left")

    def key(self, key: str, ctrl: bool = False) -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=2 if ctrl else 0)

    def text(self, selector: str) -> str:
        """The text of an element."""
        return str(self.run(f"document.querySelector({json.dumps(selector)}).textContent"))

    def wait(self, expression: str, seconds: float = 30.0) -> None:
        """Wait until an expression is true; the page itself looks every few milliseconds."""
        until = time.monotonic() + seconds
        look = f"""new Promise((done, fail) => {{
            const until = performance.now() + 1000;
            const look = () => {{
                try {{
                    if ({expression}) done(true);
                    else if (performance.now() > until) done(false);
                    else setTimeout(look, 8);
                }} catch (error) {{ fail(error); }}
            }};
            look();
        }})"""
        while True:
            with contextlib.suppress(LeftPageError):
                if self.run(look):
                    return
            assert time.monotonic() < until, f"{expression} did not become true; page errors: {self.errors}"

    def settle(self) -> None:
        """Wait for two animation frames: what was asked for is drawn then."""
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")

    def picture(self) -> np.ndarray:
        """(h, w, 3) uint8 of what is on the screen, once it is at rest, or after three seconds."""
        self.settle()
        self.run("window.patience = Date.now() + 3000")
        self.wait("typeof painter === 'undefined' || painter.rested || Date.now() > patience")
        data = self.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def close(self) -> None:
        """End the browser and remove its folder."""
        if self.socket is not None:
            self.loop.run_until_complete(self._disconnect())
        self.loop.close()
        self.process.terminate()
        self.process.wait(20)
        if self.process.stderr is not None:
            self.process.stderr.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    async def _disconnect(self) -> None:
        self.socket.close()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
