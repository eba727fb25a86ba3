"""`System`: the constraints of one connected component as flat arrays, with the elimination order of its bodies.

Each body is referred to the centroid of its features, and its rotations are measured in metres at the features'
diameter; rows in radians are weighted by the smaller diameter of the two bodies. So rank decisions and distances of
poses do not depend on the scale, from 0.1 mm to 1 km, nor on the origin of a part's frame in its file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import Tolerance
from collision.numeric.rigid_transforms import take_poses
from constraints.errors import ConstraintsError
from constraints.geometry.surfaces import LARGEST
from constraints.kinds.base import Constraint
from constraints.solve import jacobians, pose_kernels
from constraints.solve.block_cholesky import Elimination, eliminate

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Poses = Sequence[pin.SE3] | Mapping[int, pin.SE3]


@dataclass(frozen=True, eq=False)
class System:
    """Constraints connected through movable bodies, as arrays for the kernels."""

    members: tuple[int, ...]
    """indices of its constraints in the given sequence, ascending"""
    constraints: tuple[Constraint, ...]
    bodies: tuple[int, ...]
    """ids, ascending; fixed ones included"""
    movable: tuple[int, ...]
    """ids, ascending; slot s of the unknowns is `movable[s]`"""
    code: Ints
    body: Ints
    """(e, 2) indices in `bodies`"""
    element: Array
    """(e, 24) relative to the bodies' centres"""
    param: Array
    start: Ints
    owner: Ints
    """(m,) row -> index in `constraints`"""
    angular: NDArray[np.bool_]
    """(m,)"""
    weight: Array
    """(m,) factor that converts a row to metres"""
    center: Array
    """(n, 3) of each body, its frame"""
    extent: Array
    """(n,) m, diameter of each body's features about its centre"""
    slot: Ints
    """(n,) body -> slot, -1 for fixed bodies"""
    elimination: Elimination
    target: Ints
    """(e,) block of the equation's pair of movable bodies, or -1"""

    @property
    def rows(self) -> int:
        """Number of rows m."""
        return len(self.owner)

    @cached_property
    def columns(self) -> Ints:
        """(n,) body -> column of the factorisation, -1 for fixed bodies."""
        return np.where(self.slot >= 0, self.elimination.position[self.slot], -1)

    @cached_property
    def length(self) -> float:
        """m, characteristic length: median extent of the movable bodies."""
        return float(np.median(self.extent[self.slot >= 0]))

    def gather(self, poses: Poses, rigid: float = Tolerance.rigid) -> tuple[Array, Array]:
        """Return rotations (n, 3, 3) and positions of the centres (n, 3) of the bodies."""
        return _gather(poses, self.bodies, np.arange(len(self.bodies)), self.center, rigid)

    def scatter(self, rotation: Array, translation: Array) -> dict[int, pin.SE3]:
        """Return the poses of the movable bodies."""
        matrix = scatter(rotation, translation, self.center)
        return {b: pin.SE3(matrix[i]) for b, i in zip(self.movable, self.moving, strict=True)}

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Indices of the movable bodies in `bodies`."""
        return tuple(np.flatnonzero(self.slot >= 0).tolist())

    def evaluate(self, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
        """Return the unweighted residual (m,) and both Jacobians (m, 6) on local twists about the centres."""
        r, ja, jb = np.empty(self.rows), np.empty((self.rows, 6)), np.empty((self.rows, 6))
        jacobians.evaluate(self.code, self.body, self.element, self.param, self.start, rotation, translation, r, ja, jb)
        return r, ja, jb

    def dense(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """Return the weighted residual (m,) and the scaled Jacobian (m, 6·movable), both in metres."""
        r, ja, jb = self.evaluate(rotation, translation)
        jacobian = np.zeros((self.rows, len(self.movable), 6))
        rows = np.arange(self.rows)
        equation = np.repeat(np.arange(len(self.code)), np.diff(np.append(self.start, self.rows)))
        for side, j in ((0, ja), (1, jb)):
            place = self.body[equation, side]
            slot = self.slot[place]
            scaled = j * self.weight[:, None]
            scaled[:, 3:] /= self.extent[place][:, None]
            moves = slot >= 0
            jacobian[rows[moves], slot[moves]] += scaled[moves]
        return r * self.weight, jacobian.reshape(self.rows, -1)


def components(nodes: Iterable[int], edges: Iterable[tuple[int, int]]) -> tuple[tuple[int, ...], ...]:
    """Return the connected components of a graph, each ascending, ordered by their least node."""
    parent = {n: n for n in nodes}

    def find(x: int) -> int:
        while parent[x] != x:
            parent[x] = parent[parent[x]]
            x = parent[x]
        return x

    for a, b in edges:
        ra, rb = find(a), find(b)
        parent[max(ra, rb)] = min(ra, rb)
    groups: dict[int, list[int]] = {}
    for n in sorted(parent):
        groups.setdefault(find(n), []).append(n)
    return tuple(tuple(g) for g in groups.values())


def connected(constraints: Sequence[Constraint], movable: Iterable[int]) -> list[list[int]]:
    """Return the indices of the constraints with a movable body, grouped by connection through movable bodies."""
    moves = set(movable)
    between = [[body for body in c.bodies if body in moves] for c in constraints]
    label = {
        body: k
        for k, group in enumerate(components(
            {body for bodies in between for body in bodies}, ((b[0], b[1]) for b in between if len(b) == 2)
        ))
        for body in group
    }  # fmt: skip
    groups: dict[int, list[int]] = {}
    for i, bodies in enumerate(between):
        if bodies:
            groups.setdefault(label[bodies[0]], []).append(i)
    return [groups[k] for k in sorted(groups)]


@lru_cache(maxsize=128)
def systems(constraints: tuple[Constraint, ...], movable: frozenset[int]) -> tuple[System, ...]:
    """Return a `System` for each connected component; cached, since the same constraints are solved in every step."""
    return tuple(build(constraints, tuple(group), movable) for group in connected(constraints, movable))


@dataclass(frozen=True, eq=False)
class Plan:
    """All systems of a set of constraints, packed so that one kernel call solves them."""

    systems: tuple[System, ...]
    bodies: tuple[int, ...]
    """ids, each once"""
    place: Ints
    """bodies of the systems, in order -> index in `bodies`"""
    offset: Ints
    """(k + 1, 6) first equation, row, body, column, off-diagonal block and update of each system"""
    length: Array
    """(k,) m"""
    center: Array
    movable: tuple[int, ...]
    """ids of the movable bodies, system by system"""
    moving: Ints
    """their indices among the bodies of all systems"""
    system: Ints
    """the system of each"""
    packed: tuple[NDArray[Any], ...]
    """arguments of `kernels.solve_all` before `offset`"""

    def gather(self, poses: Poses, rigid: float = Tolerance.rigid) -> tuple[Array, Array]:
        """Return rotations and positions of the centres, of each system's bodies in order."""
        return _gather(poses, self.bodies, self.place, self.center, rigid)


@lru_cache(maxsize=128)
def plan(constraints: tuple[Constraint, ...], movable: frozenset[int]) -> Plan:
    """Return the plan of all systems; cached."""
    each = systems(constraints, movable)
    bodies = sorted({b for s in each for b in s.bodies})
    where = {b: i for i, b in enumerate(bodies)}
    e = [s.elimination for s in each]
    sizes = [
        (len(s.code), s.rows, len(s.bodies), len(x.column), len(x.row), len(x.update))
        for s, x in zip(each, e, strict=True)
    ]
    offset = np.concatenate([np.zeros((1, 6)), np.cumsum(np.reshape(sizes, (-1, 6)), axis=0)]).astype(np.int64)

    def packed(of: Sequence[Any], names: str) -> list[NDArray[Any]]:
        return [np.concatenate([getattr(x, name) for x in of] or [np.zeros((0, 3))]) for name in names.split()]

    return Plan(
        each,
        tuple(bodies),
        np.array([where[b] for s in each for b in s.bodies], dtype=np.int64),
        offset,
        np.array([s.length for s in each]),
        packed(each, "center")[0],
        tuple(b for s in each for b in s.movable),
        np.array([first + i for s, first in zip(each, offset[:, 2], strict=False) for i in s.moving], dtype=np.int64),
        np.repeat(np.arange(len(each)), [len(s.movable) for s in each]),
        (
            *packed(each, "code body element param start weight extent columns target"),
            *packed(e, "column row update update_start"),
        ),
    )


def _gather(poses: Poses, bodies: Sequence[int], place: Ints, center: Array, rigid: float) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and positions of the centres (n, 3) of `bodies[place]`; their poses are checked."""
    try:
        matrix = np.array([poses[b].homogeneous for b in bodies]).reshape(-1, 4, 4)
    except (KeyError, IndexError):
        raise ConstraintsError(
            f"a constraint refers to body {_without(poses, bodies)}, which has no pose; pass one"
        ) from None
    except AttributeError:
        bad = next(b for b in bodies if not isinstance(poses[b], pin.SE3))
        raise ConstraintsError(
            f"the pose of body {bad} is a {type(poses[bad]).__name__}; pass a pinocchio.SE3"
        ) from None
    wrong = take_poses(matrix, rigid, np.empty((len(matrix), 12)))
    if wrong >= 0:
        finite = np.isfinite(matrix[wrong]).all()
        words = "is no rigid motion; pass one" if finite else "is not finite; pass a finite one"
        raise ConstraintsError(f"the pose of body {bodies[wrong]} {words}")
    if np.abs(matrix[:, :3, 3]).max(initial=0.0) > LARGEST:
        far = int(np.argmax(np.abs(matrix[:, :3, 3]).max(axis=1)))
        raise ConstraintsError(f"the pose of body {bodies[far]} is farther away than {LARGEST:g} m; pass a nearer one")
    rotation, translation = np.empty((len(place), 3, 3)), np.empty((len(place), 3))
    pose_kernels.to_centres(matrix, place, center, rotation, translation)
    return rotation, translation


def _without(poses: Poses, bodies: Sequence[int]) -> int:
    """The first body without a pose."""
    for b in bodies:
        try:
            poses[b]
        except (KeyError, IndexError):
            return b
    return bodies[0]


def scatter(rotation: Array, translation: Array, center: Array) -> Array:
    """Return the poses (n, 4, 4) of bodies whose centres are at `translation`."""
    matrix = np.empty((len(center), 4, 4))
    pose_kernels.from_centres(rotation, translation, center, matrix)
    return matrix


def build(
    constraints: Sequence[Constraint], members: tuple[int, ...], movable: Iterable[int], bounds: bool = True
) -> System:
    """Return the system of the constraints `members` (indices); without `bounds`, of their equalities alone."""
    chosen = tuple(constraints[i] for i in members)
    moves = set(movable)
    ids = sorted({b for c in chosen for b in c.bodies})
    place = {b: i for i, b in enumerate(ids)}
    packed = [c.compiled if bounds else c.equalities for c in chosen]
    element = np.concatenate([p.element for p in packed])
    pairs = [[place[c.bodies[s]] for s in sides] for c, p in zip(chosen, packed, strict=True) for sides in p.side]
    body = np.array(pairs, dtype=np.int64)
    center, extent = _extents(
        len(ids), body, element, [c.reach for c, p in zip(chosen, packed, strict=True) for _ in p.code]
    )
    element[:, 0:3] -= center[body[:, 0]]
    element[:, 12:15] -= center[body[:, 1]]
    counts = [p.rows for p in packed]
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    owner = np.repeat(np.arange(len(chosen)), counts)
    angular = np.concatenate([p.angular for p in packed])
    pair_of = np.array([[place[b] for b in c.bodies] for c in chosen])
    lever = extent[pair_of].min(axis=1)
    slot = np.full(len(ids), -1, dtype=np.int64)
    free = [b for b in ids if b in moves]
    slot[[place[b] for b in free]] = np.arange(len(free))
    elimination = eliminate(
        len(free), {(int(slot[a]), int(slot[b])) for a, b in pairs if slot[a] >= 0 and slot[b] >= 0}
    )
    target = np.full(len(body), -1, dtype=np.int64)
    for e, (a, b) in enumerate(pairs):
        if slot[a] >= 0 and slot[b] >= 0:
            i, j = int(elimination.position[slot[a]]), int(elimination.position[slot[b]])
            target[e] = elimination.block_of[max(i, j), min(i, j)]
    return System(
        members,
        chosen,
        tuple(ids),
        tuple(free),
        np.concatenate([p.code for p in packed]),
        body,
        element,
        np.concatenate([p.param for p in packed]),
        np.concatenate([p.start + f for p, f in zip(packed, first, strict=True)]).astype(np.int64),
        owner,
        angular,
        np.where(angular, lever[owner], 1.0),
        center,
        extent,
        slot,
        elimination,
        target,
    )


def _extents(n: int, body: Ints, element: Array, radius: Sequence[float]) -> tuple[Array, Array]:
    """Centre (n, 3) of each body's features and their diameter (n,) about it, m."""
    index = np.concatenate([body[:, 0], body[:, 1]])
    points = np.concatenate([element[:, 0:3], element[:, 12:15]])
    center = np.zeros((n, 3))
    np.add.at(center, index, points)
    center /= np.bincount(index, minlength=n)[:, None]
    reach = np.linalg.norm(points - center[index], axis=1) + np.concatenate([radius, radius])
    extent = np.zeros(n)
    np.maximum.at(extent, index, 2.0 * reach)
    return center, extent
