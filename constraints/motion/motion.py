"""Constrained motion: a hand wants a pose, the part goes to the nearest one that constraints and solid bodies allow.

`ConstrainedMotion` is the door: it keeps collision in step with the constraints and what of one step serves the next. A
step itself is `constraints.motion.god_object`; what is near is `constraints.motion.walls`, what the constraints allow
`constraints.motion.unknowns`, and what they keep out of collision `constraints.recognition.mated`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision import CONTACT_DTYPE, Tolerance
from constraints.errors import ConstraintsError
from constraints.manager import ConstraintManager
from constraints.motion.god_object import Barrier, Linear, MotionResult, Step, Surroundings, Swept, open_way
from constraints.motion.passage import Drawn
from constraints.motion.unknowns import Unknowns
from constraints.motion.walls import NOT_SEARCHED, Searched, Walls
from constraints.recognition.mated import Ignoring, MatedSurfaces
from constraints.solve.groups import Groups


class Solids(Swept, Ignoring, Protocol):
    """What motion needs of `collision.CollisionManager`."""

    @property
    def poses(self) -> tuple[pin.SE3, ...]: ...
    def set_groups(self, groups: Iterable[Iterable[int]]) -> None: ...
    def penetration(self, i: int, j: int) -> NDArray[Any]: ...


class ConstrainedMotion:
    """Moves held parts and what hangs on them.

    Keeps the poses of `collision` up to date, and tells it to leave out the surfaces that a constraint in force mates
    (see `constraints.recognition.mated`). Everything else of both parts stays solid.

    Parameters
    ----------
    collision: a `CollisionManager` whose object ids are the bodies' ids.
    constraints: whose constraints in force hold.
    tolerance: `linear` is the distance that free motion keeps between solids.
    drawn: poses of all bodies in the assembly as drawn; by default those of the first step.
    """

    def __init__(
        self,
        collision: Solids,
        constraints: ConstraintManager,
        tolerance: Tolerance | None = None,
        drawn: Sequence[pin.SE3] | None = None,
    ) -> None:
        self.collision = collision
        self.constraints = constraints
        self.tolerance = tolerance or constraints.tolerance
        self.mated = MatedSurfaces(collision, constraints, self.tolerance)
        self.walls = Walls(collision, constraints.recogniser, self.tolerance)
        self._shape: dict[int, tuple[NDArray[np.float64], float]] = {}
        self._unknowns: tuple[Any, Unknowns] | None = None
        self._linear: Linear | None = None
        self._drawn: Drawn | None = None
        self._overlaps: dict[tuple[int, int], float] = {}
        self.jammed: Mapping[tuple[int, int], float] = {}
        """bodies of which a shaft and a bore clash as drawn, and how deep, m: where they are drawn they do not move
        against each other, unless collision leaves them out"""
        self.barrier: Barrier = open_way
        """what else stops motions, beside solids and constraints"""
        if drawn is not None:
            self.redraw(drawn)
        # a projection finer than this does not pay where measured features contradict one another by rounding
        self.solving = replace(self.tolerance, solver=max(self.tolerance.solver, 0.1 * self.tolerance.satisfied))

    def sync(self) -> None:
        """Tell collision which surfaces are mated now. `step` does so itself; call it before other queries."""
        self.mated.sync()

    def step(
        self,
        wanted: Mapping[int, pin.SE3],
        poses: Sequence[pin.SE3],
        movable: Iterable[int],
        carried: Mapping[int, Sequence[int]] | None = None,
        searched: Searched = NOT_SEARCHED,
    ) -> MotionResult:
        """Move the bodies in `wanted` towards the poses given, and with them what their constraints take along.

        wanted: target pose of each held body. poses: of all bodies, now. movable: ids that may move (held ones
        included); everything else stands still. carried: by held body those that it carries, see `carry`; None leaves
        that as it is. searched: contacts of all bodies that may move, as collision has them at these poses; they are
        used, and not searched again, if the search went far enough.

        Raises ConstraintsError for a pose that is not finite, or a body that is carried twice or carried and held.
        """
        for body, pose in wanted.items():
            if not np.isfinite(pose.homogeneous).all():
                raise ConstraintsError(f"the pose wanted of body {body} is not finite; give a finite one")
        if carried is not None:
            for held, bodies in carried.items():
                for body in bodies:
                    if held not in wanted or body in wanted:
                        raise ConstraintsError(
                            f"body {body} cannot be carried with {held}: carried once, by a held one"
                        )
            self.carry(carried, poses)
        self.sync()
        if not wanted:
            return MotionResult({}, False, np.empty(0, CONTACT_DTYPE), 0.0, {})
        jam = self._jam(wanted, poses)
        if jam is not None:
            return MotionResult({}, bool(len(jam)), jam, 0.0, {})
        moves = (frozenset(movable) | frozenset(wanted)).difference(self.groups.seats)
        key = (self.constraints.constraints, moves, frozenset(wanted), self.groups)
        if self._unknowns is None or self._unknowns[0] != key:
            constraints = self.groups.constraints(key[0])
            self._unknowns = (key, Unknowns.of(constraints, moves, key[2], self.shape, self.groups))
        if self._drawn is None:
            self.redraw(poses)
        assert self._drawn is not None
        around = Surroundings(
            self._drawn, self.collision, self.walls, self.mated, self.tolerance, self.solving, self.barrier, searched
        )
        step = Step(self._unknowns[1], wanted, poses, self._linear, around, self._home(wanted, poses))
        result = step.run()
        self._linear = step.linear
        return result

    def _jam(self, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3]) -> NDArray[Any] | None:
        """Contact rows of two jammed bodies of which hands hold one, no rows if it is wanted where it is; None if no
        jammed body is held."""
        held = {body: hand for hand in wanted for body in self.groups.members.get(hand, (hand,))}
        for a, b in self.jammed:
            if (a in held) == (b in held) or not self._stand_as_drawn(a, b):
                continue
            body = a if a in held else b
            rows = self.collision.contacts(self.constraints.within, [body])
            rows = rows[(rows["object_a"] == a) & (rows["object_b"] == b)]
            if len(rows):
                hand = held[body]
                still = np.abs(poses[hand].actInv(wanted[hand]).homogeneous - np.eye(4)).max()
                return rows if still > self.tolerance.satisfied else rows[:0]
        return None

    def _home(self, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3]) -> bool:
        """Whether held bodies are wanted where they are drawn, relative to all bodies that constraints join to them.

        The constraints must hold there within `Tolerance.linear`; none of them may be stated.
        """
        moved = self.groups.with_carried(wanted)
        mates = self.constraints
        candidates = [mates.accepted[id].candidate for id in mates.in_force.about(moved.keys(), self.groups)]
        if not candidates or any(c.stated or not mates.wanted_as_drawn(c, moved, poses) for c in candidates):
            return False
        return max(map(mates.off_as_drawn, candidates)) <= self.tolerance.linear

    @property
    def groups(self) -> Groups:
        """What is carried now."""
        return self.constraints.groups

    def carry(self, carried: Mapping[int, Sequence[int]], poses: Sequence[pin.SE3]) -> frozenset[int]:
        """Have each held body carry others, by held body: from now on they move as one rigid body.

        Bodies that move as one have no recognition, equations or contacts among them. A body that the same one
        carried before keeps its place on it to the bit.

        Returns the bodies that belong to a group now, or did before; none if nothing changed.

        Raises ConstraintsError for a body that is carried twice, or carried and held.
        """
        return self.regroup(Groups.of(carried, poses, self.groups))

    def regroup(self, groups: Groups) -> frozenset[int]:
        """`carry`, with places on the carriers that are known: those of a checkpoint."""
        before = self.groups
        if groups is before:
            return frozenset()
        self.constraints.groups = groups
        self.collision.set_groups(groups.members.values())
        return frozenset(b for g in (before, groups) for members in g.members.values() for b in members)

    def drop_caches(self) -> None:
        """Forget what was computed for earlier steps, also half of it by one that was interrupted."""
        self._unknowns = self._linear = None

    @property
    def drawn(self) -> tuple[pin.SE3, ...]:
        """The poses of all bodies in the assembly as drawn; none before the first step, if they were not given."""
        return () if self._drawn is None else self._drawn.poses

    def overlap_as_drawn(self, a: int, b: int) -> float:
        """m: how much deeper than their facets two bodies reach into each other, if they are where they are drawn."""
        if not self._stand_as_drawn(a, b):
            return 0.0
        known = self._overlaps.get((a, b))
        if known is None:
            sides = (("object_a", "surface_a"), ("object_b", "surface_b"))
            known = self._overlaps[a, b] = max(
                (
                    float(row["depth"]) - sum(self.walls.deflection(int(row[i]), int(row[s])) for i, s in sides)
                    for row in self.collision.penetration(a, b)
                ),
                default=0.0,
            )
        return max(known, self.jammed.get((min(a, b), max(a, b)), 0.0))

    def _stand_as_drawn(self, a: int, b: int) -> bool:
        """Whether two bodies stand to each other as they are drawn."""
        now, drawn = (at[a].actInv(at[b]) for at in (self.collision.poses, self.drawn))
        return bool(np.abs(drawn.actInv(now).homogeneous - np.eye(4)).max() <= self.tolerance.linear)

    def redraw(self, poses: Sequence[pin.SE3]) -> None:
        """Take other poses for those of the assembly as drawn."""
        self._drawn = Drawn(self.collision, self.walls, poses)
        self._overlaps.clear()
        self.constraints.drawn = self.drawn

    def shape(self, body: int) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) of a body's box in its frame and the radius of the ball about it that holds the body, m."""
        known = self._shape.get(body)
        if known is None:
            v = self.collision.mesh(body).vertices
            center = 0.5 * (v.min(axis=0) + v.max(axis=0))
            known = self._shape[body] = (center, float(np.sqrt(((v - center) ** 2).sum(axis=1).max())))
        return known


Motion = ConstrainedMotion
"""the name in the package's face"""
