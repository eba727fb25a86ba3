"""Rows of surface pairs, grouped by pair of parts, for clash tables and reports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.classify import KINDS as CLASSIFIED
from constraints.geometry.round_fit import RoundFit
from vpframe.analysis.fits import ClashReason
from vpframe.analysis.meanings import Meaning
from vpframe.scene.names import geometry_words
from vpframe.scene.scene import Part, Surface

_TOUCHING = CLASSIFIED.index("contact")
KINDS = (*CLASSIFIED[:_TOUCHING], "press fit", "thread", "soft", "glue", *CLASSIFIED[_TOUCHING:])
"""in descending gravity"""
OPEN_FIRST = ("new", "persistent", "accepted", "resolved")
"""order of precedence for the status of a pair of parts"""


class SurfacePair(ABC):
    """Fields by which rows are grouped and sorted."""

    kind: str
    parts: tuple[str, str]
    distance: float
    depth: float | None
    planes: int
    status: str
    remark: str

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return it for JSON."""


@dataclass(frozen=True)
class ClashRow(SurfacePair):
    """Two surfaces, or two parts as a whole, that clash, touch or are near each other."""

    kind: str
    """one of `KINDS`"""
    parts: tuple[str, str]
    surfaces: tuple[int, ...]
    """one of each part; none for parts as a whole (containment, coincidence)"""
    faces: tuple[Surface, ...]
    distance: float
    """m: lower bound, or 0"""
    depth: float
    """m"""
    interval: tuple[float, float]
    """m: bounds of the signed gap of the two true surfaces, negative for depths"""
    point: tuple[float, float, float]
    """m, world: the deepest or nearest point"""
    reason: ClashReason
    words: str
    """the reason with its measures"""
    fit: RoundFit | None = None
    open: tuple[str, ...] = ()
    """parts that are not closed, where the kind depends on what is inside"""
    status: str = ""
    """of a clash, if a status file was read (see `clash_status`)"""
    remark: str = ""
    planes: int = 0
    """number of plane faces"""
    meaning: Meaning | None = None
    """what the overlap means, where a part tells it; None also for fits and threads that the two surfaces tell"""

    @property
    def other(self) -> str:
        """Name of the part that a meaning's fastener is in, or on."""
        known = self.meaning
        return self.parts[1] if known is None or known.part == known.parts[0] else self.parts[0]

    @property
    def why(self) -> str:
        """The reason as a sentence; empty if there is none."""
        gaps = (f"{name} is not closed: its winding number decides what is inside it" for name in self.open)
        return "; ".join(filter(None, [self.words, *gaps]))

    @property
    def face_words(self) -> list[str]:
        """Names of the faces: "face 3 · bore Ø20"."""
        return [f"face {face.index} · {geometry_words(face.geometry, face.orientation)}" for face in self.faces]

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        marked = {"status": self.status, "remark": self.remark} if self.status else {}
        return {
            "kind": self.kind,
            "parts": list(self.parts),
            "surfaces": list(self.surfaces),
            "faces": self.face_words,
            "distance": self.distance,
            "depth": self.depth,
            "interval": list(self.interval),
            "point": list(self.point),
            "reason": self.why,
            **({} if self.meaning is None else {"meaning": self.meaning.document()}),
            **marked,
        }


R = TypeVar("R", bound=SurfacePair)


@dataclass(frozen=True)
class PartPair(Generic[R]):
    """Two parts with the rows of their surfaces, worst first."""

    rows: tuple[R, ...]

    @property
    def worst(self) -> R:
        """The gravest and deepest row."""
        return self.rows[0]

    @property
    def kind(self) -> str:
        """The gravest kind."""
        return self.worst.kind

    @property
    def status(self) -> str:
        """The gravest status; empty if no row has one."""
        return min(filter(None, (row.status for row in self.rows)), key=OPEN_FIRST.index, default="")

    @property
    def remark(self) -> str:
        """The remark of the worst row that has one."""
        return next((row.remark for row in self.rows if row.remark), "")

    def document(self) -> dict[str, Any]:
        """Return it for JSON: the fields of the worst row, the number of rows, and all of them as "surface_pairs"."""
        marked = {"status": self.status, "remark": self.remark} if self.status else {}
        rows = [row.document() for row in self.rows]
        return {**rows[0], **marked, "count": len(rows), "surface_pairs": rows}


def by_parts(rows: Iterable[R], apart: Callable[[R], Any] = lambda row: None) -> list[PartPair[R]]:
    """Group rows by pair of parts, gravest and deepest first.

    apart: rows of the same two parts with different values of this function are not grouped.
    """
    groups: dict[Any, list[R]] = {}
    for row in rows:
        groups.setdefault((*row.parts, apart(row)), []).append(row)
    pairs = (PartPair(tuple(sorted(members, key=worst_first))) for members in groups.values())
    return sorted(pairs, key=lambda pair: worst_first(pair.worst))


def worst_first(row: SurfacePair) -> tuple[int, float, float, int]:
    """Sort key: kind, depth, distance (to a nanometre), and curved faces before planes."""
    return KINDS.index(row.kind), -round(row.depth or 0.0, 9), round(row.distance, 9), row.planes


def meeting_box(
    parts: Sequence[Part], poses: Sequence[pin.SE3], surfaces: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners (3,), (3,) of the intersection of two surfaces' bounding boxes, or of the gap between them, world, m."""
    lows, highs = [], []
    for part, pose, surface in zip(parts, poses, surfaces, strict=True):
        corners = part.mesh.vertices[part.mesh.triangles[part.mesh.triangles_of(surface)]].reshape(-1, 3)
        points = corners @ pose.rotation.T + pose.translation
        lows.append(points.min(axis=0))
        highs.append(points.max(axis=0))
    low, high = np.max(lows, axis=0), np.min(highs, axis=0)
    return np.minimum(low, high), np.maximum(low, high)


def place_words(point: Sequence[float] | None) -> str:
    """Format a point (3,), m, as "(1.25, 0, -3.1) mm"; empty for None."""
    if point is None:
        return ""
    return "({}) mm".format(", ".join(f"{round(1e3 * x, 2) + 0.0:g}" for x in point))


def count_words(count: int, what: str) -> str:
    """Format a count: "1 pair of parts", "3 pairs of parts"."""
    return f"{count} pair{'s' if count != 1 else ''} of {what}"
