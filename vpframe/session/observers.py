"""`Observers`: passes events and frames to viewers, recorders, the report and a script's listeners."""

from __future__ import annotations

import logging
import os
import time as clock
from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from functools import partial
from typing import Any

from vpframe import services
from vpframe.errors import OutputError, VpframeError
from vpframe.events import EVENT_KINDS, ConstraintView, Event, Frame, NewEvent, Observer
from vpframe.scene.scene import Scene
from vpframe.session.controls import Controls, Request
from vpframe.session.state import Decision
from vpframe.text import plain

LOGGER = logging.getLogger("vpframe")
FITTING = {"accept": ("candidate", "refused"), "refuse": ("candidate",), "remove": ("active",)}
"""states of a constraint for which each request of a viewer is valid"""


class Observers:
    """Observers and listeners of one session, and the events passed to them.

    An observer that raises is ended and removed, with a note in the events and the report and a warning in the log
    "vpframe" (by default a line on standard error); the session continues. Calls that an
    interrupt left over are made by the next `tell`; none is made twice.

    Parameters
    ----------
    observers: in the order in which they are called.
    now: returns step and time (s) for new events.
    """

    def __init__(self, observers: Iterable[Observer], now: Callable[[], tuple[int, float]]) -> None:
        self.observers = list(observers)
        self.events: list[Event] = []
        """all events, in order"""
        self.shown = 0
        """number of events that frames have contained"""
        self.listeners: list[Callable[[Event], None]] = []
        """called with every event"""
        self.seconds = 0.0
        """time that the observers took for the last frame, s"""
        self.lost: list[OutputError] = []
        """errors of outputs that could not be completed"""
        self._now = now
        self._due: deque[Callable[[], None]] = deque()
        self._pending: list[tuple[Controls, int]] = []

    def record(self, event: NewEvent) -> None:
        """Add an event; listeners receive it with `tell`, observers with the next frame."""
        assert event.kind in EVENT_KINDS, event.kind
        happened = Event(*self._now(), *event)  # type: ignore[arg-type]
        self.events.append(happened)
        self._due.extend([partial(listener, happened) for listener in self.listeners])

    def happened(
        self,
        kind: str,
        parts: tuple[str, ...] = (),
        surfaces: tuple[tuple[int, ...], ...] = (),
        text: str = "",
        data: Mapping[str, Any] = NewEvent._field_defaults["data"],
    ) -> None:
        """Add an event and call the listeners at once; observers receive it with the next frame."""
        self.record(NewEvent(kind, parts, surfaces, text, data))
        self.tell()

    def tell(self) -> None:
        """Make all queued calls to observers and listeners. Raises what a listener raises."""
        began = clock.perf_counter()
        while self._due:
            self._due.popleft()()
        self.seconds = clock.perf_counter() - began

    def news(self) -> tuple[Event, ...]:
        """Return the events since the last frame."""
        return tuple(self.events[self.shown :])

    def rewind(self, events: int, shown: int, last: Frame | None) -> None:
        """Forget all but the first events, of which frames have contained `shown`, and the frames after `last`, as do
        observers that have a method `rewind`; others keep them."""
        self.forget(events)
        self.shown = shown
        for observer in self.observers:
            if hasattr(observer, "rewind"):
                observer.rewind(last, shown)

    def forget(self, events: int) -> None:
        """Forget all but the first events, and drop the queued calls."""
        del self.events[events:]
        self.shown = min(self.shown, events)
        self._due.clear()

    def begin(self, scene: Scene) -> None:
        """Queue the call `begin` of every observer, with a copy of the scene."""
        self._due = deque([partial(self._try, observer, "begin", scene.copy()) for observer in self.observers])

    def show(self, frame: Frame) -> None:
        """Queue the call `frame` of every observer; the frame contains the events since the last one."""
        self._due.extend([partial(self._try, observer, "frame", frame) for observer in self.observers])
        self.shown = len(self.events)

    def end(self) -> None:
        """Call `end` of every observer."""
        self._due.extend([partial(self._try, observer, "end") for observer in self.observers])
        self.tell()

    def requested(self, constraints: Iterable[ConstraintView], decided: Container[int]) -> list[Decision]:
        """Return the valid accept, refuse and remove requests of people at viewers; they stay queued until
        `drop_requests`.

        decided: ids that the script decides in this step; the script takes precedence.
        """
        waiting = [(controls, controls.waiting()) for controls in self._controls()]
        self._pending = [(controls, len(requests)) for controls, requests in waiting]
        if not any(requests for _, requests in waiting):
            return []
        state = {c.id: c.state for c in constraints if c.id not in decided}
        return [
            Decision(request.action, request.id)
            for _, requests in waiting
            for request in requests
            if request.id is not None and state.pop(request.id, "") in FITTING[request.action]
        ]

    def drop_requests(self) -> None:
        """Drop the requests that the last `requested` returned: they were carried out."""
        for controls, count in self._pending:
            controls.drop(count)
        self._pending = []

    def play(self) -> None:
        """End every pause that a viewer requested."""
        for controls in self._controls():
            controls.put(Request("play"))

    def _controls(self) -> list[Controls]:
        return [c for c in (getattr(observer, "controls", None) for observer in self.observers) if c is not None]

    def _try(self, observer: Observer, what: str, *given: Any) -> None:
        if observer not in self.observers:
            return  # it failed earlier and was removed
        try:
            getattr(observer, what)(*given)
        except Exception as error:
            self.observers.remove(observer)
            failures = [error]
            if what != "end":
                try:
                    observer.end()
                except Exception as second:
                    failures.append(second)
            self.lost += [failure for failure in failures if isinstance(failure, OutputError)][:1]
            name = type(observer).__name__
            text = f"{name} stopped watching: {type(error).__name__}: {error}"
            if not any(isinstance(failure, OutputError) for failure in failures):  # these are raised at the end
                LOGGER.warning(plain(text))  # a line on standard error, unless the program handles its log otherwise
            self.record(NewEvent("note", text=text))


def viewers(viewer: str | Observer | None) -> list[Observer]:
    """Return the observers that the argument `viewer` of a session names."""
    if viewer is None:
        return []
    if isinstance(viewer, str):
        if viewer != "meshcat":
            raise VpframeError(f'viewer={viewer!r}; give None, "meshcat" or an observer')
        return [services.call("viewer")]
    return [viewer]


def recorders(record: str | os.PathLike[str] | Observer | None) -> list[Observer]:
    """Return the observers that the argument `record` of a session names."""
    if record is None:
        return []
    if isinstance(record, str | os.PathLike):
        return [services.call("recorder", record)]
    return [record]
