"""`outline`: describe the parts of a scene as text: size, place, neighbours, mates."""

from __future__ import annotations

import json

import numpy as np

from collision import CollisionManager
from vpframe.analysis.mates import find
from vpframe.scene.boxes import placed_corners
from vpframe.scene.scene import Part, Scene
from vpframe.scene.subassembly import listed
from vpframe.text import plain

PARTS = 60
"""maximum number of parts in an outline"""
NEAR = 1e-3
"""distance within which parts are neighbours, m"""


def outline(scene: Scene) -> list[str]:
    """Return a line for each of the first `PARTS` parts: name, surfaces, size and place, mates, other neighbours."""
    parts = scene.parts[:PARTS]
    names = [plain(name) for name in scene.names]
    mates: dict[int, dict[int, list[str]]] = {}
    for c in find(scene):
        for i, j in (c.bodies, c.bodies[::-1]):
            mates.setdefault(i, {}).setdefault(j, []).append(c.kind)
    beside = _beside(scene, len(parts), mates)
    lines = []
    for i, part in enumerate(parts):
        joined = [f"{', '.join(dict.fromkeys(kinds))} to {names[j]}" for j, kinds in sorted(mates.get(i, {}).items())]
        near = [names[j] for j in sorted(beside.get(i, ()))]
        texts = [_where(part), *[listed(joined)] * bool(joined), *[f"beside {listed(near)}"] * bool(near)]
        lines.append(f"{plain(json.dumps(part.name, ensure_ascii=False))}: {'; '.join(texts)}")
    if len(scene) > PARTS:
        lines.append(f"… and {len(scene) - PARTS} more")
    return lines


def _where(part: Part) -> str:
    corners = 1e3 * placed_corners(part, part.pose)
    size, middle = np.ptp(corners, axis=0), 0.5 * (corners.min(0) + corners.max(0)) + 0.0
    at = ", ".join(f"{x:.3g}" for x in np.where(np.abs(middle) < 5e-4, 0.0, middle))
    fixed = ", fixed" if part.fixed else ""
    count = len(part.surfaces)
    return f"{count} surface{'s' * (count != 1)}, {' x '.join(f'{x:.3g}' for x in size)} mm around ({at}) mm{fixed}"


def _beside(scene: Scene, count: int, mates: dict[int, dict[int, list[str]]]) -> dict[int, set[int]]:
    """Return the neighbours of the first `count` parts, within `NEAR` and without a constraint to them."""
    manager = CollisionManager()
    for part in scene.parts:
        manager.add(part.mesh, part.pose)
    found: dict[int, set[int]] = {}
    for i, j in manager.object_pairs(range(count), within=NEAR).tolist():
        if j not in mates.get(i, {}) and float(manager.clearance(i, j)["distance"][0]) <= NEAR:
            found.setdefault(i, set()).add(j)
            found.setdefault(j, set()).add(i)
    return found
