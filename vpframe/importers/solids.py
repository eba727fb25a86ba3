"""Primitive solids of robot models as exact shapes, and the distribution of a link's mass over its parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from vpframe.errors import LoadError
from vpframe.importers.brep import measured
from vpframe.importers.raw import Array, RawPart, RawScene, RawShape

LIGHT = 1e-9
"""fraction of a link's mass given to its second and further parts; the first part carries the mass"""


def _checked(what: str, sizes: Array) -> None:
    if not all(np.isfinite(size) and size > 0.0 for size in sizes):
        raise LoadError(f"{what} of sizes {[float(s) for s in sizes]}: they must be positive", what)


def box(sizes: Array, deflection: float, angular: float) -> RawShape:
    """Return a box of edge lengths (3,), m, centred at the origin."""
    from vpframe.scene import modelling as m

    _checked("box", sizes)
    x, y, z = map(float, sizes)
    return measured(m.box(x, y, z).translated(-x / 2, -y / 2, -z / 2).occ, deflection, angular)


def cylinder(sizes: Array, deflection: float, angular: float) -> RawShape:
    """Return a cylinder of (radius, length), m, along z, centred at the origin."""
    from vpframe.scene import modelling as m

    _checked("cylinder", sizes)
    radius, length = map(float, sizes)
    return measured(m.cylinder(radius, length).translated(0.0, 0.0, -length / 2).occ, deflection, angular)


def sphere(sizes: Array, deflection: float, angular: float) -> RawShape:
    """Return a ball of (radius,), m."""
    from vpframe.scene import modelling as m

    _checked("sphere", sizes)
    return measured(m.sphere(float(sizes[0])).occ, deflection, angular)


def capsule(sizes: Array, deflection: float, angular: float) -> RawShape:
    """Return a capsule of (radius, length of the cylinder), m, along z, centred at the origin."""
    from vpframe.scene import modelling as m

    _checked("capsule", sizes)
    radius, length = map(float, sizes)
    middle = m.cylinder(radius, length).translated(0.0, 0.0, -length / 2)
    ends = (m.sphere(radius).translated(0.0, 0.0, z) for z in (-length / 2, length / 2))
    for end in ends:
        middle = middle + end
    return measured(middle.occ, deflection, angular)


SOLIDS: dict[str, Callable[[Array, float, float], RawShape]] = {
    "box": box, "cylinder": cylinder, "sphere": sphere, "capsule": capsule
}  # fmt: skip


def part_of_mass(parts: Sequence[RawPart], center: pin.SE3, mass: float, inertia: Array, raw: RawScene) -> None:
    """Give the parts of a link its mass, kg, and inertia, kg·m², about `center` in its axes; note implausible ones."""
    name = parts[0].name
    moments = np.linalg.eigvalsh(inertia)
    if not mass > 0.0 or moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-6):
        raw.notes.append(f"{name}: mass {mass:g} kg with moments {moments.tolist()} kg·m² is none of a body; left out")
        return
    for i, part in enumerate(parts):
        own = pin.SE3(part.rotation, part.translation).actInv(center)
        share = 1.0 if i == 0 else LIGHT
        turned = own.rotation @ inertia @ own.rotation.T
        part.mass = (share * mass, own.translation.copy(), share * turned)
