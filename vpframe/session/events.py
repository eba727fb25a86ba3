"""What a session tells its observers: one `Event` a happening, one `Frame` a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

if TYPE_CHECKING:
    from vpframe.session.session import Session

EVENT_KINDS = (
    "grabbed", "released", "collided", "parted", "recognised", "withdrawn", "accepted", "refused", "satisfied",
    "removed", "blocked", "landed", "expectation", "note",
)  # fmt: skip


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
    """"candidate", "active" or "refused\""""
    origin: NDArray[np.float64]
    """(3,) world, where to draw it"""
    direction: NDArray[np.float64]
    """(3,) world, axis or normal"""
    size: float
    """m, radius or half width of what to draw"""
    why: str = ""


@dataclass(frozen=True)
class Frame:
    """The state after one step, by value: observers may keep it."""

    step: int
    time: float
    poses: Mapping[str, pin.SE3]
    colliding: NDArray[np.int32]
    """(k, 4) object, surface, object, surface: sorted; objects in scene order"""
    constraints: tuple[ConstraintView, ...]
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
    """Viewer, recorder, report: reads frames, changes nothing. Exceptions in an observer end it, not the session."""

    def begin(self, session: Session) -> None:
        """Called once, before the first step; geometry is known and does not change."""

    def frame(self, frame: Frame) -> None:
        """Called after each step, in order."""

    def end(self) -> None:
        """Called once; also after an error or Ctrl-C."""


class Frames:
    """An observer that keeps every frame, in `frames`."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def begin(self, session: Session) -> None:
        """Nothing to prepare."""

    def frame(self, frame: Frame) -> None:
        """Keep it."""
        self.frames.append(frame)

    def end(self) -> None:
        """Nothing to close."""
