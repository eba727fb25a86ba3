"""Shapes of build123d or OpenCascade: their tree, names, colours and joints.

The shapes go to the reading process as B-reps, so that the kernel cannot end this process.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe.errors import LoadError
from vpframe.importers import build, cad
from vpframe.importers.names import numbered
from vpframe.importers.raw import Options, RawScene
from vpframe.scene.joints import Statement, statements
from vpframe.scene.scene import Scene

MM = 1e-3
KINDS = {
    "RigidJoint": "fixed",
    "RevoluteJoint": "revolute",
    "LinearJoint": "prismatic",
    "CylindricalJoint": "cylindrical",
    "BallJoint": "spherical",
}
"""joint kind of a build123d joint that is connected to a rigid one"""


def is_wrapped(source: object) -> bool:
    """Whether an object is a shape of OpenCascade, or wraps one as build123d does."""
    root = type(source).__module__.partition(".")[0]
    return root == "build123d" or (root == "OCP" and type(source).__name__.startswith("TopoDS_"))


@dataclass
class _Node:
    name: str
    """path, as in the scene"""
    source: Any
    given: list[Any]
    children: list[_Node]

    def all(self) -> Iterator[_Node]:
        yield self
        for child in self.children:
            yield from child.all()


def read(source: Any, options: Options) -> tuple[RawScene, Callable[[Scene], None]]:
    """Return the raw scene of a shape, and a function that adds its joints to the finished scene.

    Raises LoadError: no solid, or the kernel fails.
    """
    source = getattr(source, "part", source)  # of a build123d builder
    with tempfile.TemporaryDirectory(prefix="vpframe-") as folder:
        files = _Files(Path(folder))
        root = _node(source, _label(source) or "part", files)
        if not files.paths:
            raise LoadError(f"{root.name}: the shape is empty; build it before loading", root.name)
        _name(root, "" if root.children else root.given[0])
        raw = cad.read(files.paths, "given", options, build.settled, [root.given])
    return raw, lambda scene: _join(scene, list(root.all()))


class _Files:
    """B-rep files in a folder, one for each shape."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.paths: list[Path] = []
        self._known: list[tuple[Any, str]] = []

    def of(self, shape: Any) -> str:
        from OCP.TopLoc import TopLoc_Location

        from vpframe.importers.brep import brep_bytes

        own = shape.Located(TopLoc_Location())
        for known, name in self._known:
            if known.IsEqual(own):
                return name
        path = self.folder / f"{len(self.paths)}.brep"
        path.write_bytes(brep_bytes(own))
        self.paths.append(path)
        self._known.append((own, str(path)))
        return str(path)


def _label(source: Any) -> str:
    return str(getattr(source, "label", "") or "").strip()


def _node(source: Any, name: str, files: _Files) -> _Node:
    try:
        shape = getattr(source, "wrapped", source)
    except (AssertionError, ValueError):  # build123d raises these for an empty shape
        shape = None
    if shape is None or shape.IsNull():
        raise LoadError(f"{name}: the shape is empty; build it before loading", name)
    children = []
    for child in getattr(source, "children", ()):
        children.append(_node(child, _label(child) or type(child).__name__.lower(), files))
    transformation = shape.Location().Transformation()
    matrix = [transformation.Value(i, j) for i in range(1, 4) for j in range(1, 5)]
    file = "" if children else files.of(shape)
    below = [child.given for child in children]
    return _Node(name, source, [name.replace("/", "|"), file, matrix, _color(source), below], children)


def _color(source: Any) -> list[float] | None:
    color = getattr(source, "color", None)
    if color is None or not hasattr(color, "wrapped"):
        return None
    from OCP.Quantity import Quantity_TypeOfColor

    rgb = color.wrapped.GetRGB().Values(Quantity_TypeOfColor.Quantity_TOC_sRGB)
    return [*map(float, rgb), float(color.wrapped.Alpha())]


def _name(node: _Node, path: str) -> None:
    """Set the paths of nodes as the reading process does."""
    node.name = path
    for child, name in zip(node.children, numbered(child.given[0] for child in node.children), strict=True):
        _name(child, f"{path}/{name}" if path else name)


def _join(scene: Scene, nodes: list[_Node]) -> None:
    """Add the statements of connected joints to a scene."""
    made: list[Statement] = []
    notes: list[str] = []
    place = {id(node.source): node for node in nodes}
    for node in nodes:
        for name, joint in getattr(node.source, "joints", {}).items():
            other = joint.connected_to
            if other is None:
                continue
            what = f"joint {name} of {node.name or 'the assembly'}"
            ends = [_part(scene, place.get(id(joint.parent))), _part(scene, place.get(id(other.parent)))]
            kinds = {KINDS.get(type(j).__name__, "") for j in (joint, other)} - {"fixed"}
            if None in ends or ends[0] == ends[1]:
                notes.append(f"{what}: its other end is no part of what was loaded; left out")
            elif len(kinds) > 1 or "" in kinds:
                pair = f"{type(joint).__name__} on {type(other).__name__}"
                notes.append(f"{what}: {pair} is no lower pair; left out")
            else:
                moving = joint if type(joint).__name__ != "RigidJoint" else other
                origin, axis = _frame(moving)
                pair_of = (str(ends[0]), str(ends[1]))
                poses = (scene[pair_of[0]].pose, scene[pair_of[1]].pose)
                made += statements(next(iter(kinds), "fixed"), pair_of, poses, origin, axis)
    scene.statements += tuple(made)
    scene.notes += tuple(notes)


def _part(scene: Scene, node: _Node | None) -> str | None:
    """Return the first part of a node."""
    if node is None:
        return None
    return next((n for n in scene.names if n == node.name or n.startswith(f"{node.name}/") or not node.name), None)


def _frame(joint: Any) -> tuple[np.ndarray, np.ndarray]:
    """Origin (m) and axis of a joint at the present pose of its part, world."""
    placed = joint.parent.global_location.wrapped.Transformation()
    pose = pin.SE3(
        np.array([[placed.Value(i, j) for j in range(1, 4)] for i in range(1, 4)]),
        np.array([placed.Value(i, 4) for i in range(1, 4)]) * MM,
    )
    if hasattr(joint, "relative_axis"):
        point, direction = joint.relative_axis.position, joint.relative_axis.direction
    else:
        own = joint.relative_location
        point, direction = own.position, own.z_axis.direction
    return pose.act(np.array(tuple(point)) * MM), pose.rotation @ np.array(tuple(direction))
