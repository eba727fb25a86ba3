"""Constrained motion: a hand wants a pose, the part goes to the nearest one that constraints and solid bodies allow.

`Motion` is the door: it keeps collision in step with the constraints and what of one step serves the next. A step
itself is `constraints.motion.god_object`; what is near is `constraints.motion.walls`, what the constraints allow
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
from constraints.kinds import Fixed
from constraints.manager import ConstraintManager
from constraints.motion.god_object import Linear, MotionResult, Step, Swept
from constraints.motion.unknowns import Unknowns
from constraints.motion.walls import Near, Walls
from constraints.recognition.mated import Ignoring, MatedSurfaces


class Solids(Near, Swept, Ignoring, Protocol):
    """What motion needs of `collision.CollisionManager`."""


class Motion:
    """Moves held parts and what hangs on them.

    Keeps the poses of `collision` up to date, and tells it to leave out the surfaces that a constraint in force mates
    (see `constraints.recognition.mated`). Everything else of both parts stays solid.

    Parameters
    ----------
    collision: a `CollisionManager` whose object ids are the bodies' ids.
    constraints: whose constraints in force hold.
    tolerance: `linear` is the distance that free motion keeps between solids.
    """

    def __init__(self, collision: Solids, constraints: ConstraintManager, tolerance: Tolerance | None = None) -> None:
        self.collision = collision
        self.constraints = constraints
        self.tolerance = tolerance or constraints.tolerance
        self.mated = MatedSurfaces(collision, constraints, self.tolerance)
        self.walls = Walls(collision, constraints.recogniser, self.tolerance)
        self._shape: dict[int, tuple[NDArray[np.float64], float]] = {}
        self._unknowns: tuple[Any, Unknowns] | None = None
        self._linear: Linear | None = None
        self.carried: dict[tuple[int, int], Fixed] = {}
        """held and carried body -> how the one sits on the other, as it was when it was first carried"""
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
    ) -> MotionResult:
        """Move the bodies in `wanted` towards the poses given, and with them what their constraints take along.

        wanted: target pose of each held body. poses: of all bodies, now. movable: ids that may move (held ones
        included); everything else stands still. carried: by held body the others that move as if welded to it, from
        the first step that names them to the last.

        Raises ConstraintsError for a pose that is not finite, or a body that is carried twice or carried and held.
        """
        for body, pose in wanted.items():
            if not np.isfinite(pose.homogeneous).all():
                raise ConstraintsError(f"the pose wanted of body {body} is not finite; give a finite one")
        self.sync()
        if not wanted:
            return MotionResult({}, False, np.empty(0, CONTACT_DTYPE), 0.0, {})
        welds, welded = self._welds(wanted, poses, carried or {})
        moves = frozenset(movable) | frozenset(wanted) | frozenset(welded)
        constraints = self.constraints.constraints
        if welds:  # what holds among bodies that move as one is not asked again: rounding would set it against the weld
            free = (c for c in constraints if welded.get(c.bodies[0], -1) != welded.get(c.bodies[1], -2))
            constraints = (*free, *welds)
        key = (constraints, moves, frozenset(wanted))
        if self._unknowns is None or self._unknowns[0] != key:
            self._unknowns = (key, Unknowns.of(*key, self.shape))
        step = Step(
            self._unknowns[1], wanted, poses, self._linear,
            self.collision, self.walls, self.mated, self.tolerance, self.solving,
        )  # fmt: skip
        result = step.run()
        self._linear = step.linear
        return result

    def _welds(
        self, wanted: Mapping[int, pin.SE3], poses: Sequence[pin.SE3], carried: Mapping[int, Sequence[int]]
    ) -> tuple[tuple[Fixed, ...], dict[int, int]]:
        """A weld for each carried body, and for each body of a group that moves as one the held one."""
        pairs = [(held, body) for held, bodies in sorted(carried.items()) for body in sorted(bodies)]
        self.carried = {pair: weld for pair, weld in self.carried.items() if pair in pairs}
        group: dict[int, int] = {}
        for held, body in pairs:
            if held not in wanted or body in wanted or body in group:
                raise ConstraintsError(f"body {body} cannot be carried with {held}: carried once, by a held one")
            group |= {held: held, body: held}
            if (held, body) not in self.carried:
                size = self.shape(body)[1]
                self.carried[held, body] = Fixed.between((held, body), poses[held], poses[body], size)
        return tuple(self.carried[pair] for pair in pairs), group

    def shape(self, body: int) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) of a body's box in its frame and the radius of the ball about it that holds the body, m."""
        known = self._shape.get(body)
        if known is None:
            v = self.collision.mesh(body).vertices
            center = 0.5 * (v.min(axis=0) + v.max(axis=0))
            known = self._shape[body] = (center, float(np.sqrt(((v - center) ** 2).sum(axis=1).max())))
        return known
