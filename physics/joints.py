"""Accepted constraints as joints: their rows in the world's coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from physics.bodies import FREE, Bodies

Array = NDArray[np.float64]


class Joint(Protocol):
    """What physics needs of an accepted constraint; `constraints.kinds` are such."""

    @property
    def bodies(self) -> tuple[int, int]:
        """Ids of the two bodies."""

    def residual(self, pose_a: pin.SE3, pose_b: pin.SE3) -> Array:
        """(r,) m and rad: zero where the joint holds."""

    def jacobian(self, pose_a: pin.SE3, pose_b: pin.SE3) -> tuple[Array, Array]:
        """(r, 6) each: derivatives by the local twists of the two bodies."""


def _world_rows(jacobian: Array, bodies: Bodies, i: int) -> Array:
    """Rows (r, 6) by a local twist, rewritten for the velocity of the centre of mass and ω in world axes."""
    rotation = bodies.rotation[i]
    linear = jacobian[:, :3] @ rotation.T
    angular = jacobian[:, 3:] @ rotation.T
    d = bodies.origin[i] - bodies.center[i]
    return np.hstack([linear, angular + np.cross(d, linear)])


def assemble(joints: Sequence[Joint], bodies: Bodies, ids: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array, Array]:
    """Rows of all joints: bodies (g, 2) as places in `ids` or -1, Jacobians (g, 1, 12), residuals (g, 1)."""
    if not joints:
        return _NO_BODIES, _NO_ROWS, _NO_RESIDUALS
    place = {int(i): k for k, i in enumerate(ids)}
    which, rows, residuals = [], [], []
    for joint in joints:
        a, b = joint.bodies
        pose_a, pose_b = bodies.pose(a), bodies.pose(b)
        residual = np.asarray(joint.residual(pose_a, pose_b))
        by_a, by_b = joint.jacobian(pose_a, pose_b)
        local = [place.get(i, -1) if bodies.kind[i] == FREE else -1 for i in (a, b)]
        rows.append(np.hstack([_world_rows(by_a, bodies, a), _world_rows(by_b, bodies, b)]))
        residuals.append(residual)
        which.append(np.tile(local, (len(residual), 1)))
    return (
        np.ascontiguousarray(np.concatenate(which), dtype=np.int64),
        np.ascontiguousarray(np.concatenate(rows)[:, None, :]),
        np.ascontiguousarray(np.concatenate(residuals)[:, None]),
    )


_NO_BODIES = np.zeros((0, 2), np.int64)
_NO_ROWS = np.zeros((0, 1, 12))
_NO_RESIDUALS = np.zeros((0, 1))
