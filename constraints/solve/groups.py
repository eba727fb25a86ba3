"""`Groups`: bodies that move rigidly with a held body, their carrier, whose constraints include theirs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.errors import ConstraintsError
from constraints.kinds.base import Constraint
from constraints.kinds.equations import Array, Equation


@dataclass(frozen=True, eq=False)
class OnCarrier(Constraint):
    """A constraint of carried bodies, expressed in the frames of their carriers."""

    kind: ClassVar[str] = "on carrier"

    of: Constraint | None = None
    seats: tuple[pin.SE3, pin.SE3] = (pin.SE3.Identity(), pin.SE3.Identity())
    """pose of each body of `of` in its carrier's frame; the identity for a body that is not carried"""

    def equations(self) -> tuple[Equation, ...]:
        assert self.of is not None
        return tuple(
            replace(e, a=_moved(e.a, self.seats[e.swapped]), b=_moved(e.b, self.seats[not e.swapped]))
            for e in self.of.equations()
        )

    @property
    def reach(self) -> float:
        assert self.of is not None
        return self.of.reach


def _moved(element: Array, seat: pin.SE3) -> Array:
    """An element (12,), a point and three directions, in the frame in which its body has the pose `seat`."""
    x = element.reshape(4, 3) @ seat.rotation.T
    x[0] += seat.translation
    return x.ravel()


@dataclass(frozen=True, eq=False)
class Groups:
    """The carried bodies, their carriers, and their poses in the carriers' frames."""

    seats: Mapping[int, tuple[int, pin.SE3]]
    """carried body -> its carrier, and its pose in the carrier's frame"""

    @classmethod
    def of(cls, carried: Mapping[int, Iterable[int]], poses: Sequence[pin.SE3], before: Groups) -> Groups:
        """Return the groups of carriers and carried bodies; a body that was carried so `before` keeps its seat.

        Raises ConstraintsError for a body that is carried twice, or is a carrier itself.
        """
        seats: dict[int, tuple[int, pin.SE3]] = {}
        for carrier, bodies in sorted(carried.items()):
            for body in sorted(bodies):
                if body in seats or body in carried:
                    raise ConstraintsError(f"body {body} cannot be carried with {carrier}: carried once, by a held one")
                seat = before.seats.get(body)
                if seat is None or seat[0] != carrier:
                    seat = carrier, poses[carrier].actInv(poses[body])
                seats[body] = seat
        same = seats.keys() == before.seats.keys() and all(seats[b] is seat for b, seat in before.seats.items())
        return before if same else cls(seats)

    def carrier(self, body: int) -> int:
        """Return the carrier of a body; the body itself if it is not carried."""
        seat = self.seats.get(body)
        return body if seat is None else seat[0]

    def within(self, bodies: tuple[int, int]) -> bool:
        """Whether two bodies are in one group."""
        return bool(self.seats) and self.carrier(bodies[0]) == self.carrier(bodies[1])

    def carriers(self, count: int) -> NDArray[np.int64]:
        """Return (count,): the `carrier` of each body. Read only."""
        known = self._carriers.get(count)
        if known is None:
            known = self._carriers[count] = np.arange(count)
            known[list(self.seats)] = [carrier for carrier, _ in self.seats.values()]
        return known

    @cached_property
    def _carriers(self) -> dict[int, NDArray[np.int64]]:
        return {}

    @cached_property
    def members(self) -> dict[int, tuple[int, ...]]:
        """carrier -> all bodies of its group, itself first, the others ascending."""
        out: dict[int, tuple[int, ...]] = {}
        for body, (carrier, _) in sorted(self.seats.items()):
            out[carrier] = (*out.get(carrier, (carrier,)), body)
        return out

    def constraints(self, every: Iterable[Constraint]) -> tuple[Constraint, ...]:
        """Return the constraints as constraints of the carriers, without those within a group."""
        if not self.seats:
            return tuple(every)
        return tuple(self._taken_over(c) for c in every if not self.within(c.bodies))

    def _taken_over(self, c: Constraint) -> Constraint:
        seats = [self.seats.get(body, (body, pin.SE3.Identity())) for body in c.bodies]
        (a, at_a), (b, at_b) = seats
        if (a, b) == c.bodies:
            return c
        return OnCarrier((a, b), c.features, c.surfaces, c.size, of=c, seats=(at_a, at_b))

    def followed(self, poses: Mapping[int, pin.SE3], before: Sequence[pin.SE3]) -> dict[int, pin.SE3]:
        """Return `poses` of carriers, and those of the bodies they carry: as `before`, if the carrier stays."""
        out = dict(poses)
        for carrier, pose in poses.items() if self.seats else ():
            if pose is before[carrier] or pose == before[carrier]:
                out |= {body: before[body] for body in self.members.get(carrier, (carrier,))[1:]}
            else:
                out |= self.carried(carrier, pose)
        return out

    def with_carried(self, held: Mapping[int, pin.SE3]) -> dict[int, pin.SE3]:
        """Poses of held bodies, and those that what they carry has with them."""
        out = dict(held)
        for body, pose in held.items() if self.seats else ():
            out |= self.carried(body, pose)
        return out

    def carried(self, carrier: int, pose: pin.SE3) -> dict[int, pin.SE3]:
        """Return the poses of the bodies carried by a carrier at a pose; the last result is cached."""
        known = self._carried.get(carrier)
        key = pose.homogeneous.tobytes()
        if known is None or known[0] != key:
            seats = self.seats
            poses = {body: pose * seats[body][1] for body in self.members.get(carrier, (carrier,))[1:]}
            known = self._carried[carrier] = key, poses
        return known[1]

    @cached_property
    def _carried(self) -> dict[int, tuple[bytes, dict[int, pin.SE3]]]:
        return {}


ALONE = Groups({})
"""no carried bodies"""
