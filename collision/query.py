"""`colliding_surfaces`: one pair of meshes, one relative pose, every pair of surfaces that meet."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.poses import pack
from collision.statistics import Statistics

Method = Literal["best", "oaabb", "brute", "coal"]
METHODS = ("best", "oaabb", "brute", "coal")


def colliding_surfaces(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "best"
) -> NDArray[np.int32]:
    """Every pair of surfaces that meet.

    Parameters
    ----------
    mesh_a, mesh_b: the meshes.
    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4).
    method: "best", the hierarchy; "oaabb", the plain algorithm with overlap boxes; "brute", without them; "coal", the
        oracle. All but "coal" (which works in floating point) give the same answer, bit for bit: the exact one for
        the float64 coordinates of a and of b moved once by the pose.

    Returns
    -------
    (k, 2) int32: surface of a, surface of b, sorted.

    Raises
    ------
    PoseError, CollisionError: a pose that is not a finite rigid motion, an unknown method.
    """
    return examine(mesh_a, mesh_b, pose_ab, method)[0]


def examine(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "best"
) -> tuple[NDArray[np.int32], Statistics]:
    """`colliding_surfaces`, and what it cost."""
    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}")
    if method in ("best", "oaabb", "brute"):
        return _plain(mesh_a, mesh_b, pose, method != "brute")
    if method == "coal":
        from collision.oracle import colliding_surfaces as oracle

        return oracle(mesh_a, mesh_b, pose_ab), Statistics()
    raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")


def _plain(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose: NDArray[np.float64], clip: bool
) -> tuple[NDArray[np.int32], Statistics]:
    from collision.predicates import workspace
    from collision.surfaces import plain_pairs

    corner_a, box_a, group_a = _boxes(mesh_a)
    corner_b, _, _ = _boxes(mesh_b)
    counts = np.zeros(5, np.int64)
    pairs = plain_pairs(
        mesh_a.vertices, corner_a, mesh_a.surface_start, box_a, group_a,
        mesh_b.vertices, corner_b, mesh_b.surface_start, pose, clip, workspace(), counts,
    )  # fmt: skip
    return pairs.copy(), Statistics.of(counts)


def _boxes(mesh: SurfaceMesh) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """The corners and the boxes of the triangles by surface, and the boxes of the surfaces, kept on the mesh."""
    from collision.boxes import group_boxes, triangle_boxes

    cached = mesh._cache.get("plain")
    if cached is None:
        corner = mesh.triangles[mesh.order]
        box, group = np.empty((mesh.n_triangles, 6)), np.empty((mesh.n_surfaces, 6))
        triangle_boxes(mesh.vertices, corner, box)
        group_boxes(box, mesh.surface_start, group)
        cached = mesh._cache["plain"] = (corner, box, group)
    return cached
