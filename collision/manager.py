"""`CollisionManager`: objects with poses in, colliding surfaces out. The one door, and the one place with state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision import poses as _poses
from collision.errors import CollisionError, UnknownObjectError
from collision.mesh import SurfaceMesh
from collision.query import Method, examine
from collision.shape import ShapeMesh, mesh_of_shape
from collision.statistics import Statistics
from collision.tolerance import Tolerance
from collision.tree import tree_of

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.sweep import TimeOfContact


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
        self.tolerance = tolerance if tolerance is not None else Tolerance()
        self.method: Method = method
        self.cross_check_every = 64 if cross_check is True else int(cross_check)
        self._meshes: list[SurfaceMesh | None] = []
        self._movable: list[bool] = []
        self._pose = np.empty((0, 12))
        self._ignored: set[tuple[int, int]] = set()
        self._ignored_surfaces: dict[tuple[int, int], set[tuple[int, int]]] = {}
        self._statistics = Statistics()
        self._answers = 0

    # --- objects -----------------------------------------------------------------------------------------------------

    def add(self, mesh: SurfaceMesh, pose: pin.SE3 | ArrayLike, movable: bool = True) -> int:
        """Add an object; its id. Objects that are not `movable` are not tested against one another."""
        i = len(self._meshes)
        packed = _poses.pack(pose, f"object {i} ({mesh.name})", i, self.tolerance.rigid)
        self._meshes.append(mesh)
        self._movable.append(movable)
        if i == len(self._pose):
            self._pose = np.concatenate([self._pose, np.empty((max(16, i), 12))])
        self._pose[i] = packed
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
        self._ignored = {pair for pair in self._ignored if i not in pair}
        self._ignored_surfaces = {pair: v for pair, v in self._ignored_surfaces.items() if i not in pair}

    @property
    def objects(self) -> tuple[int, ...]:
        """The ids there are, ascending."""
        return tuple(i for i, mesh in enumerate(self._meshes) if mesh is not None)

    def mesh(self, i: int) -> SurfaceMesh:
        """The mesh of an object."""
        mesh = self._meshes[i] if 0 <= i < len(self._meshes) else None
        if mesh is None:
            known = self.objects
            hint = f"ids are {known[0]} … {known[-1]}" if known else "there are none; add one first"
            raise UnknownObjectError(f"no object {i}; {hint}", i)
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

    def packed_poses(self, objects: Sequence[int]) -> NDArray[np.float64]:
        """(n, 12) poses of objects that there are: rotation by rows, then translation."""
        return self._pose[list(objects)]

    def relative_pose(self, i: int, j: int) -> pin.SE3:
        """The pose of object j in the frame of object i, by which its vertices are moved once."""
        self.mesh(i), self.mesh(j)
        return _poses.unpack(_poses.between(self._pose[i], self._pose[j]))

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

    def heed_surfaces(self, i: int, surfaces_i: Iterable[int], j: int, surfaces_j: Iterable[int]) -> None:
        """Take those pairs of surfaces back in."""
        self._ignored_surfaces.get(self._pair(i, j), set()).difference_update(
            self._products(i, surfaces_i, j, surfaces_j)
        )

    def ignored(self, i: int, j: int) -> bool:
        """Whether the pair of objects is left out as a whole."""
        return self._pair(i, j) in self._ignored

    def ignored_surfaces(self, i: int, j: int) -> frozenset[tuple[int, int]]:
        """The pairs of surfaces left out, as (surface of the lower id, surface of the higher)."""
        return frozenset(self._ignored_surfaces.get(self._pair(i, j), ()))

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
        """Stage 1, filter objects: (n, 2) pairs i < j, sorted, whose boxes come within `within` metres.

        Pairs of which neither may move or that are ignored are left out, and, if `objects` are given, pairs without
        one of them. Conservative: never misses a pair; may hold pairs whose triangles are farther apart.
        """
        chosen = None if objects is None else {i for i in objects if self.mesh(i) is not None}
        ids = self.objects
        boxes = {i: self._world_box(i, 0.5 * within) for i in ids}
        rows = [
            (i, j)
            for i, j in combinations(ids, 2)
            if (self._movable[i] or self._movable[j])
            and (chosen is None or i in chosen or j in chosen)
            and (i, j) not in self._ignored
            and (boxes[i][0] <= boxes[j][1]).all()
            and (boxes[j][0] <= boxes[i][1]).all()
        ]
        return np.array(rows, np.int32).reshape(-1, 2)

    def _has_shape(self, i: int, j: int) -> bool:
        return isinstance(self._meshes[i], ShapeMesh) or isinstance(self._meshes[j], ShapeMesh)

    def _method(self, i: int, j: int) -> Method:
        return "coal" if self._has_shape(i, j) else self.method

    def _world_box(self, i: int, margin: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        box = tree_of(self.mesh(i)).box[0]
        rotation, translation = self._pose[i, :9].reshape(3, 3), self._pose[i, 9:]
        centre = rotation @ (0.5 * (box[:3] + box[3:])) + translation
        half = np.abs(rotation) @ (0.5 * (box[3:] - box[:3])) + margin
        half += 1e-14 * (np.abs(translation).sum() + np.abs(box).sum())  # more than rounding can have moved it
        return centre - half, centre + half

    def colliding_surfaces(self, objects: Iterable[int] | None = None) -> NDArray[np.int32]:
        """All pairs of surfaces that meet, exactly: (k, 4) int32 rows object, surface, object, surface, sorted.

        objects: only pairs with at least one of these; None for all.
        """
        rows = [np.empty((0, 4), np.int32)]
        for i, j in self.object_pairs(objects).tolist():
            pose = self.relative_pose(i, j)
            pairs, cost = examine(self.mesh(i), self.mesh(j), pose, self._method(i, j))
            self._statistics += cost
            self._answers += 1
            if self.cross_check_every and self._answers % self.cross_check_every == 0 and not self._has_shape(i, j):
                from collision.oracle import cross_check

                cross_check(self.mesh(i), self.mesh(j), pose, pairs)
            left_out = self._ignored_surfaces.get((i, j))
            if left_out:
                pairs = pairs[[(a, b) not in left_out for a, b in pairs.tolist()]]
            block = np.empty((len(pairs), 4), np.int32)
            block[:, 0], block[:, 1], block[:, 2], block[:, 3] = i, pairs[:, 0], j, pairs[:, 1]
            rows.append(block)
        return np.concatenate(rows)

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
