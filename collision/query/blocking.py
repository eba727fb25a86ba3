"""Sweeps of pairs of objects along given motions: which object blocks which.

A motion is a list of knots, world displacements of the moving object from where it stands, the first the identity; from
one knot to the next it goes along one screw (the SE(3) geodesic, less than half a turn). Each pair of objects is swept
by itself, so that a row of the table stays true whatever other objects are there (Wilson & Latombe, "Geometric
reasoning about mechanical assembly", Artificial Intelligence 71, 1994: the non-directional blocking graph, of finite
motions here instead of infinitesimal ones).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from collision.manager import CollisionManager
from collision.mesh import SurfaceMesh
from collision.query import revolution
from collision.query.front import buried, front_of, part_of, triangle_depths
from collision.tolerance import Tolerance

if TYPE_CHECKING:
    import pinocchio as pin

Array = NDArray[np.float64]
SurfacePairs = tuple[tuple[int, ...], tuple[int, ...]]
"""surfaces of the moving object, surfaces of the static object: every pair of one of the first and one of the second"""
Excuse = Callable[[int, int, "pin.SE3", "pin.SE3"], Iterable[SurfacePairs] | None]
"""callback(moving, static, displacement at the start of a leg, at its end): the surface pairs excluded on this leg, or
None if the pair blocks the leg at its start"""
PRESSED = 10.0
"""1: of the tolerance's slop: largest additional penetration on a path, for any number of legs"""
PRESSED_ON_A_LEG = 1.5
"""1: of the slop: largest penetration added by one sweep (see `collision.query.time_of_impact`)"""
PRESSED_BY_GRAZING = 2.0
"""1: of the slop: largest penetration added at a graze"""
GRAZES = 64
"""contacts grazed on a leg before it counts as stopped"""
STILL = 1e-3
"""1: of the tolerance: triangles that move less along their normal on a leg are not part of the front"""
SOON = 16.0
"""1: of the tolerance: travel after which a face that has passed through the face that it touched is seen inside"""
FEW = 64
"""vertices of a mesh that are kept without its convex hull being computed"""
MOST_EXTENTS = 4096
"""directions along which extents are kept"""
SIDES = 8
"""directions perpendicular to a straight path along which shadows are compared"""


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """A stop of one object by another on its path."""

    leg: int
    """the leg between knots `leg` and `leg + 1`"""
    t: float
    """fraction of that leg, in [0, 1), up to which all distances stay admissible"""
    contacts: NDArray[Any]
    """CONTACT_DTYPE rows of the blocking surface pairs, `object_a` moving; empty if `excuse` returned None"""


@dataclass(frozen=True, slots=True, eq=False)
class _Front:
    """The front of one of two objects on a leg."""

    side: int
    """0: front of the moving object; 1: of the static object in the moving object's frame"""
    part: SurfaceMesh
    solid: SurfaceMesh
    """the whole other object"""
    triangles: NDArray[np.int64]
    surfaces: NDArray[np.int32]
    """of the whole object, by those of `part`"""
    excused: tuple[SurfacePairs, ...]
    """surfaces of `part`, surfaces of `solid` that are left out"""


@dataclass(frozen=True, slots=True, eq=False)
class _Swept:
    """The two meshes of one sweep, and their penetration depths at the initial poses."""

    i: int
    j: int
    world: CollisionManager
    """object 0 moves, object 1 is static"""
    depths_of: Callable[[CollisionManager], dict[tuple[int, int], float]]
    """penetration depth by pair of intersecting surfaces of a world, m"""
    drawn: Callable[[], dict[tuple[int, int], float]]
    """the same at the initial poses"""
    key: Any = None
    """cache key of a sweep of whole objects"""
    front: _Front | None = None
    """the swept part of one object, if it is not whole"""

    def contacts_of(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Convert contacts of the world to contacts of the whole objects i and j."""
        out = rows.copy()
        out["object_a"], out["object_b"] = self.i, self.j
        if self.front is not None:
            which = "ab"[self.front.side]
            out[f"triangle_{which}"] = self.front.triangles[out[f"triangle_{which}"]]
            out[f"surface_{which}"] = self.front.surfaces[out[f"surface_{which}"]]
        return out


class Sweeps:
    """Sweeps of pairs of objects from their initial poses.

    Parameters
    ----------
    meshes, poses: of the objects, in the order of their ids.
    tolerance: `linear` is the least distance of surfaces that are apart, m; `slop` the fraction of it by which surfaces
        in contact may penetrate further on one leg (see `collision.query.time_of_impact`).
    excuse: returns the surface pairs excluded on each leg.
    """

    def __init__(
        self,
        meshes: Sequence[SurfaceMesh],
        poses: Sequence[pin.SE3],
        tolerance: Tolerance,
        excuse: Excuse = lambda i, j, start, end: (),
    ) -> None:
        self.meshes, self.poses, self.tolerance, self.excuse = tuple(meshes), tuple(poses), tolerance, excuse
        self.count = 0
        """legs swept so far"""
        hulls: dict[int, Array] = {id(m): _hull(m) for m in self.meshes}
        self._corners = [hulls[id(m)] for m in self.meshes]
        self._placed = np.concatenate([self.corners(i) for i in range(len(self.meshes))] or [np.zeros((0, 3))])
        self._first = np.cumsum([0, *map(len, self._corners)])[:-1]
        """of each object, its first row of `_placed`"""
        self._worlds: dict[tuple[Any, ...], CollisionManager] = {}
        pressed = tolerance.slop * tolerance.linear
        self._precision = CollisionManager(replace(tolerance, linear=pressed / tolerance.depth))
        """holds the precision of depths: a slop, and `Tolerance.depth` of themselves"""
        self._boxes: dict[tuple[int, int], tuple[Sequence[pin.SE3], Array, Array]] = {}
        self._start: dict[tuple[int, int], dict[tuple[int, int], float]] = {}
        self._depths_met: dict[tuple[int, int], dict[tuple[int, int], float]] = {}
        self._overlaps: dict[tuple[Any, ...], SurfacePairs] = {}
        self._begins: dict[tuple[Any, ...], bool] = {}
        self._extents: dict[bytes, Array] = {}
        self._turns: dict[int, tuple[Sequence[pin.SE3], Any, dict[int, Array]]] = {}
        """by identity of knots: the knots, their screw axis, and by object its profile about it"""

    def with_tolerance(self, tolerance: Tolerance) -> Sweeps:
        """The same objects with another tolerance; caches that do not depend on it are shared."""
        out = copy(self)
        out.tolerance, out.count = tolerance, 0
        out._worlds, out._boxes, out._start, out._depths_met, out._overlaps, out._begins = {}, {}, {}, {}, {}, {}
        return out

    def extent(self, i: int, direction: Array) -> tuple[float, float]:
        """(least, greatest) coordinate of object i at its initial pose along a world direction (3,), m."""
        low, high = self.extents(direction)[:, i].tolist()
        return low, high

    def extents(self, direction: Array) -> Array:
        """(2, n) least and greatest coordinates of all objects at their initial poses along a direction, m. Cached."""
        key = np.ascontiguousarray(direction).tobytes()
        if key not in self._extents:
            if len(self._extents) >= MOST_EXTENTS:
                self._extents.clear()
            heights = self._placed @ direction
            reduced = (ufunc.reduceat(heights, self._first) for ufunc in (np.minimum, np.maximum))
            self._extents[key] = np.stack(list(reduced))
        return self._extents[key]

    def corners(self, i: int) -> Array:
        """(n, 3) vertices of the convex hull of object i at its initial pose, world, m."""
        return np.asarray(self._corners[i] @ self.poses[i].rotation.T + self.poses[i].translation)

    def length_until_apart(self, i: int, j: int, direction: Array) -> float:
        """Path length of i along a unit direction until a perpendicular plane separates it from j, m; 0 if it does."""
        return max(0.0, self.extent(j, direction)[1] - self.extent(i, direction)[0])

    def shadows_meet(self, i: int, j: int, direction: Array) -> bool:
        """Whether j may lie in the shadow of i along a direction; False is certain, and i then passes j."""
        return bool(self._shadowed(i, direction)[j])

    def _shadowed(self, i: int, direction: Array) -> NDArray[np.bool_]:
        """(n,) the objects whose shadows may meet that of i."""
        out = np.ones(len(self.meshes), bool)
        for side in _across(direction):
            low, high = self.extents(side)
            out &= (low[i] <= high + self.tolerance.linear) & (low <= high[i] + self.tolerance.linear)
        return out

    def ahead(self, i: int, direction: Array) -> NDArray[np.intp]:
        """The objects that i may meet on a straight path along a direction; it certainly passes all others."""
        low, high = self.extents(direction)
        out = self._shadowed(i, direction) & (high > low[i])
        out[i] = False
        return np.flatnonzero(out)

    def beside(self, i: int, knots: Sequence[pin.SE3]) -> NDArray[np.intp]:
        """The objects whose boxes meet the box of i on a path; it certainly passes all others."""
        low, high = self._whole_box(i, knots)
        lows, highs = np.stack([self.extents(axis) for axis in np.eye(3)], axis=2)
        out = (low <= highs).all(axis=1) & (lows <= high).all(axis=1)
        out[i] = False
        return np.flatnonzero(out)

    def stop(
        self, i: int, j: int, knots: Sequence[pin.SE3], besides: tuple[SurfacePairs, ...] = (), graze: bool = True
    ) -> Stop | None:
        """The first stop of object i by static object j along `knots`; None if it reaches the end.

        besides: surface pairs excluded on every leg.
        graze: whether surfaces may come nearer than the tolerance if they part again at once. If not, None proves that
        surfaces that begin apart stay apart by the tolerance less its slop.
        """
        near = True
        if len(knots) > 2:  # of one leg the box is looked at below
            near = self.box_meets(j, *self._whole_box(i, knots))
            if near:
                besides = (*besides, *self._clear_of_turn(i, j, knots))
        for leg, (start, end) in enumerate(pairwise(knots)):
            left_out = self.excuse(i, j, start, end)
            if left_out is None:
                return Stop(leg, 0.0, _none())
            if not near or not self.boxes_meet(i, j, start, end):
                continue
            found = self._leg(i, j, start, end, tuple(left_out), besides, graze)
            if found is not None:
                return Stop(leg, *found)
        return None

    def _leg(
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, fits: tuple[SurfacePairs, ...],
        besides: tuple[SurfacePairs, ...], graze: bool,
    ) -> tuple[float, NDArray[Any]] | None:  # fmt: skip
        """The first stop of i on one leg, (fraction, contacts); None without one.

        Objects that overlap as drawn may move if the overlap shrinks, seen from either object.
        """
        left_out = *fits, *besides
        if not (graze and any(self.overlap(i, j, fits))):
            key = i, j, left_out
            whole = _Swept(i, j, self._world(*key), self._depths_of, lambda: self.depths(i, j), key)
            found = self._swept(whole, start, end, graze)
            if graze and self._pass_unseen(i, j, start, end, found, left_out):
                return self._at_once(i, j, start, left_out)
            return found
        seen_from_j = self._shrinks(i, j, 0, start, end, left_out)
        if seen_from_j is None:
            return None
        seen_from_i = self._shrinks(i, j, 1, start, end, left_out)
        return None if seen_from_i is None else max(seen_from_j, seen_from_i, key=lambda found: found[0])

    def _swept(self, swept: _Swept, start: pin.SE3, end: pin.SE3, graze: bool) -> tuple[float, NDArray[Any]] | None:
        """The first stop on one leg, (fraction, contacts); None without one.

        A sweep stops at contact, also where coplanar edges slide past each other. If `graze`, it is restarted twice the
        tolerance farther, provided no pair is deeper there than at the initial poses. Objects thinner than that may be
        passed.
        """
        import pinocchio as pin

        world, home = swept.world, self.poses[swept.i]
        way = pin.log6(start.actInv(end))
        # no pair is pressed yet, or only pairs that are apart count
        first = not graze or (start.isIdentity(0.0) and swept.front is None)
        if not first and not self._may_begin(swept, start):
            return 0.0, swept.contacts_of(world.contacts(self.tolerance.linear))
        speed = self._speed(swept.i, start, end)
        step = 2.0 * self.tolerance.linear / speed if speed > 0.0 else 1.0
        at, passed = 0.0, False
        for _ in range(GRAZES):
            begin = start * pin.exp6(way * at)
            world.set_pose(0, begin * home)
            self.count += 1
            found = world.time_of_impact({0: end * home})
            passed = not found.hit
            if passed:
                break
            t = at + (1.0 - at) * float(found.t)
            at = min(t + step, 1.0)
            if not graze:
                break
            if at < 1.0 and self._meets_squarely(
                swept, start * pin.exp6(way * t), np.asarray(way) * step, found.contacts
            ):
                break
            there = end if at == 1.0 else start * pin.exp6(way * at)
            if not self._no_deeper(swept, there, PRESSED_BY_GRAZING):
                break
            passed = at == 1.0
            if passed:
                break
        # a displacement from which no leg may begin is not entered
        if first or self._may_begin(swept, end if passed else start * pin.exp6(way * t)):
            return None if passed else (t, swept.contacts_of(found.contacts))
        return 0.0, swept.contacts_of(world.contacts(self.tolerance.linear))

    def _may_begin(self, swept: _Swept, at: pin.SE3) -> bool:
        """Whether a leg may begin at a displacement: no pair is pressed by more than `PRESSED` allows. Cached."""
        key = swept.key, at.homogeneous.tobytes()
        if swept.key is None or key not in self._begins:
            found = self._no_deeper(swept, at, PRESSED - PRESSED_ON_A_LEG)
            if swept.key is None:
                return found
            self._begins[key] = found
        return self._begins[key]

    # -- overlaps as drawn

    def overlap(self, i: int, j: int, left_out: tuple[SurfacePairs, ...] = ()) -> SurfacePairs:
        """The surfaces of i deeper in j than the tolerance at the initial poses, and those of j in i. Cached.

        left_out: surface pairs whose mutual penetration does not count. An object wholly inside the other, without an
        intersection of surfaces, does not overlap it: it is enclosed.
        """
        key = i, j, left_out
        if key not in self._overlaps:
            met = self._met(i, j)
            deep = {pair for pair, depth in met.items() if depth > self.tolerance.linear} - products(left_out)
            mine, theirs = {a for a, _ in deep}, {b for _, b in deep}
            if met:
                pose, least = self.poses[j].actInv(self.poses[i]), self.tolerance.linear
                back = tuple((b, a) for a, b in left_out)
                mine.update(buried(self.meshes[i], self.meshes[j], pose, least, left_out).tolist())
                theirs.update(buried(self.meshes[j], self.meshes[i], pose.inverse(), least, back).tolist())
            self._overlaps[key] = tuple(sorted(mine)), tuple(sorted(theirs))
        return self._overlaps[key]

    def _met(self, i: int, j: int) -> dict[tuple[int, int], float]:
        """`triangle_depths` at the initial poses. Cached."""
        if (i, j) not in self._depths_met:
            world = self._world(i, j, ())
            world.set_pose(0, self.poses[i])
            self._depths_met[i, j] = triangle_depths(world)
        return self._depths_met[i, j]

    def _pass_unseen(
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, found: tuple[float, NDArray[Any]] | None,
        left_out: tuple[SurfacePairs, ...],
    ) -> bool:  # fmt: skip
        """Whether faces that touch at the start of a leg are inside the other object soon after, or at its end.

        Distances do not show that two faces have passed through each other: faces of one outline meet nothing beyond,
        and the intersecting surfaces beside them may be excluded.
        """
        world = self._world(i, j, left_out)
        world.set_pose(0, start * self.poses[i])
        rows = world.contacts(self.tolerance.linear)
        for side, name in enumerate(("surface_a", "surface_b")) if len(rows) else ():
            front = self._front(i, j, side, start, end, left_out, rows[name])
            if front is not None and self._comes_inside(i, j, front, start, end, found):
                return True
        return False

    def _shrinks(
        self, i: int, j: int, side: int, start: pin.SE3, end: pin.SE3, left_out: tuple[SurfacePairs, ...]
    ) -> tuple[float, NDArray[Any]] | None:
        """The first time on a leg at which the overlap of i and j grows, seen from j (side 0) or i (side 1), and the
        contacts; None if it never grows.

        The front of the moving object is swept against the whole other object, and must begin outside it.
        """
        front = self._front(i, j, side, start, end, left_out)
        if front is None:
            return None
        if self._is_inside(i, j, front, start):
            return self._at_once(i, j, start, left_out)
        world = CollisionManager(self.tolerance)
        for mesh, k in zip((front.part, front.solid)[:: -1 if side else 1], (i, j), strict=True):
            world.add(mesh, self.poses[k])
        for mine, theirs in front.excused:
            world.ignore_surfaces(side, mine, 1 - side, theirs)
        drawn = {pair: d for pair, d in triangle_depths(world).items() if d <= self.tolerance.linear}
        swept = _Swept(i, j, world, triangle_depths, lambda: drawn, None, front)
        found = self._swept(swept, start, end, True)
        if self._comes_inside(i, j, front, start, end, found):
            return self._at_once(i, j, start, left_out)
        return found

    def _front(
        self, i: int, j: int, side: int, start: pin.SE3, end: pin.SE3, left_out: tuple[SurfacePairs, ...],
        surfaces: NDArray[np.integer] | None = None,
    ) -> _Front | None:  # fmt: skip
        """The front of i (side 0), or of j in the frame of i (side 1), on a leg; None if it is empty.

        surfaces: the only surfaces considered; None for all.
        """
        import pinocchio as pin

        way = pin.log6(start.actInv(end))
        if side == 0:
            mesh, solid, twist, pairings = self.meshes[i], self.meshes[j], self.poses[i].actInv(way), left_out
        else:
            mesh, solid, twist = self.meshes[j], self.meshes[i], -self.poses[j].actInv(start.act(way))
            pairings = tuple((theirs, mine) for mine, theirs in left_out)
        among = None if surfaces is None else np.flatnonzero(np.isin(mesh.surface_of_triangle, surfaces))
        triangles = front_of(mesh, twist.linear, twist.angular, STILL * self.tolerance.linear, among)
        if not len(triangles):
            return None
        part, of = part_of(mesh, triangles)
        place = {s: k for k, s in enumerate(of.tolist())}
        excused = [(tuple(place[s] for s in mine if s in place), theirs) for mine, theirs in pairings]
        return _Front(side, part, solid, triangles, of, tuple(pair for pair in excused if pair[0]))

    def _comes_inside(
        self, i: int, j: int, front: _Front, start: pin.SE3, end: pin.SE3, found: tuple[float, NDArray[Any]] | None
    ) -> bool:
        """Whether part of a front that begins outside the other object is inside it soon after, or where it stops."""
        import pinocchio as pin

        reached = _reached(start, end, found)
        if self._is_inside(i, j, front, reached):
            return True
        speed = self._speed(i, start, end)
        soon = SOON * self.tolerance.linear / speed if speed > 0.0 else 1.0
        if soon >= (1.0 if found is None else found[0]):
            return False
        return self._is_inside(i, j, front, start * pin.exp6(pin.log6(start.actInv(end)) * soon))

    def _is_inside(self, i: int, j: int, front: _Front, at: pin.SE3) -> bool:
        """Whether part of a front is deeper inside the other object than the tolerance, i displaced by `at`."""
        pose = self.poses[j].actInv(at * self.poses[i])
        pose = pose.inverse() if front.side else pose
        return bool(len(buried(front.part, front.solid, pose, self.tolerance.linear, front.excused)))

    def _at_once(
        self, i: int, j: int, start: pin.SE3, left_out: tuple[SurfacePairs, ...]
    ) -> tuple[float, NDArray[Any]]:
        """A stop at the start of a leg with the contacts there; with excluded pairs if there are no others."""
        for world in (self._world(i, j, left_out), self._world(i, j, ())):
            world.set_pose(0, start * self.poses[i])
            rows = world.contacts(self.tolerance.linear)
            rows["object_a"], rows["object_b"] = i, j
            if len(rows):
                break
        return 0.0, rows

    def _speed(self, i: int, start: pin.SE3, end: pin.SE3) -> float:
        """Upper bound of the path length of the points of i on a leg, m."""
        import pinocchio as pin

        way = np.asarray(pin.log6(start.actInv(end)))
        return float(np.linalg.norm(way[:3] + _box_corners(self._box(i)) @ pin.skew(way[3:]).T, axis=1).max())

    def _meets_squarely(self, swept: _Swept, at: pin.SE3, way: Array, rows: NDArray[Any]) -> bool:
        """Whether facets that face each other with a shared area collide on the next piece `way` (6,) of a leg.

        Then the group is stopped without measuring depths.
        """
        slack = self.tolerance.slop * self.tolerance.linear
        pose, static = at * self.poses[swept.i], self.poses[swept.j]
        mine, theirs = swept.world.mesh(0), swept.world.mesh(1)
        for row in rows[:4]:
            a = mine.vertices[mine.triangles[row["triangle_a"]]] @ pose.rotation.T + pose.translation
            b = theirs.vertices[theirs.triangles[row["triangle_b"]]]
            b = b @ static.rotation.T + static.translation
            d = float(row["distance"])
            n = _cross(a[1] - a[0], a[2] - a[0]) if d <= slack else row["point_b"] - row["point_a"]
            length = float(np.linalg.norm(n))
            if length == 0.0:
                continue
            n = n / length
            speed = at.rotation @ (way[:3] + _cross(way[3:], at.actInv(np.array(row["point_a"])))) @ n
            # a facet that is met from behind, inside its object, is left; where they touch, they lie in one plane
            facing = _cross(a[1] - a[0], a[2] - a[0]) @ n > 0.0 > _cross(b[1] - b[0], b[2] - b[0]) @ n
            flush = facing and (d > slack or np.abs((b - a[0]) @ n).max() <= slack)
            if speed - d <= 2.0 * slack or not (flush and _lies_across(a, n) and _lies_across(b, n)):
                continue
            u = _cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
            u /= np.linalg.norm(u)
            flat = np.stack([u, _cross(n, u)], axis=1)
            a, b = a @ flat, b @ flat
            longest = min(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
            if _shared_area(a, b) > 10.0 * self.tolerance.linear * longest:  # more than a strip along an edge
                return True
        return False

    def _no_deeper(self, swept: _Swept, at: pin.SE3, slops: float) -> bool:
        """Whether no surfaces of i, displaced by `at`, and j are deeper than initially by more than `slops` slops."""
        known, world = swept.drawn(), swept.world  # before the pose is set: it may be the same world
        world.set_pose(0, at * self.poses[swept.i])
        if not len(world.colliding_surfaces()):
            return True
        slack = slops * self.tolerance.slop * self.tolerance.linear
        return all(depth <= known.get(pair, 0.0) + slack for pair, depth in swept.depths_of(world).items())

    def depths(self, i: int, j: int) -> dict[tuple[int, int], float]:
        """Penetration depth by surface of i and surface of j at the initial poses, m. Cached."""
        if (i, j) not in self._start:
            world = self._world(i, j, ())
            world.set_pose(0, self.poses[i])
            self._start[i, j] = self._depths_of(world)
        return self._start[i, j]

    def _depths_of(self, world: CollisionManager) -> dict[tuple[int, int], float]:
        """Depths of `CollisionManager.penetration` by surface of object 0 and of object 1, m, without directions.

        Directions take most of the time where many surfaces only touch.
        """
        from collision.query.intersection import enabled_pairs
        from collision.query.penetration import deepest_points

        pairs = enabled_pairs(world, 0, 1)
        if not len(pairs):
            return {}
        meshes, pose = (world.mesh(0), world.mesh(1)), world.relative_pose(0, 1)
        depths = deepest_points(self._precision, meshes, pose, pairs)[:, 0]
        return dict(zip(map(tuple, pairs.tolist()), depths.tolist(), strict=True))

    def _clear_of_turn(self, i: int, j: int, knots: Sequence[pin.SE3]) -> tuple[SurfacePairs, ...]:
        """Pairs of surfaces that stay farther apart than the tolerance on a path that turns about one axis."""
        if id(knots) not in self._turns:
            size = float(np.abs(self._box(i)).max())
            self._turns[id(knots)] = knots, revolution.screw_axis(knots, size), {}
        _, found, profiles = self._turns[id(knots)]
        if found is None:
            return ()
        origin, axis, travel = found
        for k in (i, j):
            if k not in profiles:
                profiles[k] = revolution.profile(self.meshes[k], self.poses[k], origin, axis)
        both, within = (self.meshes[i], self.meshes[j]), 2.0 * self.tolerance.linear
        clear = revolution.least_gaps(*both, (profiles[i], profiles[j]), travel, within) > self.tolerance.linear
        return tuple(((a,), tuple(np.flatnonzero(row).tolist())) for a, row in enumerate(clear) if row.any())

    def near(
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, within: float, besides: tuple[SurfacePairs, ...] = ()
    ) -> NDArray[Any]:
        """CONTACT_DTYPE rows, world, of i displaced by `start` with j at most `within` m apart; `object_a` is i.

        Excluded are the pairs of `excuse` for the leg to `end`, and `besides`.
        """
        world = self._world(i, j, (*(self.excuse(i, j, start, end) or ()), *besides))
        world.set_pose(0, start * self.poses[i])
        rows = world.contacts(within)
        rows["object_a"], rows["object_b"] = i, j
        return rows

    def straight(self, i: int, j: int, direction: Array, margin: float) -> Stop | None:
        """The stop of i by j on a straight path along a unit direction until a plane separates them by `margin` m."""
        import pinocchio as pin

        far = self.length_until_apart(i, j, direction)
        if far == 0.0 or not self.shadows_meet(i, j, direction):
            identity = pin.SE3.Identity()  # no sweep is needed, but the pair may be held together
            held = self.excuse(i, j, identity, pin.SE3(np.eye(3), margin * direction)) is None
            return Stop(0, 0.0, _none()) if held else None
        return self.stop(i, j, (pin.SE3.Identity(), pin.SE3(np.eye(3), (far + margin) * direction)))

    def table(self, directions: Sequence[Array], margin: float) -> NDArray[np.bool_]:
        """(k, n, n) bool: whether object j blocks object i on its straight path along direction k.

        directions: (3,) unit vectors. Opposite directions cost one sweep per pair: their matrices are transposed.
        """
        n = len(self.meshes)
        out = np.zeros((len(directions), n, n), bool)
        for k, direction in enumerate(directions):
            twin = next((m for m in range(k) if np.array_equal(directions[m], -direction)), None)
            if twin is not None:
                out[k] = out[twin].T
                continue
            for i in range(n):
                for j in range(n):
                    out[k, i, j] = i != j and self.straight(i, j, direction, margin) is not None
        return out

    def boxes_meet(self, i: int, j: int, start: pin.SE3, end: pin.SE3) -> bool:
        """Whether the swept box of i on one leg, with the tolerance, meets the box of j."""
        return self.box_meets(j, *self._leg_box(i, start, end))

    def _leg_box(self, i: int, start: pin.SE3, end: pin.SE3) -> tuple[Array, Array]:
        """Corners of a box around i on a leg, inflated by the tolerance and the sagitta of the arcs."""
        import pinocchio as pin

        at = self.corners(i) if len(self._corners[i]) <= 64 else _box_corners(self._box(i))
        first, last = at @ start.rotation.T + start.translation, at @ end.rotation.T + end.translation
        turn = float(np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)))
        beyond = self.tolerance.linear
        if turn > 0.0:
            w = np.asarray(pin.log6(start.actInv(end)))
            speed = np.linalg.norm(w[:3] + at @ pin.skew(w[3:]).T, axis=1).max()
            beyond += float(speed) / turn * (1.0 - np.cos(0.5 * min(turn, np.pi)))
        low, high = np.minimum(first, last).min(axis=0) - beyond, np.maximum(first, last).max(axis=0) + beyond
        return low, high

    def way_box(self, i: int, knots: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """Least and greatest corner (3,) of a box around i on its path, inflated by the tolerance, m."""
        boxes = [self._leg_box(i, start, end) for start, end in pairwise(knots)]
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def box_meets(self, j: int, low: Array, high: Array) -> bool:
        """Whether the box of object j at its initial pose meets a box."""
        box = self._box(j)
        return bool((low <= box[1]).all() and (box[0] <= high).all())

    def _whole_box(self, i: int, knots: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """`way_box`, cached because a path is tested against every other object."""
        kept = self._boxes.get((i, id(knots)))
        if kept is None or kept[0] is not knots:
            kept = self._boxes[i, id(knots)] = knots, *self.way_box(i, knots)
        return kept[1], kept[2]

    def _box(self, i: int) -> Array:
        """(2, 3) least and greatest corner of object i at its initial pose, m."""
        return np.array([self.extent(i, axis) for axis in np.eye(3)]).T

    def _world(self, i: int, j: int, left_out: tuple[SurfacePairs, ...]) -> CollisionManager:
        """A world of i as object 0 and j as object 1, without the excluded surface pairs. Cached."""
        key = i, j, left_out
        if key not in self._worlds:
            world = CollisionManager(self.tolerance)
            world.add(self.meshes[i], self.poses[i])
            world.add(self.meshes[j], self.poses[j])
            for mine, theirs in left_out:
                world.ignore_surfaces(0, mine, 1, theirs)
            self._worlds[key] = world
        return self._worlds[key]


def _reached(start: pin.SE3, end: pin.SE3, found: tuple[float, NDArray[Any]] | None) -> pin.SE3:
    """The displacement reached on a leg."""
    import pinocchio as pin

    return end if found is None else start * pin.exp6(pin.log6(start.actInv(end)) * found[0])


def products(pairings: Iterable[SurfacePairs]) -> set[tuple[int, int]]:
    """All pairs of surfaces of pairings."""
    return {(a, b) for mine, theirs in pairings for a in mine for b in theirs}


def _none() -> NDArray[Any]:
    from collision.contact import CONTACT_DTYPE

    return np.empty(0, CONTACT_DTYPE)


def _hull(mesh: SurfaceMesh) -> Array:
    """(n, 3) vertices of the convex hull of a mesh's triangles; all vertices where they are few or flat."""
    from scipy.spatial import ConvexHull, QhullError

    corners = mesh.vertices[np.unique(mesh.triangles)]
    if len(corners) > FEW:
        with suppress(QhullError):
            corners = corners[ConvexHull(corners).vertices]
    return np.ascontiguousarray(corners)


@lru_cache(MOST_EXTENTS)
def _sides(direction: tuple[float, ...]) -> tuple[Array, ...]:
    return tuple(_around(np.array(direction)))


def _across(direction: Array) -> tuple[Array, ...]:
    """SIDES unit vectors perpendicular to a unit direction, over half a circle; the same for -direction."""
    d = direction if tuple(direction) > tuple(-direction) else -direction
    return _sides(tuple(d.tolist()))


def _around(d: Array) -> Iterable[Array]:
    u = np.cross(d, np.eye(3)[int(np.argmin(np.abs(d)))])
    u /= np.linalg.norm(u)
    v = np.cross(d, u)
    for k in range(SIDES):
        angle = np.pi * k / SIDES
        yield np.cos(angle) * u + np.sin(angle) * v


def _cross(a: Array, b: Array) -> Array:
    """(3,) the vector product of two vectors (3,): `numpy.cross` takes ten times as long for one pair."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _lies_across(triangle: Array, direction: Array) -> bool:
    """Whether a triangle (3, 3) is perpendicular to a unit direction."""
    normal = _cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return bool(abs(normal @ direction) > 0.999 * np.linalg.norm(normal))


def _shared_area(a: Array, b: Array) -> float:
    """Area of the intersection of two plane triangles (3, 2), m² (Sutherland & Hodgman 1974)."""
    polygon = [tuple(p) for p in a.tolist()]
    (bx, by), (cx, cy), (dx, dy) = b.tolist()
    turn = 1.0 if (cx - bx) * (dy - by) - (cy - by) * (dx - bx) > 0.0 else -1.0
    for (px, py), (qx, qy) in (((bx, by), (cx, cy)), ((cx, cy), (dx, dy)), ((dx, dy), (bx, by))):
        side = [turn * ((qx - px) * (y - py) - (qy - py) * (x - px)) for x, y in polygon]
        kept = []
        for k, (x, y) in enumerate(polygon):
            m = (k + 1) % len(polygon)
            if side[k] >= 0.0:
                kept.append((x, y))
            if (side[k] > 0.0 > side[m]) or (side[k] < 0.0 < side[m]):
                s = side[k] / (side[k] - side[m])
                kept.append((x + s * (polygon[m][0] - x), y + s * (polygon[m][1] - y)))
        polygon = kept
        if len(polygon) < 3:
            return 0.0
    area = sum(x * polygon[k - 1][1] - y * polygon[k - 1][0] for k, (x, y) in enumerate(polygon))
    return 0.5 * abs(area)


def _box_corners(box: Array) -> Array:
    """(8, 3) of a box (2, 3)."""
    return np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]])
