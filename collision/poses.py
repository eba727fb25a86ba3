"""Checking and packing of poses: (12,) float64, the rotation by rows, then the translation, m."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from collision.errors import PoseError
from collision.tolerance import Tolerance


def pack(pose: Any, who: str, object_id: int | None = None, rigid: float = Tolerance.rigid) -> NDArray[np.float64]:
    """Return the (12,) form of a `pinocchio.SE3` or (4, 4) matrix.

    Parameters
    ----------
    who: name of the pose's owner in errors.
    object_id: id of the owner, in errors.
    rigid: greatest accepted entry of |RᵀR - I|.

    Raises
    ------
    PoseError: not finite, or not a rigid motion (an entry of RᵀR - I beyond `rigid`, a mirror image, a last row that
        is not 0 0 0 1).
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
    with np.errstate(over="ignore", invalid="ignore"):
        # in the order of `rigid_transforms.take_pose`, so that both accept the same poses to the bit
        off = float(np.abs((rotation[:, :, None] * rotation[:, None]).sum(axis=0) - np.eye(3)).max())
        det = float((rotation[0] * np.cross(rotation[1], rotation[2])).sum())
    if not (off <= rigid and det > 0.0 and matrix[3].tolist() == [0.0, 0.0, 0.0, 1.0]):
        raise PoseError(
            f"{who}: the pose is not a rigid motion (RᵀR is off the identity by {off:.3g}, {rigid:g} is allowed; "
            f"det R = {det:.6g}); normalise the rotation, scale the mesh instead of the pose",
            object_id,
        )
    return np.concatenate([rotation.ravel(), matrix[:3, 3]])


def pack_rigid(pose: Any) -> NDArray[np.float64]:
    """Return the (12,) form of a `pinocchio.SE3` that is known to be a rigid motion."""
    packed = np.empty(12)
    packed[:9], packed[9:] = pose.rotation.ravel(), pose.translation
    return packed


def frames(pose: Any = None) -> NDArray[np.float64]:
    """Return (2, 12): the identity, and the packed `pinocchio.SE3`, or zeros for the caller to fill in."""
    out = np.zeros((2, 12))
    out[0, 0] = out[0, 4] = out[0, 8] = 1.0
    if pose is not None:
        out[1] = pack_rigid(pose)
    return out


def unpack(packed: NDArray[np.float64]) -> Any:
    """Return the `pinocchio.SE3` of a (12,) pose."""
    import pinocchio as pin

    return pin.SE3(packed[:9].reshape(3, 3), packed[9:].copy())


def unpack_all(packed: NDArray[np.float64]) -> list[Any]:
    """Return the `pinocchio.SE3` of each of (k, 12) poses."""
    if len(packed) < 4:
        return [unpack(row) for row in packed]
    import pinocchio as pin

    matrices = np.zeros((len(packed), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = packed[:, :9].reshape(-1, 3, 3), packed[:, 9:], 1.0
    return [pin.SE3(matrix) for matrix in matrices]
