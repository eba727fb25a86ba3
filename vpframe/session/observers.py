"""Who watches a session, and all that it tells them: viewers, recorders, the report, and a script's listeners."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from vpframe.errors import OutputError, VpframeError
from vpframe.session.events import EVENT_KINDS, ConstraintView, Event, Frame, Observer
from vpframe.session.step import Request
from vpframe.view.controls import Request as Ask

if TYPE_CHECKING:
    from vpframe.session.session import Session

FITTING = {"accept": ("candidate", "refused"), "refuse": ("candidate",), "remove": ("active",)}
"""states of a constraint in which a person may ask for each"""


class Audience:
    """Observers and listeners of one session, and the events that they have heard of.

    An observer that fails is dropped, and said to be; the session goes on. `lost` says what it then
    has not written.

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
        """called with every event as it happens"""
        self.seconds = 0.0
        """that the observers took for the last frame"""
        self.lost: list[OutputError] = []
        """files that could not be written to their end"""
        self._now = now
        self._news: list[Event] = []

    def happened(
        self,
        kind: str,
        parts: tuple[str, ...],
        surfaces: tuple[tuple[int, ...], ...],
        text: str,
        data: Mapping[str, Any],
    ) -> None:
        """Tell the listeners at once, and the observers with the next frame."""
        assert kind in EVENT_KINDS, kind
        event = Event(*self._now(), kind, parts, surfaces, text, data)
        self.events.append(event)
        self._news.append(event)
        for listener in self.listeners:
            listener(event)

    def news(self) -> tuple[Event, ...]:
        """What has happened since the last call."""
        news, self._news = tuple(self._news), []
        return news

    def begin(self, session: Session) -> None:
        """Tell every observer that the session begins."""
        self._each(lambda observer: observer.begin(session))

    def show(self, frame: Frame) -> None:
        """Show every observer a frame."""
        began = clock.perf_counter()
        self._each(lambda observer: observer.frame(frame))
        self.seconds = clock.perf_counter() - began

    def end(self) -> None:
        """Tell every observer that the session is over."""
        self._each(lambda observer: observer.end())

    def asked(self, constraints: Iterable[ConstraintView]) -> list[Request]:
        """What people at the viewers accepted, refused or removed since the last call, as far as it is still there."""
        state = {c.id: c.state for c in constraints}
        return [
            Request(wish.action, wish.id)
            for controls in self._controls()
            for wish in controls.take()
            if state.pop(wish.id, None) in FITTING[wish.action]
        ]

    def play(self) -> None:
        """End every pause that a person at a viewer has asked for."""
        for controls in self._controls():
            controls.put(Ask("play"))

    def _controls(self) -> list[Any]:
        return [c for c in (getattr(observer, "controls", None) for observer in self.observers) if c is not None]

    def _each(self, tell: Callable[[Observer], None]) -> None:
        for observer in list(self.observers):
            try:
                tell(observer)
            except Exception as error:
                if observer in self.observers:
                    self.observers.remove(observer)
                if isinstance(error, OutputError):
                    self.lost.append(error)
                name = type(observer).__name__
                self.happened("note", (), (), f"{name} stopped watching: {type(error).__name__}: {error}", {})


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
