"""Poses as the kernels take them: (12,) float64, the rotation by rows, then the translation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.errors import PoseError
from collision.tolerance import Tolerance


def pack(pose: Any, who: str, object_id: int | None = None, rigid: float = Tolerance.rigid) -> NDArray[np.float64]:
    """The (12,) form of a `pinocchio.SE3` or (4, 4) matrix.

    Raises
    ------
    PoseError: not finite, or not a rigid motion (an entry of RᵀR - I beyond `rigid`, a mirror image, a last row that
        is not 0 0 0 1); names `who` the pose is for.
    """
    matrix = getattr(pose, "homogeneous", pose)
    try:
        matrix = np.asarray(matrix, np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (4, 4):
        raise PoseError(f"{who}: a pose is a pinocchio.SE3 or a 4x4 matrix, not {type(pose).__name__}", object_id)
    if not np.isfinite(matrix).all():
        raise PoseError(f"{who}: the pose has entries that are not finite: {matrix[:3].tolist()}", object_id)
    rotation = matrix[:3, :3]
    if not _is_rigid(matrix, rigid):
        off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        raise PoseError(
            f"{who}: the pose is not a rigid motion (RᵀR is off the identity by {off:.3g}, {rigid:g} is allowed; "
            f"det R = {np.linalg.det(rotation):.6g}); normalise the rotation, scale the mesh instead of the pose",
            object_id,
        )
    return np.concatenate([rotation.ravel(), matrix[:3, 3]])


def _is_rigid(matrix: NDArray[np.float64], rigid: float) -> bool:
    """Whether a (4, 4) matrix is a rigid motion, by plain arithmetic: numpy's calls cost four times as much here."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), last = matrix.tolist()
    columns = (
        a * a + d * d + g * g - 1.0, b * b + e * e + h * h - 1.0, c * c + f * f + i * i - 1.0,
        a * b + d * e + g * h, a * c + d * f + g * i, b * c + e * f + h * i,
    )  # fmt: skip
    det = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    return max(columns) <= rigid and min(columns) >= -rigid and det > 0.0 and last == [0.0, 0.0, 0.0, 1.0]


def unpack(packed: NDArray[np.float64]) -> Any:
    """The `pinocchio.SE3` of a (12,) pose."""
    import pinocchio as pin

    return pin.SE3(packed[:9].reshape(3, 3), packed[9:].copy())


def matrix_of(packed: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (4, 4) matrix of a (12,) pose."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = packed[:9].reshape(3, 3), packed[9:]
    return matrix
