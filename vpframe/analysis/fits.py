"""Fits and threads of a scene, and the pairs of faces whose clashes are judged by them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from collision import Tolerance
from constraints import Candidate
from constraints.geometry.round_fit import RoundFit, press_fit_words
from constraints.geometry.sleeve import sleeve
from constraints.geometry.surfaces import Cylinder, Sphere
from constraints.geometry.threads import faces_of_thread
from constraints.geometry.views import Extent, Limits
from vpframe.analysis.static import StaticAnalysis

Key = tuple[int, ...]
"""part a, part b, surface of a, surface of b; or two parts as a whole"""
BAD_KINDS = ("clash", "containment")
ROUND_FITS = ("concentric", "spherical")
"""kinds whose residual is the distance of the centres, so that gap = fit - residual"""


class ClashReason(StrEnum):
    """What the kind of a pair is judged by."""

    NONE = ""
    """distance or depth"""
    INSIDE = "inside"
    """one part lies wholly inside the other"""
    COMMON = "common material"
    """the surfaces of two parts only touch, but they have material in common"""
    FIT = "fit"
    """radii and axes of two round surfaces"""
    PLANES = "planes"
    """the distance of facing planes over their shared area"""
    THREAD = "thread"


class Verdict(NamedTuple):
    """What two faces, or two parts as a whole, are to each other."""

    kind: str
    distance: float
    """m"""
    depth: float
    """m"""
    reason: ClashReason = ClashReason.NONE
    words: str = ""
    """the reason with its measures"""
    fit: RoundFit | None = None
    open: tuple[int, ...] = ()
    """parts that are not closed, where the kind depends on what is inside"""


@dataclass(frozen=True)
class FittedPair:
    """Two round surfaces, one in the other."""

    parts: tuple[int, int]
    fit: RoundFit
    why: str
    mated: frozenset[Key]
    """faces of the two features that are near each other"""
    beside: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    """faces of the first part that cannot be closer to those of the second than the two features are"""

    def of(self, keys: Iterable[Key]) -> set[Key]:
        """Return the keys of faces that are beside one another."""
        first, second = map(set, self.beside)
        return {key for key in keys if len(key) == 4 and key[2] in first and key[3] in second}


@dataclass(frozen=True)
class PressFit:
    """A part that is pressed into another: their surfaces overlap by design, and nobody checks the force."""

    parts: tuple[str, str]
    interference: float
    """m, radial"""

    def __str__(self) -> str:
        return f"{' – '.join(self.parts)}: {press_fit_words(self.interference)}"

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {"parts": list(self.parts), "interference": self.interference, "text": str(self)}


def press_fits(mates: Iterable[tuple[tuple[str, str], float]]) -> tuple[PressFit, ...]:
    """Return the press fits among mates, given by the names of their parts and the radial interference (m, 0 if they
    are none): the tightest of each pair of parts, in the order given."""
    found: dict[tuple[str, str], float] = {}
    for parts, press in mates:
        if press > 0.0:
            found[parts] = max(press, found.get(parts, 0.0))
    return tuple(PressFit(parts, press) for parts, press in found.items())


@dataclass(frozen=True, eq=False)
class ThreadedPair:
    """A screw in its nut or tapped hole."""

    parts: tuple[int, int]
    why: str
    pitch: float
    """pitch, m a turn"""
    mated: frozenset[Key]
    """faces of the two threads that are near each other"""
    faces: frozenset[Key]
    """flanks, crests, roots and ends of a thread with real geometry"""
    depth: float = 0.0
    """overlap of a thread drawn as two cylinders, m; 0 for real geometry"""
    origin: NDArray[np.float64] | None = None
    """(3,) m: middle of the overlap of a drawn thread's cylinders"""
    axis: NDArray[np.float64] | None = None
    """(3,) unit"""
    size: tuple[float, float] = (0.0, 0.0)
    """radius of the screw and half the length of the overlap, m"""

    def claimed(
        self, rows: Mapping[Key, Verdict], deepest: Mapping[Key, NDArray[np.float64]], slack: float
    ) -> dict[Key, Verdict]:
        """Return the rows that belong to the thread, changed to kind "thread".

        Its faces may penetrate up to one pitch (out of phase). Of a drawn thread are also other clashes of the two
        parts whose deepest point lies within the overlap and that are no deeper than it: tip and wall, head and mouth.

        Parameters
        ----------
        rows: of the scene. deepest: deepest point (3,), m, of each clash. slack: uncertainty of depths, m.
        """
        own = {
            key: self._verdict(rows[key])
            for key in (self.mated | self.faces) & rows.keys()
            if rows[key].depth <= self.pitch + slack and (key in self.mated or rows[key].kind in BAD_KINDS)
        }
        clashes = {key: row for key, row in rows.items() if key[:2] == self.parts and row.kind in BAD_KINDS}
        if self.depth == 0.0:  # crests reach no deeper into the ends of the other thread than into the thread
            most = max((row.depth for row in own.values()), default=0.0) + slack
            ours, theirs = ({key[k] for key in self.faces} for k in (2, 3))
            for key, row in clashes.items():
                if len(key) == 4 and (key[2] in ours or key[3] in theirs) and row.depth <= most:
                    own[key] = self._verdict(row)
            return own
        for key, row in clashes.items():
            if row.depth <= self.depth + slack and key in deepest and self._holds(deepest[key], slack):
                own[key] = self._verdict(row)
        return own | dict.fromkeys(self.mated, self._verdict(Verdict("", 0.0, self.depth)))

    def _verdict(self, row: Verdict) -> Verdict:
        return Verdict("thread", row.distance, row.depth, ClashReason.THREAD, self.why)

    def _holds(self, point: NDArray[np.float64], slack: float) -> bool:
        """Whether a point (3,) lies in the overlap of a drawn thread."""
        if self.origin is None or self.axis is None:
            return False
        radius, half = self.size
        along = float((point - self.origin) @ self.axis)
        aside = float(np.linalg.norm(point - self.origin - along * self.axis))
        return radius - self.depth - slack <= aside <= radius + slack and abs(along) <= half + self.depth + slack


def fit_of(candidate: Candidate, tolerance: Tolerance, offset: float | None = None) -> RoundFit | None:
    """Return what the two round surfaces of a candidate are to each other; None if its kind is none of `ROUND_FITS`.

    offset: m, of axes or centres; by default as it was when the candidate was found.
    """
    fit = candidate.match.fit
    radii = [g.radius for g in candidate.geometries if isinstance(g, Cylinder | Sphere)]
    if candidate.kind not in ROUND_FITS or fit is None or len(radii) != 2:
        return None
    hollow, solid = (max(radii), min(radii)) if fit > 0.0 else (min(radii), max(radii))
    tilt = candidate.match.angle if candidate.kind == "concentric" else 0.0
    wider = solid * (1.0 / math.cos(tilt) - 1.0)  # a tilted shaft's cut across the bore is an ellipse
    offset = (candidate.residual if offset is None else offset) + wider
    return Limits.keep(tolerance).round_fit(hollow, fit, offset)


def fits_of(
    analysis: StaticAnalysis, tell: Callable[[float], None] = lambda fraction: None
) -> tuple[tuple[FittedPair, ...], tuple[ThreadedPair, ...]]:
    """Return the fits and threads of parts where they stand, and the shafts in bores that clash.

    tell: receives the fraction done.
    """
    t, features, world = analysis.tolerance, analysis.features, analysis.world
    within = max(analysis.within, analysis.within_deflection)
    fits, threads = [], []
    for candidate in analysis.candidates(tell, implied=True, within=within):
        a, fa, b, fb, kind = candidate.key
        near = frozenset((a, b, i, j) for i, j, _ in candidate.near)
        fit = candidate.match.fit
        if kind == "screw" and fit is None:
            faces = product(faces_of_thread(features[a], fa), faces_of_thread(features[b], fb))
            pitch = abs(candidate.pitch or 0.0)
            threads.append(ThreadedPair((a, b), candidate.why, pitch, near, frozenset((a, b, i, j) for i, j in faces)))
        elif kind == "screw" and fit is not None:
            screw = features[a][fa] if features[a][fa].sense > 0 else features[b][fb]
            radius = Extent.of(screw).radii[1]
            threads.append(_drawn(candidate, near, radius, candidate.residual - fit))
        elif (found := fit_of(candidate, t)) is not None:
            beside = sleeve(candidate, features, (world.mesh(a), world.mesh(b)), t.fit) or ((), ())
            fits.append(FittedPair((a, b), found, candidate.why, near, beside))
    for misfit in analysis.misfits(within):
        a, _, b, _ = misfit.pair
        fits.append(FittedPair((a, b), misfit.fit, misfit.why, frozenset((a, b, i, j) for i, j in misfit.faces)))
    return tuple(fits), tuple(threads)


def _drawn(candidate: Candidate, near: frozenset[Key], radius: float, depth: float) -> ThreadedPair:
    match = candidate.match
    return ThreadedPair(
        candidate.bodies,
        candidate.why,
        abs(candidate.pitch or 0.0),
        near,
        frozenset(),
        depth,
        match.origin,
        match.direction,
        (radius, 0.5 * match.overlap),
    )
