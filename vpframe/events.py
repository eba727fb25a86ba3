"""Data that observers receive: `Event`s, and one read-only `Frame` for each step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vpframe.scene.scene import Scene

EVENT_KINDS = (
    "grabbed", "released", "collided", "parted", "recognised", "withdrawn", "accepted", "refused", "satisfied",
    "removed", "blocked", "landed", "expectation", "note",
)  # fmt: skip


class NewEvent(NamedTuple):
    """An event without its time."""

    kind: str
    """one of EVENT_KINDS"""
    parts: tuple[str, ...] = ()
    surfaces: tuple[tuple[int, ...], ...] = ()
    text: str = ""
    data: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Event:
    """An event of one step."""

    step: int
    time: float
    """s since the session began"""
    kind: str
    """one of EVENT_KINDS"""
    parts: tuple[str, ...] = ()
    surfaces: tuple[tuple[int, ...], ...] = ()
    """surfaces involved, one tuple for each part"""
    text: str = ""
    """one line for people"""
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ConstraintView:
    """A constraint or candidate in the user's terms, as observers receive it."""

    id: int
    kind: str
    """"against", "concentric", …"""
    parts: tuple[str, str]
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    residual: float
    """largest position residual, m"""
    state: str
    """"candidate", "active" or "refused"; "standing" when a rule judges a constraint of the initial assembly"""
    origin: NDArray[np.float64]
    """(3,) world, m: where to draw it"""
    direction: NDArray[np.float64]
    """(3,) world, unit: axis or normal"""
    size: float
    """radius or half width of the drawn symbol, m"""
    why: str = ""
    press: float = 0.0
    """radial interference of a press fit, m; 0 for anything else"""


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """A contact point of a part with another part."""

    other: str
    """the other part"""
    point: NDArray[np.float64]
    """(3,) world, m"""
    normal: NDArray[np.float64]
    """(3,) world, unit, towards the part; 0 if two edges touch"""
    force: NDArray[np.float64] | None
    """(3,) world, N, on the part; None if a hand carries the part"""


class Poses(Mapping[str, pin.SE3]):
    """Read-only poses by part name; each access returns a new pose.

    numbers: row of each part. rows: (n, 12) rotation by rows, translation in m; they are made read-only.
    """

    def __init__(self, numbers: Mapping[str, int], rows: NDArray[np.float64]) -> None:
        rows.setflags(write=False)
        self._numbers = numbers
        self.rows = rows

    @classmethod
    def of(cls, poses: Mapping[str, pin.SE3]) -> Poses:
        """Return copies of poses."""
        rows = np.empty((len(poses), 12))
        for row, pose in zip(rows, poses.values(), strict=True):
            row[:9], row[9:] = pose.rotation.ravel(), pose.translation
        return cls({name: i for i, name in enumerate(poses)}, rows)

    def __getitem__(self, name: str) -> pin.SE3:
        row = self.rows[self._numbers[name]]
        return pin.SE3(row[:9].reshape(3, 3), row[9:])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


def moved(before: Mapping[str, pin.SE3], now: Mapping[str, pin.SE3]) -> list[str]:
    """Return the parts whose poses differ between two mappings, or that are only in the second."""
    if isinstance(before, Poses) and isinstance(now, Poses) and before.rows.shape == now.rows.shape:
        if before.rows is now.rows:
            return []
        names = list(now)
        return [names[i] for i in np.flatnonzero((before.rows != now.rows).any(axis=1)).tolist()]
    return [name for name, pose in now.items() if name not in before or before[name] != pose]


@dataclass(frozen=True)
class Frame:
    """The state after one step, by value; observers may keep it."""

    step: int
    time: float
    poses: Mapping[str, pin.SE3]
    colliding: NDArray[np.int32]
    """(k, 4) object, surface, object, surface: sorted; objects in scene order"""
    constraints: Sequence[ConstraintView]
    freedom: Mapping[str, int]
    """degrees of freedom of each part that is held or has moved since the session began"""
    joint: Mapping[str, str]
    """name of each such part's lower pair"""
    clearance: float | None
    """least distance of moving parts to the others, without constrained pairs, m; None if not measured"""
    timings: Mapping[str, float]
    """computing time, s: "collision", "constraints", "motion", "physics", "observers" (of the step before)"""
    held: tuple[str, ...] = ()
    hands: Mapping[str, pin.SE3] = field(default_factory=dict)
    script: str = ""
    """text of the running verbs, e.g. "hand.move_to(...)\""""
    events: tuple[Event, ...] = ()


class Observer(Protocol):
    """Viewer, recorder or report: reads frames, changes nothing.

    An observer that raises is ended and removed with a note in the events; the session continues. An observer with an
    attribute `controls` (`vpframe.session.controls.Controls`) may request pause, step, accept, refuse and remove. One
    with a method `rewind(last, events)` forgets what a session takes back: the frames after `last` (all if it is None)
    and the events after the first `events`; others keep them.
    """

    def begin(self, scene: Scene) -> None:
        """Receive a copy of the scene before the first step: names, meshes, colours, poses; metres."""

    def frame(self, frame: Frame) -> None:
        """Receive the frame of a step, in order."""

    def end(self) -> None:
        """End the observation; called once, also after an error or Ctrl-C."""


class Frames:
    """An observer that keeps every frame in `frames`."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def begin(self, scene: Scene) -> None:
        """Do nothing."""

    def frame(self, frame: Frame) -> None:
        """Keep the frame."""
        self.frames.append(frame)

    def end(self) -> None:
        """Do nothing."""
