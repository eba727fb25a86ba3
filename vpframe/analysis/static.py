"""Static analysis of an assembly at its present poses: collision world and candidate constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

from numpy.typing import NDArray

from collision import CollisionManager, Tolerance
from constraints import Candidate, recognise
from constraints.geometry.features import Feature
from constraints.geometry.threads import threaded
from constraints.recognition.recognise import contacts_within
from vpframe.scene.names import thread_words
from vpframe.scene.scene import Scene, Shape

_THREADED: WeakKeyDictionary[Shape, tuple[tuple[Feature, ...], dict[int, float]]] = WeakKeyDictionary()
"""features of each shape with its threads, and the pitches by place"""


def world_of(scene: Scene, tolerance: Tolerance | None = None) -> CollisionManager:
    """Return a collision manager with the parts of a scene, with a tolerance without reach."""
    manager = CollisionManager(replace(tolerance or Tolerance(), reach=0.0, reach_angular=0.0))
    for part in scene.parts:
        manager.add(part.mesh, part.pose)
    return manager


def candidates(
    scene: Scene,
    world: CollisionManager,
    tell: Callable[[float], None] = lambda fraction: None,
    *,
    implied: bool = False,
    contacts: NDArray[Any] | None = None,
) -> tuple[Candidate, ...]:
    """Return the candidate constraints between parts in contact, best first.

    Parameters
    ----------
    world: of the scene, from `world_of`.
    tell: receives the fraction done.
    implied: whether to return candidates that others imply (see `constraints.recognition.implied`).
    contacts: of the world, at least as far as `contacts_within` says; None: they are computed.
    """
    t = world.tolerance
    features, pitches = threaded_features(scene)
    if contacts is None:
        contacts = world.contacts(within=contacts_within(features, t))
    return recognise(
        features, [part.pose for part in scene.parts], contacts, t,
        threads=pitches, named=named_threads(scene), implied=implied, tell=tell,
    )  # fmt: skip


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
