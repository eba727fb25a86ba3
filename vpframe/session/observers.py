"""`Observers`: viewers, recorders, the report and a script's listeners, and the events that they get."""

from __future__ import annotations

import os
import time as clock
from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from functools import partial
from typing import Any

from vpframe.errors import OutputError, VpframeError
from vpframe.scene.scene import Scene
from vpframe.session.events import EVENT_KINDS, ConstraintView, Event, Frame, NewEvent, Observer
from vpframe.session.state import Decision
from vpframe.view.controls import Controls, Request

FITTING = {"accept": ("candidate", "refused"), "refuse": ("candidate",), "remove": ("active",)}
"""states of a constraint in which a person may ask for each"""


class Observers:
    """Observers and listeners of one session, and the events that they have heard of.

    An observer that fails is ended and taken out, and a note says so; the session goes on. `lost` says what it then
    has not written. What was interrupted while they were told goes on with the next of them: nobody is told twice.

    Parameters
    ----------
    observers: in the order in which they are told.
    now: the step and the time (s) that an event happens at.
    """

    def __init__(self, observers: Iterable[Observer], now: Callable[[], tuple[int, float]]) -> None:
        self.observers = list(observers)
        self.events: list[Event] = []
        """all that has happened, in order"""
        self.listeners: list[Callable[[Event], None]] = []
        """called with every event once it has happened"""
        self.seconds = 0.0
        """that they took for the last frame"""
        self.lost: list[OutputError] = []
        """files that could not be written to their end"""
        self._now = now
        self._news: list[Event] = []
        self._due: deque[Callable[[], None]] = deque()
        self._heard: list[tuple[Controls, int]] = []

    def record(self, event: NewEvent) -> None:
        """Take in an event; listeners hear of it with `tell`, observers with the next frame."""
        assert event.kind in EVENT_KINDS, event.kind
        happened = Event(*self._now(), *event)  # type: ignore[arg-type]
        self.events.append(happened)
        self._news.append(happened)
        self._due.extend([partial(listener, happened) for listener in self.listeners])

    def happened(
        self,
        kind: str,
        parts: tuple[str, ...] = (),
        surfaces: tuple[tuple[int, ...], ...] = (),
        text: str = "",
        data: Mapping[str, Any] = NewEvent._field_defaults["data"],
    ) -> None:
        """Tell the listeners at once, and the observers with the next frame."""
        self.record(NewEvent(kind, parts, surfaces, text, data))
        self.tell()

    def tell(self) -> None:
        """Tell those who are to be told of anything yet. What a listener raises is raised here."""
        began = clock.perf_counter()
        while self._due:
            self._due.popleft()()
        self.seconds = clock.perf_counter() - began

    def news(self) -> tuple[Event, ...]:
        """What has happened since the last frame."""
        return tuple(self._news)

    def mark(self) -> tuple[int, list[Event], int]:
        """What was heard so far, to `undo` what follows."""
        return len(self.events), list(self._news), len(self._due)

    def undo(self, mark: tuple[int, list[Event], int]) -> None:
        """Go back to a mark; nobody was told of what came after it."""
        count, self._news, due = mark
        del self.events[count:]
        while len(self._due) > due:
            self._due.pop()
        self._heard = []

    def begin(self, scene: Scene) -> None:
        """Give every observer a copy of the scene, with the next `tell`."""
        self._due = deque([partial(self._try, observer, "begin", scene.copy()) for observer in self.observers])

    def show(self, frame: Frame) -> None:
        """Show every observer a frame, which has the news, with the next `tell`."""
        self._due.extend([partial(self._try, observer, "frame", frame) for observer in self.observers])
        self._news = []

    def end(self) -> None:
        """Tell every observer that the session is over."""
        self._due.extend([partial(self._try, observer, "end") for observer in self.observers])
        self.tell()

    def asked(self, constraints: Iterable[ConstraintView], decided: Container[int]) -> list[Decision]:
        """What people at the viewers accepted, refused or removed, as far as it is still there.

        decided: ids that the script has decided about; it goes first. It is asked again until `heard`.
        """
        waiting = [(controls, controls.waiting()) for controls in self._controls()]
        self._heard = [(controls, len(requests)) for controls, requests in waiting]
        if not any(requests for _, requests in waiting):
            return []
        state = {c.id: c.state for c in constraints if c.id not in decided}
        return [
            Decision(request.action, request.id)
            for _, requests in waiting
            for request in requests
            if request.id is not None and state.pop(request.id, "") in FITTING[request.action]
        ]

    def heard(self) -> None:
        """What `asked` returned last is done."""
        for controls, count in self._heard:
            controls.drop(count)
        self._heard = []

    def play(self) -> None:
        """End every pause that a person at a viewer has asked for."""
        for controls in self._controls():
            controls.put(Request("play"))

    def _controls(self) -> list[Controls]:
        return [c for c in (getattr(observer, "controls", None) for observer in self.observers) if c is not None]

    def _try(self, observer: Observer, what: str, *given: Any) -> None:
        if observer not in self.observers:
            return  # it failed before its turn came
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
            self.record(NewEvent("note", text=f"{name} stopped watching: {type(error).__name__}: {error}"))


def viewers(viewer: str | Observer | None) -> list[Observer]:
    """What a session's `viewer` means."""
    if viewer is None:
        return []
    if isinstance(viewer, str):
        if viewer != "meshcat":
            raise VpframeError(f'viewer={viewer!r}; give None, "meshcat" or an observer')
        from vpframe.view.meshcat_viewer import watched

        return [watched()]
    return [viewer]


def recorders(record: str | os.PathLike[str] | Observer | None) -> list[Observer]:
    """What a session's `record` means."""
    if record is None:
        return []
    if isinstance(record, str | os.PathLike):
        from vpframe.view.recorder import RerunRecorder

        return [RerunRecorder(record)]
    return [record]
