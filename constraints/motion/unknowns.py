"""The unknowns of constrained motion and what the constraints say of them to first order.

For each body the local twist about the centre of its box, rotation measured in metres at the rim of the ball about it:
all unknowns are lengths. A system's equations are linear in twists about the system's own centres; they are brought to
these unknowns here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from collision.numeric.kernel import kernel
from constraints.kinds import Constraint
from constraints.solve.groups import ALONE, Groups
from constraints.solve.system import System, systems

Array = NDArray[np.float64]
Shape = Callable[[int], tuple[Array, float]]
"""body -> centre (3,) of its box in its frame, and the radius (m) of the ball about it that holds the body"""


@dataclass(frozen=True, eq=False)
class _Rows:
    """Where one system's Jacobian goes among the unknowns, for one of the two bodies of its equations."""

    rows: NDArray[np.int64]
    """(k,) of those whose body moves"""
    block: NDArray[np.int64]
    """(k,) place of the body of each"""
    shift: Array
    """(k, 3) from the body's centre here to the system's"""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Which bodies move together, as long as the same constraints hold and the same bodies are held."""

    bodies: tuple[int, ...]
    place: dict[int, int]
    """body -> place in `bodies` of it or of its carrier; its unknowns are the six from 6·place on"""
    center: Array
    """(k, 3)"""
    radius: Array
    """(k,)"""
    reach: Array
    """(k,) m: how far from `center` any point of the body and of what it carries lies, at most"""
    groups: Groups
    systems: tuple[System, ...]
    scatter: tuple[tuple[_Rows, _Rows], ...]
    constraints: tuple[Constraint, ...]
    """those that speak of the bodies"""

    @classmethod
    def of(
        cls, constraints: tuple[Constraint, ...], moves: frozenset[int], held: frozenset[int], shape: Shape,
        groups: Groups = ALONE,
    ) -> Unknowns:  # fmt: skip
        """The held bodies, and those that a chain of constraints between movable ones joins to them.

        groups: whose carriers the constraints speak of; what is carried is not among `moves`.
        """
        own = tuple(s for s in systems(constraints, moves) if held & set(s.movable))
        bodies = tuple(sorted(held | {b for s in own for b in s.movable}))
        place = {b: k for k, b in enumerate(bodies)}
        center = np.array([shape(b)[0] for b in bodies])
        radius = np.array([shape(b)[1] for b in bodies])
        scatter = tuple((_rows(s, 0, place, center), _rows(s, 1, place, center)) for s in own)
        members = tuple(constraints[k] for s in own for k in s.members)
        reach = radius.copy()
        for body, (carrier, seat) in groups.seats.items():
            if carrier in place:
                k = place[body] = place[carrier]
                middle, ball = shape(body)
                reach[k] = max(reach[k], float(np.linalg.norm(seat.act(middle) - center[k])) + ball)
        return cls(bodies, place, center, radius, reach, groups, own, scatter, members)

    @cached_property
    def named(self) -> tuple[int, ...]:
        """All bodies that the constraints speak of, ascending."""
        return tuple(sorted({b for system in self.systems for b in system.bodies}))

    @property
    def n(self) -> int:
        """How many there are."""
        return 6 * len(self.bodies)

    def linearised(self, poses: Sequence[pin.SE3], rigid: float) -> tuple[Array, Array]:
        """Residual (m,) and Jacobian (m, n) of the constraints, in metres (radians at the size of the features).

        rigid: `Tolerance.rigid`, which the poses have to meet.
        """
        m = sum(system.rows for system in self.systems)
        residual, jacobian = np.empty(m), np.zeros((m, self.n))
        first = 0
        for system, sides in zip(self.systems, self.scatter, strict=True):
            r, *both = system.evaluate(*system.gather(poses, rigid))
            residual[first : first + system.rows] = r * system.weight
            for j, to in zip(both, sides, strict=True):
                _add_rows(j, system.weight, to.rows, to.block, to.shift, self.radius, first, jacobian)
            first += system.rows
        return residual, jacobian

    def turn(self, x: Array) -> float:
        """rad: the most that a body turns in the motion x."""
        return _extremes(x, self.radius, self.reach)[0]

    def travel(self, x: Array) -> float:
        """m: the farthest that any point of any body goes, at most."""
        return _extremes(x, self.radius, self.reach)[1]

    def closing(self, x: Array) -> float:
        """m: bound of how much nearer any two points come to each other by the motion x."""
        return self.travel(x) * min(len(self.bodies), 2)

    def clipped(self, x: Array, most: float) -> Array:
        """A motion shortened until no body turns by more than `most` rad."""
        turn = self.turn(x)
        return x if turn <= most else x * (most / turn)

    def moved(self, x: Array, poses: Sequence[pin.SE3]) -> dict[int, pin.SE3]:
        """Where the motion x brings the bodies: each goes along one screw, so that those that move as one stay so."""
        target = {}
        for k, body in enumerate(self.bodies):
            turn = x[6 * k + 3 : 6 * k + 6] / self.radius[k]
            twist = pin.Motion(x[6 * k : 6 * k + 3] - pin.skew(turn) @ self.center[k], turn)
            moved = poses[body] * pin.exp6(twist)
            target[body] = pin.SE3(pin.Quaternion(moved.rotation).normalized().matrix(), moved.translation)
        return target

    def gap_rows(self, rows: NDArray[Any], normals: Array, poses: Sequence[pin.SE3]) -> Array:
        """C (k, n): to first order the gaps of contact rows grow by C x; `normals` (k, 3) point from a to b."""
        out = np.zeros((len(rows), self.n))
        rotation = np.array([poses[b].rotation for b in self.bodies])
        translation = np.array([poses[b].translation for b in self.bodies])
        for side, sign in (("a", -1.0), ("b", 1.0)):
            place = np.array([self.place.get(i, -1) for i in rows["object_" + side].tolist()], np.int64)
            points = np.ascontiguousarray(rows["point_" + side])
            _add_gaps(place, points, normals, sign, rotation, translation, self.center, self.radius, out)
        return out


def _rows(system: System, side: int, place: dict[int, int], center: Array) -> _Rows:
    equation = np.repeat(np.arange(len(system.code)), np.diff(np.append(system.start, system.rows)))
    at = system.body[equation, side]
    rows = np.flatnonzero(system.slot[at] >= 0)
    block = np.array([place[system.bodies[i]] for i in at[rows]], dtype=np.int64)
    return _Rows(rows, block, (system.center[at[rows]] - center[block]).reshape(-1, 3))


@kernel
def _extremes(x, radius, reach):  # pragma: no cover - compiled
    """rad that a body turns at most in the motion x (n,), and m that a point goes at most."""
    most = farthest = 0.0
    for k in range(len(radius)):
        shift = turn = 0.0
        for d in range(3):
            shift += x[6 * k + d] * x[6 * k + d]
            turn += x[6 * k + 3 + d] * x[6 * k + 3 + d]
        angle = np.sqrt(turn) / radius[k]
        most = max(most, angle)
        farthest = max(farthest, np.sqrt(shift) + angle * reach[k])
    return most, farthest


@kernel
def _add_rows(j, weight, rows, block, shift, radius, first, out):  # pragma: no cover - compiled
    """Add a system's Jacobian (m, 6) of one side, twists about its own centres, to the rows of `out` from `first`."""
    for k in range(len(rows)):
        row, w, c = rows[k], weight[rows[k]], 6 * block[k]
        x, y, z = j[row, 0], j[row, 1], j[row, 2]
        a, b, d = shift[k, 0], shift[k, 1], shift[k, 2]
        scale = w / radius[block[k]]
        out[first + row, c] += w * x
        out[first + row, c + 1] += w * y
        out[first + row, c + 2] += w * z
        out[first + row, c + 3] += scale * (j[row, 3] + b * z - d * y)
        out[first + row, c + 4] += scale * (j[row, 4] + d * x - a * z)
        out[first + row, c + 5] += scale * (j[row, 5] + a * y - b * x)


@kernel(allocates=True)
def _add_gaps(place, points, normals, sign, rotation, translation, center, radius, out):  # pragma: no cover - compiled
    """Add to `out` (k, n) how fast points (k, 3) on moving bodies go along `sign`·normals (k, 3), all world."""
    n, arm = np.empty(3), np.empty(3)
    for k in range(len(place)):
        body = place[k]
        if body < 0:
            continue
        for i in range(3):
            n[i], arm[i] = 0.0, -center[body, i]
            for d in range(3):
                n[i] += sign * normals[k, d] * rotation[body, d, i]
                arm[i] += (points[k, d] - translation[body, d]) * rotation[body, d, i]
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            out[k, 6 * body + i] += n[i]
            out[k, 6 * body + 3 + i] += (arm[p] * n[q] - arm[q] * n[p]) / radius[body]
