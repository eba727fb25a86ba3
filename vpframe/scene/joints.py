"""Joints of a model (URDF, MJCF, CAD) as the constraints that they consist of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from constraints.geometry.surfaces import Plane
from vpframe.errors import VpframeError

Place = str | tuple[str, Any]
"""part, or (part, geometry in its frame)"""


@dataclass(frozen=True, eq=False)
class Statement:
    """A constraint from a model file; a session puts it in force at its start."""

    kind: str
    """kind, as in `Session.constrain`"""
    a: Place
    b: Place
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parts(self) -> tuple[str, str]:
        """Names of the two parts."""
        a, b = (place if isinstance(place, str) else place[0] for place in (self.a, self.b))
        return a, b

    def renamed(self, names: Mapping[str, str]) -> Statement:
        """Return the statement with parts renamed."""

        def place(given: Place) -> Place:
            return names.get(given, given) if isinstance(given, str) else (names.get(given[0], given[0]), given[1])

        return Statement(self.kind, place(self.a), place(self.b), self.parameters)


KINDS = ("fixed", "revolute", "prismatic", "screw", "cylindrical", "planar", "spherical")


def statements(
    kind: str,
    parts: tuple[str, str],
    poses: tuple[pin.SE3, pin.SE3],
    origin: ArrayLike,
    axis: ArrayLike = (0, 0, 1),
    pitch: float = 0.0,
) -> tuple[Statement, ...]:
    """Return the statements that leave two parts, at their poses, exactly the freedom of a joint.

    kind: one of KINDS. poses: of the parts, world. origin, axis: (3,) m and (3,), world; a planar joint's normal.
    pitch: of a screw, m a turn. Raises VpframeError for an unknown kind.
    """
    from constraints.freedom.lower_pairs import frame_along  # imports the solver
    from constraints.kinds import Line, Point

    frame = frame_along(np.asarray(axis, dtype=np.float64), np.asarray(origin, dtype=np.float64))
    x, _, z = frame.rotation.T

    def at(make: Any, *directions: NDArray[np.float64]) -> tuple[Place, Place]:
        a, b = (
            (name, make(pose.actInv(frame.translation), *(pose.rotation.T @ d for d in directions)))
            for name, pose in zip(parts, poses, strict=True)
        )
        return a, b

    match kind:
        case "fixed" | "rigid":
            return (Statement("fixed", *parts),)
        case "revolute":
            return Statement("concentric", *at(Line, z), {"sense": 1}), Statement("coplanar", *at(Plane, z))
        case "cylindrical":
            return (Statement("concentric", *at(Line, z), {"sense": 1}),)
        case "prismatic":
            y = frame.rotation[:, 1]
            return Statement("coplanar", *at(Plane, x)), Statement("coplanar", *at(Plane, y))
        case "screw":
            return (Statement("screw", *at(Line, z), {"sense": 1, "pitch": pitch}),)
        case "planar":
            return (Statement("coplanar", *at(Plane, z)),)
        case "spherical":
            return (Statement("spherical", *at(Point)),)
    raise VpframeError(f"joint {kind!r} of {parts[0]} and {parts[1]} is not known; there are: {', '.join(KINDS)}")
