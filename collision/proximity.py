"""Nearness of surfaces: which come within a tolerance, how far two parts or two surfaces are apart, and where.

Distances are those of the triangles. Two surfaces are at distance 0 if and only if the exact predicate says that they
meet; a positive distance carries the rounding of float64 arithmetic in a's frame (about 1e-15 of the coordinates).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from collision.mesh import SurfaceMesh
from collision.reference.shape import ShapeMesh
from collision.tolerance import DEFAULT, Tolerance

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.manager import CollisionManager


def surface_contacts(
    mesh_a: SurfaceMesh,
    mesh_b: SurfaceMesh,
    pose_ab: pin.SE3,
    within: float = 0.0,
    heeded: NDArray[np.uint8] | None = None,
    tolerance: Tolerance = DEFAULT,
) -> NDArray[Any]:
    """All surface pairs of two meshes at a distance of at most `within`, with witness points.

    Parameters
    ----------
    pose_ab: pose of b in a's frame.
    within: m, at least 0; infinity gives every pair.
    heeded: (ka, kb) uint8, 0 for the surface pairs to leave out; None heeds all.
    tolerance: what coal, if one of them is a shape of coal's, is asked with.

    Returns
    -------
    CONTACT_DTYPE rows sorted by surface a, surface b; `object_a` is 0 and `object_b` is 1, points are in a's frame.
    Distance 0: the surfaces meet, and both points are one point that they have in common.
    """
    if isinstance(mesh_a, ShapeMesh) or isinstance(mesh_b, ShapeMesh):
        from collision.reference import oracle

        return oracle.surface_contacts(mesh_a, mesh_b, pose_ab, within, heeded, tolerance)
    from collision.query.distance import contacts_at

    return contacts_at(mesh_a, mesh_b, pose_ab, within, heeded)


def mesh_clearance(
    mesh_a: SurfaceMesh,
    mesh_b: SurfaceMesh,
    pose_ab: pin.SE3,
    surface_a: int | None = None,
    surface_b: int | None = None,
    bound: float = np.inf,
    tolerance: Tolerance = DEFAULT,
) -> NDArray[Any] | None:
    """The least distance of two meshes, or of one surface of each, as one CONTACT_DTYPE row in a's frame.

    None if nothing is within `bound` (m). A mesh wholly inside another has the distance of their surfaces.
    """
    if isinstance(mesh_a, ShapeMesh) or isinstance(mesh_b, ShapeMesh):
        rows = surface_contacts(mesh_a, mesh_b, pose_ab, bound, tolerance=tolerance)
        for name, surface in (("surface_a", surface_a), ("surface_b", surface_b)):
            if surface is not None:
                rows = rows[rows[name] == surface]
        return rows[[int(np.argmin(rows["distance"]))]] if len(rows) else None
    from collision.query.distance import clearance_at

    rows = clearance_at(mesh_a, mesh_b, pose_ab, surface_a, surface_b, bound)
    return rows if len(rows) else None


def contacts(manager: CollisionManager, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]:
    """`CollisionManager.contacts`."""
    return manager.contacts(within, objects)


def pair_contacts(manager: CollisionManager, i: int, j: int, within: float) -> NDArray[Any]:
    """The rows of `contacts` for one pair of objects, i < j."""
    return manager.pair_contacts(i, j, within)


def clearance(
    manager: CollisionManager, i: int, j: int, surface_i: int | None = None, surface_j: int | None = None
) -> NDArray[Any]:
    """`CollisionManager.clearance`."""
    return manager.clearance(i, j, surface_i, surface_j)
