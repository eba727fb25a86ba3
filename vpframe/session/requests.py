"""Requests of pages: one table of actions and their fields. Pages are not trusted: anything else is dropped."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

MOST = 1 << 31
"""upper limit of ids and of numbers of parts, surfaces and frames"""
FARTHEST = 1e6
"""greatest coordinate, m or rad"""


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not -MOST < value < MOST:
        raise ValueError
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError
    return value


def _real(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    if abs(value) > FARTHEST:
        raise ValueError
    return float(value)


def _numbers(count: int) -> Callable[[Any], tuple[float, ...]]:
    def read(value: Any) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise ValueError
        return tuple(map(_real, value))

    return read


def _axis(value: Any) -> str:
    if value not in ("x", "y", "z", "axis"):
        raise ValueError
    return str(value)


_POINT, _POSE = _numbers(3), _numbers(7)
NOTHING: Mapping[str, Callable[[Any], Any]] = {}
ACTIONS: dict[str, Mapping[str, Callable[[Any], Any]]] = {
    # the run
    "play": NOTHING,
    "pause": NOTHING,
    "step": NOTHING,
    # constraints
    "accept": {"id": _count},
    "refuse": {"id": _count},
    "remove": {"id": _count},
    # the hand
    "grab": {"part": _count, "level": _count, "surface": _count},
    "release": NOTHING,
    "drag": {"point": _POINT, "to": _POINT, "free": _flag},
    "place": {"pose": _POSE, "free": _flag},
    "rest": NOTHING,
    "loosen": NOTHING,
    "slide": {"along": _axis, "distance": _real},
    "turn": {"about": _axis, "angle": _real},
    # what was done
    "undo": NOTHING,
    "redo": NOTHING,
    "save": NOTHING,
    # what this page looks at
    "look": {"frame": _count},
}
"""fields of each action, and what reads them; lengths m, angles rad, poses x y z qx qy qz qw. "grab" takes a part, or
the subassembly that the first `level` names of its path name (0: the part alone). "drag" takes a point of what is held
(in its frame) towards a place, "place" its frame to a pose; both along its freedom unless `free`, until "rest". A
`surface` and a `frame` below 0 stand for none and for the newest. "loosen" takes out what holds it."""
ABOUT_CONSTRAINTS = ("accept", "refuse", "remove")
OF_THE_RUN = ("play", "pause", "step")


@dataclass(frozen=True)
class Request:
    """A person's request; `id` names the constraint of accept, refuse and remove, `given` has all other fields."""

    action: str
    id: int | None = None
    given: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    client: int = field(default=0, compare=False)
    """number of the page that sent it"""

    @classmethod
    def read(cls, message: Any, client: int = 0) -> Request | None:
        """Return the request in a decoded message; None if it is none."""
        if not isinstance(message, dict) or not isinstance(message.get("action"), str):
            return None
        fields = ACTIONS.get(message["action"])
        if fields is None:
            return None
        try:
            given = {name: read(message[name]) for name, read in fields.items()}
        except (KeyError, ValueError, OverflowError):
            return None
        return cls(message["action"], given.pop("id", None), MappingProxyType(given), client)
