"""Read URDF: links with geometry and inertia, and joints with their degrees of freedom."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin

from vpframe.errors import LoadError, VpframeError
from vpframe.importers import meshes
from vpframe.importers.raw import Axis, Color, Options, RawJoint, RawPart, RawScene, RawShape
from vpframe.importers.solids import SOLIDS, part_of_mass

_AXES = {"revolute": ("revolute",), "continuous": ("revolute",), "prismatic": ("prismatic",), "fixed": ()}
_FREE = ("floating",)
_KNOWN = (*_AXES, *_FREE, "planar")
_LEVELS = 6
"""number of folders above the file searched for packages"""


def read(path: Path, options: Options) -> RawScene:
    """Return the raw scene of a URDF file with all joints at zero; each link with geometry is one or more parts.

    Visual geometry is read, or collision geometry for links without it. Raises LoadError for an invalid file.
    """
    robot = _parsed(path)
    links = {link.get("name", ""): link for link in robot.iter("link") if link.get("name")}
    joints = list(robot.findall("joint"))
    poses, order = _poses(path, links, joints)
    raw = RawScene(links=[[] for _ in order])
    reader = _Shapes(path, raw, options, _materials(robot))
    reader.read_meshes(links[name] for name in order)
    for k, name in enumerate(order):
        raw.links[k] = reader.add(name, links[name], poses[name])
    number = {name: k for k, name in enumerate(order)}
    for joint in joints:
        raw.joints.append(_joint(path, joint, poses, number))
    for loop in robot.findall("loop"):
        pair = [number.get(loop.get(key, ""), -1) for key in ("link1", "link2")]
        if min(pair) >= 0:
            raw.joints.append(RawJoint(f"loop {loop.get('link1')}", (pair[0], pair[1]), []))
    limited = [j.get("name", "") for j in joints if j.find("limit") is not None and _bounded(j)]
    mimicking = [j.get("name", "") for j in joints if j.find("mimic") is not None]
    for what, names in (("limits", limited), ("mimicry", mimicking)):
        if names:
            raw.notes.append(f"{what} of {len(names)} joints ({', '.join(names[:6])}) left out: no constraint has them")
    if not raw.parts:
        raise LoadError(f"{path}: no link has geometry that can be read{_why(raw)}; check its mesh files", str(path))
    return raw


def _why(raw: RawScene) -> str:
    return f" ({raw.notes[0]})" if raw.notes else ""


class _Tree(xml.TreeBuilder):
    """Builds the tree of a file that has no document type, which could declare entities without end."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def doctype(self, *_: str | None) -> None:
        raise LoadError(f"{self._path}: has a document type, which no URDF needs; remove it", str(self._path))


def _parsed(path: Path) -> xml.Element:
    try:
        root = xml.fromstring(path.read_bytes(), xml.XMLParser(target=_Tree(path)))
    except xml.ParseError as error:
        raise LoadError(
            f"{path}: is no well-formed XML ({error}); if it is xacro, expand it first", str(path)
        ) from None
    if root.tag != "robot":
        raise LoadError(f"{path}: its root is <{root.tag}>, not <robot>; give a URDF file", str(path))
    return root


def _numbers(path: Path, element: xml.Element | None, name: str, default: str) -> np.ndarray:
    text = default if element is None else element.get(name, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([np.nan])
    if len(values) != len(default.split()) or not np.isfinite(values).all():
        tag = "" if element is None else element.tag
        raise LoadError(f"{path}: <{tag} {name}={text!r}>: {len(default.split())} finite numbers are needed", str(path))
    return values


def _origin(path: Path, element: xml.Element) -> pin.SE3:
    origin = element.find("origin")
    rotation = pin.rpy.rpyToMatrix(_numbers(path, origin, "rpy", "0 0 0"))
    return pin.SE3(rotation, _numbers(path, origin, "xyz", "0 0 0"))


def _ends(joint: xml.Element) -> tuple[str, str]:
    parent, child = (joint.find(tag) for tag in ("parent", "child"))
    return ("" if parent is None else parent.get("link", "")), ("" if child is None else child.get("link", ""))


def _poses(
    path: Path, links: dict[str, xml.Element], joints: list[xml.Element]
) -> tuple[dict[str, pin.SE3], list[str]]:
    """Return the world pose of each link, and the links' names, root first."""
    above: dict[str, tuple[str, xml.Element]] = {}
    for joint in joints:
        parent, child = _ends(joint)
        for name in (parent, child):
            if name not in links:
                raise LoadError(f"{path}: joint {joint.get('name')}: there is no link {name!r}", str(path))
        if child in above:
            raise LoadError(f"{path}: link {child!r} has two parents; URDF knows trees only", str(path))
        above[child] = parent, joint
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        what = f"{len(roots)} roots ({', '.join(roots[:4])})" if roots else "no root: its joints run in a circle"
        raise LoadError(f"{path}: has {what}; a URDF has one", str(path))
    poses = {roots[0]: pin.SE3.Identity()}
    order = [roots[0]]
    below: dict[str, list[str]] = {}
    for child, (parent, _) in above.items():
        below.setdefault(parent, []).append(child)
    for name in order:
        for child in below.get(name, ()):
            poses[child] = poses[name] * _origin(path, above[child][1])
            order.append(child)
    if len(order) != len(links):
        raise LoadError(
            f"{path}: {len(links) - len(order)} links hang on no root: their joints run in a circle", str(path)
        )
    return poses, order


def _joint(path: Path, joint: xml.Element, poses: dict[str, pin.SE3], number: dict[str, int]) -> RawJoint:
    name, kind = joint.get("name", ""), joint.get("type", "")
    parent, child = _ends(joint)
    if kind not in _KNOWN:
        raise LoadError(f"{path}: joint {name}: type {kind!r} is none of {', '.join(_KNOWN)}", str(path))
    frame = poses[child]
    axis = frame.rotation @ _numbers(path, joint.find("axis"), "xyz", "1 0 0")
    length = float(np.linalg.norm(axis))
    if kind in _AXES and _AXES[kind] and not length > 0.0:
        raise LoadError(f"{path}: joint {name}: its axis is zero", str(path))
    axis = axis / (length or 1.0)
    axes: list[Axis] = [(k, frame.translation.copy(), axis) for k in _AXES.get(kind, ())]
    if kind == "planar":
        x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        x /= np.linalg.norm(x)
        slides = [("prismatic", frame.translation.copy(), d) for d in (x, np.cross(axis, x))]
        axes = [*slides, ("revolute", frame.translation.copy(), axis)]
    return RawJoint(name, (number[parent], number[child]), axes, free=kind in _FREE)


def _bounded(joint: xml.Element) -> bool:
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return False
    try:
        return max(abs(float(limit.get(key, "0"))) for key in ("lower", "upper")) < 1e5
    except ValueError:
        return True


def _materials(robot: xml.Element) -> dict[str, Color]:
    """Return the colour of each name, that of the robot's own material before one inside a link."""
    found: dict[str, Color] = {}
    for material in (*robot.findall("material"), *robot.iter("material")):
        name, color = material.get("name", ""), _color(material)
        if name and color is not None:
            found.setdefault(name, color)
    return found


def _color(material: xml.Element) -> Color | None:
    color = material.find("color")
    try:
        r, g, b, a = map(float, () if color is None else color.get("rgba", "").split())
    except ValueError:
        return None
    return r, g, b, a


def _shown(link: xml.Element) -> list[xml.Element]:
    return link.findall("visual") or link.findall("collision")


def _key(element: xml.Element) -> tuple[Any, ...]:
    return element.tag, tuple(sorted(element.attrib.items()))


class _Shapes:
    """Reads the parts of links; each mesh file and scale is read once."""

    def __init__(self, path: Path, raw: RawScene, options: Options, colors: dict[str, Color]) -> None:
        self.path = path
        self.raw = raw
        self.options = options.deflection, options.angular
        self.colors = colors
        self._read: dict[tuple[Any, ...], RawScene | LoadError] = {}
        self._starts: dict[int, int] = {}
        """index of the first shape of each scene that was read"""

    def read_meshes(self, links: Iterable[xml.Element]) -> None:
        """Read the mesh files of all links in one process, each file and scale once; errors are kept until used."""
        wanted: dict[tuple[Any, ...], tuple[Path, tuple[float, ...]]] = {}
        for geometry in (element.find("geometry") for link in links for element in _shown(link)):
            element = None if geometry is None or not len(geometry) else geometry[0]
            if element is None or element.tag != "mesh":
                continue
            try:
                scale = _numbers(self.path, element, "scale", "1 1 1")
                wanted[_key(element)] = self._find(element.get("filename", "")), tuple(scale.tolist())
            except LoadError as error:
                self._read[_key(element)] = error
        self._read.update(zip(wanted, meshes.read_scaled(list(wanted.values())), strict=True))

    def add(self, name: str, link: xml.Element, pose: pin.SE3) -> list[str]:
        """Add the parts of a link; return their names."""
        made: list[RawPart] = []
        for element in _shown(link):
            placed = pose * _origin(self.path, element)
            material = element.find("material")
            color = None if material is None else _color(material) or self.colors.get(material.get("name", ""))
            try:
                made += self._parts(element.find("geometry"), placed, color)
            except VpframeError as error:
                self.raw.notes.append(f"link {name}: a geometry is lost: {error}")
        for i, part in enumerate(made):
            part.name = name if len(made) == 1 else f"{name}/{i + 1}"
        inertial = link.find("inertial")
        if made and inertial is not None:
            mass, inertia = self._inertia(inertial)
            part_of_mass(made, pose * _origin(self.path, inertial), mass, inertia, self.raw)
        self.raw.parts += made
        return [part.name for part in made]

    def _inertia(self, inertial: xml.Element) -> tuple[float, np.ndarray]:
        mass = float(_numbers(self.path, inertial.find("mass"), "value", "0")[0])
        terms = inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (
            float(_numbers(self.path, terms, key, "0")[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        return mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def _parts(self, geometry: xml.Element | None, pose: pin.SE3, color: Color | None) -> list[RawPart]:
        element = None if geometry is None or not len(geometry) else geometry[0]
        if element is None:
            raise LoadError(f"{self.path}: a <geometry> is empty", str(self.path))
        scene = self._scene(element)
        if id(scene) not in self._starts:
            self._starts[id(scene)] = len(self.raw.shapes)
            self.raw.shapes += scene.shapes
        first = self._starts[id(scene)]
        out = []
        for part in scene.parts:
            placed = pose * pin.SE3(part.rotation, part.translation)
            shown = part.color if color is None else color
            out.append(RawPart("", first + part.shape, placed.rotation, placed.translation, shown))
        return out

    def _scene(self, element: xml.Element) -> RawScene:
        """Return the shapes of a geometry in its frame, from the cache if possible."""
        key = _key(element)
        if key not in self._read:
            if element.tag not in SOLIDS:
                raise LoadError(f"{self.path}: <{element.tag}> is no geometry that is read", str(self.path))
            self._read[key] = self._solid(element)
        found = self._read[key]
        if isinstance(found, LoadError):
            raise found
        return found

    def _solid(self, element: xml.Element) -> RawScene:
        if element.tag == "box":
            sizes = _numbers(self.path, element, "size", "0 0 0")
        elif element.tag == "sphere":
            sizes = _numbers(self.path, element, "radius", "0")
        else:
            sizes = np.array([_numbers(self.path, element, key, "0")[0] for key in ("radius", "length")])
        shape: RawShape = SOLIDS[element.tag](sizes, *self.options)
        return RawScene([shape], [RawPart("", 0, np.eye(3), np.zeros(3))])

    def _find(self, name: str) -> Path:
        """Return a mesh file: beside the URDF, or in a package in a folder above it."""
        given = re.sub(r"^(package|model|file)://", "", name)
        if name.startswith("file://"):
            return Path(given)
        above = [self.path.resolve().parent, *self.path.resolve().parents][: _LEVELS + 1]
        inner = given.partition("/")[2] if name != given else given
        found = next((f for folder in above for f in (folder / given, folder / inner) if f.is_file()), None)
        if found is None:
            raise LoadError(f"{name}: no such file beside {self.path} or in a folder above it", str(self.path))
        return found
