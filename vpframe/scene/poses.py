"""Checks of poses from scripts and files."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from vpframe.errors import VpframeError

RIGID = 1e-6
"""1: maximum entry of |RᵀR - I| of a rotation from a script or file"""


def rigid(pose: Any, what: str, error: type[VpframeError] = VpframeError) -> pin.SE3:
    """Return the pose if it is finite and a rigid motion; a (4, 4) matrix of one as `pinocchio.SE3`.

    Raises `error`, which names `what`.
    """
    if not isinstance(pose, pin.SE3):
        try:
            matrix = np.asarray(pose, dtype=np.float64)
        except (TypeError, ValueError):
            matrix = np.empty(0)
        if matrix.shape != (4, 4):
            raise error(f"{what} is {type(pose).__name__}; give a pinocchio.SE3 or a 4x4 matrix")
        if np.isfinite(matrix).all() and matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise error(f"{what} is no rigid motion: the last row of its matrix is not 0 0 0 1")
        pose = pin.SE3(matrix[:3, :3], matrix[:3, 3])
    (a, b, c), (d, e, f), (g, h, i) = pose.rotation.tolist()
    if not all(map(math.isfinite, (a, b, c, d, e, f, g, h, i, *pose.translation.tolist()))):
        raise error(f"{what} must be finite; the pose given holds NaN or infinity")
    mirrored = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0.0
    length = max(abs(a * a + d * d + g * g - 1.0), abs(b * b + e * e + h * h - 1.0), abs(c * c + f * f + i * i - 1.0))
    skew = max(abs(a * b + d * e + g * h), abs(a * c + d * f + g * i), abs(b * c + e * f + h * i))
    if mirrored or max(length, skew) > RIGID:
        raise error(f"{what} is no rigid motion: its rotation is stretched or mirrored; normalise it")
    return pose
