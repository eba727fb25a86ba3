"""Nearness of surfaces: which come within a tolerance, how far two parts or two surfaces are apart, and where.

Distances are those of the triangles. Two surfaces are at distance 0 if and only if the exact predicate says that they
meet; a positive distance carries the rounding of float64 arithmetic in a's frame (about 1e-15 of the coordinates).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from collision.contact import CONTACT_DTYPE
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.shape import ShapeMesh
from collision.tolerance import DEFAULT, Tolerance
from collision.tree import MeshTree, tree_of

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.manager import CollisionManager

_ALL = np.empty((0, 0), np.uint8)


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
    from collision import kernels_distance as kernels
    from collision.predicates import workspace

    if isinstance(mesh_a, ShapeMesh) or isinstance(mesh_b, ShapeMesh):
        from collision import oracle

        return oracle.surface_contacts(mesh_a, mesh_b, pose_ab, within, heeded, tolerance)
    a, b = tree_of(mesh_a), tree_of(mesh_b)
    rotation, translation = np.ascontiguousarray(pose_ab.rotation), pose_ab.translation
    rounding = kernels.rounding_of(a.box, b.box, rotation, translation)
    stack = np.empty((kernels.STACK, 2), np.int64)
    pairs = near_surfaces(a, b, rotation, translation, within + rounding, heeded)
    n = len(pairs)
    if n == 0:
        return np.empty(0, CONTACT_DTYPE)
    best = np.empty((n, 7))
    hit = np.empty((n, 2), np.int32)
    kernels.surface_contacts(
        pairs, a.root, b.root,
        mesh_a.vertices, a.box, a.second, a.first, a.count, a.corner,
        mesh_b.vertices, b.box, b.second, b.first, b.count, b.corner,
        rotation, translation, float(within), rounding, best, hit, workspace(), stack, np.empty(kernels.STACK),
    )  # fmt: skip
    found = np.flatnonzero(hit[:, 0] >= 0)
    found = found[np.lexsort((pairs[found, 1], pairs[found, 0]))]
    rows = np.empty(len(found), CONTACT_DTYPE)
    rows["object_a"], rows["object_b"] = 0, 1
    rows["surface_a"], rows["surface_b"] = pairs[found, 0], pairs[found, 1]
    rows["distance"] = best[found, 0]
    rows["point_a"], rows["point_b"] = best[found, 1:4], best[found, 4:7]
    rows["triangle_a"], rows["triangle_b"] = a.order[hit[found, 0]], b.order[hit[found, 1]]
    return rows


def near_surfaces(
    a: MeshTree, b: MeshTree, rotation: NDArray[np.float64], translation: NDArray[np.float64],
    reach: float, heeded: NDArray[np.uint8] | None,
) -> NDArray[np.int32]:  # fmt: skip
    """(n, 2) pairs of surfaces, in the order of the trees, whose boxes come within `reach` (m)."""
    from collision import kernels_distance as kernels

    mask = _ALL if heeded is None else heeded
    pairs = np.empty((64, 2), np.int32)
    stack = np.empty((kernels.STACK, 2), np.int64)
    arguments = (a.box, a.second, a.surface, b.box, b.second, b.surface, rotation, translation, reach, mask)
    while (n := kernels.near_surfaces(*arguments, pairs, stack)) > len(pairs):
        pairs = np.empty((n, 2), np.int32)
    return pairs[:n]


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
    from collision import kernels_distance as kernels
    from collision.predicates import workspace

    if isinstance(mesh_a, ShapeMesh) or isinstance(mesh_b, ShapeMesh):
        rows = surface_contacts(mesh_a, mesh_b, pose_ab, bound, tolerance=tolerance)
        for name, surface in (("surface_a", surface_a), ("surface_b", surface_b)):
            if surface is not None:
                rows = rows[rows[name] == surface]
        return rows[[int(np.argmin(rows["distance"]))]] if len(rows) else None
    a, b = tree_of(mesh_a), tree_of(mesh_b)
    rotation, translation = np.ascontiguousarray(pose_ab.rotation), pose_ab.translation
    best, hit = np.empty(7), np.empty(2, np.int32)
    kernels.closest(
        0 if surface_a is None else int(a.root[surface_a]), 0 if surface_b is None else int(b.root[surface_b]),
        mesh_a.vertices, a.box, a.second, a.first, a.count, a.corner,
        mesh_b.vertices, b.box, b.second, b.first, b.count, b.corner,
        rotation, translation, float(bound), kernels.rounding_of(a.box, b.box, rotation, translation),
        best, hit, workspace(), np.empty((kernels.STACK, 2), np.int64), np.empty(kernels.STACK),
    )  # fmt: skip
    if hit[0] < 0:
        return None
    row = np.zeros(1, CONTACT_DTYPE)
    row["object_b"] = 1
    row["triangle_a"], row["triangle_b"] = a.order[hit[0]], b.order[hit[1]]
    row["surface_a"] = mesh_a.surface_of_triangle[row["triangle_a"]]
    row["surface_b"] = mesh_b.surface_of_triangle[row["triangle_b"]]
    row["distance"], row["point_a"], row["point_b"] = best[0], best[1:4], best[4:7]
    return row


def contacts(manager: CollisionManager, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]:
    """All surface pairs of a manager's objects at a distance of at most `within` (m), witnesses in the world frame.

    Pairs of objects neither of which is movable, ignored pairs and ignored pairs of surfaces are left out, and, with
    `objects`, pairs without one of them. CONTACT_DTYPE rows, sorted by the four ids.
    """
    rows = [np.empty(0, CONTACT_DTYPE)]
    for i, j in manager.object_pairs(objects, within).tolist():
        rows.append(pair_contacts(manager, i, j, within))
    return np.concatenate(rows)


def pair_contacts(manager: CollisionManager, i: int, j: int, within: float) -> NDArray[Any]:
    """The rows of `contacts` for one pair of objects, i < j."""
    mesh_a, mesh_b = manager.mesh(i), manager.mesh(j)
    pose, heeded = manager.relative_pose(i, j), manager.heeded_surfaces(i, j)
    return _to_world(manager, i, j, surface_contacts(mesh_a, mesh_b, pose, within, heeded, manager.checked))


def clearance(
    manager: CollisionManager, i: int, j: int, surface_i: int | None = None, surface_j: int | None = None
) -> NDArray[Any]:
    """The least distance of two objects, or of a surface of either, as one CONTACT_DTYPE row in the world frame.

    `object_a` is the lower of the two ids, as in all rows. Nothing is left out: ignored pairs have a clearance too. The
    distance is that of the surfaces: 0 where they meet, positive for an object wholly inside another (see `contains`).
    """
    manager.ignored(i, j)  # raises, unless there are both, and two
    if i > j:
        i, j, surface_i, surface_j = j, i, surface_j, surface_i
    for k, surface in ((i, surface_i), (j, surface_j)):
        if surface is not None and not 0 <= surface < manager.mesh(k).n_surfaces:
            raise CollisionError(
                f"object {k} ({manager.mesh(k).name}) has no surface {surface}; "
                f"they are 0 … {manager.mesh(k).n_surfaces - 1}"
            )
    pose = manager.relative_pose(i, j)
    row = mesh_clearance(manager.mesh(i), manager.mesh(j), pose, surface_i, surface_j, tolerance=manager.checked)
    assert row is not None  # nothing is beyond an infinite bound
    return _to_world(manager, i, j, row)


def _to_world(manager: CollisionManager, i: int, j: int, rows: NDArray[Any]) -> NDArray[Any]:
    pose = manager.pose(i)
    rows["object_a"], rows["object_b"] = i, j
    for point in ("point_a", "point_b"):
        rows[point] = rows[point] @ pose.rotation.T + pose.translation
    return rows
