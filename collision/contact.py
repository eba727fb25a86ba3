"""What the queries answer: rows of contacts and of penetrations, and the time of impact of a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pinocchio as pin

CONTACT_DTYPE = np.dtype(
    [
        ("object_a", np.int32),
        ("surface_a", np.int32),
        ("object_b", np.int32),
        ("surface_b", np.int32),
        ("distance", np.float64),  # m; 0 where triangles intersect
        ("point_a", np.float64, 3),  # witness on surface a, world frame, m
        ("point_b", np.float64, 3),  # witness on surface b, world frame, m
        ("triangle_a", np.int32),
        ("triangle_b", np.int32),
    ]
)
"""One row a surface pair, `object_a < object_b`, rows sorted by the four ids."""

PENETRATION_DTYPE = np.dtype(
    [
        ("object_a", np.int32),
        ("surface_a", np.int32),
        ("object_b", np.int32),
        ("surface_b", np.int32),
        ("depth", np.float64),  # m, 0 where the surfaces only touch
        (
            "direction",
            np.float64,
            3,
        ),  # unit, world frame: moving b along it by `depth` takes the deepest point out of a
        ("point", np.float64, 3),  # the deepest point, world frame, m
    ]
)
"""One row a pair of surfaces that meet, `object_a < object_b`, rows sorted by the four ids."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeOfImpact:
    """The first impact on the way of some objects to their targets."""

    t: float
    """in [0, 1]: how far along the motion; 1 where nothing stops it"""
    contacts: NDArray[Any]
    """CONTACT_DTYPE rows of the surface pairs that stop it, at that time, world frame; none where nothing does"""
    poses: Mapping[int, pin.SE3]
    """where the moving objects are at that time"""

    @property
    def hit(self) -> bool:
        """Whether something stops the motion."""
        return len(self.contacts) > 0

    @property
    def rows(self) -> NDArray[np.int32]:
        """(k, 4) object, surface, object, surface of the pairs that stop the motion, sorted."""
        names = ("object_a", "surface_a", "object_b", "surface_b")
        return np.stack([self.contacts[name] for name in names], axis=1).astype(np.int32).reshape(-1, 4)
