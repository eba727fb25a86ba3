"""Which objects stand in each other's way along given motions: the blocking table of an assembly.

A motion is a list of knots, world displacements of the moving object from where it stands, the first the identity; from
one knot to the next it goes along one screw (the SE(3) geodesic, less than half a turn). Each pair of objects is swept
by itself, so that a row of the table stays true whatever other objects are there (Wilson & Latombe, "Geometric
reasoning about mechanical assembly", Artificial Intelligence 71, 1994: the non-directional blocking graph, of finite
motions here instead of infinitesimal ones).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
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
Pairing = tuple[tuple[int, ...], tuple[int, ...]]
"""surfaces of the moving object and of the standing one: each of the first is left out with each of the second"""
Excuse = Callable[[int, int, "pin.SE3", "pin.SE3"], Iterable[Pairing] | None]
"""(moving, standing, displacement at the start of a leg, at its end) -> the surface pairs that this leg leaves out, or
None where the pair stops the leg before it begins"""
PRESSED = 10.0
"""1: of the tolerance's slop: surfaces are pressed by no more beyond where the objects stand, on however many legs"""
PRESSED_ON_A_LEG = 1.5
"""1: of the slop: by how much a sweep may press surfaces (see `collision.query.time_of_impact`)"""
PRESSED_BY_GRAZING = 2.0
"""1: of the slop: by how much a graze may have pressed them"""
GRAZES = 64
"""contacts that a leg may graze before it counts as stopped"""
STILL = 1e-3
"""1: of the tolerance: a triangle that goes no farther along its normal on a leg does not count as front"""
SIDES = 8
"""directions across a straight way along which shadows are compared"""


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Where one object stops another on its way."""

    leg: int
    """between which knots: `leg` and `leg + 1`"""
    t: float
    """in [0, 1): how far along that leg; until then nothing has come nearer than it may"""
    contacts: NDArray[Any]
    """CONTACT_DTYPE rows of the surface pairs that stop it, `object_a` the moving object; none where an excuse does"""


@dataclass(frozen=True, slots=True, eq=False)
class _Front:
    """The front of one of two objects on a leg."""

    side: int
    """0: of the moving object, 1: of the standing one, as seen from the moving one"""
    part: SurfaceMesh
    solid: SurfaceMesh
    """the whole other object"""
    triangles: NDArray[np.int64]
    surfaces: NDArray[np.int32]
    """of the whole object, by those of `part`"""
    excused: tuple[Pairing, ...]
    """surfaces of `part`, surfaces of `solid` that are left out"""


@dataclass(frozen=True, slots=True, eq=False)
class _Swept:
    """What of two objects is swept against each other, and how deep it is as drawn."""

    i: int
    j: int
    world: CollisionManager
    """the moving object as object 0, the standing one as object 1"""
    depths_of: Callable[[CollisionManager], dict[tuple[int, int], float]]
    """m by pair of surfaces of that world that meet"""
    drawn: Callable[[], dict[tuple[int, int], float]]
    """the same where the objects stand"""
    key: Any = None
    """of whole objects, for what is kept"""
    front: _Front | None = None
    """in the place of its object"""

    def told(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Rows of the world as rows of the whole objects i and j."""
        out = rows.copy()
        out["object_a"], out["object_b"] = self.i, self.j
        if self.front is not None:
            which = "ab"[self.front.side]
            out[f"triangle_{which}"] = self.front.triangles[out[f"triangle_{which}"]]
            out[f"surface_{which}"] = self.front.surfaces[out[f"surface_{which}"]]
        return out


class Sweeps:
    """Sweeps of pairs of objects that begin where the objects stand.

    Parameters
    ----------
    meshes, poses: of the objects, in the order of their ids.
    tolerance: `linear` is how near surfaces may come that are apart, `slop` by how much of it surfaces in contact may
        be pressed further in one leg (see `collision.query.time_of_impact`).
    excuse: returns, for each leg, the pairs of surfaces that are left out.
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
        self._corners = [np.ascontiguousarray(m.vertices[np.unique(m.triangles)]) for m in self.meshes]
        self._worlds: dict[tuple[Any, ...], CollisionManager] = {}
        pressed = tolerance.slop * tolerance.linear
        self._precision = CollisionManager(replace(tolerance, linear=pressed / tolerance.depth))
        """holds the precision of depths: a slop, and `Tolerance.depth` of themselves"""
        self._boxes: dict[tuple[int, int], tuple[Sequence[pin.SE3], Array, Array]] = {}
        self._start: dict[tuple[int, int], dict[tuple[int, int], float]] = {}
        self._depths_met: dict[tuple[int, int], dict[tuple[int, int], float]] = {}
        self._overlaps: dict[tuple[Any, ...], Pairing] = {}
        self._begins: dict[tuple[Any, ...], bool] = {}
        self._extents: dict[tuple[int, bytes], tuple[float, float]] = {}
        self._turns: dict[int, tuple[Sequence[pin.SE3], Any, dict[int, Array]]] = {}
        """by identity of knots: the knots, their screw axis, and by object its profile about it"""

    def with_tolerance(self, tolerance: Tolerance) -> Sweeps:
        """The same objects where they stand, under another tolerance; what hangs on none is shared."""
        out = copy(self)
        out.tolerance, out.count = tolerance, 0
        out._worlds, out._boxes, out._start, out._depths_met, out._overlaps, out._begins = {}, {}, {}, {}, {}, {}
        return out

    def extent(self, i: int, direction: Array) -> tuple[float, float]:
        """(least, greatest) coordinate of object i, where it stands, along a world direction (3,), m."""
        key = i, np.ascontiguousarray(direction).tobytes()
        if key not in self._extents:
            heights = self._corners[i] @ (self.poses[i].rotation.T @ direction) + self.poses[i].translation @ direction
            self._extents[key] = float(heights.min()), float(heights.max())
        return self._extents[key]

    def corners(self, i: int) -> Array:
        """(n, 3) the vertices of object i where it stands, world, m."""
        return np.asarray(self._corners[i] @ self.poses[i].rotation.T + self.poses[i].translation)

    def length_until_apart(self, i: int, j: int, direction: Array) -> float:
        """m: how far i goes along a unit direction until a plane across it parts it from j; 0 if one does already."""
        return max(0.0, self.extent(j, direction)[1] - self.extent(i, direction)[0])

    def shadows_meet(self, i: int, j: int, direction: Array) -> bool:
        """Whether j may lie in the shadow of i along a direction: False is sure, and i then passes j."""
        return all(
            self.extent(i, side)[0] <= self.extent(j, side)[1] + self.tolerance.linear
            and self.extent(j, side)[0] <= self.extent(i, side)[1] + self.tolerance.linear
            for side in _across(direction)
        )

    def stop(
        self, i: int, j: int, knots: Sequence[pin.SE3], besides: tuple[Pairing, ...] = (), graze: bool = True
    ) -> Stop | None:
        """Where object j, standing, stops object i on its way along `knots`; None if it goes to the end.

        besides: surface pairs that are left out beside those that the legs leave out.
        graze: whether surfaces may come nearer than the tolerance where they part again at once; where they may not,
        None proves that of those that begin apart none comes nearer than the tolerance, less its slop.
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
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, fits: tuple[Pairing, ...], besides: tuple[Pairing, ...],
        graze: bool,
    ) -> tuple[float, NDArray[Any]] | None:  # fmt: skip
        """Where and by what i is stopped on one leg, None if it is not.

        Of objects that overlap as drawn it is enough that the overlap shrinks, seen from either of them.
        """
        left_out = *fits, *besides
        if not (graze and any(self.overlap(i, j, fits))):
            key = i, j, left_out
            whole = _Swept(i, j, self._world(*key), self._depths_of, lambda: self.depths(i, j), key)
            found = self._swept(whole, start, end, graze)
            if fits and graze and self._pass_unseen(i, j, start, end, found, left_out):
                return self._at_once(i, j, start, left_out)
            return found
        seen_from_j = self._shrinks(i, j, 0, start, end, left_out)
        if seen_from_j is None:
            return None
        seen_from_i = self._shrinks(i, j, 1, start, end, left_out)
        return None if seen_from_i is None else max(seen_from_j, seen_from_i, key=lambda found: found[0])

    def _swept(self, swept: _Swept, start: pin.SE3, end: pin.SE3, graze: bool) -> tuple[float, NDArray[Any]] | None:
        """Where and by what the moving object is stopped on one leg, None if it is not.

        A sweep stops where surfaces come into contact, and so where edges that lie in one plane slide past each other.
        Twice the tolerance farther they have parted again; there a group that may graze goes on, if nothing is deeper
        than where the objects stand. What is thinner than that may be passed.
        """
        import pinocchio as pin

        world, home = swept.world, self.poses[swept.i]
        way = pin.log6(start.actInv(end))
        # nothing is pressed yet, or what is apart alone counts
        first = not graze or (start.isIdentity(0.0) and swept.front is None)
        if not first and not self._may_begin(swept, start):
            return 0.0, swept.told(world.contacts(self.tolerance.linear))
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
        # where the next leg could not begin the group does not go
        if first or self._may_begin(swept, end if passed else start * pin.exp6(way * t)):
            return None if passed else (t, swept.told(found.contacts))
        return 0.0, swept.told(world.contacts(self.tolerance.linear))

    def _may_begin(self, swept: _Swept, at: pin.SE3) -> bool:
        """Whether a leg may begin at a displacement: nothing is pressed farther there than `PRESSED` allows. Kept."""
        key = swept.key, at.homogeneous.tobytes()
        if swept.key is None or key not in self._begins:
            found = self._no_deeper(swept, at, PRESSED - PRESSED_ON_A_LEG)
            if swept.key is None:
                return found
            self._begins[key] = found
        return self._begins[key]

    # -- overlaps as drawn

    def overlap(self, i: int, j: int, left_out: tuple[Pairing, ...] = ()) -> Pairing:
        """The surfaces of i that reach into j, deeper than the tolerance, where the objects stand, and those of j that
        reach into i; of those that are left out, nothing counts behind each other. None where the objects do not
        overlap. Kept.

        An object all of which is inside the other, meeting none of its surfaces, does not overlap it: it is held.
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
        """`triangle_depths` where the objects stand. Kept."""
        if (i, j) not in self._depths_met:
            world = self._world(i, j, ())
            world.set_pose(0, self.poses[i])
            self._depths_met[i, j] = triangle_depths(world)
        return self._depths_met[i, j]

    def _pass_unseen(
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, found: tuple[float, NDArray[Any]] | None,
        left_out: tuple[Pairing, ...],
    ) -> bool:  # fmt: skip
        """Whether faces that touch where a leg begins are inside the other object where it comes to: no distance tells
        that two of them have passed each other, and the surfaces beside them, which meet, may be left out."""
        world = self._world(i, j, left_out)
        world.set_pose(0, start * self.poses[i])
        rows = world.contacts(self.tolerance.linear)
        at = _reached(start, end, found)
        for side, name in enumerate(("surface_a", "surface_b")) if len(rows) else ():
            front = self._front(i, j, side, start, end, left_out, rows[name])
            if front is not None and self._is_inside(i, j, front, at):
                return True
        return False

    def _shrinks(
        self, i: int, j: int, side: int, start: pin.SE3, end: pin.SE3, left_out: tuple[Pairing, ...]
    ) -> tuple[float, NDArray[Any]] | None:
        """Where on a leg the overlap of i and j begins to grow, seen from j (side 0) or from i (side 1), and by which
        contacts; None if it never does.

        Swept is the front of the one that moves, against all of the other. It must not begin inside the other.
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
        if front.excused and self._is_inside(i, j, front, _reached(start, end, found)):
            return self._at_once(i, j, start, left_out)
        return found

    def _front(
        self, i: int, j: int, side: int, start: pin.SE3, end: pin.SE3, left_out: tuple[Pairing, ...],
        surfaces: NDArray[np.integer] | None = None,
    ) -> _Front | None:  # fmt: skip
        """The front of i (side 0), or of j (side 1) as seen from i, on a leg, of some surfaces; None without one."""
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

    def _is_inside(self, i: int, j: int, front: _Front, at: pin.SE3) -> bool:
        """Whether some of a front is deeper inside the other object than the tolerance, i displaced."""
        pose = self.poses[j].actInv(at * self.poses[i])
        pose = pose.inverse() if front.side else pose
        return bool(len(buried(front.part, front.solid, pose, self.tolerance.linear, front.excused)))

    def _at_once(self, i: int, j: int, start: pin.SE3, left_out: tuple[Pairing, ...]) -> tuple[float, NDArray[Any]]:
        """A stop where a leg begins, by what touches or overlaps there; by what is left out if nothing else does."""
        for world in (self._world(i, j, left_out), self._world(i, j, ())):
            world.set_pose(0, start * self.poses[i])
            rows = world.contacts(self.tolerance.linear)
            rows["object_a"], rows["object_b"] = i, j
            if len(rows):
                break
        return 0.0, rows

    def _speed(self, i: int, start: pin.SE3, end: pin.SE3) -> float:
        """m: no point of i goes farther on a leg."""
        import pinocchio as pin

        way = np.asarray(pin.log6(start.actInv(end)))
        return float(np.linalg.norm(way[:3] + _box_corners(self._box(i)) @ pin.skew(way[3:]).T, axis=1).max())

    def _meets_squarely(self, swept: _Swept, at: pin.SE3, way: Array, rows: NDArray[Any]) -> bool:
        """Whether facets that lie over each other run into each other on the next piece `way` (6,) of a leg: then the
        group is stopped, and nothing needs to be measured."""
        slack = self.tolerance.slop * self.tolerance.linear
        pose, standing = at * self.poses[swept.i], self.poses[swept.j]
        mine, theirs = swept.world.mesh(0), swept.world.mesh(1)
        for row in rows[:4]:
            a = mine.vertices[mine.triangles[row["triangle_a"]]] @ pose.rotation.T + pose.translation
            b = theirs.vertices[theirs.triangles[row["triangle_b"]]]
            b = b @ standing.rotation.T + standing.translation
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
        """Whether no surfaces of i, displaced, and j reach deeper into each other than where they stand, by more than
        so many slops."""
        known, world = swept.drawn(), swept.world  # before the pose is set: it may be the same world
        world.set_pose(0, at * self.poses[swept.i])
        if not len(world.colliding_surfaces()):
            return True
        slack = slops * self.tolerance.slop * self.tolerance.linear
        return all(depth <= known.get(pair, 0.0) + slack for pair, depth in swept.depths_of(world).items())

    def depths(self, i: int, j: int) -> dict[tuple[int, int], float]:
        """m by surface of i and of j: how deep they reach into each other where the objects stand."""
        if (i, j) not in self._start:
            world = self._world(i, j, ())
            world.set_pose(0, self.poses[i])
            self._start[i, j] = self._depths_of(world)
        return self._start[i, j]

    def _depths_of(self, world: CollisionManager) -> dict[tuple[int, int], float]:
        """m by surface of object 0 and of object 1 that meet: the depths of `CollisionManager.penetration`, without the
        directions, which take most of the time where many surfaces only touch."""
        from collision.query.intersection import intersecting
        from collision.query.penetration import deepest_points

        pose, enabled = world.relative_pose(0, 1), world.enabled_surfaces(0, 1)
        a, b = world.mesh(0), world.mesh(1)
        pairs = intersecting(a, b, pose, world.checked.rigid)[0]
        if enabled is not None:
            pairs = pairs[enabled[pairs[:, 0], pairs[:, 1]] != 0]
        if not len(pairs):
            return {}
        depths = deepest_points(self._precision, (a, b), pose, pairs)[:, 0]
        return dict(zip(map(tuple, pairs.tolist()), depths.tolist(), strict=True))

    def _clear_of_turn(self, i: int, j: int, knots: Sequence[pin.SE3]) -> tuple[Pairing, ...]:
        """Pairs of surfaces that stay farther apart than the tolerance on a way that turns about one axis."""
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
        self, i: int, j: int, start: pin.SE3, end: pin.SE3, within: float, besides: tuple[Pairing, ...] = ()
    ) -> NDArray[Any]:
        """CONTACT_DTYPE rows of i, displaced by `start`, with j within `within` m, world; `object_a` is i.

        Left out is what a leg from there to `end` leaves out, and `besides`.
        """
        world = self._world(i, j, (*(self.excuse(i, j, start, end) or ()), *besides))
        world.set_pose(0, start * self.poses[i])
        rows = world.contacts(within)
        rows["object_a"], rows["object_b"] = i, j
        return rows

    def straight(self, i: int, j: int, direction: Array, margin: float) -> Stop | None:
        """Where j stops i on its straight way along a unit direction until a plane across it parts them by `margin`."""
        import pinocchio as pin

        far = self.length_until_apart(i, j, direction)
        if far == 0.0 or not self.shadows_meet(i, j, direction):
            identity = pin.SE3.Identity()  # nothing is swept, but the pair may be held together
            held = self.excuse(i, j, identity, pin.SE3(np.eye(3), margin * direction)) is None
            return Stop(0, 0.0, _none()) if held else None
        return self.stop(i, j, (pin.SE3.Identity(), pin.SE3(np.eye(3), (far + margin) * direction)))

    def table(self, directions: Sequence[Array], margin: float) -> NDArray[np.bool_]:
        """(k, n, n) whether object j stops object i on its straight way along direction k until they are apart.

        directions: (3,) unit vectors. Opposite ones cost one sweep a pair: j in the way of i is i in the way of j.
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
        """Whether the boxes of i on one leg and of j come near each other."""
        return self.box_meets(j, *self._leg_box(i, start, end))

    def _leg_box(self, i: int, start: pin.SE3, end: pin.SE3) -> tuple[Array, Array]:
        """Corners of a box that holds i on a leg, and the tolerance around; points stray from chords by their arcs."""
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
        """Least and greatest corner (3,) of a box that holds i on its way, and the tolerance around; m."""
        boxes = [self._leg_box(i, start, end) for start, end in pairwise(knots)]
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def box_meets(self, j: int, low: Array, high: Array) -> bool:
        """Whether the box of object j, where it stands, meets a box."""
        box = self._box(j)
        return bool((low <= box[1]).all() and (box[0] <= high).all())

    def _whole_box(self, i: int, knots: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """The same of all legs; kept, because a way is tested against every other object."""
        kept = self._boxes.get((i, id(knots)))
        if kept is None or kept[0] is not knots:
            kept = self._boxes[i, id(knots)] = knots, *self.way_box(i, knots)
        return kept[1], kept[2]

    def _box(self, i: int) -> Array:
        """(2, 3) least and greatest corner of object i where it stands."""
        return np.array([self.extent(i, axis) for axis in np.eye(3)]).T

    def _world(self, i: int, j: int, left_out: tuple[Pairing, ...]) -> CollisionManager:
        """The two objects, i as object 0, without the surface pairs that are left out."""
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
    """The displacement that a leg comes to."""
    import pinocchio as pin

    return end if found is None else start * pin.exp6(pin.log6(start.actInv(end)) * found[0])


def products(pairings: Iterable[Pairing]) -> set[tuple[int, int]]:
    """All pairs of surfaces of pairings."""
    return {(a, b) for mine, theirs in pairings for a in mine for b in theirs}


def _none() -> NDArray[Any]:
    from collision.contact import CONTACT_DTYPE

    return np.empty(0, CONTACT_DTYPE)


def _across(direction: Array) -> Iterable[Array]:
    """Unit vectors at right angles to a unit direction, half a circle of them; those of -direction are the same."""
    d = direction if tuple(direction) > tuple(-direction) else -direction
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
    """Whether a triangle (3, 3) is at right angles to a unit direction."""
    normal = _cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return bool(abs(normal @ direction) > 0.999 * np.linalg.norm(normal))


def _shared_area(a: Array, b: Array) -> float:
    """m²: what two plane triangles (3, 2) share (Sutherland & Hodgman 1974)."""
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
