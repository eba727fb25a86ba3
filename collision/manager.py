"""`CollisionManager`: objects with poses in, colliding surfaces out. The one door, and the one place with state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision import poses as _poses
from collision.contact import CONTACT_DTYPE
from collision.errors import CollisionError, PoseError, UnknownObjectError
from collision.mesh import SurfaceMesh
from collision.query import METHODS, Method, examine
from collision.reference.shape import ShapeMesh, mesh_of_shape
from collision.statistics import Statistics
from collision.tolerance import Tolerance

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.contact import TimeOfImpact


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
        from collision.broad_phase import BroadPhase, bodies_for
        from collision.narrow_phase import NarrowPhase

        self._meshes: list[SurfaceMesh | None] = []
        self._bodies = bodies_for(16)
        self._version: list[int] = []  # how often each object was moved
        self._broad, self._narrow = BroadPhase(), NarrowPhase()
        self._shapes = False  # whether any object is or was no mesh
        self._changed = True  # whether objects came or went since the broad phase was last asked
        self._last: NDArray[np.int32] | None = None  # the last answer about all objects, if nothing has changed since
        self._ignored: set[int] = set()  # 2^32·i + j
        self._ignored_surfaces: dict[tuple[int, int], set[tuple[int, int]]] = {}
        self._heeded: dict[tuple[int, int], NDArray[np.uint8]] = {}  # the same as tables, as they are asked for
        self._statistics = Statistics()  # of what was not asked of the narrow phase, less what was before a reset
        self._answers = 0

    # --- objects -----------------------------------------------------------------------------------------------------

    def add(self, mesh: SurfaceMesh, pose: pin.SE3 | ArrayLike, movable: bool = True) -> int:
        """Add an object; its id. Objects that are not `movable` are not tested against one another."""
        i = len(self._meshes)
        if not isinstance(mesh, SurfaceMesh):
            raise CollisionError(
                f"object {i} is a {type(mesh).__name__}; give a SurfaceMesh, or a shape to `add_shape`"
            )
        from collision.broad_phase import bodies_for
        from collision.bvh.build import bounds_of

        packed = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
        if i == len(self._bodies.pose):
            self._bodies = bodies_for(2 * i, self._bodies)
        self._meshes.append(mesh)
        self._shapes |= isinstance(mesh, ShapeMesh)
        self._version.append(0)
        self._bodies.pose[i], self._bodies.own[i], self._bodies.movable[i] = packed, bounds_of(mesh), movable
        self._changed, self._last = True, None
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
        self._changed, self._last = True, None
        self._narrow.forget(lambda a, b: i not in (a, b))
        self._ignored = {key for key in self._ignored if i not in _ids(key)}
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
        return bool(self._bodies.movable[i])

    def pose(self, i: int) -> pin.SE3:
        """The pose of an object in the world."""
        self.mesh(i)
        return _poses.unpack(self._bodies.pose[i])

    def set_pose(self, i: int, pose: pin.SE3 | ArrayLike) -> None:
        """Move an object. An object that is not movable may be placed anew as well."""
        mesh = self.mesh(i)
        matrix = getattr(pose, "homogeneous", None)
        if matrix is None or not self._broad.place(self._bodies, i, matrix, self.tolerance.rigid):
            packed = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
            self._bodies.pose[i], self._bodies.stale[i] = packed, True
        self._version[i] += 1
        self._last = None

    def set_poses(self, ids: Sequence[int] | NDArray[np.integer], poses: Sequence[pin.SE3] | ArrayLike) -> None:
        """Move many objects at once; poses: as many `pinocchio.SE3`, or (n, 4, 4). All are moved, or none."""
        where = self._ids(ids)
        try:
            if not isinstance(poses, np.ndarray):
                poses = [getattr(pose, "homogeneous", pose) for pose in poses]  # type: ignore[union-attr]
            matrices = np.ascontiguousarray(poses, np.float64)
        except (TypeError, ValueError):
            matrices = np.empty(0)
        if where.ndim != 1 or matrices.shape != (len(where), 4, 4):
            raise PoseError(f"{where.shape} ids take as many poses, (n, 4, 4), not {matrices.shape}")
        packed, bad = self._broad.packed(matrices, self.tolerance.rigid)
        if bad >= 0:
            i = int(where[bad])
            _poses.pack(matrices[bad], f"object {i} ({self.mesh(i).name})", i, self.tolerance.rigid)  # raises
        self._bodies.pose[where] = packed
        self._bodies.stale[where] = True
        version = self._version
        for i in where.tolist():
            version[i] += 1
        self._last = None

    def _ids(self, ids: Sequence[int] | NDArray[np.integer]) -> NDArray[np.int64]:
        """Checked ids as an array."""
        for k in ids.tolist() if isinstance(ids, np.ndarray) else ids:
            self.mesh(k)
        return np.asarray(ids, np.int64)

    def world_boxes(self) -> NDArray[np.float64]:
        """(n, 6) least and greatest corners of boxes that hold the objects, by id; none too small by rounding."""
        self._follow()
        return self._bodies.box[: len(self._meshes)]

    def relative_pose(self, i: int, j: int) -> pin.SE3:
        """The pose of object j in the frame of object i, by which its vertices are moved once."""
        self.mesh(i), self.mesh(j)
        return _poses.unpack(self._broad.relative_poses(self._bodies.pose, np.array([[i, j]], np.int32))[0])

    # --- what is left out --------------------------------------------------------------------------------------------

    def ignore(self, i: int, j: int) -> None:
        """Leave the pair of objects out of every answer until `heed(i, j)`."""
        self._ignored.add(_key(*self._pair(i, j)))
        self._last = None

    def heed(self, i: int, j: int) -> None:
        """Take the pair of objects back in."""
        self._ignored.discard(_key(*self._pair(i, j)))
        self._last = None

    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Leave every pair of a surface of i among `surfaces_i` and one of j among `surfaces_j` out of every answer."""
        self._ignored_surfaces.setdefault(self._pair(i, j), set()).update(self._products(i, surfaces_i, j, surfaces_j))
        self._enabled_anew(i, j)

    def heed_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Take those pairs of surfaces back in."""
        self._ignored_surfaces.get(self._pair(i, j), set()).difference_update(
            self._products(i, surfaces_i, j, surfaces_j)
        )
        self._enabled_anew(i, j)

    def _enabled_anew(self, i: int, j: int) -> None:
        """Forget what was made of the pairs of surfaces that are left out."""
        for pair in ((i, j), (j, i)):
            self._heeded.pop(pair, None)
        self._narrow.forget(lambda a, b: (a, b) not in ((i, j), (j, i)))
        self._last = None

    @property
    def ignores(self) -> bool:
        """Whether any pair of objects, or of their surfaces, may be left out."""
        return bool(self._ignored or self._ignored_surfaces)

    def ignored(self, i: int, j: int) -> bool:
        """Whether the pair of objects is left out as a whole."""
        return _key(*self._pair(i, j)) in self._ignored

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
        _check_within(within)
        keys = self._near(objects, within)
        pairs = np.empty((len(keys), 2), np.int32)
        pairs[:, 0], pairs[:, 1] = keys >> 32, keys & 0xFFFFFFFF
        return pairs

    def _near(self, objects: Iterable[int] | None, within: float = 0.0) -> NDArray[np.int64]:
        """The pairs of objects as 2^32·i + j, sorted."""
        n, chosen = len(self._meshes), None
        if objects is not None:
            chosen = np.zeros(n, np.bool_)
            for i in objects:
                self.mesh(i)
                chosen[i] = True
        self._begin()
        keys = self._broad.near(self._bodies, n, within, chosen)
        if self._ignored:
            keys = keys[[key not in self._ignored for key in keys.tolist()]]
        return keys

    def _begin(self) -> None:
        """Tell the broad phase of objects that came or went."""
        if self._changed:
            self._broad.reset(np.array(self.objects, np.int64), self._bodies)
            self._changed = False

    def _follow(self) -> None:
        """Bring boxes in the world up to date."""
        self._begin()
        self._broad.near(self._bodies, len(self._meshes), 0.0, None)

    def _has_shape(self, i: int, j: int) -> bool:
        return isinstance(self._meshes[i], ShapeMesh) or isinstance(self._meshes[j], ShapeMesh)

    def colliding_surfaces(self, objects: Iterable[int] | None = None) -> NDArray[np.int32]:
        """All pairs of surfaces that meet, exactly: (k, 4) int32 rows object, surface, object, surface, sorted.

        objects: only pairs with at least one of these; None for all.

        Pairs of objects of which neither moved since they were last asked are not asked again. With enough others, two
        threads share them; answers do not depend on it.
        """
        if objects is None and self._last is not None and not self.cross_check_every:
            return self._last.copy()
        keys = self._near(objects).tolist()
        by_tree = keys
        if self.method != "best" or self._shapes:
            by_tree = [] if self.method != "best" else [key for key in keys if not self._has_shape(*_ids(key))]
        rows = self._narrow.intersecting(by_tree, self._meshes, self._version, self._bodies.pose, self.heeded_surfaces)
        if by_tree is not keys:
            answers = dict(zip(by_tree, rows, strict=True))
            rows = [answers[key] if key in answers else self._examined(*_ids(key)) for key in keys]
        if len(self._narrow.pairs) > 4 * len(keys) + 1024 and objects is None:  # what has long gone apart
            near = set(keys)
            self._narrow.forget(lambda i, j: _key(i, j) in near)
        if self.cross_check_every:
            self._cross_check(keys, rows)
        answer = np.concatenate(rows) if len(rows) > 1 else rows[0].copy() if rows else np.empty((0, 4), np.int32)
        if objects is None:
            self._last = answer
            return answer.copy()
        return answer

    def _examined(self, i: int, j: int) -> NDArray[np.int32]:
        """The rows of a pair of objects by another method than the hierarchy."""
        method: Method = "coal" if self._has_shape(i, j) else self.method
        pairs, cost = examine(self.mesh(i), self.mesh(j), self.relative_pose(i, j), method, self.checked)
        self._statistics += cost
        enabled = self.heeded_surfaces(i, j)
        if enabled is not None:
            pairs = pairs[enabled[pairs[:, 0], pairs[:, 1]] != 0]
        rows = np.empty((len(pairs), 4), np.int32)
        rows[:, 0], rows[:, 2], rows[:, 1::2] = i, j, pairs
        return rows

    def _cross_check(self, keys: list[int], rows: list[NDArray[np.int32]]) -> None:
        from collision.reference.oracle import cross_check

        for key, answer in zip(keys, rows, strict=True):
            i, j = _ids(key)
            self._answers += 1
            if self._answers % self.cross_check_every == 0 and not self._has_shape(i, j):
                pose, enabled = self.relative_pose(i, j), self.heeded_surfaces(i, j)
                cross_check(self.mesh(i), self.mesh(j), pose, answer[:, 1::2], enabled=enabled, tolerance=self.checked)

    def contacts(self, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]:
        """All pairs of surfaces at a distance of at most `within` metres: `CONTACT_DTYPE` rows with witness points.

        Sorted by the four ids, in the world frame. objects: only pairs with at least one of these; None for all. Left
        out is what `colliding_surfaces` leaves out. Pairs of objects that have not moved are not asked again.

        Raises
        ------
        CollisionError: `within` is negative or no number.
        """
        _check_within(within)
        return self._contacts(self._near(objects, within).tolist(), within)

    def pair_contacts(self, i: int, j: int, within: float) -> NDArray[Any]:
        """The rows of `contacts` for one pair of objects, i < j."""
        return self._contacts([_key(i, j)], within)

    def _contacts(self, keys: list[int], within: float) -> NDArray[Any]:
        by_tree = keys
        if self._shapes:
            by_tree = [key for key in keys if not self._has_shape(*_ids(key))]
        rows = self._narrow.contacts(
            by_tree, self._meshes, self._version, self._bodies.pose, self.heeded_surfaces, float(within)
        )
        if by_tree is not keys:
            answers = dict(zip(by_tree, rows, strict=True))
            rows = [answers[key] if key in answers else self._shape_contacts(*_ids(key), within) for key in keys]
        return np.concatenate(rows) if len(rows) > 1 else rows[0].copy() if rows else np.empty(0, CONTACT_DTYPE)

    def _shape_contacts(self, i: int, j: int, within: float) -> NDArray[Any]:
        from collision.reference.oracle import surface_contacts

        pose, heeded = self.relative_pose(i, j), self.heeded_surfaces(i, j)
        rows = surface_contacts(self.mesh(i), self.mesh(j), pose, within, heeded, self.checked)
        return self._to_world(i, j, rows)

    def _to_world(self, i: int, j: int, rows: NDArray[Any]) -> NDArray[Any]:
        pose = self.pose(i)
        rows["object_a"], rows["object_b"] = i, j
        for point in ("point_a", "point_b"):
            rows[point] = rows[point] @ pose.rotation.T + pose.translation
        return rows

    def clearance(self, i: int, j: int, surface_i: int | None = None, surface_j: int | None = None) -> NDArray[Any]:
        """The least distance of two objects, or of a surface of either: one `CONTACT_DTYPE` row with witness points.

        In the world frame; `object_a` is the lower of the two ids, as in all rows. Nothing is left out: ignored pairs
        have a clearance too. The distance is that of the surfaces: 0 where they meet, positive for an object wholly
        inside another (see `contains`).

        Raises
        ------
        UnknownObjectError, CollisionError: no such object or surface, or one object twice.
        """
        self._pair(i, j)
        if i > j:
            i, j, surface_i, surface_j = j, i, surface_j, surface_i
        for k, surface in ((i, surface_i), (j, surface_j)):
            if surface is not None:
                self._surfaces(k, (surface,))
        if self._has_shape(i, j):
            from collision.proximity import mesh_clearance

            pose = self.relative_pose(i, j)
            row = mesh_clearance(self.mesh(i), self.mesh(j), pose, surface_i, surface_j, tolerance=self.checked)
            assert row is not None  # nothing is beyond an infinite bound
            return self._to_world(i, j, row)
        surfaces = surface_i, surface_j
        return self._narrow.clearance(_key(i, j), self._meshes, self._bodies.pose, self.heeded_surfaces, surfaces)

    def contains(self, i: int, j: int) -> bool:
        """Whether object j lies wholly inside object i, no surfaces meeting; see `collision.query.containment`."""
        from collision.query.containment import contains

        return contains(self, i, j)

    def penetration(self, i: int, j: int) -> NDArray[Any]:
        """Depth and direction of every pair of surfaces of two objects that penetrate; see `query.penetration`."""
        from collision.query.penetration import penetration

        return penetration(self, i, j)

    def time_of_contact(self, moves: Mapping[int, pin.SE3], deflection: float = 0.0) -> TimeOfImpact:
        """First contact on the way of the given objects to the given poses; see `collision.query.time_of_impact`."""
        from collision.query.time_of_impact import time_of_impact

        return time_of_impact(self, moves, deflection)

    @property
    def statistics(self) -> Statistics:
        """Counts of all questions since the beginning, or since `reset_statistics()`."""
        return self._statistics + self._narrow.statistics

    def reset_statistics(self) -> None:
        """Begin the counts anew."""
        self._statistics = Statistics() - self._narrow.statistics


def _key(i: int, j: int) -> int:
    return i << 32 | j


def _ids(key: int) -> tuple[int, int]:
    return key >> 32, key & 0xFFFFFFFF


def _check_within(within: float) -> None:
    if not within >= 0.0:
        raise CollisionError(f"within is {within!r}; give a distance of at least 0 m")
