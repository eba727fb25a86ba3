"""Results of queries: rows of contacts and of penetrations, first impact of a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
"""one row per pair of surfaces, `object_a < object_b`, sorted by the four ids"""
_WHOLE = np.dtype((np.void, CONTACT_DTYPE.itemsize))


def joined(blocks: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate contact rows; faster than numpy, which copies them field by field."""
    whole = [block.view(_WHOLE) for block in blocks]
    return (np.concatenate(whole) if whole else np.empty(0, _WHOLE)).view(CONTACT_DTYPE)


def picked(rows: NDArray[Any], which: NDArray[Any]) -> NDArray[Any]:
    """Return a copy of the contact rows chosen by a mask (n,) or by indices (k,)."""
    return rows.view(_WHOLE)[which].view(CONTACT_DTYPE)


def surfaces_of(rows: NDArray[Any]) -> NDArray[np.int32]:
    """(k, 4) object, surface, object, surface of contact rows: a view of them."""
    return rows.view(np.int32).reshape(-1, CONTACT_DTYPE.itemsize // 4)[:, :4]


PENETRATION_DTYPE = np.dtype(
    [
        ("object_a", np.int32),
        ("surface_a", np.int32),
        ("object_b", np.int32),
        ("surface_b", np.int32),
        ("depth", np.float64),  # m, 0 where the surfaces only touch
        ("bound", np.float64),  # m, upper bound of the depth, up to the precision of depths
        ("direction", np.float64, 3),  # 1, world frame: moving b along it by `depth` takes the deepest point out of a
        ("point", np.float64, 3),  # the deepest point, world frame, m
    ]
)
"""one row per pair of surfaces that intersect, `object_a < object_b`, sorted by the four ids"""


@dataclass(frozen=True, slots=True, eq=False)
class TimeOfImpact:
    """First impact of objects that move to target poses."""

    t: float
    """1, in [0, 1]: fraction of the motion before the impact; 1 without one"""
    contacts: NDArray[Any]
    """CONTACT_DTYPE rows of the pairs of surfaces that stop the motion, at time t, world frame; empty without impact"""
    poses: Mapping[int, pin.SE3]
    """poses of the moving objects at time t, by id"""

    @property
    def hit(self) -> bool:
        """Whether there is an impact."""
        return len(self.contacts) > 0

    @property
    def rows(self) -> NDArray[np.int32]:
        """Return (k, 4) int32 object, surface, object, surface of the pairs that stop the motion, sorted."""
        return surfaces_of(self.contacts).copy()
