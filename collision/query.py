"""`colliding_surfaces`: one pair of meshes, one relative pose, every pair of surfaces that meet."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.poses import pack
from collision.shape import triangles_needed
from collision.statistics import Statistics
from collision.tables import CAPACITY, COUNTS, FRONT_TABLE, LAST, PREPARED_FOR, SCRATCH, SPREAD, STACK
from collision.tolerance import DEFAULT, Tolerance
from collision.wide import WideTree, build_wide_trees, wide_tree_of

Method = Literal["best", "oaabb", "brute", "coal"]
METHODS = ("best", "oaabb", "brute", "coal")


def colliding_surfaces(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "best", tolerance: Tolerance = DEFAULT
) -> NDArray[np.int32]:
    """Every pair of surfaces that meet.

    Parameters
    ----------
    mesh_a, mesh_b: the meshes.
    pose_ab: pose of b in a's frame, `pinocchio.SE3` or (4, 4).
    method: "best", the hierarchy; "oaabb", the plain algorithm with overlap boxes; "brute", without them; "coal", the
        oracle. All but "coal" (which works in floating point) give the same answer, bit for bit: the exact one for
        the float64 coordinates of a and of b moved once by the pose.
    tolerance: its `rigid` says which poses are taken, its `gjk` what coal is asked for.

    Returns
    -------
    (k, 2) int32: surface of a, surface of b, sorted.

    Raises
    ------
    PoseError, CollisionError: a pose that is not a finite rigid motion, an unknown method.
    """
    if method == "best":
        return _ask_once(mesh_a, mesh_b, pose_ab, tolerance.rigid)[0]
    return examine(mesh_a, mesh_b, pose_ab, method, tolerance)[0]


def examine(
    mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose_ab: Any, method: Method = "best", tolerance: Tolerance = DEFAULT
) -> tuple[NDArray[np.int32], Statistics]:
    """`colliding_surfaces`, and what it cost."""
    if method == "best":
        before = _scratch(*_sizes(wide_tree_of(mesh_a), wide_tree_of(mesh_b))).statistics
        pairs, scratch = _ask_once(mesh_a, mesh_b, pose_ab, tolerance.rigid)
        return pairs, scratch.statistics - before
    pose = pack(pose_ab, _who(mesh_a, mesh_b), rigid=tolerance.rigid)
    if method in ("oaabb", "brute"):
        return _plain(mesh_a, mesh_b, pose, method == "oaabb")
    if method == "coal":
        from collision.oracle import colliding_surfaces as oracle

        return oracle(mesh_a, mesh_b, pose_ab, tolerance), Statistics()
    raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")


class Scratch:
    """What the fast query works in, for trees of so many float32 of nodes and so many pairs of surfaces.

    One a thread, replaced by a larger one when it is too small (never grown in place: an interruption in between would
    leave addresses of what is gone); never part of an answer.
    """

    def __init__(self, size_a: int = 1, size_b: int = 1, pairs: int = 1) -> None:
        from collision.lanes import MOTION
        from collision.predicates import FALLBACKS, workspace

        self._fallbacks = FALLBACKS
        self.sizes = size_a, size_b, pairs
        self.pose, self.motion = np.empty(15), np.empty(MOTION, np.float32)
        self.moved, self.stamp = np.empty(size_b, np.float32), np.zeros(size_b // 8 + 1, np.int64)
        self.turned = np.empty(SPREAD * size_b, np.float32)
        self.prepared, self.stamp_a = np.empty(SPREAD * size_a, np.float32), np.zeros(size_a // 8 + 1, np.int64)
        self.stack = np.empty(STACK, np.int64)
        self.keys, self.pairs = np.empty(pairs, np.int64), np.empty((pairs, 2), np.int32)
        self.counts = np.zeros(COUNTS, np.int64)
        self.workspace = workspace()
        arrays = (
            self.pose, self.motion, self.moved, self.stamp, self.turned, self.prepared, self.stamp_a,
            self.stack, self.keys, self.pairs, self.counts, self.workspace,
        )  # fmt: skip
        self.table = np.zeros(SCRATCH, np.int64)
        self.table[: len(arrays)] = [array.ctypes.data for array in arrays]
        self.address = self.table.ctypes.data

    @property
    def statistics(self) -> Statistics:
        """Counts of all questions so far."""
        return Statistics.of([*self.counts[:4], self.workspace[self._fallbacks]])


class Front:
    """Room for what `collision.certificates` keeps of two meshes."""

    def __init__(self, a: WideTree, b: WideTree) -> None:
        from collision.certificates import ROW
        from collision.lanes import ROOM

        leaves = (len(a.nodes) + len(b.nodes)) // 72
        capacity = min(1 << 16, 512 + 4 * leaves)
        pairs = a.n_surfaces * b.n_surfaces
        self.table = np.zeros(FRONT_TABLE, np.int64)
        self.address = self.table.ctypes.data
        self.planes = np.empty(ROW * (capacity // 8 + 1), np.float32)
        self.pieces = np.empty(2 * capacity, np.int64)
        self.lists = np.empty((2, capacity), np.int64)
        self.met, self.seen = np.empty(pairs, np.int64), np.zeros(pairs, np.int64)
        self.room, self.before = np.empty(ROOM, np.float32), np.full(12, np.nan)
        arrays = (self.planes, self.pieces, *self.lists, self.met, self.seen, self.room, self.before)
        self.table[: len(arrays)] = [array.ctypes.data for array in arrays]
        self.table[CAPACITY] = capacity


class PairQuery:
    """Two meshes asked again and again along a motion: `colliding_surfaces`, faster, with the very same answers.

    Remembered between questions: for each pair of surfaces the triangles that met last, tried first next time; and as
    long as steps are small, a front of separating planes between what did not meet (see `certificates`). Not for
    two threads at once. `tolerance.rigid` says which poses are taken.
    """

    def __init__(self, mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, tolerance: Tolerance = DEFAULT) -> None:
        self._meshes, self._tolerance = (mesh_a, mesh_b), tolerance
        self._trees = a, b = wide_tree_of(mesh_a), wide_tree_of(mesh_b)
        self._last = np.full(a.n_surfaces * b.n_surfaces, -1, np.int64)
        self._scratch = Scratch(*_sizes(a, b))
        self._scratch.counts[PREPARED_FOR] = 1
        self._scratch.table[LAST] = self._last.ctypes.data
        self._front = Front(a, b)
        self._ask: Any = None
        self._addresses = a.address, b.address
        self._rest = tolerance.rigid, self._scratch.address, self._front.address
        self._pairs = self._scratch.pairs

    def colliding_surfaces(self, pose_ab: Any) -> NDArray[np.int32]:
        """(k, 2) int32: surface of a, surface of b, sorted; for b at `pose_ab` in a's frame."""
        matrix = _matrix(pose_ab, *self._meshes, self._tolerance.rigid)
        n = (self._ask or self._first)(*self._addresses, matrix, *self._rest)
        if n < 0:
            pack(pose_ab, _who(*self._meshes), rigid=self._tolerance.rigid)  # raises
        return self._pairs[:n].copy()

    def _first(self, *arguments: Any) -> int:
        """The first question: answered before the kernels of the front are there (compiling them takes seconds)."""
        from collision.best import ask

        n: int = ask(*arguments[:-1])
        if n >= 0:
            from collision.front import ask_along

            self._ask = ask_along
        return n

    @property
    def statistics(self) -> Statistics:
        """Counts of all questions so far."""
        return self._scratch.statistics

    def __reduce__(self) -> tuple[Any, ...]:
        return PairQuery, (
            *self._meshes,
            self._tolerance,
        )  # a copy remembers nothing: addresses are of this one's memory


class Remembered:
    """A pair of objects in a `CollisionManager`: what was answered, for which poses, and what met."""

    __slots__ = ("address", "asked", "last", "meshes", "pairs", "versions")

    def __init__(self, mesh_a: SurfaceMesh, mesh_b: SurfaceMesh) -> None:
        surfaces = mesh_a.n_surfaces * mesh_b.n_surfaces
        self.meshes = mesh_a, mesh_b
        self.last = np.full(surfaces, -1, np.int64) if surfaces <= REMEMBERED else NOTHING
        self.address = self.last.ctypes.data if len(self.last) else 0
        self.pairs: NDArray[np.int32]
        self.versions = self.asked = (-1, -1)

    def __reduce__(self) -> tuple[Any, ...]:
        return Remembered, self.meshes  # as above


def ask_many(asked: Sequence[tuple[Remembered, NDArray[np.float64]]]) -> Statistics:
    """Answer pairs of objects at (12,) poses, on two threads where it is worth one; what it cost."""
    build_wide_trees({id(mesh): mesh for known, _ in asked for mesh in known.meshes}.values())
    if len(asked) < 2 * WORTH_A_THREAD:
        return _ask_some(asked)
    other = _pool().submit(_ask_some, asked[1::2])
    return _ask_some(asked[::2]) + other.result()


def _ask_some(asked: Sequence[tuple[Remembered, NDArray[np.float64]]]) -> Statistics:
    from collision.best import best_pairs

    if not asked:
        return Statistics()
    trees = [(wide_tree_of(known.meshes[0]), wide_tree_of(known.meshes[1])) for known, _ in asked]
    scratch = _scratch(*(max(sizes) for sizes in zip(*(_sizes(a, b) for a, b in trees), strict=True)))
    before = scratch.statistics
    try:
        for (known, pose), (a, b) in zip(asked, trees, strict=True):
            scratch.pose[:12] = pose
            scratch.table[LAST] = known.address
            n = best_pairs(a.address, b.address, scratch.address)
            known.pairs = scratch.pairs[:n].copy()
            known.versions = known.asked
    finally:
        scratch.table[LAST] = 0
    return scratch.statistics - before


def _ask_once(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, pose: Any, rigid: float) -> tuple[NDArray[np.int32], Scratch]:
    """The colliding pairs of surfaces, nothing remembered; and in what they were found."""
    from collision.best import ask

    a, b = wide_tree_of(mesh_a), wide_tree_of(mesh_b)
    scratch = _scratch(*_sizes(a, b))
    n = ask(a.address, b.address, _matrix(pose, mesh_a, mesh_b, rigid), rigid, scratch.address)
    if n < 0:
        pack(pose, _who(mesh_a, mesh_b), rigid=rigid)  # raises
    return scratch.pairs[:n].copy(), scratch


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "collision")


os.register_at_fork(after_in_child=_pool.cache_clear)  # its thread is not in the child, where a result never came


REMEMBERED = 1 << 16
"""pairs of surfaces beyond which nothing is remembered of a pair of objects"""
WORTH_A_THREAD = 4
"""pairs of objects that take longer than handing them to a thread"""
NOTHING = np.empty(0, np.int64)
"""nothing remembered"""


def _who(mesh_a: SurfaceMesh, mesh_b: SurfaceMesh) -> str:
    return f"pose of {mesh_b.name} in {mesh_a.name}"


def _matrix(pose: Any, mesh_a: SurfaceMesh, mesh_b: SurfaceMesh, rigid: float) -> NDArray[np.float64]:
    """The (4, 4) form of a pose; a `pinocchio.SE3` is checked by the kernel, anything else here."""
    matrix: NDArray[np.float64] | None = getattr(pose, "homogeneous", None)
    if matrix is None:
        packed = pack(pose, _who(mesh_a, mesh_b), rigid=rigid)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = packed[:9].reshape(3, 3), packed[9:]
    return matrix


class _Local(threading.local):
    @cached_property
    def scratch(self) -> Scratch:
        return Scratch()


_local = _Local()


def _sizes(a: WideTree, b: WideTree) -> tuple[int, int, int]:
    return len(a.nodes), len(b.nodes), a.n_surfaces * b.n_surfaces


def _scratch(size_a: int, size_b: int, pairs: int) -> Scratch:
    """This thread's, large enough."""
    scratch = _local.scratch
    has_a, has_b, has_pairs = scratch.sizes
    if size_a > has_a or size_b > has_b or pairs > has_pairs:
        scratch = Scratch(max(size_a, has_a), max(size_b, has_b), max(pairs, has_pairs))
        _local.scratch = scratch
    return scratch


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
        triangles_needed(mesh)
        corner = mesh.triangles[mesh.order]
        box, group = np.empty((mesh.n_triangles, 6)), np.empty((mesh.n_surfaces, 6))
        triangle_boxes(mesh.vertices, corner, box)
        group_boxes(box, mesh.surface_start, group)
        cached = mesh._cache["plain"] = (corner, box, group)
    return cached
