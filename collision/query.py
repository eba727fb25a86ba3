"""`colliding_surfaces`: one pair of meshes, one relative pose, every pair of surfaces that meet."""

from __future__ import annotations

import threading
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.poses import pack
from collision.statistics import Statistics
from collision.tolerance import Tolerance
from collision.wide import wide_tree_of

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
    if method == "best":
        scratch = _local.scratch
        return scratch.ask(mesh_a, mesh_b, pose_ab)
    return examine(mesh_a, mesh_b, pose_ab, method)[0]


def examine(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "best"
) -> tuple[NDArray[np.int32], Statistics]:
    """`colliding_surfaces`, and what it cost."""
    if method == "best":
        scratch = _local.scratch
        before = Statistics.of(scratch.counts)
        pairs = scratch.ask(mesh_a, mesh_b, pose_ab)
        return pairs, Statistics.of(scratch.counts) - before
    pose = pack(pose_ab, f"pose of {mesh_b.name} in {mesh_a.name}")
    if method in ("oaabb", "brute"):
        return _plain(mesh_a, mesh_b, pose, method == "oaabb")
    if method == "coal":
        from collision.oracle import colliding_surfaces as oracle

        return oracle(mesh_a, mesh_b, pose_ab), Statistics()
    raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")


class Scratch:
    """What the fast query works in: one a thread, grown to the largest meshes seen, never part of an answer."""

    def __init__(self) -> None:
        from collision.best import LEVELS, SLOT, SPREAD, STACK, ask
        from collision.lanes import MOTION
        from collision.predicates import workspace

        self._ask = ask
        self._slot, self._spread = SLOT, SPREAD
        self._query = 0
        self.pose, self.motion = np.empty(15), np.empty(MOTION, np.float32)
        self.stack = np.empty(STACK, np.int32)
        self.levels = np.empty((3, LEVELS), np.int64)
        self.workspace = workspace()
        self.counts = np.zeros(5, np.int64)
        self._grow_a(1)
        self._grow_b(1)
        self._grow_pairs(1)

    def _grow_a(self, nodes: int) -> None:
        self.prepared = np.empty(self._spread * nodes, np.float32)
        self.stamp_a = np.zeros(nodes // self._slot + 1, np.int64)

    def _grow_b(self, nodes: int) -> None:
        self.moved = np.empty(nodes, np.float32)
        self.turned = np.empty(self._spread * nodes, np.float32)
        self.stamp = np.zeros(nodes // self._slot + 1, np.int64)

    def _grow_pairs(self, pairs: int) -> None:
        self.keys = np.empty(pairs, np.int64)
        self.pairs = np.empty((pairs, 2), np.int32)

    def ask(self, mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose: Any) -> NDArray[np.int32]:
        """The colliding pairs of surfaces."""
        a, b = wide_tree_of(mesh_a), wide_tree_of(mesh_b)
        if len(a.nodes) > len(self.prepared) // self._spread:
            self._grow_a(len(a.nodes))
        if len(b.nodes) > len(self.moved):
            self._grow_b(len(b.nodes))
        if mesh_a.n_surfaces * mesh_b.n_surfaces > len(self.keys):
            self._grow_pairs(mesh_a.n_surfaces * mesh_b.n_surfaces)
        self._query += 1
        matrix = getattr(pose, "homogeneous", None)
        if matrix is None:
            packed = pack(pose, f"pose of {mesh_b.name} in {mesh_a.name}")
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = packed[:9].reshape(3, 3), packed[9:]
        n = self._ask(
            a.nodes, a.info, a.corner, a.vertices, a.frame, b.nodes, b.info, b.corner, b.vertices, b.frame,
            matrix, Tolerance.rigid, self.pose, self.motion, self.moved, self.stamp, self.turned,
            self.prepared, self.stamp_a, self._query, self.stack, self.levels, self.keys, self.pairs,
            self.counts, self.workspace,
        )  # fmt: skip
        if n < 0:
            pack(pose, f"pose of {mesh_b.name} in {mesh_a.name}")
        return self.pairs[:n].copy()


class _Local(threading.local):
    @cached_property
    def scratch(self) -> Scratch:
        return Scratch()


_local = _Local()


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
