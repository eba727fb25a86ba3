"""A mechanism as URDF, and back into Pinocchio.

URDF knows trees only. A screw is a turn with a slide that mimics it; a joint of several degrees is a chain of joints
over massless links; a loop is written as an element `<loop link1="…" link2="…"/>`, which other readers skip: the two
links (one a massless copy of the other at the end of its own chain) have to coincide.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin

from constraints.mechanism.model import Joint, Mechanism, axis_name


def to_urdf(
    mechanism: Mechanism,
    name: str = "assembly",
    inertias: Mapping[int, pin.Inertia] | None = None,
    meshes: Mapping[int, str] | None = None,
    colors: Mapping[int, tuple[float, float, float, float]] | None = None,
) -> str:
    """URDF text of a mechanism.

    inertias: of each body, in its frame. meshes: file name of each body's mesh, relative to where the URDF will lie.
    colors: of each body's mesh, red, green, blue, opacity.
    """
    robot = xml.Element("robot", name=name)
    ends = {0: (_link(robot, "world"), pin.SE3.Identity())}
    for joint in mechanism.joints:
        ends[joint.child] = _chain(robot, joint, ends[joint.parent])
    for link, group in enumerate(mechanism.links):
        parent, frame = ends[link]
        for body in group:
            element = _link(robot, mechanism.names[body])
            _inertial(element, (inertias or {}).get(body))
            mesh = (meshes or {}).get(body)
            for tag in ("visual", "collision") if mesh is not None else ():
                shown = xml.SubElement(element, tag)
                xml.SubElement(xml.SubElement(shown, "geometry"), "mesh", filename=str(mesh))
                if tag == "visual" and colors is not None and body in colors:
                    material = xml.SubElement(shown, "material", name=f"{mechanism.names[body]}__color")
                    xml.SubElement(material, "color", rgba=numbers(np.array(colors[body])))
            _fixed(robot, parent, element, frame.actInv(mechanism.poses[body]))
    for k, loop in enumerate(mechanism.loops):
        parent, frame = _chain(robot, loop, ends[loop.parent])
        copy = _link(robot, mechanism.loop_name(k))
        body = mechanism.links[loop.child][0]
        _fixed(robot, parent, copy, frame.actInv(mechanism.poses[body]))
        xml.SubElement(robot, "loop", link1=mechanism.names[body], link2=mechanism.loop_name(k))
    xml.indent(robot)
    return '<?xml version="1.0"?>\n' + xml.tostring(robot, encoding="unicode") + "\n"


def _link(robot: xml.Element, name: str) -> xml.Element:
    return xml.SubElement(robot, "link", name=name)


def numbers(values: np.ndarray) -> str:
    """Return values (k,) as text, separated by blanks; each reads back to the same bits."""
    return " ".join(repr(float(v)) for v in values)


def _origin(element: xml.Element, pose: pin.SE3) -> None:
    xml.SubElement(element, "origin", xyz=numbers(pose.translation), rpy=numbers(pin.rpy.matrixToRpy(pose.rotation)))


def _joint(
    robot: xml.Element, name: str, kind: str, parent: xml.Element, child: xml.Element, pose: pin.SE3
) -> xml.Element:
    joint = xml.SubElement(robot, "joint", name=name, type=kind)
    _origin(joint, pose)
    xml.SubElement(joint, "parent", link=parent.get("name", ""))
    xml.SubElement(joint, "child", link=child.get("name", ""))
    return joint


def _fixed(robot: xml.Element, parent: xml.Element, child: xml.Element, pose: pin.SE3) -> None:
    _joint(robot, f"{child.get('name')}__fixed", "fixed", parent, child, pose)


def _chain(robot: xml.Element, joint: Joint, start: tuple[xml.Element, pin.SE3]) -> tuple[xml.Element, pin.SE3]:
    parent, frame = start
    for k, axis in enumerate(joint.axes):
        name = axis_name(joint, k)
        pose = frame.actInv(axis.frame)
        if axis.kind == "screw":
            child = _link(robot, f"{name}__turned")
            _axis(_joint(robot, name, "revolute", parent, child, pose))
            parent, pose = child, pin.SE3.Identity()
            child = _link(robot, f"{name}__link")
            slide = _joint(robot, f"{name}__advance", "prismatic", parent, child, pose)
            _axis(slide)
            xml.SubElement(slide, "mimic", joint=name, multiplier=repr(axis.pitch), offset="0")
        else:
            child = _link(robot, f"{name}__link")
            _axis(_joint(robot, name, axis.kind, parent, child, pose))
        parent, frame = child, axis.frame
    return parent, frame


def _axis(joint: xml.Element) -> None:
    """Axis z, with limits beyond any motion: contacts end it. (The type "continuous" has other coordinates.)"""
    xml.SubElement(joint, "axis", xyz="0 0 1")
    xml.SubElement(joint, "limit", lower="-1e6", upper="1e6", effort="1e9", velocity="1e9")


def _inertial(link: xml.Element, inertia: pin.Inertia | None) -> None:
    if inertia is None:
        return
    element = xml.SubElement(link, "inertial")
    _origin(element, pin.SE3(np.eye(3), inertia.lever))
    xml.SubElement(element, "mass", value=repr(float(inertia.mass)))
    i = inertia.inertia
    terms = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    xml.SubElement(element, "inertia", {k: repr(float(i[v])) for k, v in terms.items()})


def load_urdf(path: str | Path) -> tuple[pin.Model, list[pin.FrameAnchorConstraintModel]]:
    """Pinocchio model of a URDF file, screws as mimicking joints, and the welds that close its loops."""
    path = Path(path)
    model = pin.buildModelFromUrdf(str(path), mimic=True)
    welds = []
    for loop in xml.parse(path).getroot().iter("loop"):
        first, second = (model.frames[model.getFrameId(loop.get(k, ""))] for k in ("link1", "link2"))
        welds.append(
            pin.FrameAnchorConstraintModel(
                model, first.parentJoint, first.placement, second.parentJoint, second.placement
            )
        )
    return model, welds
