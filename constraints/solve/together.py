"""`Together`: residuals of many constraints in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from constraints.kinds.base import Constraint
from constraints.solve import jacobians

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Together:
    """Constraints as flat arrays, in the order given."""

    bodies: Ints
    """(k, 2) ids"""
    equations: Ints
    """(k + 1,) first equation of each"""
    rows: Ints
    """(k + 1,) first row of each"""
    linear: NDArray[np.bool_]
    """(m,) whether a row is in metres"""
    code: Ints
    side: Ints
    """(e, 2) ids of the bodies that carry element a and element b"""
    element: Array
    param: Array
    start: Ints
    """(e,) first row of each equation"""

    @classmethod
    def of(cls, constraints: Sequence[Constraint]) -> Together:
        """Return constraints packed as arrays."""
        each = [c.compiled for c in constraints]
        bodies = np.array([c.bodies for c in constraints], np.int64).reshape(-1, 2)
        equations, rows = (np.cumsum([0, *counts]) for counts in ([len(x.code) for x in each], [x.rows for x in each]))
        owner = np.repeat(np.arange(len(each)), np.diff(equations))

        def packed(arrays: Sequence[NDArray[Any]], empty: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([empty, *arrays])

        side = packed([x.side for x in each], np.zeros((0, 2), np.int64))
        return cls(
            bodies, equations, rows,
            ~packed([x.angular for x in each], np.zeros(0, bool)),
            packed([x.code for x in each], np.zeros(0, np.int64)),
            bodies[owner[:, None], side],
            packed([x.element for x in each], np.zeros((0, 24))),
            packed([x.param for x in each], np.zeros((0, 4))),
            packed([x.start for x in each], np.zeros(0, np.int64)) + rows[owner],
        )  # fmt: skip

    def subset(self, chosen: Ints) -> Together:
        """Return the constraints at these indices, which must be ascending."""
        counts = np.diff(self.equations)[chosen]
        lengths = np.diff(self.rows)[chosen]
        equations, rows = np.append(0, np.cumsum(counts)), np.append(0, np.cumsum(lengths))
        e = np.arange(equations[-1]) + np.repeat(self.equations[chosen] - equations[:-1], counts)
        r = np.arange(rows[-1]) + np.repeat(self.rows[chosen] - rows[:-1], lengths)
        start = self.start[e] + np.repeat(rows[:-1] - self.rows[chosen], counts)
        return Together(
            self.bodies[chosen], equations, rows, self.linear[r],
            self.code[e], self.side[e], self.element[e], self.param[e], start,
        )  # fmt: skip

    def residual(self, poses: Sequence[pin.SE3]) -> Array:
        """Return (m,), m or rad: all rows at `poses` of every body, by id."""
        return self.residual_at(*self.gather(poses))

    def gather(self, poses: Sequence[pin.SE3]) -> tuple[Array, Array]:
        """Return rotations (u, 3, 3) and translations (u, 3) of the bodies in `named`."""
        at = np.array([poses[i].homogeneous for i in self.named[0]]).reshape(-1, 4, 4)
        return np.ascontiguousarray(at[:, :3, :3]), np.ascontiguousarray(at[:, :3, 3])

    def residual_at(self, rotation: Array, translation: Array) -> Array:
        """Return `residual` at poses from `gather`."""
        m = int(self.rows[-1])
        r, ja, jb = np.empty(m), np.empty((m, 6)), np.empty((m, 6))
        jacobians.evaluate(
            self.code, self.named[1], self.element, self.param, self.start, rotation, translation, r, ja, jb
        )
        return r

    @cached_property
    def named(self) -> tuple[list[int], Ints]:
        """(ids of the bodies, indices in them of the entries of `side`)."""
        named, place = np.unique(self.side, return_inverse=True)
        return named.tolist(), place.reshape(self.side.shape)

    def distance(self, residual: Array) -> Array:
        """Return (k,) m: greatest row in metres of each constraint, 0 without one. residual: (m,) of all rows."""
        return np.maximum.reduceat(np.append(np.where(self.linear, np.abs(residual), 0.0), 0.0), self.rows[:-1])
