"""`solve`: the nearest poses at which the constraints hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from collision import Tolerance
from constraints.kinds.base import Constraint
from constraints.solve import kernels
from constraints.solve.pose_kernels import move
from constraints.solve.ranks import least_norm
from constraints.solve.system import Array, Poses, System, plan, scatter

MAX_ITERATIONS = 200
MAX_POLISHED = 240
"""columns of the largest system that is polished by a dense decomposition"""
ROUNDING = 1e-13
"""1: pivots below this times the largest are rounding"""


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of `solve`."""

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
    work = plan(tuple(constraints), frozenset(movable))
    rotation, translation = work.gather(poses, tol.rigid)
    n = len(work.systems)
    if n == 0:
        return Solution({}, 0.0, True, 0)
    status, iterations, worst = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    given: tuple[Any, ...] = (*work.packed, work.offset, work.length, rotation, translation, tol.solver, MAX_ITERATIONS)
    given += (status, iterations, worst)
    kernels.solve_all(*given)
    unsolved = np.flatnonzero(status != kernels.SOLVED)
    for k in unsolved.tolist():
        own = slice(work.offset[k, 2], work.offset[k + 1, 2])
        state = status[k], iterations[k], worst[k]
        status[k], iterations[k], worst[k] = _finish(work.systems[k], rotation[own], translation[own], tol, state)
    out = {b: poses[b] for b in work.movable}
    moved = (iterations > 0)[work.system]
    if moved.any():
        matrix = scatter(rotation, translation, work.center)
        for k in np.flatnonzero(moved).tolist():
            out[work.movable[k]] = pin.SE3(matrix[work.moving[k]])
    conflicting: list[int] = []
    for k in unsolved[status[unsolved] != kernels.SOLVED].tolist():
        system, own = work.systems[k], slice(work.offset[k, 2], work.offset[k + 1, 2])
        limit = kernels.resolution(system.element, translation[own], tol.solver)
        r = system.evaluate(rotation[own], translation[own])[0]
        conflicting += sorted({system.members[i] for i in system.owner[np.abs(r) > limit]})
    return Solution(out, float(worst.max()), not conflicting, int(iterations.sum()), tuple(sorted(conflicting)))


def run(system: System, rotation: Array, translation: Array, tolerance: Tolerance) -> tuple[int, int, float]:
    """Solve one system, poses changed in place: (status, iterations, greatest residual)."""
    e = system.elimination
    state = kernels.solve_system(
        system.code, system.body, system.element, system.param, system.start, system.weight, system.extent,
        system.columns, system.target, e.column, e.row, e.update, e.update_start,
        rotation, translation, system.length, tolerance.solver, MAX_ITERATIONS,
    )  # fmt: skip
    return _finish(system, rotation, translation, tolerance, state)


def _finish(
    system: System, rotation: Array, translation: Array, tolerance: Tolerance, state: tuple[int, int, float]
) -> tuple[int, int, float]:
    """Polish what Levenberg-Marquardt left unsolved, where the system is small enough."""
    status, iterations, worst = state
    if status == kernels.SOLVED or 6 * len(system.movable) > MAX_POLISHED:
        return state
    limit = kernels.resolution(system.element, translation, tolerance.solver)
    more, worst = _polish(system, rotation, translation, worst, limit)
    return (kernels.SOLVED if worst <= limit else status), iterations + more, worst


def _polish(system: System, rotation: Array, translation: Array, worst: float, limit: float) -> tuple[int, float]:
    """Gauss-Newton steps of least norm from an orthogonal decomposition, while each halves the residual.

    JᵀJ hides what is weaker than 1e-7 (planes that far from parallel); here anything above rounding is followed, since
    a step is taken only if it pays.
    """
    columns = np.argsort(system.elimination.position)
    turned, moved = rotation.copy(), translation.copy()
    for count in range(MAX_ITERATIONS):
        if worst <= limit:
            return count, worst
        r, jacobian = system.dense(rotation, translation)
        step = least_norm(np.ascontiguousarray(jacobian.T), -r, ROUNDING).reshape(-1, 6)[columns]
        move(rotation, translation, system.extent, system.columns, step, turned, moved)
        now = float(np.abs(system.evaluate(turned, moved)[0]).max())
        if now > 0.5 * worst:
            return count, worst
        rotation[:], translation[:], worst = turned, moved, now
    return MAX_ITERATIONS, worst
