"""The constraints of an assembly as it stands: what `vpframe mates FILE` prints.

Every pair of features that touch and fit within `Tolerance.linear` is taken for a constraint. Freedom and joint of
a part are what all of them together leave it against the base: the parts marked fixed, or where none is, the part of
largest volume.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from collision import CollisionManager, Tolerance
from constraints import Candidate, mobility, recognise
from vpframe.scene import Scene


def base_parts(scene: Scene) -> tuple[int, ...]:
    """Places of the parts that do not move: those marked fixed, else the largest by volume (the first of equals)."""
    fixed = tuple(i for i, part in enumerate(scene.parts) if part.fixed)
    if fixed or not scene.parts:
        return fixed
    return (max(range(len(scene)), key=lambda i: (scene.parts[i].shape.volume, -i)),)


def find(scene: Scene, tolerance: Tolerance | None = None) -> tuple[Candidate, ...]:
    """The constraints of a scene as it stands, sorted by kind, then by their parts' places."""
    t = replace(tolerance or Tolerance(), reach=0.0, reach_angular=0.0)
    collision = CollisionManager(t)
    for part in scene.parts:
        collision.add(part.mesh, part.pose)
    contacts = collision.contacts(within=max(t.linear, t.clearance))
    found = recognise([p.features for p in scene.parts], [p.pose for p in scene.parts], contacts, t)
    return tuple(sorted(found, key=lambda c: (c.kind, c.key)))


def mates(scene: Scene, tolerance: Tolerance | None = None) -> dict[str, Any]:
    """Every constraint of a scene as it stands, each part's joint and freedom; lengths in metres.

    Returns
    -------
    {"parts": [{"name", "joint", "freedom"}], "constraints": [{"kind", "parts": [a, b], "surfaces": [[…], […]],
    "residual"}]}; constraints also carry "fit" (m, radial clearance, negative for interference) where there is one, and
    "why" in words.
    """
    found = find(scene, tolerance)
    base = base_parts(scene)
    parts = scene.parts
    freedom = mobility([c.constraint for c in found], [p.pose for p in parts], base, tolerance).parts
    return {
        "parts": [
            {"name": part.name, "joint": "fixed", "freedom": 0}
            if i in base
            else {"name": part.name, "joint": freedom[i].joint, "freedom": freedom[i].freedom}
            for i, part in enumerate(parts)
        ],
        "constraints": [_row(c, scene.names) for c in found],
    }


def _row(candidate: Candidate, names: Sequence[str]) -> dict[str, Any]:
    a, b = candidate.bodies
    row: dict[str, Any] = {
        "kind": candidate.kind,
        "parts": [names[a], names[b]],
        "surfaces": [list(candidate.surfaces[0]), list(candidate.surfaces[1])],
        "residual": candidate.residual,
    }
    if candidate.match.fit is not None:
        row["fit"] = candidate.match.fit
    row["why"] = candidate.why
    return row


def table(document: dict[str, Any]) -> str:
    """What `mates` found, for a person."""
    width = max((len(p["name"]) for p in document["parts"]), default=4)
    lines = [f"{'part':{width}}  joint         freedom"]
    lines += [f"{p['name']:{width}}  {p['joint']:12}  {p['freedom']:7}" for p in document["parts"]]
    kinds = sorted({c["kind"] for c in document["constraints"]})
    counts = ", ".join(f"{sum(c['kind'] == k for c in document['constraints'])} {k}" for k in kinds)
    lines += ["", counts or "no constraints"]
    lines += [f"  {c['kind']:10}  {c['parts'][0]} – {c['parts'][1]}: {c['why']}" for c in document["constraints"]]
    return "\n".join(lines)
