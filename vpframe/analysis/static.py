"""Static analysis of an assembly at its present poses: collision world and candidate constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from collision import CollisionManager, Tolerance
from constraints import Candidate, recognise
from constraints.geometry.features import Feature
from constraints.geometry.threads import threaded
from constraints.recognition.recognise import contacts_within
from vpframe.scene.scene import Scene


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
) -> tuple[Candidate, ...]:
    """Return the candidate constraints between parts in contact, best first.

    Parameters
    ----------
    world: of the scene, from `world_of`.
    tell: receives the fraction done.
    implied: whether to return candidates that others imply (see `constraints.recognition.implied`).
    """
    t = world.tolerance
    features, pitches = threaded_features(scene)
    contacts = world.contacts(within=contacts_within(features, t))
    return recognise(
        features, [part.pose for part in scene.parts], contacts, t, threads=pitches, implied=implied, tell=tell
    )


def threaded_features(scene: Scene) -> tuple[list[tuple[Feature, ...]], dict[tuple[int, int], float]]:
    """Return each part's features, with threads of real geometry, and the pitches by (part, feature)."""
    known: dict[int, tuple[tuple[Feature, ...], dict[int, float]]] = {}
    features, threads = [], {}
    for i, part in enumerate(scene.parts):
        key = id(part.shape)
        if key not in known:
            known[key] = threaded(part.mesh, part.features)
        features.append(known[key][0])
        threads.update({(i, place): pitch for place, pitch in known[key][1].items()})
    return features, threads


def base_parts(scene: Scene) -> tuple[int, ...]:
    """Return the indices of the parts that do not move: the fixed ones, else the one of largest volume."""
    fixed = tuple(i for i, part in enumerate(scene.parts) if part.fixed)
    if fixed or not scene.parts:
        return fixed
    return (max(range(len(scene)), key=lambda i: (scene.parts[i].shape.volume, -i)),)
