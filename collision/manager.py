"""`CollisionManager`: objects with poses in, colliding surfaces out. The one door, and the one place with state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision import poses as _poses
from collision.errors import CollisionError, PoseError, UnknownObjectError
from collision.mesh import SurfaceMesh
from collision.query import METHODS, Method, Remembered, ask_many, examine
from collision.shape import ShapeMesh, mesh_of_shape
from collision.statistics import Statistics
from collision.tolerance import Tolerance
from collision.tree import bounds_of

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.objects import ObjectTree
    from collision.sweep import TimeOfContact


NONE: NDArray[np.int32] = np.empty((0, 2), np.int32)


class CollisionManager:
    """Objects, each a `SurfaceMesh` at a pose, and the questions one asks about them.

    Parameters
    ----------
    tolerance: what counts as near; verdicts are exact and do not depend on it.
    method: how pairs are examined, see `colliding_surfaces`.
    cross_check: True compares every 64th answer about a pair of objects with the oracle, n every n-th; see `oracle`.

    An object's id is its place in the order of adding, and stays its own when others are removed.
    """

    def __init__(
        self, tolerance: Tolerance | None = None, method: Method = "best", cross_check: bool | int = False
    ) -> None:
        if method not in METHODS:
            raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")
        if int(cross_check) < 0:
            raise CollisionError(f"cross_check is {cross_check!r}; give True, False, or n to check every n-th answer")
        self.tolerance = tolerance if tolerance is not None else Tolerance()
        self.checked = replace(self.tolerance, rigid=np.inf)
        """the tolerance for poses of one object in another's frame: they were checked as they came in"""
        self.method: Method = method
        self.cross_check_every = 64 if cross_check is True else int(cross_check)
        self._meshes: list[SurfaceMesh | None] = []
        self._movable: list[bool] = []
        self._pose, self._own = np.empty((0, 12)), np.empty((0, 7))
        self._box, self._radius = np.empty((0, 6)), np.empty(0)
        self._stale = np.empty(0, np.bool_)  # whose world box is behind its pose
        self._version = np.empty(0, np.int64)  # how often each was moved
        self._trees: tuple[ObjectTree, ObjectTree] | None = None  # of the movable objects, and of the others
        self._remembered: dict[tuple[int, int], Remembered] = {}
        self._ignored: set[tuple[int, int]] = set()
        self._ignored_surfaces: dict[tuple[int, int], set[tuple[int, int]]] = {}
        self._heeded: dict[tuple[int, int], NDArray[np.uint8]] = {}  # the same as tables, as they are asked for
        self._statistics = Statistics()
        self._answers = 0

    # --- objects -----------------------------------------------------------------------------------------------------

    def add(self, mesh: SurfaceMesh, pose: pin.SE3 | ArrayLike, movable: bool = True) -> int:
        """Add an object; its id. Objects that are not `movable` are not tested against one another."""
        i = len(self._meshes)
        if not isinstance(mesh, SurfaceMesh):
            raise CollisionError(
                f"object {i} is a {type(mesh).__name__}; give a SurfaceMesh, or a shape to `add_shape`"
            )
        packed = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
        self._meshes.append(mesh)
        self._movable.append(movable)
        if i == len(self._pose):
            more = max(16, i)
            self._pose = np.concatenate([self._pose, np.empty((more, 12))])
            self._own = np.concatenate([self._own, np.empty((more, 7))])
            self._box = np.concatenate([self._box, np.empty((more, 6))])
            self._radius = np.concatenate([self._radius, np.empty(more)])
            self._stale = np.concatenate([self._stale, np.zeros(more, np.bool_)])
            self._version = np.concatenate([self._version, np.zeros(more, np.int64)])
        self._pose[i], self._own[i], self._stale[i] = packed, bounds_of(mesh), True
        self._trees = None
        return i

    def add_shape(self, shape: Any, pose: pin.SE3 | ArrayLike, movable: bool = True, name: str | None = None) -> int:
        """Add a solid that is no mesh, a coal primitive, convex hull, height field or octree, as one surface; its id.

        Answers about it are coal's, not exact; it has no penetration, contains nothing and is not swept. A height field
        becomes a mesh, to which none of this applies.
        """
        return self.add(mesh_of_shape(shape, name), pose, movable)

    def remove(self, i: int) -> None:
        """Take an object out; its id is not used again."""
        self.mesh(i)
        self._meshes[i] = None
        self._stale[i] = False
        self._trees = None
        self._remembered = {pair: v for pair, v in self._remembered.items() if i not in pair}
        self._ignored = {pair for pair in self._ignored if i not in pair}
        self._ignored_surfaces = {pair: v for pair, v in self._ignored_surfaces.items() if i not in pair}
        self._heeded = {pair: v for pair, v in self._heeded.items() if i not in pair}

    @property
    def objects(self) -> tuple[int, ...]:
        """The ids there are, ascending."""
        return tuple(i for i, mesh in enumerate(self._meshes) if mesh is not None)

    def mesh(self, i: int) -> SurfaceMesh:
        """The mesh of an object."""
        try:
            mesh = self._meshes[i] if 0 <= i < len(self._meshes) else None
        except TypeError:  # no number, or no whole one
            mesh = None
        if mesh is None:
            known = self.objects
            hint = f"ids are {known[0]} … {known[-1]}" if known else "there are none; add one first"
            raise UnknownObjectError(f"no object {i!r}; {hint}", i)
        return mesh

    def movable(self, i: int) -> bool:
        """Whether an object may move."""
        self.mesh(i)
        return self._movable[i]

    def pose(self, i: int) -> pin.SE3:
        """The pose of an object in the world."""
        self.mesh(i)
        return _poses.unpack(self._pose[i])

    def set_pose(self, i: int, pose: pin.SE3 | ArrayLike) -> None:
        """Move an object. An object that is not movable may be placed anew as well."""
        mesh = self.mesh(i)
        self._pose[i] = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
        self._stale[i] = True
        self._version[i] += 1

    def set_poses(self, ids: Sequence[int] | NDArray[np.integer], poses: Sequence[pin.SE3] | ArrayLike) -> None:
        """Move many objects at once; poses: as many `pinocchio.SE3`, or (n, 4, 4). All are moved, or none."""
        from collision.objects import take_poses

        for k in ids.tolist() if isinstance(ids, np.ndarray) else ids:
            self.mesh(k)
        where = np.asarray(ids, np.int64)
        try:
            if not isinstance(poses, np.ndarray):
                poses = [getattr(pose, "homogeneous", pose) for pose in poses]  # type: ignore[union-attr]
            matrices = np.ascontiguousarray(poses, np.float64)
        except (TypeError, ValueError):
            matrices = np.empty(0)
        if where.ndim != 1 or matrices.shape != (len(where), 4, 4):
            raise PoseError(f"{where.shape} ids take as many poses, (n, 4, 4), not {matrices.shape}")
        packed = np.empty((len(where), 12))
        bad = take_poses(matrices, self.tolerance.rigid, packed)
        if bad >= 0:
            i = int(where[bad])
            _poses.pack(matrices[bad], f"object {i} ({self.mesh(i).name})", i, self.tolerance.rigid)  # raises
        self._pose[where] = packed
        self._stale[where] = True
        self._version[where] += 1

    def world_boxes(self) -> NDArray[np.float64]:
        """(n, 6) least and greatest corners of boxes that hold the objects, by id; none too small by rounding."""
        self._current_trees()
        return self._box[: len(self._meshes)]

    def relative_pose(self, i: int, j: int) -> pin.SE3:
        """The pose of object j in the frame of object i, by which its vertices are moved once."""
        self.mesh(i), self.mesh(j)
        from collision.objects import relative_poses

        out = np.empty((1, 12))
        relative_poses(self._pose, np.array([[i, j]], np.int32), out)
        return _poses.unpack(out[0])

    # --- what is left out --------------------------------------------------------------------------------------------

    def ignore(self, i: int, j: int) -> None:
        """Leave the pair of objects out of every answer until `heed(i, j)`."""
        self._ignored.add(self._pair(i, j))

    def heed(self, i: int, j: int) -> None:
        """Take the pair of objects back in."""
        self._ignored.discard(self._pair(i, j))

    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Leave every pair of a surface of i among `surfaces_i` and one of j among `surfaces_j` out of every answer."""
        self._ignored_surfaces.setdefault(self._pair(i, j), set()).update(self._products(i, surfaces_i, j, surfaces_j))
        for pair in ((i, j), (j, i)):
            self._heeded.pop(pair, None)

    def heed_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Take those pairs of surfaces back in."""
        self._ignored_surfaces.get(self._pair(i, j), set()).difference_update(
            self._products(i, surfaces_i, j, surfaces_j)
        )
        for pair in ((i, j), (j, i)):
            self._heeded.pop(pair, None)

    @property
    def ignores(self) -> bool:
        """Whether any pair of objects, or of their surfaces, may be left out."""
        return bool(self._ignored or self._ignored_surfaces)

    def ignored(self, i: int, j: int) -> bool:
        """Whether the pair of objects is left out as a whole."""
        return self._pair(i, j) in self._ignored

    def ignored_surfaces(self, i: int, j: int) -> frozenset[tuple[int, int]]:
        """The pairs of surfaces left out, as (surface of the lower id, surface of the higher)."""
        return frozenset(self._ignored_surfaces.get(self._pair(i, j), ()))

    def heeded_surfaces(self, i: int, j: int) -> NDArray[np.uint8] | None:
        """(ka, kb) uint8, 0 for the pairs of a surface of i and one of j that are left out; None if none is."""
        left_out = self._ignored_surfaces.get(self._pair(i, j))
        if not left_out:
            return None
        heeded = self._heeded.get((i, j))
        if heeded is None:
            heeded = np.ones((self.mesh(i).n_surfaces, self.mesh(j).n_surfaces), np.uint8)
            low, high = np.array(sorted(left_out)).T
            heeded[(low, high) if i < j else (high, low)] = 0
            heeded.setflags(write=False)
            self._heeded[i, j] = heeded
        return heeded

    def _pair(self, i: int, j: int) -> tuple[int, int]:
        self.mesh(i), self.mesh(j)
        if i == j:
            raise CollisionError(f"object {i} twice; a pair needs two objects")
        return (i, j) if i < j else (j, i)

    def _products(
        self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]
    ) -> Iterable[tuple[int, int]]:
        si, sj = self._surfaces(i, surfaces_i), self._surfaces(j, surfaces_j)
        return {(a, b) if i < j else (b, a) for a in si for b in sj}

    def _surfaces(self, i: int, surfaces: Iterable[int]) -> Sequence[int]:
        known = self.mesh(i).n_surfaces
        out = [int(s) for s in surfaces]
        for s in out:
            if not 0 <= s < known:
                raise CollisionError(f"object {i} ({self.mesh(i).name}) has no surface {s}; they are 0 … {known - 1}")
        return out

    # --- questions ---------------------------------------------------------------------------------------------------

    def object_pairs(self, objects: Iterable[int] | None = None, within: float = 0.0) -> NDArray[np.int32]:
        """Stage 1, filter objects: (n, 2) pairs i < j, sorted, whose boxes and spheres come within `within` metres.

        Pairs of which neither may move or that are ignored are left out, and, if `objects` are given, pairs without
        one of them. Conservative: never misses a pair; may hold pairs whose triangles are farther apart.
        """
        from collision.objects import near_pairs

        if not within >= 0.0:
            raise CollisionError(f"within is {within!r}; give a distance of at least 0 m")
        n = len(self._meshes)
        chosen = np.full(n, objects is None)
        for i in objects if objects is not None else ():
            self.mesh(i)
            chosen[i] = True
        movers, fixed = self._current_trees()
        pairs = np.empty((4 * n + 64, 2), np.int32)
        arguments = (*movers.arrays, *fixed.arrays, self._box, self._radius, within, chosen)
        while (found := near_pairs(*arguments, pairs)) > len(pairs):
            pairs = np.empty((found, 2), np.int32)
        pairs = pairs[:found]
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        if self._ignored:
            pairs = pairs[[pair not in self._ignored for pair in map(tuple, pairs.tolist())]]
        return pairs

    def _current_trees(self) -> tuple[ObjectTree, ObjectTree]:
        from collision.objects import ObjectTree, move_world_boxes

        stale = self._stale[: len(self._meshes)]
        if self._trees is None:
            ids = np.array(self.objects, np.int64)
            movable = np.array(self._movable, np.bool_)[ids]
            self._trees = ObjectTree(ids[movable]), ObjectTree(ids[~movable])
            stale[ids] = True
        behind = [tree for tree in self._trees if stale[tree.ids].any()]
        move_world_boxes(self._own, self._pose, stale, self._box, self._radius)
        for tree in behind:
            tree.follow(self._box)
        return self._trees

    def _has_shape(self, i: int, j: int) -> bool:
        return isinstance(self._meshes[i], ShapeMesh) or isinstance(self._meshes[j], ShapeMesh)

    def _method(self, i: int, j: int) -> Method:
        return "coal" if self._has_shape(i, j) else self.method

    def colliding_surfaces(self, objects: Iterable[int] | None = None) -> NDArray[np.int32]:
        """All pairs of surfaces that meet, exactly: (k, 4) int32 rows object, surface, object, surface, sorted.

        objects: only pairs with at least one of these; None for all.

        Pairs of objects of which neither moved since they were last asked are not asked again. With enough others, two
        threads share them; answers do not depend on it.
        """
        object_pairs = self.object_pairs(objects)
        answers = self._answer(object_pairs)
        rows = np.empty((sum(map(len, answers)), 4), np.int32)
        end = 0
        for (i, j), pairs in zip(object_pairs.tolist(), answers, strict=True):
            begin, end = end, end + len(pairs)
            rows[begin:end, 0], rows[begin:end, 2] = i, j
            rows[begin:end, 1::2] = pairs
        if not self._ignored_surfaces:
            return rows
        none: set[tuple[int, int]] = set()
        heeded = [(b, d) not in self._ignored_surfaces.get((a, c), none) for a, b, c, d in rows.tolist()]
        return rows[np.array(heeded, np.bool_)]

    def _answer(self, pairs: NDArray[np.int32]) -> list[NDArray[np.int32]]:
        """For each pair of objects the pairs of surfaces that meet."""
        from collision.objects import relative_poses

        poses = np.empty((len(pairs), 12))
        relative_poses(self._pose, pairs, poses)
        answers: list[NDArray[np.int32]] = [NONE] * len(pairs)
        fast = []
        for k, (i, j) in enumerate(pairs.tolist()):
            if self._method(i, j) != "best":
                pose = _poses.unpack(poses[k])
                answers[k], cost = examine(self.mesh(i), self.mesh(j), pose, self._method(i, j), self.checked)
                self._statistics += cost
                continue
            known = self._remembered.get((i, j))
            if known is None:
                known = self._remembered[i, j] = Remembered(self.mesh(i), self.mesh(j))
            versions = int(self._version[i]), int(self._version[j])
            if known.versions != versions:
                known.asked = versions
                fast.append((known, poses[k]))
        if len(self._remembered) > 4 * len(pairs) + 1024:  # what has long gone apart
            current = set(map(tuple, pairs.tolist()))
            self._remembered = {pair: known for pair, known in self._remembered.items() if pair in current}
        self._statistics += ask_many(fast)
        for k, (i, j) in enumerate(pairs.tolist()):
            if self._method(i, j) == "best":
                answers[k] = self._remembered[i, j].pairs
        self._cross_check(pairs, poses, answers)
        return answers

    def _cross_check(
        self, pairs: NDArray[np.int32], poses: NDArray[np.float64], answers: list[NDArray[np.int32]]
    ) -> None:
        if not self.cross_check_every:
            return
        from collision.oracle import cross_check

        for (i, j), pose, answer in zip(pairs.tolist(), poses, answers, strict=True):
            self._answers += 1
            if self._answers % self.cross_check_every == 0 and not self._has_shape(i, j):
                cross_check(self.mesh(i), self.mesh(j), _poses.unpack(pose), answer, tolerance=self.checked)

    def contacts(self, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]:
        """All pairs of surfaces at a distance of at most `within` metres: `CONTACT_DTYPE` rows with witness points."""
        from collision.proximity import contacts

        return contacts(self, within, objects)

    def clearance(self, i: int, j: int, surface_i: int | None = None, surface_j: int | None = None) -> NDArray[Any]:
        """The least distance of two objects, or of a surface of either: one `CONTACT_DTYPE` row with witness points."""
        from collision.proximity import clearance

        return clearance(self, i, j, surface_i, surface_j)

    def contains(self, i: int, j: int) -> bool:
        """Whether object j lies wholly inside object i, no surfaces meeting; see `collision.containment`."""
        from collision.containment import contains

        return contains(self, i, j)

    def penetration(self, i: int, j: int) -> NDArray[Any]:
        """Depth and direction of every pair of surfaces of two objects that penetrate; see `collision.penetration`."""
        from collision.penetration import penetration

        return penetration(self, i, j)

    def time_of_contact(self, moves: Mapping[int, pin.SE3], deflection: float = 0.0) -> TimeOfContact:
        """First contact on the way of the given objects to the given poses; see `collision.sweep`."""
        from collision.sweep import time_of_contact

        return time_of_contact(self, moves, deflection)

    @property
    def statistics(self) -> Statistics:
        """Counts of all questions since the beginning, or since `reset_statistics()`."""
        return self._statistics

    def reset_statistics(self) -> None:
        """Begin the counts anew."""
        self._statistics = Statistics()
