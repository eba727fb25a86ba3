"""Frames kept for looking back: all frames of a short run, evenly spaced ones of a long run, and all events."""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from operator import itemgetter

from vpframe.events import Event, Frame


class History:
    """At most `limit` frames, evenly spaced over all added ones, always with the last one."""

    def __init__(self, limit: int = 1200) -> None:
        self.limit = limit
        self._stride = 1
        self._count = 0
        self._kept: list[tuple[int, Frame]] = []
        self._events: list[tuple[int, Event]] = []
        self._last: Frame | None = None

    def add(self, frame: Frame) -> None:
        """Add the next frame; one that shows the last step again replaces it."""
        if self._last is not None and frame.step == self._last.step:
            self._count -= 1
            if self._kept and self._kept[-1][0] == self._count:
                self._kept.pop()
        self._events.extend((self._count, event) for event in frame.events)
        if self._count % self._stride == 0:
            self._kept.append((self._count, frame))
            if len(self._kept) > self.limit:
                self._stride *= 2
                self._kept = self._kept[::2]
        self._count += 1
        self._last = frame

    def rewind(self, last: Frame | None, events: int) -> None:
        """Forget the frames after `last`, of all if it is None, and the events after the first `events`."""
        if self._last is not None:
            self._count -= self._count if last is None else self._last.step - last.step
        self._last = last
        del self._events[events:]
        del self._kept[bisect.bisect_left(self._kept, self._count, key=itemgetter(0)) :]

    @property
    def last(self) -> Frame | None:
        """Return the newest frame."""
        return self._last

    @property
    def events(self) -> tuple[Event, ...]:
        """Return all events, in order."""
        return tuple(event for _, event in self._events)

    def events_since(self, count: int) -> tuple[tuple[int, Event], ...]:
        """Return the events after the first `count`, each with the number of its frame."""
        return tuple(self._events[count:])

    def at(self, number: int) -> tuple[int, Frame] | None:
        """Return the last kept frame up to this number (else the first) with its own; None if none is kept."""
        place = bisect.bisect_right(self._kept, number, key=itemgetter(0))
        return self._kept[max(place - 1, 0)] if self._kept else None

    def __len__(self) -> int:
        """Return the number of added frames."""
        return self._count

    def sample(self, count: int) -> list[tuple[Frame, tuple[Event, ...]]]:
        """Return about `count` of the kept frames, evenly spaced."""
        kept = list(self)
        return kept[:: max(len(kept) // count, 1)]

    def __iter__(self) -> Iterator[tuple[Frame, tuple[Event, ...]]]:
        """Iterate over the kept frames, each with the events since the kept frame before it."""
        frames = list(self._kept)
        if self._last is not None and (not frames or frames[-1][0] != self._count - 1):
            frames.append((self._count - 1, self._last))
        at = 0
        for number, frame in frames:
            since = at
            while at < len(self._events) and self._events[at][0] <= number:
                at += 1
            yield frame, tuple(event for _, event in self._events[since:at])
