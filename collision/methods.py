"""Which surfaces of two meshes collide, by any of four methods: the hierarchy, the paper's two, and coal."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.statistics import Statistics
from collision.tolerance import DEFAULT, Tolerance

Method = Literal["bvh", "oaabb", "brute", "coal"]
METHODS = ("bvh", "oaabb", "brute", "coal")


def colliding_surfaces(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "bvh", tolerance: Tolerance = DEFAULT
) -> NDArray[np.int32]:
    """Return every pair of surfaces that intersect; touching counts.

    Parameters
    ----------
    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4), m.
    method: "bvh", two bounding volume hierarchies; "oaabb", the paper's algorithm with overlap boxes; "brute", without
        them; "coal", the oracle. All but "coal", which works in floating point, return the same result, the exact one
        for the float64 coordinates of a and of b moved once by the pose.
    tolerance: `rigid` is the accepted error of the pose, `gjk` coal's precision.

    Returns
    -------
    (k, 2) int32: surface of a, surface of b, sorted.

    Raises
    ------
    PoseError, CollisionError: a pose that is not a finite rigid motion; an unknown method.
    """
    if method == "bvh":
        from collision.query.intersection import intersecting

        return intersecting(mesh_a, mesh_b, pose_ab, tolerance.rigid)[0]
    return examine(mesh_a, mesh_b, pose_ab, method, tolerance)[0]


def examine(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "bvh", tolerance: Tolerance = DEFAULT
) -> tuple[NDArray[np.int32], Statistics]:
    """Return the pairs of `colliding_surfaces`, and the counts of their query; coal has no counts."""
    if method == "bvh":
        from collision.bvh.traverse import counts_of, workspace
        from collision.query.intersection import intersecting

        before = counts_of(workspace())
        pairs, ws = intersecting(mesh_a, mesh_b, pose_ab, tolerance.rigid)
        return pairs, Statistics(*counts_of(ws)) - Statistics(*before)
    if method in ("oaabb", "brute"):
        from collision.reference.oaabb import plain_pairs_of

        return plain_pairs_of(mesh_a, mesh_b, pose_ab, tolerance.rigid, clip=method == "oaabb")
    if method == "coal":
        from collision.reference.oracle import colliding_surfaces as oracle

        return oracle(mesh_a, mesh_b, pose_ab, tolerance), Statistics()
    raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")
