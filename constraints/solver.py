"""`solve`: the nearest poses at which the constraints hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints import system_kernels as kernels
from constraints.kinds.base import Constraint
from constraints.system import Array, Poses, System, systems

MAX_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Solution:
    """What `solve` found."""

    poses: Mapping[int, pin.SE3]
    """of each movable body that a constraint speaks of; where nothing had to move, the pose that was given"""
    residual: float
    """m or rad: greatest row over all constraints that a movable body takes part in"""
    converged: bool
    """every row within `tolerance.solver` (or what float64 resolves at the scene's size, if that is more)"""
    iterations: int
    conflicting: tuple[int, ...] = ()
    """places of the constraints that do not hold at `poses` (empty if converged); `mobility` says which clash"""


def solve(
    constraints: Sequence[Constraint],
    poses: Poses,
    movable: Iterable[int],
    tolerance: Tolerance | None = None,
) -> Solution:
    """Move the movable bodies, as little as it takes, until the constraints hold.

    Only connected components with a movable body are looked at, and of these only the ones that do not hold already
    are moved. A contradiction ends at the least-squares poses, with `converged` False.

    Parameters
    ----------
    constraints: any order; a solution does not depend on names, only on this order's rounding.
    poses: of every body that a constraint names, by id (sequence or mapping); not changed.
    movable: ids of the bodies that may move.

    Raises
    ------
    ConstraintsError: a constraint names a body without a pose, or a pose is not finite.
    """
    tol = tolerance or Tolerance()
    moves = frozenset(movable)
    out: dict[int, pin.SE3] = {}
    residual, iterations, converged = 0.0, 0, True
    conflicting: list[int] = []
    for system in systems(tuple(constraints), moves):
        rotation, translation = system.gather(poses)
        limit = resolution(system, translation, tol)
        status, count, worst = run(system, rotation, translation, limit)
        if status == kernels.SOLVED and count == 0:
            out.update((b, poses[b]) for b in system.movable)
        else:
            out.update(system.scatter(rotation, translation))
        if status != kernels.SOLVED:
            converged = False
            r = system.evaluate(rotation, translation)[0]
            conflicting += sorted({system.members[k] for k in system.owner[np.abs(r) > limit]})
        residual = max(residual, worst)
        iterations += count
    return Solution(out, residual, converged, iterations, tuple(sorted(conflicting)))


def resolution(system: System, translation: Array, tolerance: Tolerance) -> float:
    """The residual to reach: `tolerance.solver`, or four roundings of the largest coordinate where that is more."""
    largest = max(float(np.abs(translation).max()), float(np.abs(system.element[:, [0, 1, 2, 12, 13, 14]]).max()))
    return max(tolerance.solver, 4.0 * float(np.spacing(largest)))


def run(system: System, rotation: Array, translation: Array, limit: float) -> tuple[int, int, float]:
    """Levenberg-Marquardt on one system, poses changed in place: (status, iterations, greatest residual)."""
    e = system.elimination
    return kernels.levenberg_marquardt(
        system.code, system.body, system.element, system.param, system.start, system.weight, system.extent,
        system.columns, system.target, e.column, e.row, e.update, e.update_start,
        rotation, translation, system.length, limit, MAX_ITERATIONS,
    )  # fmt: skip
