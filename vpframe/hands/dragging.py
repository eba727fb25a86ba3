"""Pose of a part that is dragged by a point, within the freedom that its constraints leave."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

MOST_TURN = 0.25
"""maximum rotation of a Gauss–Newton step, rad: limit of the linearisation"""
ROUNDS = 4
"""number of Gauss–Newton steps"""
DAMPING = 1e-2
"""damping length, as a fraction of the part's half size: points closer to an axis turn the part little"""
SMALL = 1e-9
"""singular value below which a twist has no rotation"""


def along_freedom(
    pose: pin.SE3,
    point: NDArray[np.float64],
    to: NDArray[np.float64],
    twists: NDArray[np.float64] | None,
    size: float,
) -> pin.SE3:
    """Return the pose that brings a part's `point` (3,), part frame, m, closest to `to` (3,), world, m.

    Translations move as far as they can; rotations do the rest, by damped least squares.

    Parameters
    ----------
    twists: (6, k) orthonormal, linear first, in the part's frame; None: all translations, no rotation.
    size: half the part's size, m.
    """
    goal = pin.SE3(pose)
    if twists is None:
        goal.translation = goal.translation + (to - goal.act(point))
        return goal
    shifts = _shifts(twists)
    off = goal.actInv(to) - point
    goal = goal * pin.SE3(np.eye(3), shifts @ (shifts.T @ off))
    lever = np.hstack([np.eye(3), -pin.skew(point)]) @ twists
    lever -= shifts @ (shifts.T @ lever)  # errors that translations have removed
    arm = float(np.linalg.norm(lever, 2)) if lever.size else 0.0
    if arm <= DAMPING * size:
        return goal
    for _ in range(ROUNDS):
        off = goal.actInv(to) - point
        off -= shifts @ (shifts.T @ off)
        off *= min(1.0, arm / max(float(np.linalg.norm(off)), arm))  # beyond reach only the direction counts
        damped = lever.T @ lever + (DAMPING * size) ** 2 * np.eye(twists.shape[1])
        step = twists @ np.linalg.solve(damped, lever.T @ off)
        turn = float(np.linalg.norm(step[3:]))
        goal = goal * pin.exp6(step * min(1.0, MOST_TURN / turn) if turn > 0.0 else step)
    return goal


def _shifts(twists: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, m) orthonormal translations in the span of twists (6, k)."""
    if twists.shape[1] == 0:
        return np.zeros((3, 0))
    _, sizes, rows = np.linalg.svd(twists[3:])
    still = rows[int((sizes > SMALL).sum()) :].T
    return twists[:3] @ still
