"""The constraints of an assembly as it stands: what `vpframe mates FILE` prints.

Every pair of features that touch and fit within `Tolerance.linear` is taken for a constraint. Parts that constraints
join are a group, with a base of its own: the parts of it marked fixed, else the one of largest volume. Of each part are
told its joint to every neighbour, made by their own constraints; its freedom alone, all other parts held where they are
(what `Session.freedom` says); and its freedom with what it carries, where only the base is held.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints import Candidate, Constraint, Freedom
from constraints.freedom.graph import AssemblyGraph, components
from constraints.freedom.mobility import mobility
from constraints.mechanism.model import mechanism
from constraints.mechanism.urdf import to_urdf
from vpframe import files
from vpframe.analysis.static import candidates, world_of
from vpframe.app.outputs import GENERATOR, MESH, URDF, OutputFolder, claimed
from vpframe.scene.scene import Part, Scene
from vpframe.scene.stl import write_stl
from vpframe.text import plain

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


@dataclass(frozen=True)
class Group:
    """Parts that constraints join, by place."""

    parts: tuple[int, ...]
    base: tuple[int, ...]
    """the parts of it that are taken not to move; none of a part by itself"""
    why: str
    """why these are its base"""


def groups(scene: Scene, constraints: Iterable[Constraint]) -> tuple[Group, ...]:
    """The parts of a scene as constraints join them, in the order of the parts; a part by itself is a group, too."""
    out = []
    for parts in components(range(len(scene)), [c.bodies for c in constraints]):
        fixed = tuple(i for i in parts if scene.parts[i].fixed)
        if fixed:
            out.append(Group(parts, fixed, "fixed"))
        elif len(parts) > 1:
            largest = max(parts, key=lambda i: (scene.parts[i].shape.volume, -i))
            out.append(Group(parts, (largest,), "the largest of them by volume"))
        else:
            out.append(Group(parts, (), "joined to nothing"))
    return tuple(out)


def find(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> tuple[Candidate, ...]:
    """The constraints of a scene as it stands, sorted by kind, then by their parts' places."""
    progress(0.0, "trees")
    world = world_of(scene, tolerance)
    progress(0.05, "contacts")
    found = candidates(scene, world, lambda done: progress(0.3 + 0.7 * done, "pairs of features"))
    return tuple(sorted(found, key=lambda c: (c.kind, c.key)))


def mates(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> dict[str, Any]:
    """Every constraint of a scene as it stands, each part's joints and freedom; lengths in metres.

    Returns
    -------
    {"parts": [{"name", "joint", "freedom", "alone": {"joint", "freedom"}, "base": […], "neighbours": [{"part", "joint",
    "freedom"}]}], "groups": [{"parts": […], "base": […], "why"}], "constraints": [{"kind", "parts": [a, b], "surfaces":
    [[…], […]], "residual"}]}. "joint" and "freedom" are a part's with what it carries, against the base of its group;
    of a base they are "fixed" and 0. "surfaces" are the faces that are near each other; constraints also carry "fit"
    (m, radial clearance, negative for interference) where there is one, and "why" in words.
    """
    found = find(scene, tolerance, lambda fraction, text: progress(0.6 * fraction, text))
    constraints = [c.constraint for c in found]
    poses = [part.pose for part in scene.parts]
    names = scene.names
    joined = groups(scene, constraints)
    base = {i: group.base for group in joined for i in group.parts}
    held = {i for group in joined for i in group.base}
    carrying = mobility(constraints, poses, held, tolerance).parts
    on: dict[int, dict[int, list[Constraint]]] = {i: {} for i in range(len(scene))}
    for c in constraints:
        a, b = c.bodies
        on[a].setdefault(b, []).append(c)
        on[b].setdefault(a, []).append(c)
    parts = []
    for i, name in enumerate(names):
        progress(0.6 + 0.4 * i / len(names), "freedom of the parts")
        own = [c for cs in on[i].values() for c in cs]
        here = {k: poses[k] for k in (i, *on[i])}
        alone = mobility(own, here, on[i], tolerance).parts[i]
        neighbours = {k: mobility(cs, {i: poses[i], k: poses[k]}, (k,), tolerance).parts[i] for k, cs in on[i].items()}
        parts.append(
            {
                "name": name,
                **({"joint": "fixed", "freedom": 0} if i in held else _joint(carrying[i])),
                "alone": {"joint": "rigid", "freedom": 0} if scene.parts[i].fixed else _joint(alone),
                "base": [names[k] for k in base[i]],
                "neighbours": [{"part": names[k], **_joint(neighbours[k])} for k in sorted(neighbours)],
            }
        )
    return {
        "parts": parts,
        "groups": [
            {"parts": [names[k] for k in g.parts], "base": [names[k] for k in g.base], "why": g.why} for g in joined
        ],
        "constraints": [_row(c, names) for c in found],
    }


def _joint(freedom: Freedom) -> dict[str, Any]:
    return {"joint": freedom.joint, "freedom": freedom.freedom}


def _row(candidate: Candidate, names: Sequence[str]) -> dict[str, Any]:
    a, b = candidate.bodies
    row: dict[str, Any] = {
        "kind": candidate.kind,
        "parts": [names[a], names[b]],
        "surfaces": [sorted({near[side] for near in candidate.near}) for side in (0, 1)],
        "residual": candidate.residual,
    }
    if candidate.match.fit is not None:
        row["fit"] = candidate.match.fit
    row["why"] = candidate.why
    return row


def table(document: dict[str, Any]) -> str:
    """What `mates` found, for a person."""
    width = max((len(p["name"]) for p in document["parts"]), default=4)
    parts = {p["name"]: p for p in document["parts"]}
    lines = []
    for group in (g for g in document["groups"] if len(g["parts"]) > 1):
        base = ", ".join(group["base"])
        lines += [
            f"{len(group['parts'])} parts on {base} ({group['why']})",
            f"  {'part':{width}}  {'others held':14}  {'only the base held':18}  to its neighbours",
        ]
        for p in (parts[name] for name in group["parts"]):
            near = ", ".join(f"{_named(n)} {n['part']}" for n in p["neighbours"])
            lines.append(f"  {p['name']:{width}}  {_named(p['alone']):14}  {_named(p):18}  {near}")
        lines.append("")
    single = [g["parts"][0] for g in document["groups"] if len(g["parts"]) == 1]
    if single:
        lines += [f"joined to nothing: {', '.join(single)}", ""]
    kinds = sorted({c["kind"] for c in document["constraints"]})
    counts = ", ".join(f"{sum(c['kind'] == k for c in document['constraints'])} {k}" for k in kinds)
    lines += [counts or "no constraints"]
    lines += [f"  {c['kind']:10}  {c['parts'][0]} – {c['parts'][1]}: {c['why']}" for c in document["constraints"]]
    return "\n".join(map(plain, lines))


def _named(joint: dict[str, Any]) -> str:
    """A joint with its freedom, where its name does not tell it."""
    name, freedom = joint["joint"], joint["freedom"]
    return str(name) if name in ("fixed", "rigid", f"{freedom}-dof") else f"{name} {freedom}"


def graph(scene: Scene, tolerance: Tolerance | None = None) -> AssemblyGraph:
    """The assembly relationship graph of a scene as it stands, under its parts' names."""
    return _graph(scene, scene.names, tolerance)


def _graph(scene: Scene, names: Sequence[str], tolerance: Tolerance | None) -> AssemblyGraph:
    constraints = [c.constraint for c in find(scene, tolerance)]
    return AssemblyGraph.of(constraints, [p.pose for p in scene.parts], base_parts(scene), names, tolerance)


def write_urdf(scene: Scene, path: str | os.PathLike[str], tolerance: Tolerance | None = None) -> tuple[str, ...]:
    """Write the mechanism of a scene as URDF, and beside it a folder of meshes, one STL a shape.

    path: the file, or the `Output` of one. Masses follow the parts' densities, `WATER` where a part has none. Returns
    notes: contacts that are no joint.

    Raises
    ------
    OutputError: there is something at `path`, or in the folder of meshes, that vpframe did not write.
    """
    with claimed(path, URDF) as output:
        path = output.path
        made = mechanism(_graph(scene, [plain(name) for name in scene.names], tolerance))  # XML has no control codes
        folder = path.with_name(f"{path.stem}_meshes")
        names: dict[int, str] = {}
        shapes = {}
        meshes = {}
        for i, part in enumerate(scene.parts):
            key = id(part.shape)
            if key not in names:
                names[key] = f"{len(names)}_{re.sub(r'[^A-Za-z0-9_-]+', '_', part.name)}.stl"
                shapes[names[key]] = part.shape
            meshes[i] = f"{folder.name}/{names[key]}"
        with OutputFolder(folder, dict.fromkeys(shapes, MESH), output.force, output.inputs) as beside:
            for name, shape in shapes.items():
                write_stl(beside.file(name), shape.mesh.vertices, shape.mesh.triangles)
        inertias = {i: _inertia(part) for i, part in enumerate(scene.parts) if part.shape.volume > 0.0}
        declaration, _, robot = to_urdf(made, path.stem, inertias, meshes).partition("\n")
        files.replace(path, f"{declaration}\n<!-- {GENERATOR} -->\n{robot}")
    return made.notes


def _inertia(part: Part) -> pin.Inertia:
    density = WATER if part.density is None else part.density
    shape = part.shape
    return pin.Inertia(density * shape.volume, np.asarray(shape.center), density * np.asarray(shape.inertia))
