"""How deep two surfaces that meet reach into one another's material, and which way out.

The depth of a point x behind the boundary of a solid A is its distance to that boundary: the length of the shortest
translation that takes x out of A. The depth of surface t of B in surface s of A is that of the deepest point of t whose
nearest boundary point lies on s; the depth of the pair is the greater of t in A and s in B. For indentations that are
shallow against the parts this is the translation that parts the two surfaces: the overlap d of two boxes face to face,
the height of a sphere's cap below a plane, the interference of a peg and a bore's wall. It grows with every
translation into the material as long as the nearest surface stays the same; it is never more than half the wall's
thickness, for beyond the middle the other side is nearer. Surfaces that only touch have depth 0. Behind means inside
for closed meshes; an open mesh counts as the boundary of what lies behind it, and where it ends the winding number
tells (see `collision.containment`).

Depths are found by branch and bound, from below: none is deeper than what is returned by more than `Tolerance.depth`
(1 %) of it and of `Tolerance.linear`, unless `BUDGET` ended the search. See `collision.kernels_depth`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from collision.containment import boundary_of
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
"""Pieces opened for one surface in another; beyond it the deepest point seen counts."""


def penetration(manager: CollisionManager, i: int, j: int) -> NDArray[Any]:
    """Depth and direction of every pair of surfaces of two objects that meet: PENETRATION_DTYPE rows.

    Ignored pairs of surfaces are left out.
    """
    manager.ignored(i, j)  # raises, unless there are both, and two
    i, j = min(i, j), max(i, j)
    contacts = pair_contacts(manager, i, j, 0.0)
    rows = np.zeros(len(contacts), PENETRATION_DTYPE)
    for name in ("object_a", "surface_a", "object_b", "surface_b"):
        rows[name] = contacts[name]
    if not len(rows):
        return rows
    mesh_a, mesh_b = manager.mesh(i), manager.mesh(j)
    world, pose = manager.pose(i), manager.relative_pose(i, j)
    surfaces = np.stack([rows["surface_a"], rows["surface_b"]], axis=1)
    b_in_a = _deepest(manager, mesh_a, mesh_b, pose, surfaces, np.zeros(len(rows)))
    a_in_b = _deepest(manager, mesh_b, mesh_a, pose.inverse(), surfaces[:, ::-1], b_in_a[:, 0])
    deeper = a_in_b[:, 0] > b_in_a[:, 0]
    back = a_in_b[:, 1:].reshape(-1, 2, 3) @ pose.rotation.T + pose.translation
    ends = np.where(deeper[:, None, None], back, b_in_a[:, 1:].reshape(-1, 2, 3))
    out = (ends[:, 1] - ends[:, 0]) * np.where(deeper, -1.0, 1.0)[:, None]
    length = np.linalg.norm(out, axis=1)
    behind = length > manager.tolerance.solver
    for k in np.flatnonzero(~behind).tolist():
        out[k], length[k] = _normal(mesh_a, int(contacts["triangle_a"][k])), 1.0
    rows["depth"] = np.maximum(a_in_b[:, 0], b_in_a[:, 0])
    rows["direction"] = out / length[:, None] @ world.rotation.T
    deepest = ends[:, 0] @ world.rotation.T + world.translation
    rows["point"] = np.where(behind[:, None], deepest, contacts["point_a"])
    return rows


def _normal(mesh: SurfaceMesh, triangle: int) -> NDArray[np.float64]:
    a, b, c = mesh.vertices[mesh.triangles[triangle]]
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n)
    return n / length if length > 0.0 else np.array([0.0, 0.0, 1.0])


def _deepest(
    manager: CollisionManager, solid: SurfaceMesh, other: SurfaceMesh, pose: pin.SE3,
    pairs: NDArray[np.int32], known: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """(n, 7) depth, point and nearest boundary point, in the frame of `solid`, in which `other` is at `pose`.

    pairs: (n, 2) surface of the solid, surface of the other. known: (n,) depths above which is looked; else depth 0.
    """
    from collision import kernels_depth as kernels
    from collision.kernels_boundary import room
    from collision.kernels_pieces import room_for

    moving = tree_of(other)
    out = np.zeros((len(pairs), 7))
    out[:, 0] = known
    rotation = np.ascontiguousarray(pose.rotation)
    vertices = other.vertices @ rotation.T + pose.translation
    relative = manager.tolerance.depth
    kernels.deepest(
        np.ascontiguousarray(pairs, np.int32),
        boundary_of(solid),
        kernels.Other(
            vertices, moving.box, moving.second, moving.first, moving.count, moving.corner, moving.root,
            rotation, np.array(pose.translation), np.empty(len(vertices)), np.full(len(vertices), -1, np.int32),
        ),
        relative, relative * manager.tolerance.linear, BUDGET, out,
        room_for(4 * BUDGET), room(),
    )  # fmt: skip
    return out
