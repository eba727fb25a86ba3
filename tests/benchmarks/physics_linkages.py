"""The mechanisms of the physics benchmark as CAD parts whose joints are recognised from how the parts touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import physics_cases as pc
import pinocchio as pin

from collision import CollisionManager, Tolerance
from constraints import Constraint, recognise
from physics import Body, Gravity, Sleeping, World
from vpframe.scene.modelling import Solid, box, cylinder, scene

PIN = 0.005
"""m, radius of pins and bores"""
BEYOND = 0.01
"""m, from a bore's axis to the end of its bar"""


def _along_y(radius: float, start: float, end: float, x: float) -> Solid:
    """A cylinder about an axis along y through (x, 0, 0)."""
    return cylinder(radius, end - start).rotated([1.0, 0.0, 0.0], -np.pi / 2).translated(x, start, 0.0)


def bar(length: float, width: float, height: float, bores: Sequence[float] = (), pins: Sequence[float] = ()) -> Solid:
    """A bar along x about the origin, `length` between its axes; at these x bores, and pins out of its side +y."""
    whole = length + 2 * BEYOND
    solid = box(whole, width, height).translated(-whole / 2, -width / 2, -height / 2)
    for x in bores:
        solid = solid - _along_y(PIN, -width, width, x)
    for x in pins:
        solid = solid + _along_y(PIN, 0.0, 1.5 * width, x)
    return solid


def world_of(
    parts: Mapping[str, tuple[Solid, pin.SE3]], bodies: Mapping[str, Body]
) -> tuple[World, dict[str, int], list[Constraint]]:
    """A world of the parts; those with no body stand still; whatever fits is joined as it is recognised.

    Pairs that are joined, and pairs that never meet, do not collide: the joints hold them.
    """
    assembly = scene(dict(parts))
    manager = CollisionManager()
    ids = {part.name: manager.add(part.mesh, part.pose, movable=part.name in bodies) for part in assembly.parts}
    tolerance = Tolerance()
    joints = [
        candidate.constraint
        for candidate in recognise(
            [part.features for part in assembly.parts],
            [part.pose for part in assembly.parts],
            manager.contacts(within=tolerance.clearance),
            tolerance,
        )
    ]
    for i in ids.values():
        for j in range(i):
            manager.ignore(j, i)
    world = World(manager)
    for name, body in bodies.items():
        world.add(ids[name], body, [Gravity(), Sleeping(False)])
    world.set_joints(joints)
    return world, ids, joints


def pendulum() -> tuple[World, dict[str, int], list[Constraint]]:
    """A bar hung by a bore at its end on the pin of a post, its mass that of the uniform bar between its ends."""
    p = pc.PENDULUM
    size = np.array([p["length"], p["width"], p["height"]])
    post = box(0.04, 0.02, 0.04).translated(-0.02, -p["width"] / 2 - 0.02, -0.02)
    turn = pin.exp3(np.array([0.0, p["angle"], 0.0]))
    parts = {
        "post": (post + _along_y(PIN, -p["width"], p["width"], 0.0), pin.SE3.Identity()),
        "bar": (bar(*size, bores=[-p["length"] / 2]), pin.SE3(turn, turn @ [p["length"] / 2, 0, 0])),
    }
    return world_of(parts, {"bar": Body.box(size, p["density"] * size.prod())})


def fourbar() -> tuple[World, dict[str, int], list[Constraint]]:
    """Crank and rocker on the pins of a base, a coupler upon both; masses those of uniform bars between the axes."""
    f = pc.FOURBAR
    w, d = f["width"], f["ground"]
    b, c = pc.fourbar_points(f["crank"])
    base = box(d + 0.04, w, w).translated(-0.02, -1.5 * w, -w / 2)
    base = base + _along_y(PIN, -w, w / 4, 0.0) + _along_y(PIN, -w, w / 4, d)
    parts = {"base": (base, pin.SE3.Identity())}
    bodies = {}
    ends = {"crank": ([0, 0], b, 0.0), "coupler": (b, c, w), "rocker": ([d, 0], c, 0.0)}
    for (name, (start, end, y)), length in zip(ends.items(), f["bars"], strict=True):
        left, right = -length / 2, length / 2
        solid = bar(length, w, w, [left, right]) if name == "coupler" else bar(length, w, w, [left], [right])
        x = np.array([end[0] - start[0], 0.0, end[1] - start[1]]) / length
        middle = np.array([(start[0] + end[0]) / 2, y, (start[1] + end[1]) / 2])
        turn = np.column_stack([x, [0.0, 1.0, 0.0], np.cross(x, [0.0, 1.0, 0.0])])
        parts[name] = (solid, pin.SE3(turn, middle))
        bodies[name] = Body.box([length, w, w], f["density"] * length * w * w)
    return world_of(parts, bodies)
