"""Fits and threads of a scene, and the pairs of faces whose clashes are judged by them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from collision import CollisionManager
from constraints import Candidate
from constraints.geometry.sleeve import sleeve
from constraints.geometry.threads import faces_of_thread
from constraints.geometry.views import Extent
from vpframe.analysis.static import candidates, threaded_features
from vpframe.scene.scene import Scene

Key = tuple[int, ...]
"""part a, part b, surface of a, surface of b; or two parts as a whole"""
Row = tuple[str, float, float, str]
"""kind, distance (m), depth (m), reason"""
BAD_KINDS = ("clash", "containment")
ROUND_FITS = ("concentric", "spherical")
"""kinds whose residual is the distance of the centres, so that gap = fit - residual"""


@dataclass(frozen=True)
class Fit:
    """Fit of two round surfaces."""

    gap: float
    """least gap, m; negative for interference"""
    why: str
    mated: frozenset[Key]
    """faces of the two features that are near each other"""
    beside: frozenset[Key]
    """face pairs that cannot be closer than the two features"""


@dataclass(frozen=True, eq=False)
class Thread:
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
        self, rows: Mapping[Key, Row], deepest: Mapping[Key, NDArray[np.float64]], slack: float
    ) -> dict[Key, Row]:
        """Return the rows that belong to the thread, changed to kind "thread".

        Its faces may penetrate up to one pitch (out of phase). For a drawn thread, other clashes of the two parts
        belong to
        it if their deepest point lies within the overlap and they are no deeper than it: tip and wall, head and mouth.

        Parameters
        ----------
        rows: of the scene. deepest: deepest point (3,), m, of each clash. slack: uncertainty of depths, m.
        """
        own = {
            key: ("thread", *rows[key][1:3], self.why)
            for key in (self.mated | self.faces) & rows.keys()
            if rows[key][2] <= self.pitch + slack and (key in self.mated or rows[key][0] in BAD_KINDS)
        }
        if self.depth == 0.0:
            return own
        for key, (kind, distance, depth, _) in rows.items():
            clashes = key[:2] == self.parts and kind in BAD_KINDS and depth <= self.depth + slack
            if clashes and key in deepest and self._holds(deepest[key], slack):
                own[key] = ("thread", distance, depth, self.why)
        return own | dict.fromkeys(self.mated, ("thread", 0.0, self.depth, self.why))

    def _holds(self, point: NDArray[np.float64], slack: float) -> bool:
        """Whether a point (3,) lies in the overlap of a drawn thread."""
        if self.origin is None or self.axis is None:
            return False
        radius, half = self.size
        along = float((point - self.origin) @ self.axis)
        aside = float(np.linalg.norm(point - self.origin - along * self.axis))
        return radius - self.depth - slack <= aside <= radius + slack and abs(along) <= half + self.depth + slack


def fits_of(
    scene: Scene, world: CollisionManager, tell: Callable[[float], None]
) -> tuple[tuple[Fit, ...], tuple[Thread, ...]]:
    """Return the fits and threads of a scene at its present poses; `tell` receives the fraction done."""
    features, _ = threaded_features(scene)
    fits, threads = [], []
    for candidate in candidates(scene, world, tell, implied=True):
        a, fa, b, fb, kind = candidate.key
        near = frozenset((a, b, i, j) for i, j, _ in candidate.near)
        fit = candidate.match.fit
        if kind == "screw" and fit is None:
            faces = product(faces_of_thread(features[a], fa), faces_of_thread(features[b], fb))
            pitch = abs(candidate.pitch or 0.0)
            threads.append(Thread((a, b), candidate.why, pitch, near, frozenset((a, b, i, j) for i, j in faces)))
        elif kind == "screw" and fit is not None:
            screw = features[a][fa] if features[a][fa].sense > 0 else features[b][fb]
            radius = Extent.of(screw).radii[1]
            threads.append(_drawn(candidate, near, radius, candidate.residual - fit))
        elif kind in ROUND_FITS and fit is not None:
            beside = sleeve(candidate, features, (world.mesh(a), world.mesh(b)), world.tolerance.fit) or ((), ())
            others = frozenset((a, b, i, j) for i, j in product(*beside))
            fits.append(Fit(fit - candidate.residual, candidate.why, near, others))
    return tuple(fits), tuple(threads)


def _drawn(candidate: Candidate, near: frozenset[Key], radius: float, depth: float) -> Thread:
    match = candidate.match
    return Thread(
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
