"""What observers get: `Event`s, and one read-only `Frame` a step."""

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
    """Something that happened at one step."""

    step: int
    time: float
    """s since the session began"""
    kind: str
    """one of EVENT_KINDS"""
    parts: tuple[str, ...] = ()
    surfaces: tuple[tuple[int, ...], ...] = ()
    """the surfaces concerned, one tuple a part"""
    text: str = ""
    """one line a person can read"""
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ConstraintView:
    """A constraint or candidate as observers see it (already in the user's terms)."""

    id: int
    kind: str
    """"against", "concentric", …"""
    parts: tuple[str, str]
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    residual: float
    """m, largest of its position residuals"""
    state: str
    """"candidate", "active" or "refused"; rules are asked about the assembly as it stands with "standing\""""
    origin: NDArray[np.float64]
    """(3,) world, where to draw it"""
    direction: NDArray[np.float64]
    """(3,) world, axis or normal"""
    size: float
    """m, radius or half width of what to draw"""
    why: str = ""


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """Where a part meets another one."""

    other: str
    """the other part"""
    point: NDArray[np.float64]
    """(3,) world, m"""
    normal: NDArray[np.float64]
    """(3,) world, unit, towards the part; 0 where two edges touch"""
    force: NDArray[np.float64] | None
    """(3,) world, N, on the part; None where a hand carries the part, against which no force counts"""


class Poses(Mapping[str, pin.SE3]):
    """Poses by part name, by value: each access returns a pose of its own.

    numbers: place of each part. rows: (n, 12) rotation by rows, translation in m; they are made read-only.
    """

    def __init__(self, numbers: Mapping[str, int], rows: NDArray[np.float64]) -> None:
        rows.setflags(write=False)
        self._numbers = numbers
        self.rows = rows

    @classmethod
    def of(cls, poses: Mapping[str, pin.SE3]) -> Poses:
        """Copies of these."""
        rows = [np.append(pose.rotation.ravel(), pose.translation) for pose in poses.values()]
        return cls({name: i for i, name in enumerate(poses)}, np.array(rows).reshape(-1, 12))

    def __getitem__(self, name: str) -> pin.SE3:
        row = self.rows[self._numbers[name]]
        return pin.SE3(row[:9].reshape(3, 3), row[9:])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


def moved(before: Mapping[str, pin.SE3], now: Mapping[str, pin.SE3]) -> list[str]:
    """The parts whose poses are not the same in two mappings, or are in the second only."""
    if isinstance(before, Poses) and isinstance(now, Poses) and before.rows.shape == now.rows.shape:
        if before.rows is now.rows:
            return []
        names = list(now)
        return [names[i] for i in np.flatnonzero((before.rows != now.rows).any(axis=1)).tolist()]
    return [name for name, pose in now.items() if name not in before or before[name] != pose]


@dataclass(frozen=True)
class Frame:
    """The state after one step, by value: observers may keep it, and change nothing by it."""

    step: int
    time: float
    poses: Mapping[str, pin.SE3]
    colliding: NDArray[np.int32]
    """(k, 4) object, surface, object, surface: sorted; objects in scene order"""
    constraints: Sequence[ConstraintView]
    freedom: Mapping[str, int]
    """degrees of freedom left, of each part that is held, or moved since the session began"""
    joint: Mapping[str, str]
    """the lower pair's name for the same parts"""
    clearance: float | None
    """m: least distance between moving parts and the rest, pairs under a constraint left out; None if not asked for"""
    timings: Mapping[str, float]
    """s spent: "collision", "constraints", "motion", "physics", "observers" (of the step before)"""
    held: tuple[str, ...] = ()
    hands: Mapping[str, pin.SE3] = field(default_factory=dict)
    script: str = ""
    """the script's line in words, e.g. "hand.move_to(...)\""""
    events: tuple[Event, ...] = ()


class Observer(Protocol):
    """Viewer, recorder, report: reads frames, changes nothing.

    One that raises is ended and taken out, and a note says so; the session goes on. One that has an attribute
    `controls` (`vpframe.view.controls.Controls`) may ask through it: pause, step, accept, refuse, remove.
    """

    def begin(self, scene: Scene) -> None:
        """Called once, before the first step, with a copy of the scene: names, meshes, colours, poses; metres."""

    def frame(self, frame: Frame) -> None:
        """Called after each step, in order."""

    def end(self) -> None:
        """Called once; also after an error or Ctrl-C."""


class Frames:
    """An observer that keeps every frame, in `frames`."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def begin(self, scene: Scene) -> None:
        """Nothing to prepare."""

    def frame(self, frame: Frame) -> None:
        """Keep it."""
        self.frames.append(frame)

    def end(self) -> None:
        """Nothing to close."""
