"""What a person asks of a running session from a page: play, pause, step, accept, refuse, remove."""

from __future__ import annotations

import threading

from vpframe.view.requests import Request


class Controls:
    """Requests pass from the page's thread to the session's through here."""

    def __init__(self) -> None:
        self._change = threading.Condition()
        self._paused = False
        self._steps = 0
        self._requests: list[Request] = []
        self._go = threading.Event()

    @property
    def paused(self) -> bool:
        """Whether the session is asked to wait."""
        return self._paused

    def put(self, request: Request) -> None:
        """Take a request in (any thread)."""
        with self._change:
            if request.action == "play":
                self._go.set()
                self._paused, self._steps = False, 0
            elif request.action == "pause":
                self._paused = True
            elif request.action == "step":
                self._paused, self._steps = True, self._steps + 1
            else:
                self._requests.append(request)
            self._change.notify_all()

    def take(self) -> tuple[Request, ...]:
        """The requests about constraints since the last call, in order: what the session does before its next step."""
        taken = self.waiting()
        self.drop(len(taken))
        return taken

    def waiting(self) -> tuple[Request, ...]:
        """The same, without taking them."""
        with self._change:
            return tuple(self._requests)

    def drop(self, count: int) -> None:
        """Forget the first requests: they are done."""
        with self._change:
            del self._requests[:count]

    def asked_to_go(self, timeout: float) -> bool:
        """Whether anybody has ever asked for "play", waiting for it for `timeout` s at most."""
        return self._go.wait(timeout)

    def wait(self, timeout: float | None = None) -> bool:
        """Hold the caller while paused; each "step" lets one call through. False when `timeout` (s) ran out."""
        with self._change:
            if not self._change.wait_for(lambda: not self._paused or self._steps > 0, timeout):
                return False
            if self._paused:
                self._steps -= 1
            return True
