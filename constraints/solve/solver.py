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
"""columns of the largest system that is refined by a dense decomposition"""
ROUNDING = 1e-13
"""1: pivots below this times the largest are rounding errors"""


@dataclass(frozen=True, eq=False)
class Solution:
    """The result of `solve`."""

    poses: Mapping[int, pin.SE3]
    """of each movable body with a constraint; the given pose if it did not have to move"""
    residual: float
    """m or rad: greatest row of all constraints with a movable body"""
    converged: bool
    """whether every row is within `tolerance.solver`, or the resolution of float64 at the scene's size"""
    iterations: int
    conflicting: tuple[int, ...] = ()
    """indices of the constraints that do not hold at `poses` (empty if converged); `mobility` finds the conflicts"""


def solve(
    constraints: Sequence[Constraint],
    poses: Poses,
    movable: Iterable[int],
    tolerance: Tolerance | None = None,
) -> Solution:
    """Return the nearest poses of the movable bodies at which the constraints hold.

    Only connected components with a movable body are considered, and only those that do not hold are moved. A
    contradiction ends at the least-squares poses, with `converged` False.

    Parameters
    ----------
    constraints: in any order, which affects solutions by rounding only.
    poses: of every body with a constraint, by id (sequence or mapping); not changed.
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
    """Solve one system, changing poses in place; return (status, iterations, greatest residual)."""
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
    """Refine what Levenberg-Marquardt left unsolved, if the system is small enough."""
    status, iterations, worst = state
    if status == kernels.SOLVED or 6 * len(system.movable) > MAX_POLISHED:
        return state
    limit = kernels.resolution(system.element, translation, tolerance.solver)
    more, worst = _polish(system, rotation, translation, worst, limit)
    return (kernels.SOLVED if worst <= limit else status), iterations + more, worst


def _polish(system: System, rotation: Array, translation: Array, worst: float, limit: float) -> tuple[int, float]:
    """Gauss-Newton steps of least norm from an orthogonal decomposition, while each halves the residual.

    JᵀJ loses singular values below 1e-7 (planes that far from parallel); here all above rounding are used, since a step
    is taken only if it halves the residual.
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
