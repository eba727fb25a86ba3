"""`Batch`: islands that are advanced side by side, each with its own clock; and how bodies are grouped into islands.

Two bodies are in one island of a step if their swept bounds meet: their boxes come within the way they close plus a
margin for leaving free flight (forces, impacts). The margin is estimated at the start of the step and measured during
it; islands whose margin was too small are taken again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from physics.contact.contact_features import end_of_pair
from physics.contact.surface_pairs import apart, closing_speed
from physics.joints.articulated_body import ArticulatedBody
from physics.joints.rows import JointConstraint
from physics.model.bodies import Bodies
from physics.model.shapes import Shapes
from physics.solver.islands import components

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(eq=False)
class Batch:
    """Bodies of some islands and pairs near to them. Islands are numbered 0 … count-1; rows are in that order."""

    ids: Ints
    """free bodies, by island, then ascending"""
    island: Ints
    """(n,) of each body"""
    count: int
    pairs: Ints
    """(k, 4) near surface pairs that involve at least one of them, by island"""
    of: Ints
    """island by object id, -1 for objects that are not free or not in the batch"""
    moved: Ints
    """moving kinematic bodies among the pairs and joints; islands near the same one are merged"""
    moved_island: Ints
    """(m,) the island each of them is near to"""
    joints: Sequence[JointConstraint] = ()
    mechanism: ArticulatedBody | None = None
    """the same bodies in joint coordinates, where that is possible (a batch of one island)"""
    constant: bool = True
    """whether all applied forces are constant"""
    start: Ints = field(default_factory=lambda: np.zeros(1, np.int64))
    """(count,) row of each island's first body"""

    def __post_init__(self) -> None:
        self.start = np.searchsorted(self.island, np.arange(self.count))

    def of_rows(self, ints: Ints) -> Ints:
        """(c,) island of rows whose first two columns are object ids, -1 for rows of other batches."""
        return np.maximum(self.of[ints[:, 0]], self.of[ints[:, 1]])

    def part(self, chosen: NDArray[np.bool_]) -> Batch:
        """The islands of a mask (count,), renumbered; itself if that is all of them."""
        if chosen.all():
            return self
        number = np.cumsum(chosen) - 1
        number[~chosen] = -1
        mine = chosen[self.island]
        near = chosen[np.maximum(self.of[self.pairs[:, 0]], self.of[self.pairs[:, 2]])]
        of = np.where(self.of >= 0, number[self.of], -1)
        kept = chosen[self.moved_island]
        return Batch(
            self.ids[mine], number[self.island[mine]], int(chosen.sum()), self.pairs[near], of, self.moved[kept],
            number[self.moved_island[kept]], self.joints, self.mechanism, self.constant,
        )  # fmt: skip

    def all(self, of_bodies: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(count,) whether a mask over `ids` is true for every body of an island."""
        return np.logical_and.reduceat(of_bodies, self.start)

    def largest(self, of_bodies: Array) -> Array:
        """(count,) maximum of values over `ids`, by island."""
        return np.maximum.reduceat(of_bodies, self.start)


def whole(
    ids: Ints, pairs: Ints, moved: Ints, n: int, joints: Sequence[JointConstraint], mechanism, constant: bool
) -> Batch:
    """One island of the bodies `ids`."""
    of = np.full(n, -1, np.int64)
    of[ids] = 0
    none = np.zeros(len(moved), np.int64)
    return Batch(ids, np.zeros(len(ids), np.int64), 1, pairs, of, moved, none, joints, mechanism, constant)


class SweptBounds:
    """Swept bounds of bodies over a step from their state at its start; tells which may meet."""

    def __init__(self, bodies: Bodies, shape_of: Ints, shapes: Shapes, dt: float) -> None:
        self._state = (bodies.rotation, bodies.origin, bodies.velocity)
        self._shapes = (bodies.radius, shape_of, shapes.first_surface, shapes.boxes)
        self._dt = dt

    def keep(self) -> None:
        """Copy the state at the start of the step, so that `meeting` can be called after bodies have moved."""
        rotation, origin, velocity = self._state
        self._state = (rotation.copy(), origin.copy(), velocity.copy())

    def meeting(self, pairs: Ints, spread: Array) -> NDArray[np.bool_]:
        """Mask (k,) of the surface pairs (k, 4), sorted, of objects that may meet; spread: (N,) m by id, by which an
        object may leave its free flight.
        """
        return _meeting(pairs, *self._state, *self._shapes, spread, self._dt)


def same_objects(pairs: Ints, among: Ints) -> NDArray[np.bool_]:
    """Mask (k,) of the surface pairs whose objects have a row in `among`."""
    n = np.int64(1) << 31
    return np.isin(pairs[:, 0] * n + pairs[:, 2], among[:, 0] * n + among[:, 2])


def split(ids: Ints, pairs: Ints, moved: Ints, bodies: Bodies) -> Batch:
    """The bodies `ids` (ascending) as islands, by the near surface pairs (k, 4)."""
    n = bodies.n
    place = np.full(n, -1, np.int64)
    place[ids] = np.arange(len(ids))
    links = np.stack([place[pairs[:, 0]], place[pairs[:, 2]]], axis=1)
    carried = moved[bodies.velocity[moved].any(axis=1)]
    label, count = components(len(ids), np.concatenate([links, _through(carried, pairs, place)]))
    order = np.argsort(label, kind="stable")
    of = np.full(n, -1, np.int64)
    of[ids] = label
    by_island = np.argsort(np.maximum(of[pairs[:, 0]], of[pairs[:, 2]]), kind="stable")
    pairs = np.ascontiguousarray(pairs[by_island])
    near = np.maximum(of[pairs[:, 0]], of[pairs[:, 2]])
    of_moved = np.array([near[(pairs[:, 0] == i) | (pairs[:, 2] == i)].max(initial=-1) for i in moved], np.int64)
    return Batch(ids[order], label[order], count, pairs, of, moved[of_moved >= 0], of_moved[of_moved >= 0])


def _through(moved: Ints, pairs: Ints, place: Ints) -> Ints:
    """(c, 2) links between the bodies that are near to the same moving kinematic body."""
    out = [np.zeros((0, 2), np.int64)]
    for i in moved:
        others = np.concatenate([pairs[pairs[:, 0] == i, 2], pairs[pairs[:, 2] == i, 0]])
        met = place[others]
        met = met[met >= 0]
        out.append(np.stack([met[:-1], met[1:]], axis=1))
    return np.concatenate(out)


@kernel(allocates=True)
def _meeting(pairs, rotations, origins, velocity, radius, shape_of, first_surface, boxes, spread, dt):
    """See `SweptBounds.meeting`.

    Objects may meet if boxes of two of their surfaces come within what they move; then all surface pairs within twice
    that count, for a rebound.
    """
    near = np.zeros(len(pairs), np.bool_)
    first = 0
    while first < len(pairs):
        a, b = pairs[first, 0], pairs[first, 2]
        last = end_of_pair(pairs, first)
        speed = closing_speed(velocity, radius, a, b)
        within = dt * speed + spread[a] + spread[b]
        fa, fb = first_surface[shape_of[a]], first_surface[shape_of[b]]
        meet = False
        for i in range(first, last):
            box_a, box_b = boxes[fa + pairs[i, 1]], boxes[fb + pairs[i, 3]]
            if not apart(box_a, rotations[a], origins[a], box_b, rotations[b], origins[b], within):
                meet = True
                break
        if meet:
            for i in range(first, last):
                box_a, box_b = boxes[fa + pairs[i, 1]], boxes[fb + pairs[i, 3]]
                near[i] = not apart(box_a, rotations[a], origins[a], box_b, rotations[b], origins[b], 2.0 * within)
        first = last
    return near
