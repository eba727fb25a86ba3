"""Requests of a person at a page to a running session: play, pause, step, accept, refuse, remove."""

from __future__ import annotations

import threading

from vpframe.session.requests import Request


class Controls:
    """A queue of requests from the page's thread to the session's."""

    def __init__(self) -> None:
        self._change = threading.Condition()
        self._paused = False
        self._steps = 0
        self._requests: list[Request] = []
        self._go = threading.Event()

    @property
    def paused(self) -> bool:
        """Whether the session must wait."""
        return self._paused

    def put(self, request: Request) -> None:
        """Add a request (any thread)."""
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
        """Return the requests about constraints since the last call, in order: input of the next step."""
        taken = self.waiting()
        self.drop(len(taken))
        return taken

    def waiting(self) -> tuple[Request, ...]:
        """Return the same requests without removing them."""
        with self._change:
            return tuple(self._requests)

    def drop(self, count: int) -> None:
        """Remove the first requests: they are carried out."""
        with self._change:
            del self._requests[:count]

    def asked_to_go(self, timeout: float) -> bool:
        """Wait for the first "play", at most `timeout` s; return whether it was received."""
        return self._go.wait(timeout)

    def wait(self, timeout: float | None = None) -> bool:
        """Block the caller while paused; each "step" lets one call through. Return False after `timeout` (s)."""
        with self._change:
            if not self._change.wait_for(lambda: not self._paused or self._steps > 0, timeout):
                return False
            if self._paused:
                self._steps -= 1
            return True
