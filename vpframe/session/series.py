"""`Series`: measurements of every step in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

Item = TypeVar("Item")

LIMIT = 8192
"""maximum number of items: all of a run of two minutes"""


class Series(Generic[Item]):
    """Items in order, all of them up to `LIMIT`; beyond, one item represents two, four, … neighbours.

    Parameters
    ----------
    choose: which of two neighbours represents both; default: the earlier one.
    """

    def __init__(self, choose: Callable[[Item, Item], Item] | None = None) -> None:
        self._choose = choose or _earlier
        self._kept: list[Item] = []
        self._stride = 1
        self._count = 0

    def add(self, item: Item) -> None:
        """Append an item."""
        if self._count % self._stride:
            self._kept[-1] = self._choose(self._kept[-1], item)
        else:
            if len(self._kept) == LIMIT:
                self._kept = list(map(self._choose, self._kept[::2], self._kept[1::2]))
                self._stride *= 2
            self._kept.append(item)
        self._count += 1

    def rewind(self, last: Callable[[Item], bool]) -> None:
        """Drop the newest items until one is `last`; an item that represents later ones too is kept unchanged."""
        while self._kept and not last(self._kept[-1]):
            self._kept.pop()
            self._count = len(self._kept) * self._stride

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Item]:
        return iter(self._kept)


def _earlier(earlier: Item, later: Item) -> Item:
    return earlier
