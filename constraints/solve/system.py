"""`System`: the constraints of one connected component as flat arrays, with the elimination order of its parts.

Each body is referred to the centroid of its own features, and its rotations are measured in metres at the features'
diameter; rows in radians are weighed by the smaller one of the two bodies. Rank decisions and "nearest" then mean the
same for a part of 0.1 mm and one of 1 km, and do not depend on where a file put a part's origin.
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
    """Constraints that share movable bodies, ready for the kernels."""

    members: tuple[int, ...]
    """places of its constraints in the sequence it was made from, ascending"""
    constraints: tuple[Constraint, ...]
    bodies: tuple[int, ...]
    """ids, ascending; fixed ones included"""
    movable: tuple[int, ...]
    """ids, ascending; slot s of the unknowns is `movable[s]`"""
    code: Ints
    body: Ints
    """(e, 2) places in `bodies`"""
    element: Array
    """(e, 24) relative to the bodies' centres"""
    param: Array
    start: Ints
    owner: Ints
    """(m,) row -> place in `constraints`"""
    angular: NDArray[np.bool_]
    """(m,)"""
    weight: Array
    """(m,) what makes a row metres"""
    center: Array
    """(n, 3) of each body, its frame"""
    extent: Array
    """(n,) m, diameter of each body's features about its centre"""
    slot: Ints
    """(n,) body -> slot, or -1 where fixed"""
    elimination: Elimination
    target: Ints
    """(e,) block of the equation's pair of movable bodies, or -1"""

    @property
    def rows(self) -> int:
        """Number of rows m."""
        return len(self.owner)

    @cached_property
    def columns(self) -> Ints:
        """(n,) body -> column of the factorisation, or -1 where fixed."""
        return np.where(self.slot >= 0, self.elimination.position[self.slot], -1)

    @cached_property
    def length(self) -> float:
        """m, characteristic length: median extent of the movable bodies."""
        return float(np.median(self.extent[self.slot >= 0]))

    def gather(self, poses: Poses, rigid: float = Tolerance.rigid) -> tuple[Array, Array]:
        """Rotations (n, 3, 3) and positions of the centres (n, 3) of the bodies."""
        return _gather(poses, self.bodies, np.arange(len(self.bodies)), self.center, rigid)

    def scatter(self, rotation: Array, translation: Array) -> dict[int, pin.SE3]:
        """Poses of the movable bodies."""
        matrix = scatter(rotation, translation, self.center)
        return {b: pin.SE3(matrix[i]) for b, i in zip(self.movable, self.moving, strict=True)}

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Places in `bodies` of the movable ones."""
        return tuple(np.flatnonzero(self.slot >= 0).tolist())

    def evaluate(self, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
        """Residual (m,) and both Jacobians (m, 6) on local twists about the centres; unweighed."""
        r = np.empty(self.rows)
        ja = np.empty((self.rows, 6))
        jb = np.empty((self.rows, 6))
        jacobians.evaluate(self.code, self.body, self.element, self.param, self.start, rotation, translation, r, ja, jb)
        return r, ja, jb

    def dense(self, rotation: Array, translation: Array) -> tuple[Array, Array]:
        """Weighed residual (m,) and Jacobian (m, 6·movable), columns scaled: both in metres."""
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
    """Connected components of a graph, each ascending, ordered by their least node."""
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
    """Places of the constraints that a movable body takes part in, grouped by connection through movable bodies."""
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
    """One `System` a connected component; kept, since the same constraints are solved step after step."""
    return tuple(build(constraints, tuple(group), movable) for group in connected(constraints, movable))


@dataclass(frozen=True, eq=False)
class Plan:
    """All systems of a set of constraints, packed one after another so that one kernel call solves them."""

    systems: tuple[System, ...]
    bodies: tuple[int, ...]
    """ids, each once"""
    place: Ints
    """body of each system, in order -> place in `bodies`"""
    offset: Ints
    """(k + 1, 6) first equation, row, body, column, off-diagonal block and update of each system"""
    length: Array
    """(k,) m"""
    center: Array
    movable: tuple[int, ...]
    """ids of the movable bodies, system by system"""
    moving: Ints
    """where they are among the bodies of all systems"""
    system: Ints
    """which system each belongs to"""
    packed: tuple[NDArray[Any], ...]
    """what `system_kernels.solve_all` takes before `offset`"""

    def gather(self, poses: Poses, rigid: float = Tolerance.rigid) -> tuple[Array, Array]:
        """Rotations and positions of the centres, of each system's bodies in order."""
        return _gather(poses, self.bodies, self.place, self.center, rigid)


@lru_cache(maxsize=128)
def plan(constraints: tuple[Constraint, ...], movable: frozenset[int]) -> Plan:
    """The plan of one system a connected component; kept."""
    each = systems(constraints, movable)
    bodies = sorted({b for s in each for b in s.bodies})
    where = {b: i for i, b in enumerate(bodies)}
    sizes = [
        (
            len(s.code),
            s.rows,
            len(s.bodies),
            len(s.elimination.column),
            len(s.elimination.row),
            len(s.elimination.update),
        )
        for s in each
    ]

    offset = np.concatenate([np.zeros((1, 6)), np.cumsum(np.reshape(sizes, (-1, 6)), axis=0)]).astype(np.int64)

    def pack(arrays: Sequence[NDArray[Any]], *shape: int) -> NDArray[Any]:
        return np.concatenate(arrays) if arrays else np.zeros((0, *shape))

    e = [s.elimination for s in each]
    return Plan(
        each,
        tuple(bodies),
        np.array([where[b] for s in each for b in s.bodies], dtype=np.int64),
        offset,
        np.array([s.length for s in each]),
        pack([s.center for s in each], 3),
        tuple(b for s in each for b in s.movable),
        np.array([first + i for s, first in zip(each, offset[:, 2], strict=False) for i in s.moving], dtype=np.int64),
        np.repeat(np.arange(len(each)), [len(s.movable) for s in each]),
        (
            pack([s.code for s in each]),
            pack([s.body for s in each]),
            pack([s.element for s in each]),
            pack([s.param for s in each]),
            pack([s.start for s in each]),
            pack([s.weight for s in each]),
            pack([s.extent for s in each]),
            pack([s.columns for s in each]),
            pack([s.target for s in each]),
            pack([x.column for x in e]),
            pack([x.row for x in e]),
            pack([x.update for x in e]),
            pack([x.update_start for x in e]),
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
    """The first body that has no pose."""
    for b in bodies:
        try:
            poses[b]
        except (KeyError, IndexError):
            return b
    return bodies[0]


def scatter(rotation: Array, translation: Array, center: Array) -> Array:
    """Poses (n, 4, 4) of bodies whose centres are at `translation`."""
    matrix = np.empty((len(center), 4, 4))
    pose_kernels.from_centres(rotation, translation, center, matrix)
    return matrix


def build(
    constraints: Sequence[Constraint], members: tuple[int, ...], movable: Iterable[int], bounds: bool = True
) -> System:
    """The system of the constraints at places `members`; without `bounds`, of their equalities alone."""
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
    """Centre (n, 3) of each body's features and the diameter (n,) that they span about it, m."""
    index = np.concatenate([body[:, 0], body[:, 1]])
    points = np.concatenate([element[:, 0:3], element[:, 12:15]])
    center = np.zeros((n, 3))
    np.add.at(center, index, points)
    center /= np.bincount(index, minlength=n)[:, None]
    reach = np.linalg.norm(points - center[index], axis=1) + np.concatenate([radius, radius])
    extent = np.zeros(n)
    np.maximum.at(extent, index, 2.0 * reach)
    return center, extent
