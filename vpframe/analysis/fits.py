"""Fits and threads of a scene as it stands, and the pairs of faces that a clash judges by them."""

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
"""part a, part b, surface of a, surface of b; or the two parts alone, where they are meant as a whole"""
Row = tuple[str, float, float, str]
"""kind, distance (m), depth (m), reason"""
BAD_KINDS = ("clash", "containment")
ROUND_FITS = ("concentric", "spherical")
"""kinds whose residual is how far the centres are apart, so that gap = fit - residual"""


@dataclass(frozen=True)
class Fit:
    """Round surfaces that fit each other."""

    gap: float
    """m between them where they are nearest; negative for interference"""
    why: str
    mated: frozenset[Key]
    """faces of the two features that are near each other"""
    beside: frozenset[Key]
    """faces that cannot be nearer to each other than the two features are"""


@dataclass(frozen=True, eq=False)
class Thread:
    """A screw in its nut or tapped hole."""

    parts: tuple[int, int]
    why: str
    pitch: float
    """m, the advance of a turn either way"""
    mated: frozenset[Key]
    """faces of the two threads that are near each other"""
    faces: frozenset[Key]
    """faces of flanks, crests, roots and ends, where the thread is real geometry"""
    depth: float = 0.0
    """m: by which a thread that is drawn as two cylinders overlaps all round; 0 where it is real geometry"""
    origin: NDArray[np.float64] | None = None
    """(3,) the middle of what a drawn thread's cylinders share"""
    axis: NDArray[np.float64] | None = None
    """(3,) unit"""
    size: tuple[float, float] = (0.0, 0.0)
    """m: radius of the screw, and half the length that the cylinders share"""

    def claimed(
        self, rows: Mapping[Key, Row], deepest: Mapping[Key, NDArray[np.float64]], slack: float
    ) -> dict[Key, Row]:
        """The rows that are the thread's own, as rows of kind "thread".

        Its faces are, no deeper in each other than a pitch: out of phase. Of a drawn one so is every clash that is
        deepest within the screw, beside the hole, and no deeper than the two overlap: a screw's tip with the wall, its
        head with the mouth.

        Parameters
        ----------
        rows: of the scene. deepest: (3,) m, the deepest point of each clash. slack: m, how exactly depths are known.
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
        """Whether a point (3,) lies in the wall that the screw of a drawn thread takes up."""
        if self.origin is None or self.axis is None:
            return False
        radius, half = self.size
        along = float((point - self.origin) @ self.axis)
        aside = float(np.linalg.norm(point - self.origin - along * self.axis))
        return radius - self.depth - slack <= aside <= radius + slack and abs(along) <= half + self.depth + slack


def fits_of(
    scene: Scene, world: CollisionManager, tell: Callable[[float], None]
) -> tuple[tuple[Fit, ...], tuple[Thread, ...]]:
    """Round surfaces that fit each other as the scene stands, and threads; `tell` hears the fraction done."""
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
