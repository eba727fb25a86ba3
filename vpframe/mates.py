"""The constraints of an assembly as it stands: what `vpframe mates FILE` prints.

Every pair of features that touch and fit within `Tolerance.linear` is taken for a constraint. Freedom and joint of
a part are what all of them together leave it against the base: the parts marked fixed, or where none is, the part of
largest volume.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints import Candidate, mobility
from constraints.graph import AssemblyGraph
from constraints.mechanism import mechanism
from constraints.urdf import to_urdf
from vpframe.scene import Part, Scene
from vpframe.standing import candidates, world_of
from vpframe.stl import write_stl

Progress = Callable[[float, str], None]
"""hears the fraction done and what is being done"""

WATER = 1000.0
"""kg/m³, of parts whose file gives no density"""


def base_parts(scene: Scene) -> tuple[int, ...]:
    """Places of the parts that do not move: those marked fixed, else the largest by volume (the first of equals)."""
    fixed = tuple(i for i, part in enumerate(scene.parts) if part.fixed)
    if fixed or not scene.parts:
        return fixed
    return (max(range(len(scene)), key=lambda i: (scene.parts[i].shape.volume, -i)),)


def find(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> tuple[Candidate, ...]:
    """The constraints of a scene as it stands, sorted by kind, then by their parts' places."""
    progress(0.0, "trees")
    world = world_of(scene, tolerance)
    progress(0.05, "contacts")
    found = candidates(
        scene, world, real_threads=True, tell=lambda done: progress(0.3 + 0.7 * done, "pairs of features")
    )
    return tuple(sorted(found, key=lambda c: (c.kind, c.key)))


def mates(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> dict[str, Any]:
    """Every constraint of a scene as it stands, each part's joint and freedom; lengths in metres.

    Returns
    -------
    {"parts": [{"name", "joint", "freedom"}], "constraints": [{"kind", "parts": [a, b], "surfaces": [[…], […]],
    "residual"}]}; constraints also carry "fit" (m, radial clearance, negative for interference) where there is one, and
    "why" in words.
    """
    found = find(scene, tolerance, lambda fraction, text: progress(0.6 * fraction, text))
    progress(0.6, "freedom of the parts")
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


def graph(scene: Scene, tolerance: Tolerance | None = None) -> AssemblyGraph:
    """The assembly relationship graph of a scene as it stands, under its parts' names."""
    constraints = [c.constraint for c in find(scene, tolerance)]
    return AssemblyGraph.of(constraints, [p.pose for p in scene.parts], base_parts(scene), scene.names, tolerance)


def write_urdf(scene: Scene, path: str | Path, tolerance: Tolerance | None = None) -> tuple[str, ...]:
    """Write the mechanism of a scene as URDF, and beside it a folder of meshes, one STL a shape.

    Masses follow the parts' densities, `WATER` where a part has none. Returns notes: contacts that are no joint.
    """
    path = Path(path)
    made = mechanism(graph(scene, tolerance))
    folder = path.with_name(f"{path.stem}_meshes")
    folder.mkdir(parents=True, exist_ok=True)
    files: dict[int, str] = {}
    meshes = {}
    for i, part in enumerate(scene.parts):
        key = id(part.shape)
        if key not in files:
            files[key] = f"{folder.name}/{len(files)}_{re.sub(r'[^A-Za-z0-9_-]+', '_', part.name)}.stl"
            write_stl(path.parent / files[key], part.mesh.vertices, part.mesh.triangles)
        meshes[i] = files[key]
    inertias = {i: _inertia(part) for i, part in enumerate(scene.parts) if part.shape.volume > 0.0}
    path.write_text(to_urdf(made, path.stem, inertias, meshes), encoding="utf-8")
    return made.notes


def _inertia(part: Part) -> pin.Inertia:
    density = WATER if part.density is None else part.density
    shape = part.shape
    return pin.Inertia(density * shape.volume, np.asarray(shape.center), density * np.asarray(shape.inertia))
