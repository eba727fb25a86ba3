"""Static analysis of an assembly at its present poses: collision world, contacts, recogniser, candidate constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary, finalize

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from constraints import Candidate
from constraints.geometry.features import Feature
from constraints.geometry.threads import threaded
from constraints.geometry.views import Limits
from constraints.recognition.misfits import Misfit, misfits
from constraints.recognition.recognise import Recogniser
from vpframe.scene.deflection import deflections
from vpframe.scene.names import thread_words
from vpframe.scene.scene import Scene, Shape

_THREADED: WeakKeyDictionary[Shape, tuple[tuple[Feature, ...], dict[int, float]]] = WeakKeyDictionary()
"""features of each shape with its threads, and the pitches by place"""
_KNOWN: dict[int, tuple[Any, StaticAnalysis]] = {}
"""version and analysis of each scene that is alive, by its id"""


def world_of(scene: Scene, tolerance: Tolerance | None = None) -> CollisionManager:
    """Return a collision manager with the parts of a scene, with a tolerance without reach."""
    manager = CollisionManager(replace(tolerance or Tolerance(), reach=0.0, reach_angular=0.0))
    for part in scene.parts:
        manager.add(part.mesh, part.pose)
    return manager


class StaticAnalysis:
    """Parts at fixed poses; what several questions about them need is computed once, at first use.

    tolerance: its reach does not count: parts are judged as they stand.
    """

    def __init__(self, scene: Scene, tolerance: Tolerance | None = None) -> None:
        self.world = world_of(scene, tolerance)
        self.tolerance = self.world.tolerance
        self.parts = scene.parts
        self.poses = [pin.SE3(part.pose) for part in scene.parts]
        self.features, pitches = threaded_features(scene)
        self.recogniser = Recogniser(self.features, pitches, named_threads(scene))
        self._widest = 0.0
        self._contacts: NDArray[Any] | None = None

    @cached_property
    def deflections(self) -> list[NDArray[np.float64]]:
        """Deflection of each surface of each part, m."""
        return [deflections(part.shape) for part in self.parts]

    @cached_property
    def deflection(self) -> list[float]:
        """Greatest deflection of each part, m."""
        return [float(own.max(initial=0.0)) for own in self.deflections]

    @cached_property
    def within(self) -> float:
        """Distance up to which recognition needs contacts, m."""
        return self.recogniser.within(Limits.offer(self.tolerance))

    @property
    def within_deflection(self) -> float:
        """Greatest distance of the triangles of two surfaces that may touch, m."""
        return self.tolerance.linear + 2.0 * max(self.deflection, default=0.0)

    def contacts(self, within: float) -> NDArray[Any]:
        """Return the contact rows up to a distance (m), see `CollisionManager.contacts`."""
        if self._contacts is None or within > self._widest:
            self._contacts, self._widest = self.world.contacts(within=within), within
        return self._contacts[self._contacts["distance"] <= within]

    def candidates(
        self, tell: Callable[[float], None] = lambda fraction: None, *, implied: bool = False, within: float = 0.0
    ) -> tuple[Candidate, ...]:
        """Return the candidate constraints between parts in contact, best first.

        Parameters
        ----------
        tell: receives the fraction done.
        implied: whether to return candidates that others imply (see `constraints.recognition.implied`).
        within: m: contacts up to this distance count, if it is more than recognition needs.
        """
        contacts = self.contacts(max(within, self.within))
        return self.recogniser.candidates(self.poses, contacts, self.tolerance, implied=implied, tell=tell)

    def misfits(self, within: float) -> tuple[Misfit, ...]:
        """Return the shafts in bores that clash, of parts with contacts up to a distance, m."""
        meshes = [part.mesh for part in self.parts]
        return misfits(
            self.recogniser, meshes, self.poses, self.contacts(within), Limits.offer(self.tolerance), self.deflection
        )


def analysis_of(scene: Scene, tolerance: Tolerance | None = None) -> StaticAnalysis:
    """Return the analysis of a scene; the same one until its parts, their poses or the tolerance change."""
    parts = tuple((part.name, part.shape, part.pose.homogeneous.tobytes()) for part in scene.parts)
    version = (tolerance or Tolerance(), parts)
    known = _KNOWN.get(id(scene))
    if known is None:
        finalize(scene, _KNOWN.pop, id(scene), None)
    if known is None or known[0] != version:
        known = _KNOWN[id(scene)] = version, StaticAnalysis(scene, tolerance)
    return known[1]


def threaded_features(scene: Scene) -> tuple[list[tuple[Feature, ...]], dict[tuple[int, int], float]]:
    """Return each part's features, with threads of real geometry, and the pitches by (part, feature)."""
    features, threads = [], {}
    for i, part in enumerate(scene.parts):
        if part.shape not in _THREADED:
            _THREADED[part.shape] = threaded(part.mesh, part.features)
        own, pitches = _THREADED[part.shape]
        features.append(own)
        threads.update({(i, place): pitch for place, pitch in pitches.items()})
    return features, threads


def named_threads(scene: Scene) -> dict[int, tuple[str, ...]]:
    """Return the words of parts' names that speak of threads, by part; parts without are left out."""
    words = ((i, thread_words(name)) for i, name in enumerate(scene.names))
    return {i: found for i, found in words if found}


def base_parts(scene: Scene) -> tuple[int, ...]:
    """Return the indices of the parts that do not move: the fixed ones, else the one of largest volume."""
    fixed = tuple(i for i, part in enumerate(scene.parts) if part.fixed)
    if fixed or not scene.parts:
        return fixed
    return (max(range(len(scene)), key=lambda i: (scene.parts[i].shape.enclosed, -i)),)
