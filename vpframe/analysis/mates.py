"""Mates of an assembly at its present poses: `vpframe mates FILE`.

Every pair of features in contact that fits within `Tolerance.linear` counts as a constraint. Parts joined by
constraints form a group; its base is its fixed parts, else its part of largest volume. Each part is given its joint to
every neighbour (their common constraints), its freedom alone (all other parts fixed, as in `Session.freedom`) and its
freedom with the parts it carries (only the base fixed).
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints import Candidate, Constraint, Freedom
from constraints.freedom.graph import AssemblyGraph
from constraints.freedom.mobility import mobility
from constraints.kinds.stated import stated
from constraints.mechanism.mjcf import TINY, to_mjcf
from constraints.mechanism.model import Mechanism, mechanism
from constraints.mechanism.urdf import to_urdf
from constraints.recognition.iso286 import FitClassError, fit_class
from constraints.solve.system import components
from vpframe import files
from vpframe.analysis.statements import statement, words
from vpframe.analysis.static import analysis_of, base_parts
from vpframe.outputs import GENERATOR, MESH, MJCF, URDF, Output, OutputFolder, claimed
from vpframe.scene.scene import Part, Scene, Size
from vpframe.scene.stl import write_stl
from vpframe.text import plain

Progress = Callable[[float, str], None]
"""receives the fraction done and the present task"""

LARGEST_MESH = 200_000
"""maximum number of triangles of an STL file in MuJoCo"""
WATER = 1000.0
"""density of parts without one in the file, kg/m³"""
SHOWN = 5
"""most parts that a note names"""


class PartJoint(NamedTuple):
    """How a part moves against others."""

    joint: str
    """name of the lower pair; "rigid" or "fixed" without freedom"""
    freedom: int
    """degrees of freedom"""

    @property
    def words(self) -> str:
        """The joint, with its freedom if the name does not imply it."""
        implied = self.joint in ("fixed", "rigid", f"{self.freedom}-dof")
        return self.joint if implied else f"{self.joint} {self.freedom}"


@dataclass(frozen=True)
class PartRow:
    """A part with its joints."""

    name: str
    carrying: PartJoint
    """with the parts it carries, against the base of its group"""
    alone: PartJoint
    """all other parts held"""
    base: tuple[str, ...]
    neighbours: tuple[tuple[str, PartJoint], ...]
    """each part that shares a constraint with it, and the joint that these make"""

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        neighbours = [{"part": part, **joint._asdict()} for part, joint in self.neighbours]
        alone, base = self.alone._asdict(), list(self.base)
        return {"name": self.name, **self.carrying._asdict(), "alone": alone, "base": base, "neighbours": neighbours}


@dataclass(frozen=True)
class MateRow:
    """A constraint between two parts."""

    kind: str
    parts: tuple[str, str]
    surfaces: tuple[tuple[int, ...], tuple[int, ...]]
    """faces of each part that are near faces of its mate"""
    residual: float
    """m"""
    fit: float | None
    """m, radial clearance, negative for interference; None for surfaces without one"""
    why: str
    """what touches, what fits, how exactly"""

    @staticmethod
    def of(candidate: Candidate, names: Sequence[str]) -> MateRow:
        """Return the row of a candidate; names: of all parts."""
        a, b = candidate.bodies
        first, second = (tuple(sorted({int(near[side]) for near in candidate.near})) for side in (0, 1))
        match = candidate.match
        parts = names[a], names[b]
        return MateRow(candidate.kind, parts, (first, second), candidate.residual, match.fit, candidate.why)

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class SizeRow:
    """A toleranced face (PMI), compared with its mates."""

    part: str
    surface: int
    size: Size
    measured: float
    """m, diameter"""
    mates: tuple[tuple[str, float | None], ...]
    """each part fitted to it, and the fit, m"""
    wrong: tuple[str, ...]
    """what does not hold"""

    @property
    def holds(self) -> bool:
        """Whether it is as specified."""
        return not self.wrong

    def document(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "part": self.part, "surface": self.surface, "size": str(self.size), "measured": self.measured,
            "mates": [{"part": part, "fit": fit} for part, fit in self.mates], "holds": self.holds,
            "why": "; ".join(self.wrong),
        }  # fmt: skip


@dataclass(frozen=True)
class Group:
    """Parts joined by constraints, by index."""

    parts: tuple[int, ...]
    base: tuple[int, ...]
    """parts taken as fixed; none for a single part"""
    why: str
    """reason for the choice of the base"""


@dataclass(frozen=True)
class MatesFound:
    """All constraints of a scene, and each part's joints and freedom."""

    parts: tuple[PartRow, ...]
    groups: tuple[Group, ...]
    constraints: tuple[MateRow, ...]
    sizes: tuple[SizeRow, ...]

    def document(self) -> dict[str, Any]:
        """Return it for JSON, lengths in metres.

        {"parts": [{"name", "joint", "freedom", "alone": {"joint", "freedom"}, "base": […], "neighbours": [{"part",
        "joint", "freedom"}]}], "groups": [{"parts": […], "base": […], "why"}], "constraints": [{"kind", "parts": [a,
        b], "surfaces": [[…], […]], "residual", "fit" (if there is one), "why"}], "sizes": [{"part", "surface", "size":
        "Ø8 H7", "measured", "mates": [{"part", "fit"}], "holds", "why"}], if there are any}.
        """
        names = [part.name for part in self.parts]
        return {
            "parts": [part.document() for part in self.parts],
            "groups": [
                {"parts": [names[k] for k in g.parts], "base": [names[k] for k in g.base], "why": g.why}
                for g in self.groups
            ],
            "constraints": [mate.document() for mate in self.constraints],
            **({"sizes": [size.document() for size in self.sizes]} if self.sizes else {}),
        }


def groups(scene: Scene, constraints: Iterable[Constraint]) -> tuple[Group, ...]:
    """Return the groups of a scene, in the order of parts; a part without constraints is a group of its own."""
    out = []
    for parts in components(range(len(scene)), [c.bodies for c in constraints]):
        fixed = tuple(i for i in parts if scene.parts[i].fixed)
        if fixed:
            out.append(Group(parts, fixed, "fixed"))
        elif len(parts) > 1:
            largest = max(parts, key=lambda i: (scene.parts[i].shape.enclosed, -i))
            out.append(Group(parts, (largest,), "the largest of them by volume"))
        else:
            out.append(Group(parts, (), "joined to nothing"))
    return tuple(out)


def find(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> tuple[Candidate, ...]:
    """Return the constraints of a scene at its present poses, sorted by kind, then by parts."""
    progress(0.0, "trees")
    analysis = analysis_of(scene, tolerance)
    progress(0.05, "contacts")
    found = analysis.candidates(lambda done: progress(0.3 + 0.7 * done, "pairs of features"))
    return tuple(sorted((*found, *imposed(scene, analysis.tolerance)), key=lambda c: (c.kind, c.key)))


def imposed(scene: Scene, tolerance: Tolerance) -> list[Candidate]:
    """Return the constraints that the model states (`Scene.statements`) at the present poses."""
    features, poses = [part.features for part in scene.parts], [part.pose for part in scene.parts]
    out = []
    for number, s in enumerate(scene.statements):
        constraint = statement(scene, features, poses, s.kind, s.a, s.b, s.parameters, tolerance)
        out.append(stated(constraint, poses, features, number, words(constraint, "model")))
    return out


def mates(
    scene: Scene, tolerance: Tolerance | None = None, progress: Progress = lambda fraction, text: None
) -> MatesFound:
    """Return all constraints of a scene at its present poses, and each part's joints and freedom.

    The joint of a part with the parts it carries is that against the base of its group; "fixed" for a base.
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
            PartRow(
                name,
                PartJoint("fixed", 0) if i in held else _joint(carrying[i]),
                PartJoint("rigid", 0) if scene.parts[i].fixed else _joint(alone),
                tuple(names[k] for k in base[i]),
                tuple((names[k], _joint(neighbours[k])) for k in sorted(neighbours)),
            )
        )
    return MatesFound(tuple(parts), joined, tuple(MateRow.of(c, names) for c in found), sizes(scene, found))


def sizes(scene: Scene, found: Iterable[Candidate]) -> tuple[SizeRow, ...]:
    """Compare toleranced sizes (PMI) with the fits found: each such face needs a fit, of the stated classes.

    A face holds if it is modelled at nominal size or within its deviations, and if each concentric mate has the
    clearance that the two classes allow or is modelled at nominal size too (ISO 286-1). A face without a mate does not
    hold. found: of the scene, from `find`.
    """
    slack = Tolerance().linear
    out = []
    for i, part in enumerate(scene.parts):
        for surface in part.surfaces:
            size, radius = surface.size, getattr(surface.geometry, "radius", None)
            if size is None or radius is None:
                continue
            off = 2.0 * radius - size.nominal
            lower, upper = size.lower or 0.0, size.upper or 0.0
            drawn = abs(off) <= slack or lower - slack <= off <= upper + slack
            wrong = [] if drawn else [f"drawn Ø{2e3 * radius:.6g}"]
            fitted = []
            for c in found:
                side = c.bodies.index(i) if c.kind == "concentric" and i in c.bodies else None
                if side is None or surface.index not in {near[side] for near in c.near}:
                    continue
                other = scene.parts[c.bodies[1 - side]]
                fitted.append((other.name, c.match.fit))
                mated = (other.surfaces[int(near[1 - side])].size for near in c.near)
                wrong += _misfit(size, next(filter(None, mated), None), c.match.fit, slack)
            if not fitted:
                wrong.append("nothing is fitted to it")
            out.append(SizeRow(part.name, surface.index, size, 2.0 * radius, tuple(fitted), tuple(wrong)))
    return tuple(out)


def _misfit(size: Size, mate: Size | None, fit: float | None, slack: float) -> list[str]:
    """Describe a radial clearance `fit` (m) outside the limits of two toleranced faces; empty if it is inside."""
    if mate is None or fit is None or not (size.fit and mate.fit):
        return []
    hole, shaft = (size, mate) if size.fit[0].isupper() else (mate, size)
    name = f"{hole.fit}/{shaft.fit}"
    try:
        allowed = fit_class(name, size.nominal)
    except FitClassError as error:
        return [str(error)]
    if allowed.allows(2.0 * fit, slack):
        return []
    return [
        f"clearance {2e3 * fit:.4f} mm on the diameter, {name} allows {allowed.least * 1e3:g} … {allowed.most * 1e3:g}"
    ]


def _joint(freedom: Freedom) -> PartJoint:
    return PartJoint(freedom.joint, freedom.freedom)


def table(found: MatesFound) -> str:
    """Format the result of `mates`."""
    width = max((len(part.name) for part in found.parts), default=4)
    lines = []
    for group in (g for g in found.groups if len(g.parts) > 1):
        base = ", ".join(found.parts[k].name for k in group.base)
        lines += [
            f"{len(group.parts)} parts on {base} ({group.why})",
            f"  {'part':{width}}  {'others held':14}  {'only the base held':18}  to its neighbours",
        ]
        for part in (found.parts[k] for k in group.parts):
            near = ", ".join(f"{joint.words} {name}" for name, joint in part.neighbours)
            lines.append(f"  {part.name:{width}}  {part.alone.words:14}  {part.carrying.words:18}  {near}")
        lines.append("")
    single = [found.parts[g.parts[0]].name for g in found.groups if len(g.parts) == 1]
    if single:
        lines += [f"joined to nothing: {', '.join(single)}", ""]
    kinds = Counter(mate.kind for mate in found.constraints)
    lines += [", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) or "no constraints"]
    lines += [f"  {mate.kind:10}  {' – '.join(mate.parts)}: {mate.why}" for mate in found.constraints]
    if found.sizes:
        lines += ["", "toleranced sizes"]
    for size in found.sizes:
        mated = ", ".join(part for part, _ in size.mates)
        verdict = f"fits {mated}" if size.holds else f"NOT AS SPECIFIED: {'; '.join(size.wrong)}"
        lines.append(f"  {size.part} · face {size.surface} · {size.size}: {verdict}")
    return "\n".join(map(plain, lines))


def graph(scene: Scene, tolerance: Tolerance | None = None) -> AssemblyGraph:
    """Return the assembly relationship graph of a scene, with its parts' names."""
    return _graph(scene, scene.names, tolerance)


def _graph(scene: Scene, names: Sequence[str], tolerance: Tolerance | None) -> AssemblyGraph:
    constraints = [c.constraint for c in find(scene, tolerance)]
    return AssemblyGraph.of(constraints, [p.pose for p in scene.parts], base_parts(scene), names, tolerance)


def write_urdf(scene: Scene, path: str | os.PathLike[str], tolerance: Tolerance | None = None) -> tuple[str, ...]:
    """Write the mechanism of a scene as URDF, with a folder of meshes beside it, one STL for each shape.

    path: the file, or its `Output`. Masses follow the parts' densities, default `WATER`, which a comment
        names. Returns notes on contacts that are no joint, and on assumed masses.

    Raises
    ------
    OutputError: `path` or the folder of meshes holds files that vpframe did not write.
    """
    with claimed(path, URDF) as output:
        path = output.path
        made = _mechanism(scene, tolerance)
        inertias, meshes = _inertias(scene), _write_meshes(scene, output)
        declaration, _, robot = to_urdf(made, path.stem, inertias, meshes, _colors(scene)).partition("\n")
        assumed = _assumed(scene)
        comments = "".join(f"<!-- {_commented(text)} -->\n" for text in (GENERATOR, *assumed))
        files.replace(path, f"{declaration}\n{comments}{robot}")
    return (*made.notes, *assumed)


def write_mjcf(scene: Scene, path: str | os.PathLike[str], tolerance: Tolerance | None = None) -> tuple[str, ...]:
    """Write the mechanism of a scene as MJCF, with meshes and masses as `write_urdf` does.

    Returns notes on contacts that are no joint, and on approximations for MuJoCo.

    Raises
    ------
    OutputError: `path` or the folder of meshes holds files that vpframe did not write.
    """
    with claimed(path, MJCF) as output:
        path = output.path
        made = _mechanism(scene, tolerance)
        inertias, meshes = _inertias(scene), _write_meshes(scene, output)
        notes = [*made.notes]
        for i, part in enumerate(scene.parts):
            if part.mesh.n_triangles > LARGEST_MESH:
                del meshes[i]
                notes.append(
                    f"{part.name}: its {part.mesh.n_triangles} triangles are more than MuJoCo reads; no geometry"
                )
        for group in made.links[1:]:
            notes += [f"{scene.names[i]}: no mass is known; {TINY:g} kg is written" for i in group if i not in inertias]
        notes += [f"loop at {made.link_name(loop.child)}: closed by an equality, which is soft" for loop in made.loops]
        screws = [j.name for j in (*made.joints, *made.loops) if any(a.kind == "screw" for a in j.axes)]
        notes += [f"screw {name}: a hinge and a slide that an equality ties, which is soft" for name in screws]
        text = to_mjcf(made, path.stem, inertias, meshes, _colors(scene))
        assumed = _assumed(scene)
        comments = "".join(f"<!-- {_commented(text)} -->\n" for text in (GENERATOR, *assumed))
        files.replace(path, f"{comments}{text}")
    return (*notes, *assumed)


def _mechanism(scene: Scene, tolerance: Tolerance | None) -> Mechanism:
    return mechanism(_graph(scene, [plain(name) for name in scene.names], tolerance))  # XML has no control codes


def _write_meshes(scene: Scene, output: Output) -> dict[int, str]:
    """Write one STL for each shape into a folder beside `output`; return each part's file, relative to `output`."""
    folder = output.path.with_name(f"{output.path.stem}_meshes")
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
    return meshes


def _colors(scene: Scene) -> dict[int, tuple[float, float, float, float]]:
    return {i: part.color for i, part in enumerate(scene.parts)}


def _assumed(scene: Scene) -> list[str]:
    """Name the parts whose masses are assumed, in one line; none if the model gives all."""
    names = [part.name for part in scene.parts if part.inertia is None and part.density is None]
    if not names:
        return []
    which = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
    return [f"assumed masses: the model gives no density for {which}; {WATER:g} kg/m³ is taken"]


def _commented(text: str) -> str:
    """Return text that may stand in an XML comment."""
    return plain(text).replace("--", "- -")


def _inertias(scene: Scene) -> dict[int, pin.Inertia]:
    known = (i for i, part in enumerate(scene.parts) if part.inertia is not None or part.shape.volume > 0.0)
    return {i: _inertia(scene.parts[i]) for i in known}


def _inertia(part: Part) -> pin.Inertia:
    if part.inertia is not None:
        return part.inertia
    density = WATER if part.density is None else part.density
    shape = part.shape
    return pin.Inertia(density * shape.volume, np.asarray(shape.center), density * np.asarray(shape.inertia))
