"""How deep two surfaces that meet reach into one another's material, and which way out.

The depth of a point x behind the boundary of a solid A is its distance to that boundary: the length of the shortest
translation that takes x out of A. The depth of surface t of B in surface s of A is that of the deepest point of t whose
nearest boundary point lies on s; the depth of the pair is the greater of t in A and s in B. For indentations that are
shallow against the parts this is the translation that parts the two surfaces: the overlap d of two boxes face to face,
the height of a sphere's cap below a plane, the interference of a peg and a bore's wall. It grows with every
translation into the material as long as the nearest surface stays the same; it is never more than half the wall's
thickness, for beyond the middle the other side is nearer. Surfaces that only touch have depth 0. Behind means inside
for closed meshes; an open mesh counts as the boundary of what lies behind it.

Depths are found by branch and bound, from below, to within 1 % and a hundredth of `Tolerance.linear`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.containment import solid_of
from collision.mesh import SurfaceMesh
from collision.proximity import pair_contacts
from collision.tree import tree_of

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.manager import CollisionManager

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

BUDGET: Final = 20000
"""Triangles, halved ones too, looked at for one surface in another; beyond it the deepest point seen counts."""


def penetration(manager: CollisionManager, i: int, j: int) -> NDArray[Any]:
    """Depth and direction of every pair of surfaces of two objects that meet: PENETRATION_DTYPE rows.

    Ignored pairs of surfaces are left out.
    """
    i, j = min(i, j), max(i, j)
    contacts = pair_contacts(manager, i, j, 0.0)
    mesh_a, mesh_b = manager.mesh(i), manager.mesh(j)
    world, a_to_b = manager.pose(i), manager.relative_pose(i, j).inverse()
    precision = 0.01 * manager.tolerance.linear
    rows = np.zeros(len(contacts), PENETRATION_DTYPE)
    for row, contact in zip(rows, contacts, strict=True):
        for name in ("object_a", "surface_a", "object_b", "surface_b"):
            row[name] = contact[name]
        s, t = int(contact["surface_a"]), int(contact["surface_b"])
        b_in_a = _deepest(mesh_a, s, mesh_b, t, a_to_b.inverse(), precision)
        a_in_b = _deepest(mesh_b, t, mesh_a, s, a_to_b, precision)
        if b_in_a[0] >= a_in_b[0]:
            depth, point, nearest = b_in_a[0], b_in_a[1:4], b_in_a[4:7]
            out = nearest - point
        else:
            back = a_to_b.inverse()
            depth, point, nearest = a_in_b[0], back.act(a_in_b[1:4]), back.act(a_in_b[4:7])
            out = point - nearest
        row["depth"] = depth
        length = np.linalg.norm(out)
        if length > manager.tolerance.solver:
            row["direction"], row["point"] = world.rotation @ (out / length), world.act(point)
        else:
            row["direction"] = world.rotation @ _normal(mesh_a, int(contact["triangle_a"]))
            row["point"] = contact["point_a"]
    return rows


def _normal(mesh: SurfaceMesh, triangle: int) -> NDArray[np.float64]:
    a, b, c = mesh.vertices[mesh.triangles[triangle]]
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n)
    return n / length if length > 0.0 else np.array([0.0, 0.0, 1.0])


def _deepest(
    solid: SurfaceMesh, surface: int, other: SurfaceMesh, other_surface: int, pose: pin.SE3, precision: float
) -> NDArray[np.float64]:
    """(7,) depth, point and nearest boundary point of a surface of `other`, posed in the frame of `solid`."""
    from collision import kernels_solid as kernels
    from collision.kernels_distance import STACK
    from collision.predicates import workspace

    tree, boundary = tree_of(solid), solid_of(solid)
    out = np.zeros(7)
    corners = (other.vertices @ pose.rotation.T + pose.translation)[other.triangles[other.triangles_of(other_surface)]]
    box = tree.box[0]
    near = (corners.min(axis=1) <= box[3:]).all(axis=1) & (corners.max(axis=1) >= box[:3]).all(axis=1)
    n = int(np.count_nonzero(near))
    todo = np.empty((4 * n + 256, 9))  # halving a triangle again and again leaves one sibling a step
    todo[:n] = corners[near].reshape(-1, 9)
    kernels.deepest(
        solid.vertices, tree.box, tree.second, tree.first, tree.count, tree.corner,
        boundary.face, boundary.edge, boundary.vertex, solid.surface_of_triangle[tree.order],
        todo, n, surface, tree.root[surface], precision, BUDGET, out, workspace(),
        np.empty(STACK, np.int64), np.empty(STACK),
    )  # fmt: skip
    return out
