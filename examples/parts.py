"""Geometry that several examples share: bolts, nuts, plates, a bench. Lengths are metres."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from vpframe.scene import modelling

STEEL, BRASS, ALUMINIUM, WOOD, RUBBER = (
    (0.62, 0.64, 0.68),
    (0.80, 0.66, 0.28),
    (0.76, 0.78, 0.80),
    (0.68, 0.52, 0.36),
    (0.16, 0.16, 0.18),
)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    """A pose without rotation."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def bolt(diameter: float, length: float, across_flats: float, head: float) -> modelling.Solid:
    """A hexagon bolt, head upwards: its shank ends at z = -length, its head begins at z = 0. The thread is plain."""
    r, c = diameter / 2, diameter / 12
    shank = modelling.revolve([(0.0, -length), (r - c, -length), (r, c - length), (r, 0.001), (0.0, 0.001)])
    return shank + modelling.hexagon(across_flats, head)


def nut(diameter: float, across_flats: float, height: float) -> modelling.Solid:
    """A hexagon nut from z = 0 to its height. The thread is plain."""
    return modelling.hexagon(across_flats, height) - modelling.cylinder(diameter / 2, height)


def plate(x: float, y: float, z: float, holes: list[tuple[float, float]], diameter: float) -> modelling.Solid:
    """A plate centred on z, from z = 0 to `z`, with round holes through it."""
    solid = modelling.box(x, y, z).translated(-x / 2, -y / 2, 0.0)
    for hx, hy in holes:
        solid = solid - modelling.cylinder(diameter / 2, z).translated(hx, hy, 0.0)
    return solid


def bench(x: float = 0.2, y: float = 0.2, thickness: float = 0.02) -> modelling.Solid:
    """A table top, its surface at z = 0."""
    return modelling.box(x, y, thickness).translated(-x / 2, -y / 2, -thickness)
