"""`CollisionManager`: queries of objects at poses, with results cached between queries."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collision.contact import joined, picked
from collision.errors import CollisionError
from collision.mesh import SurfaceMesh
from collision.methods import METHODS, Method, examine
from collision.objects import Objects, ids_of, key_of
from collision.poses import pack_rigid
from collision.reference.shape import ShapeMesh, mesh_of_shape
from collision.statistics import Statistics
from collision.tolerance import Tolerance

if TYPE_CHECKING:
    import pinocchio as pin

    from collision.contact import TimeOfImpact

SAME_PLACE = 2.0**-30
"""m and 1: relative poses of instances that differ by less are one, for depths"""
CHECK_EVERY = 64
"""`cross_check=True` compares every result of this number with the oracle"""


class CollisionManager(Objects):
    """Objects, each a `SurfaceMesh` at a pose: their intersections, distances, depths and times of impact.

    Parameters
    ----------
    tolerance: distance of surfaces in contact, and accepted error of poses; intersections are exact and independent of
        it.
    method: of finding colliding surfaces, see `colliding_surfaces`.
    cross_check: True compares every 64th result for a pair of objects with the oracle, n every n-th; see
        `collision.reference.oracle`.

    Raises
    ------
    CollisionError: an unknown method, a negative `cross_check`.

    Results leave out, unless a method says otherwise, pairs of objects neither of which is movable, and the pairs given
    to `ignore` and `ignore_surfaces`. Rows are sorted by the ids of their objects and surfaces; objects i < j.
    """

    def __init__(
        self, tolerance: Tolerance | None = None, method: Method = "bvh", cross_check: bool | int = False
    ) -> None:
        if method not in METHODS:
            raise CollisionError(f"method {method!r}; known are {', '.join(METHODS)}")
        if int(cross_check) < 0:
            raise CollisionError(f"cross_check is {cross_check!r}; give True, False, or n to check every n-th answer")
        super().__init__(tolerance)
        self.method: Method = method
        self.cross_check_every = CHECK_EVERY if cross_check is True else int(cross_check)
        from collision.narrow_phase import NarrowPhase

        self._narrow = NarrowPhase()
        self._shapes = False  # whether any object is or was a shape without triangles
        self._last: tuple[int, NDArray[np.int32]] | None = None  # revision and rows of the last query of all objects
        self._statistics = Statistics()  # of queries outside the narrow phase, less the counts before a reset
        self._answers = 0

    def add(self, mesh: SurfaceMesh, pose: pin.SE3 | ArrayLike, movable: bool = True) -> int:
        """Add an object and return its id; see `Objects.add`."""
        i = super().add(mesh, pose, movable)
        self._shapes |= isinstance(mesh, ShapeMesh)
        return i

    def add_shape(self, shape: Any, pose: pin.SE3 | ArrayLike, movable: bool = True, name: str | None = None) -> int:
        """Add a coal primitive, convex hull, height field or octree as an object of one surface; return its id.

        Its queries are coal's, not exact; it has no penetration, contains nothing and is not swept. A height field
        becomes a mesh, to which none of this applies.

        Raises
        ------
        CollisionError: no such shape, or one without bounds.
        """
        return self.add(mesh_of_shape(shape, name), pose, movable)

    def _forget(self, outdated: Callable[[int, int], bool]) -> None:
        super()._forget(outdated)
        self._narrow.forget(outdated)

    def forget_nearest(self) -> None:
        """Make contacts and clearances independent of earlier queries, bit for bit.

        Otherwise, among triangles that are equally near up to rounding, a query finds those next to its last result.
        """
        self._narrow.forget_nearest()

    # --- colliding and near surfaces ---------------------------------------------------------------------------------

    def object_pairs(self, objects: Iterable[int] | None = None, within: float = 0.0) -> NDArray[np.int32]:
        """Return (n, 2) pairs of objects whose boxes and spheres come within `within` metres: the broad phase.

        Conservative: no pair is missing; some may be farther apart. objects: only pairs with at least one of these.

        Raises
        ------
        CollisionError: `within` is negative or no number.
        """
        _check_within(within)
        keys = self._near(objects, within)
        pairs = np.empty((len(keys), 2), np.int32)
        pairs[:, 0], pairs[:, 1] = keys >> 32, keys & 0xFFFFFFFF
        return pairs

    def _near(self, objects: Iterable[int] | None, within: float = 0.0) -> NDArray[np.int64]:
        """The keys of the pairs of objects, sorted."""
        n, chosen = len(self._meshes), None
        if objects is not None:
            chosen = np.zeros(n, np.bool_)
            ids = list(objects)
            self._require(ids)
            chosen[ids] = True
        self._rebuild_broad_phase()
        keys = self._broad.near(self._bodies, n, within, chosen)
        if self._ignored:
            keys = keys[[key not in self._ignored for key in keys.tolist()]]
        return keys

    def colliding_surfaces(self, objects: Iterable[int] | None = None) -> NDArray[np.int32]:
        """Return all pairs of surfaces that intersect, exactly: (k, 4) object, surface, object, surface.

        objects: only pairs with at least one of these; None for all.

        Pairs of objects neither of which has moved since the last call are not tested again. Two threads share the
        others if they are many; results do not depend on it.
        """
        if objects is None and self._last is not None and self._last[0] == self._revision:
            return self._last[1].copy()
        keys = self._near(objects).tolist()
        rows = self._rows(keys, self._intersecting, self._examined, self.method == "bvh")
        if len(self._narrow.pairs) > 4 * len(keys) + 1024 and objects is None:  # most cached pairs have moved apart
            near = set(keys)
            self._narrow.forget(lambda i, j: key_of(i, j) not in near)
        answer = np.concatenate(rows) if len(rows) > 1 else rows[0].copy() if rows else np.empty((0, 4), np.int32)
        if self.cross_check_every:
            self._cross_check(keys, rows)
        elif objects is None:
            self._last = self._revision, answer
            return answer.copy()
        return answer

    def _rows(
        self, keys: list[int], of_meshes: Callable[[list[int]], list[NDArray[Any]]],
        of_pair: Callable[[int, int], NDArray[Any]], bvh: bool = True,
    ) -> list[NDArray[Any]]:  # fmt: skip
        """The rows of each pair of objects: pairs of meshes by `of_meshes` if `bvh`, the others one by one."""
        if bvh and not self._shapes:
            return of_meshes(keys)
        meshes = [key for key in keys if bvh and not self._has_shape(*ids_of(key))]
        answers = dict(zip(meshes, of_meshes(meshes), strict=True))
        return [answers[key] if key in answers else of_pair(*ids_of(key)) for key in keys]

    def _has_shape(self, i: int, j: int) -> bool:
        return isinstance(self._meshes[i], ShapeMesh) or isinstance(self._meshes[j], ShapeMesh)

    def _intersecting(self, keys: list[int]) -> list[NDArray[np.int32]]:
        poses, enabled = self._bodies.pose, self.enabled_surfaces
        return self._narrow.intersecting(keys, self._meshes, self._version.data, poses, enabled)

    def _examined(self, i: int, j: int) -> NDArray[np.int32]:
        """The rows of a pair of objects by another method than the hierarchy."""
        method: Method = "coal" if self._has_shape(i, j) else self.method
        pairs, cost = examine(self.mesh(i), self.mesh(j), self.relative_pose(i, j), method, self.checked)
        self._statistics += cost
        enabled = self.enabled_surfaces(i, j)
        if enabled is not None:
            pairs = pairs[enabled[pairs[:, 0], pairs[:, 1]] != 0]
        rows = np.empty((len(pairs), 4), np.int32)
        rows[:, 0], rows[:, 2], rows[:, 1::2] = i, j, pairs
        return rows

    def _cross_check(self, keys: list[int], rows: list[NDArray[np.int32]]) -> None:
        from collision.reference.oracle import cross_check

        for key, answer in zip(keys, rows, strict=True):
            i, j = ids_of(key)
            self._answers += 1
            if self._answers % self.cross_check_every == 0 and not self._has_shape(i, j):
                pose, enabled = self.relative_pose(i, j), self.enabled_surfaces(i, j)
                cross_check(self.mesh(i), self.mesh(j), pose, answer[:, 1::2], enabled=enabled, tolerance=self.checked)

    def contacts(self, within: float = 0.0, objects: Iterable[int] | None = None) -> NDArray[Any]:
        """Return all pairs of surfaces at a distance of at most `within` metres, `CONTACT_DTYPE` rows, world frame.

        objects: only pairs with at least one of these; None for all. The distance of two surfaces is 0 if and only if
        `colliding_surfaces` returns them; both witness points are then one common point. A positive distance has the
        rounding error of float64 in the frame of object_a, about 1e-15 of the coordinates.

        Raises
        ------
        CollisionError: `within` is negative or no number.
        """
        _check_within(within)
        return self._contacts(self._near(objects, within).tolist(), float(within))

    def pair_contacts(self, i: int, j: int, within: float) -> NDArray[Any]:
        """Return the rows of `contacts` for one pair of objects, i < j, even if it is ignored."""
        return self._contacts([key_of(i, j)], float(within))

    def _contacts(self, keys: list[int], within: float) -> NDArray[Any]:
        def of_meshes(keys: list[int]) -> list[NDArray[Any]]:
            poses, enabled = self._bodies.pose, self.enabled_surfaces
            return self._narrow.contacts(keys, self._meshes, self._version.data, poses, enabled, within)

        def of_pair(i: int, j: int) -> NDArray[Any]:
            from collision.reference.oracle import surface_contacts

            pose, enabled = self.relative_pose(i, j), self.enabled_surfaces(i, j)
            return self._to_world(
                i, j, surface_contacts(self.mesh(i), self.mesh(j), pose, within, enabled, self.checked)
            )

        rows = joined(self._rows(keys, of_meshes, of_pair))
        near = rows["distance"] <= within
        return rows if near.all() else picked(rows, near)

    def _to_world(self, i: int, j: int, rows: NDArray[Any]) -> NDArray[Any]:
        pose = self.pose(i)
        rows["object_a"], rows["object_b"] = i, j
        for point in ("point_a", "point_b"):
            rows[point] = rows[point] @ pose.rotation.T + pose.translation
        return rows

    # --- queries of two objects --------------------------------------------------------------------------------------

    def clearance(self, i: int, j: int, surface_i: int | None = None, surface_j: int | None = None) -> NDArray[Any]:
        """Return one `CONTACT_DTYPE` row: the least distance of two objects, or of a surface of either, world frame.

        `object_a` is the lower of the two ids. Ignored pairs are included. The distance is that of the surfaces: 0 if
        they intersect, positive for an object wholly inside another (see `contains`).

        Raises
        ------
        UnknownObjectError, CollisionError: no such object or surface; one object twice.
        """
        self._pair(i, j)
        if i > j:
            i, j, surface_i, surface_j = j, i, surface_j, surface_i
        for k, surface in ((i, surface_i), (j, surface_j)):
            if surface is not None:
                self._surfaces(k, (surface,))
        surfaces = surface_i, surface_j
        if self._has_shape(i, j):
            from collision.reference.oracle import clearance

            row = clearance(self.mesh(i), self.mesh(j), self.relative_pose(i, j), *surfaces, self.checked)
            return self._to_world(i, j, row)
        return self._narrow.clearance(key_of(i, j), self._meshes, self._bodies.pose, self.enabled_surfaces, surfaces)

    def contains(self, i: int, j: int) -> bool:
        """Whether object j lies wholly inside object i, no surfaces intersecting; see `query.containment.contains`."""
        from collision.query.containment import contains

        return contains(self, i, j)

    def penetration(self, i: int, j: int) -> NDArray[Any]:
        """Return `PENETRATION_DTYPE` rows, one a pair of surfaces that intersect; see `query.penetration`."""
        from collision.query.penetration import penetration

        return penetration(self, i, j)

    def penetrations(
        self, pairs: Iterable[Sequence[int]], limit: Callable[[int, int], ArrayLike] = lambda i, j: 0.0
    ) -> Iterator[NDArray[Any]]:
        """Yield the rows of `penetration` of each pair (i, j) of objects, i < j, computed on all cores meanwhile.

        Instances of two meshes that are placed alike relative to one another share what is found.

        limit: m, of two objects, by surface of i and surface of j, or one for all: depths above it are told from those
        below, and need not be known better than to this where that takes long; see `query.penetration`.
        """
        from collision.query.penetration import penetration
        from collision.solid import solid_of

        wanted = [(i, j) for i, j in pairs]
        for k in sorted({k for pair in wanted for k in pair}):
            solid_of(self.mesh(k))  # derived once, not by two threads
        limits = [np.asarray(limit(i, j), np.float64) for i, j in wanted]
        alike: dict[Any, list[int]] = {}
        for k, (i, j) in enumerate(wanted):
            placed = np.round(self.relative_pose(i, j).homogeneous / SAME_PLACE) + 0.0  # no -0
            alike.setdefault((self.mesh(i), self.mesh(j), placed.tobytes(), limits[k].tobytes()), []).append(k)

        def of_group(members: list[int]) -> list[NDArray[Any]]:
            known: dict[tuple[int, int], NDArray[np.float64]] = {}
            return [penetration(self, *wanted[k], limits[k], known) for k in members]

        pool = ThreadPoolExecutor(os.cpu_count(), "penetration")
        try:
            groups = [(members, pool.submit(of_group, members)) for members in alike.values()]
            place = {k: (group, n) for members, group in groups for n, k in enumerate(members)}
            for k in range(len(wanted)):
                group, n = place[k]
                yield group.result()[n]
        finally:
            pool.shutdown(cancel_futures=True)

    def signed_distances(
        self, i: int, j: int, surfaces: ArrayLike, within: float = 0.0, at: pin.SE3 | None = None
    ) -> NDArray[np.float64]:
        """Return (n,) signed distances, m, at most `within`, of pairs (n, 2) of surfaces of i and of j.

        Negative where surfaces meet: minus the shortest translation that separates two of their triangles. at: pose of
        j in the frame of i instead of the present one. Ignored pairs are included.
        """
        from collision.bvh.build import bvh_of
        from collision.query.signed_distance import signed_distances_of

        pose = pack_rigid(self.relative_pose(i, j) if at is None else at)
        return signed_distances_of(bvh_of(self.mesh(i)), bvh_of(self.mesh(j)), pose, np.asarray(surfaces), within)

    def time_of_impact(self, moves: Mapping[int, pin.SE3], deflection: float = 0.0) -> TimeOfImpact:
        """Return the first impact while objects move to their target poses; see `query.time_of_impact`."""
        from collision.query.time_of_impact import time_of_impact

        return time_of_impact(self, moves, deflection)

    # --- counts ------------------------------------------------------------------------------------------------------

    @property
    def statistics(self) -> Statistics:
        """Counts of all queries since construction, or since `reset_statistics()`."""
        return self._statistics + self._narrow.statistics

    def reset_statistics(self) -> None:
        """Set all counts to 0."""
        self._statistics = Statistics() - self._narrow.statistics


def _check_within(within: float) -> None:
    if not within >= 0.0:
        raise CollisionError(f"within is {within!r}; give a distance of at least 0 m")
