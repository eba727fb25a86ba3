"""`Objects`: meshes at poses, by id, and the pairs of them, and of their surfaces, that are enabled."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision import poses as _poses
from collision.errors import CollisionError, PoseError, UnknownObjectError
from collision.mesh import SurfaceMesh
from collision.tolerance import Tolerance

if TYPE_CHECKING:
    import pinocchio as pin


class ObjectsState(NamedTuple):
    """Poses, groups and ignored pairs at one instant, see `Objects.snapshot`."""

    poses: NDArray[np.float64]
    """(n, 12) rotation by rows, translation in m"""
    versions: NDArray[np.int64]
    """(n,)"""
    groups: NDArray[np.int64]
    """(n,) number of the group that each object belongs to, -1 for none"""
    ignored: frozenset[int]
    ignored_surfaces: dict[tuple[int, int], frozenset[tuple[int, int]]]


class Objects:
    """Objects, each a `SurfaceMesh` at a pose.

    Parameters
    ----------
    tolerance: distance of surfaces in contact, and accepted error of poses.

    An object's id is its place in the order of adding; it does not change when others are removed.
    """

    def __init__(self, tolerance: Tolerance | None = None) -> None:
        from collision.broad_phase import BroadPhase, bodies_for

        self.tolerance = tolerance if tolerance is not None else Tolerance()
        self.checked = replace(self.tolerance, rigid=np.inf)
        """the tolerance for relative poses, which are not checked: the objects' poses were, when they were set"""
        self._meshes: list[SurfaceMesh | None] = []
        self._bodies = bodies_for(16)
        self._version = np.zeros(16, np.int64)
        self._moves = 0  # number of moves so far: the last version given
        self._posed: tuple[int, tuple[pin.SE3, ...], NDArray[np.int64]] = (-1, (), self._version[:0])
        self._given: tuple[int, dict[int, pin.SE3]] = -1, {}  # version and copies of poses given to `set_poses`
        self._revision = 0  # number of changes so far
        self._broad = BroadPhase()
        self._changed = True  # whether objects were added or removed since the broad phase was last rebuilt
        self._ignored: frozenset[int] = frozenset()  # keys of pairs
        self._ignored_surfaces: dict[tuple[int, int], frozenset[tuple[int, int]]] = {}
        self._shared = False  # whether a snapshot holds the table above, which is then copied before a change
        self._enabled: dict[tuple[int, int], NDArray[np.uint8]] = {}  # `_ignored_surfaces` as masks, made when needed

    # --- objects -----------------------------------------------------------------------------------------------------

    def add(self, mesh: SurfaceMesh, pose: pin.SE3 | ArrayLike, movable: bool = True) -> int:
        """Add an object and return its id.

        Parameters
        ----------
        pose: `pinocchio.SE3` or (4, 4), in the world frame, m.
        movable: whether it may move. Pairs of objects neither of which is movable are left out of every result.

        Raises
        ------
        CollisionError: `mesh` is no SurfaceMesh.
        PoseError: the pose is not a finite rigid motion.
        """
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
            self._version = np.concatenate([self._version, np.zeros(i, np.int64)])
        self._meshes.append(mesh)
        self._version[i] = self._next_version()
        self._bodies.pose[i], self._bodies.own[i], self._bodies.movable[i] = packed, bounds_of(mesh), movable
        self._changed = True
        self._revision += 1
        return i

    def remove(self, i: int) -> None:
        """Remove an object; its id is not used again."""
        self.mesh(i)
        self._meshes[i] = None
        self._changed = True
        self._ignored = frozenset(key for key in self._ignored if i not in ids_of(key))
        self._ignored_surfaces = {pair: v for pair, v in self._ignored_surfaces.items() if i not in pair}
        self._enabled = {pair: v for pair, v in self._enabled.items() if i not in pair}
        self._forget(lambda a, b: i in (a, b))

    def _forget(self, outdated: Callable[[int, int], bool]) -> None:
        """Drop cached results of the outdated pairs (a, b), a < b, of objects; extended by subclasses."""
        self._revision += 1

    @property
    def objects(self) -> tuple[int, ...]:
        """The ids of all objects, ascending."""
        return tuple(i for i, mesh in enumerate(self._meshes) if mesh is not None)

    def mesh(self, i: int) -> SurfaceMesh:
        """Return the mesh of an object.

        Raises
        ------
        UnknownObjectError: there is no object of that id.
        """
        try:
            mesh = self._meshes[i] if 0 <= i < len(self._meshes) else None
        except TypeError:  # no number, or no whole one
            mesh = None
        if mesh is None:
            known = self.objects
            hint = f"ids are {known[0]} … {known[-1]}" if known else "there are none; add one first"
            raise UnknownObjectError(f"no object {i!r}; {hint}", i)
        return mesh

    def _require(self, ids: Iterable[int]) -> None:
        """Raise UnknownObjectError unless there are objects of all these ids."""
        meshes, n = self._meshes, len(self._meshes)
        for i in ids:
            if type(i) is not int or not 0 <= i < n or meshes[i] is None:
                self.mesh(i)

    def movable(self, i: int) -> bool:
        """Whether an object may move."""
        self.mesh(i)
        return bool(self._bodies.movable[i])

    # --- poses -------------------------------------------------------------------------------------------------------

    def pose(self, i: int) -> pin.SE3:
        """Return the pose of an object in the world frame."""
        self.mesh(i)
        return _poses.unpack(self._bodies.pose[i])

    def set_pose(self, i: int, pose: pin.SE3 | ArrayLike) -> None:
        """Move an object to a pose, `pinocchio.SE3` or (4, 4); also one that is not movable.

        Its version changes only if its pose does.

        Raises
        ------
        UnknownObjectError, PoseError: no such object; the pose is not a finite rigid motion.
        """
        mesh = self.mesh(i)
        before = self._bodies.pose[i].tobytes()
        matrix = getattr(pose, "homogeneous", None)
        if matrix is None or not self._broad.place(self._bodies, i, matrix, self.tolerance.rigid):
            packed = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
            self._bodies.pose[i], self._bodies.stale[i] = packed, True
        if self._bodies.pose[i].tobytes() != before:
            self._version[i] = self._next_version()
            self._revision += 1

    def set_poses(self, ids: Sequence[int] | NDArray[np.integer], poses: Sequence[pin.SE3] | ArrayLike) -> None:
        """Move many objects at once: all of them, or none if an error is raised.

        Parameters
        ----------
        poses: as many `pinocchio.SE3` as ids, or (n, 4, 4).

        Raises
        ------
        UnknownObjectError, PoseError: as `set_pose`; another number of poses than of ids.
        """
        if isinstance(poses, list) and len(ids) == len(poses) == 1:
            self.set_pose(ids[0], poses[0])
            return
        ids = ids.tolist() if isinstance(ids, np.ndarray) else list(ids)
        listed = poses if isinstance(poses, np.ndarray | Sequence) else [poses]
        if len(listed) != len(ids):
            raise PoseError(f"{len(ids)} ids take as many poses, (n, 4, 4), not {len(listed)}")
        packed, where = self.packed(ids, listed), np.array(ids, np.int64)
        moved = (packed.view(np.int64) != self._bodies.pose[where].view(np.int64)).any(axis=1)
        if not moved.any():
            return
        where = where[moved]
        self._bodies.pose[where] = packed[moved]
        self._bodies.stale[where] = True
        self._version[where] = version = self._next_version()
        self._revision += 1
        kinds = set(map(type, listed))
        if len(kinds) == 1 and hasattr(kinds.pop(), "homogeneous"):  # to copy poses is quicker than to make them
            copies = {i: pose.copy() for i, pose, other in zip(ids, listed, moved.tolist(), strict=True) if other}
            self._given = version, copies

    def packed(
        self, ids: Sequence[int], poses: Sequence[Any] | NDArray[np.float64], what: str = "object"
    ) -> NDArray[np.float64]:
        """Return (n, 12) poses, rotation by rows and translation in m, of as many objects; nothing is moved.

        Parameters
        ----------
        poses: n `pinocchio.SE3` or (4, 4), or one array (n, 4, 4).
        what: name of an object in errors.

        Raises
        ------
        UnknownObjectError, PoseError: no such object; a pose that is not a finite rigid motion.
        """
        self._require(ids)
        plain = poses if isinstance(poses, np.ndarray) else [getattr(pose, "homogeneous", pose) for pose in poses]
        try:
            matrices = np.ascontiguousarray(plain, np.float64)
        except (TypeError, ValueError):
            matrices = np.empty(0)
        if matrices.shape == (len(ids), 4, 4):
            packed, bad = self._broad.packed(matrices, self.tolerance.rigid)
            if bad < 0:
                return packed
        named = [(pose, f"{what} {i} ({self.mesh(i).name})", i) for i, pose in zip(ids, poses, strict=True)]
        return np.array([_poses.pack(*each, self.tolerance.rigid) for each in named]).reshape(-1, 12)

    def _next_version(self) -> int:
        self._moves += 1
        return self._moves

    @property
    def versions(self) -> NDArray[np.int64]:
        """(n,) by id: a number that changes whenever the object moves, never to an earlier value. Read only."""
        return self._version[: len(self._meshes)]

    @property
    def poses(self) -> tuple[pin.SE3, ...]:
        """The poses of all objects by id, world frame; each is the same `pin.SE3` until its object moves."""
        moves, known, versions = self._posed
        if moves == self._moves:
            return known
        now = self.versions
        if len(known) != len(now):
            known, versions = (), np.full(len(now), -1)
        poses: list[pin.SE3] = list(known) or [None] * len(now)
        version, given = self._given
        moved, copied = versions != now, now == version
        for i in np.flatnonzero(moved & copied).tolist():
            poses[i] = given[i]
        others = np.flatnonzero(moved & ~copied)
        for i, pose in zip(others.tolist(), _poses.unpack_all(self._bodies.pose[others]), strict=True):
            poses[i] = pose
        self._posed = self._moves, tuple(poses), now.copy()
        return self._posed[1]

    def packed_poses(self) -> NDArray[np.float64]:
        """Return a copy of the poses by id, (n, 12): rotation by rows, translation in m."""
        return self._bodies.pose[: len(self._meshes)].copy()

    @property
    def snapshot(self) -> ObjectsState:
        """Poses, groups and ignored pairs at this instant; assigning it undoes later changes of them.

        An object that moved in between gets a new version. Objects must not be added or removed in between.
        """
        self._shared = True
        group = self._bodies.group[: len(self._meshes)].copy()
        return ObjectsState(self.packed_poses(), self.versions.copy(), group, self._ignored, self._ignored_surfaces)

    @snapshot.setter
    def snapshot(self, there: ObjectsState) -> None:
        pose = self._bodies.pose[: len(there.poses)]
        # an interrupt may come between a pose and its version
        other = (pose.view(np.int64) != there.poses.view(np.int64)).any(axis=1)
        moved = np.flatnonzero(other | (self.versions != there.versions))
        pose[moved], self._bodies.stale[moved] = there.poses[moved], True
        self._version[moved] = self._next_version()
        self._bodies.group[: len(there.groups)] = there.groups
        self._ignored, self._ignored_surfaces, self._shared = there.ignored, there.ignored_surfaces, True
        self._enabled = {}
        self._changed = True
        self._forget(lambda i, j: True)

    def relative_pose(self, i: int, j: int) -> pin.SE3:
        """Return the pose of object j in the frame of object i, by which queries move the vertices of j."""
        self.mesh(i), self.mesh(j)
        return _poses.unpack(self._broad.relative_poses(self._bodies.pose, np.array([[i, j]], np.int32))[0])

    def world_boxes(self) -> NDArray[np.float64]:
        """Return (n, 6) least and greatest corners, m, of boxes in the world frame that contain the objects, by id.

        They are inflated by more than all rounding.
        """
        self._rebuild_broad_phase()
        self._broad.near(self._bodies, len(self._meshes), 0.0, None)
        return self._bodies.box[: len(self._meshes)]

    def _rebuild_broad_phase(self) -> None:
        """Rebuild the trees of the broad phase if objects were added or removed."""
        if self._changed:
            self._broad.rebuild(np.array(self.objects, np.int64), self._bodies)
            self._changed = False

    # --- enabled pairs -----------------------------------------------------------------------------------------------

    def ignore(self, i: int, j: int) -> None:
        """Leave a pair of objects out of every result until `enable(i, j)`."""
        self._ignored |= {key_of(*self._pair(i, j))}
        self._revision += 1

    def enable(self, i: int, j: int) -> None:
        """Undo `ignore(i, j)`."""
        self._ignored -= {key_of(*self._pair(i, j))}
        self._revision += 1

    def set_groups(self, groups: Iterable[Iterable[int]]) -> None:
        """Leave pairs of objects within each of these groups, which move as one, out of every result.

        The groups replace those set before; without groups all pairs are enabled again.

        Raises
        ------
        UnknownObjectError, CollisionError: no such object; an object in two groups, or twice in one.
        """
        listed = [[int(i) for i in group] for group in groups]
        for i in (members := [i for group in listed for i in group]):
            self.mesh(i)
        if len(set(members)) < len(members):
            raise CollisionError("an object is in two groups, or in one twice; give each once")
        self._broad.set_groups(self._bodies, listed)
        self._revision += 1

    def ignore_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Leave every pair of a surface of i in `surfaces_i` and one of j in `surfaces_j` out of every result."""
        pairs = self._products(i, surfaces_i, j, surfaces_j)
        self._leave_out(i, j, self.ignored_surfaces(i, j) | pairs, pairs, 0)

    def enable_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Undo `ignore_surfaces` for these pairs of surfaces."""
        pairs = self._products(i, surfaces_i, j, surfaces_j)
        self._leave_out(i, j, self.ignored_surfaces(i, j) - pairs, pairs, 1)

    def _leave_out(
        self, i: int, j: int, surfaces: frozenset[tuple[int, int]], changed: frozenset[tuple[int, int]], enabled: int
    ) -> None:
        """Set the pairs of surfaces of i and j to leave out; those in `changed` become `enabled` (0 or 1)."""
        if self._shared:
            self._ignored_surfaces, self._shared = dict(self._ignored_surfaces), False
        pair = self._pair(i, j)
        self._ignored_surfaces[pair] = surfaces
        for key in (pair, pair[::-1]):
            if (known := self._enabled.get(key)) is not None:
                self._enabled[key] = _with(known, changed, key == pair, enabled)
        self._forget(lambda a, b: (a, b) == pair)

    @property
    def ignores(self) -> bool:
        """Whether any pair of objects, or of their surfaces, may be left out."""
        return bool(self._ignored or self._ignored_surfaces)

    def ignored(self, i: int, j: int) -> bool:
        """Whether a pair of objects is left out as a whole, by `ignore` or as members of one group.

        Raises
        ------
        UnknownObjectError, CollisionError: no such object; one object twice.
        """
        pair, group = self._pair(i, j), self._bodies.group
        return key_of(*pair) in self._ignored or bool(group[i] >= 0 and group[i] == group[j])

    def ignored_surfaces(self, i: int, j: int) -> frozenset[tuple[int, int]]:
        """Return the pairs of surfaces left out, as (surface of the lower id, surface of the higher)."""
        return self._ignored_surfaces.get(self._pair(i, j), frozenset())

    def enabled_surfaces(self, i: int, j: int) -> NDArray[np.uint8] | None:
        """Return (ki, kj) uint8, 0 for each pair of surfaces of i and j to leave out; None if all are enabled."""
        left_out = self._ignored_surfaces.get(self._pair(i, j))
        if not left_out:
            return None
        enabled = self._enabled.get((i, j))
        if enabled is None:
            whole = np.ones((self.mesh(i).n_surfaces, self.mesh(j).n_surfaces), np.uint8)
            enabled = self._enabled[i, j] = _with(whole, left_out, i < j, 0)
        return enabled

    def _pair(self, i: int, j: int) -> tuple[int, int]:
        self.mesh(i), self.mesh(j)
        if i == j:
            raise CollisionError(f"object {i} twice; a pair needs two objects")
        return (i, j) if i < j else (j, i)

    def _products(
        self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]
    ) -> frozenset[tuple[int, int]]:
        si, sj = self._surfaces(i, surfaces_i), self._surfaces(j, surfaces_j)
        return frozenset((a, b) if i < j else (b, a) for a in si for b in sj)

    def _surfaces(self, i: int, surfaces: Iterable[int]) -> Sequence[int]:
        known = self.mesh(i).n_surfaces
        out = [int(s) for s in surfaces]
        for s in out:
            if not 0 <= s < known:
                raise CollisionError(f"object {i} ({self.mesh(i).name}) has no surface {s}; they are 0 … {known - 1}")
        return out


def _with(
    table: NDArray[np.uint8], pairs: frozenset[tuple[int, int]], ascending: bool, enabled: int
) -> NDArray[np.uint8]:
    """A read-only copy of a table of enabled pairs of surfaces in which `pairs` (low, high) are set to `enabled`."""
    table = table.copy()
    if pairs:
        low, high = np.array(list(pairs)).T
        table[(low, high) if ascending else (high, low)] = enabled
    table.setflags(write=False)
    return table


def key_of(i: int, j: int) -> int:
    """Return a pair of ids as one number, 2³²·i + j."""
    return i << 32 | j


def ids_of(key: int) -> tuple[int, int]:
    """Return the ids (i, j) of a key."""
    return key >> 32, key & 0xFFFFFFFF
