"""Frames kept for looking back: all of a short run, ever fewer a second of a long one, every event of both."""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from operator import itemgetter

from vpframe.session.events import Event, Frame


class History:
    """At most `limit` frames, evenly spaced over all that were added; the last one is always there."""

    def __init__(self, limit: int = 1200) -> None:
        self.limit = limit
        self._stride = 1
        self._count = 0
        self._kept: list[tuple[int, Frame]] = []
        self._events: list[tuple[int, Event]] = []
        self._last: Frame | None = None

    def add(self, frame: Frame) -> None:
        """Take the next frame in."""
        self._events.extend((self._count, event) for event in frame.events)
        if self._count % self._stride == 0:
            self._kept.append((self._count, frame))
            if len(self._kept) > self.limit:
                self._stride *= 2
                self._kept = self._kept[::2]
        self._count += 1
        self._last = frame

    def mark(self) -> tuple[int, int, Frame | None]:
        """How much there is, to `undo` what follows."""
        return self._count, len(self._events), self._last

    def undo(self, mark: tuple[int, int, Frame | None]) -> None:
        """Forget what was added since a mark."""
        self._count, events, self._last = mark
        del self._events[events:]
        del self._kept[bisect.bisect_left(self._kept, self._count, key=itemgetter(0)) :]

    @property
    def last(self) -> Frame | None:
        """The newest frame."""
        return self._last

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, in order."""
        return tuple(event for _, event in self._events)

    def events_since(self, count: int) -> tuple[tuple[int, Event], ...]:
        """The events after the first `count`, each with the number of the frame that it came with."""
        return tuple(self._events[count:])

    def at(self, number: int) -> tuple[int, Frame] | None:
        """The last kept frame up to that number, with its number; the first one kept if there is none, None of none."""
        place = bisect.bisect_right(self._kept, number, key=itemgetter(0))
        return self._kept[max(place - 1, 0)] if self._kept else None

    def __len__(self) -> int:
        """How many frames were added."""
        return self._count

    def sample(self, count: int) -> list[tuple[Frame, tuple[Event, ...]]]:
        """About `count` of the kept frames, evenly spaced."""
        kept = list(self)
        return kept[:: max(len(kept) // count, 1)]

    def __iter__(self) -> Iterator[tuple[Frame, tuple[Event, ...]]]:
        """Kept frames, each with the events since the one kept before it."""
        frames = list(self._kept)
        if self._last is not None and (not frames or frames[-1][0] != self._count - 1):
            frames.append((self._count - 1, self._last))
        at = 0
        for number, frame in frames:
            since = at
            while at < len(self._events) and self._events[at][0] <= number:
                at += 1
            yield frame, tuple(event for _, event in self._events[since:at])
