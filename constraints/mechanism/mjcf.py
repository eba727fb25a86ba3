"""A mechanism as MJCF, the model format of MuJoCo.

A link is a body with one joint an axis; MuJoCo applies the joints of a body one after another, as the chain does. A
screw is a hinge with a slide that an equality ties to it; a loop is the end of its own chain, welded by an equality to
the link it closes on. Both equalities are soft: MuJoCo's solver holds them, its kinematics alone do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as xml

import numpy as np
import pinocchio as pin

from constraints.mechanism.model import Joint, Mechanism, axis_name
from constraints.mechanism.urdf import numbers

ADVANCE = "__advance"
"""ending of the slide of a screw's hinge"""
TINY = 1e-6
"""kg, and kg·m²: of bodies that move and have no mass of their own, which MuJoCo does not take"""
TYPES = {"revolute": "hinge", "prismatic": "slide"}


def to_mjcf(
    mechanism: Mechanism,
    name: str = "assembly",
    inertias: Mapping[int, pin.Inertia] | None = None,
    meshes: Mapping[int, str] | None = None,
    colors: Mapping[int, tuple[float, float, float, float]] | None = None,
) -> str:
    """MJCF text of a mechanism; joints, and bodies by their parts' names, as in `Mechanism.model` and `to_urdf`.

    inertias: of each body, in its frame; `TINY` where a body that moves has none. meshes: file name of each body's
    mesh, relative to where the MJCF will lie. colors: of each body, red, green, blue, opacity. Geometries are for the
    eye: MuJoCo would collide their convex hulls, which parts that fit into each other share.
    """
    root = xml.Element("mujoco", model=name)
    xml.SubElement(root, "compiler", angle="radian", autolimits="true")
    asset = xml.SubElement(root, "asset")
    assets: dict[str, str] = {}
    for file in dict.fromkeys((meshes or {}).values()):
        assets[file] = f"mesh_{len(assets)}"
        xml.SubElement(asset, "mesh", name=assets[file], file=file, inertia="shell")
    world = xml.SubElement(root, "worldbody")
    equality = xml.SubElement(root, "equality")

    def dressed(body: xml.Element, number: int, moves: bool) -> None:
        _inertial(body, (inertias or {}).get(number), moves)
        mesh = (meshes or {}).get(number)
        if mesh is not None:
            rgba = numbers(np.array((colors or {}).get(number, (0.7, 0.7, 0.75, 1.0))))
            shown = {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0", "rgba": rgba}
            xml.SubElement(body, "geom", {"type": "mesh", "mesh": assets[mesh], **shown})

    frames = [pin.SE3(mechanism.poses[group[0]]) for group in mechanism.links]
    bodies: dict[int, xml.Element] = {}
    for number in mechanism.links[0]:
        body = _body(world, mechanism.names[number], mechanism.poses[number])
        bodies.setdefault(0, body)
        dressed(body, number, moves=False)
    for joint in mechanism.joints:
        first, *others = mechanism.links[joint.child]
        body = _body(bodies[joint.parent], mechanism.names[first], frames[joint.parent].actInv(frames[joint.child]))
        bodies[joint.child] = body
        _joints(body, equality, joint, frames[joint.child])
        dressed(body, first, moves=True)
        for number in others:
            placed = frames[joint.child].actInv(mechanism.poses[number])
            dressed(_body(body, mechanism.names[number], placed), number, moves=False)
    for k, loop in enumerate(mechanism.loops):
        copy = _body(bodies[loop.parent], mechanism.loop_name(k), frames[loop.parent].actInv(frames[loop.child]))
        _joints(copy, equality, loop, frames[loop.child])
        _inertial(copy, None, moves=True)
        xml.SubElement(equality, "weld", body1=mechanism.link_name(loop.child), body2=mechanism.loop_name(k))
    xml.indent(root)
    return xml.tostring(root, encoding="unicode") + "\n"


def _body(parent: xml.Element, name: str, pose: pin.SE3) -> xml.Element:
    x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
    return xml.SubElement(
        parent, "body", name=name, pos=numbers(pose.translation), quat=numbers(np.array([w, x, y, z]))
    )


def _joints(body: xml.Element, equality: xml.Element, joint: Joint, frame: pin.SE3) -> None:
    """Joints of a chain, in the frame (world) of the body at its end."""
    for k, axis in enumerate(joint.axes):
        name = axis_name(joint, k)
        place = {
            "pos": numbers(frame.actInv(axis.origin)),
            "axis": numbers(frame.rotation.T @ axis.direction),
        }
        xml.SubElement(body, "joint", {"name": name, "type": TYPES.get(axis.kind, "hinge"), **place})
        if axis.kind == "screw":
            xml.SubElement(body, "joint", {"name": name + ADVANCE, "type": "slide", **place})
            tie = {"joint1": name + ADVANCE, "joint2": name, "polycoef": numbers(np.array([0, axis.pitch, 0, 0, 0]))}
            xml.SubElement(equality, "joint", tie)


def _inertial(body: xml.Element, inertia: pin.Inertia | None, moves: bool) -> None:
    if inertia is None and moves:
        inertia = pin.Inertia(TINY, np.zeros(3), TINY * np.eye(3))
    if inertia is not None:
        i = inertia.inertia
        terms = np.array([i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]])
        mass = repr(float(inertia.mass))
        xml.SubElement(body, "inertial", pos=numbers(inertia.lever), mass=mass, fullinertia=numbers(terms))
