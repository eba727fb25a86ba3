"""Rigid transforms in kernels: (12,) float64, the rotation by rows, then the translation, m."""

from __future__ import annotations

import numpy as np

from collision.numeric.kernel import inline_kernel, inner_kernel, kernel
from collision.numeric.vectors import cross, dot


@inner_kernel
def take_pose(matrix, rigid, pose):
    """Pack the (4, 4) `matrix` into `pose` (12,) if it is a finite rigid motion; return whether it is."""
    off = 0.0
    for d in range(3):
        for e in range(d, 3):
            product = matrix[0, d] * matrix[0, e] + matrix[1, d] * matrix[1, e] + matrix[2, d] * matrix[2, e]
            off = max(off, abs(product - (1.0 if d == e else 0.0)))
        if not np.isfinite(matrix[d, 3]) or matrix[3, d] != 0.0:
            return False
    det = dot(matrix[0], cross(matrix[1], matrix[2]))
    if not (off <= rigid and 0.0 < det < np.inf and matrix[3, 3] == 1.0):  # NaN: det > 0 is false
        return False
    for d in range(3):
        for e in range(3):
            pose[3 * d + e] = matrix[d, e]
        pose[9 + d] = matrix[d, 3]
    return True


@kernel
def take_poses(matrices, rigid, packed):
    """Pack (n, 4, 4) `matrices` into `packed` (n, 12); return the index of the first that is no rigid motion, or -1."""
    for n in range(len(matrices)):
        if not take_pose(matrices[n], rigid, packed[n]):
            return n
    return -1


@inline_kernel
def rotate(pose, u):
    """The vector u rotated by a pose (12,)."""
    return (
        pose[0] * u[0] + pose[1] * u[1] + pose[2] * u[2],
        pose[3] * u[0] + pose[4] * u[1] + pose[5] * u[2],
        pose[6] * u[0] + pose[7] * u[1] + pose[8] * u[2],
    )


@inline_kernel
def unrotate(pose, u):
    """The vector u rotated by the inverse of a pose (12,)."""
    return (
        pose[0] * u[0] + pose[3] * u[1] + pose[6] * u[2],
        pose[1] * u[0] + pose[4] * u[1] + pose[7] * u[2],
        pose[2] * u[0] + pose[5] * u[1] + pose[8] * u[2],
    )


@inline_kernel
def transform(pose, p):
    """The point p moved by a pose (12,)."""
    x, y, z = rotate(pose, p)
    return x + pose[9], y + pose[10], z + pose[11]


@inner_kernel
def relative_pose(pose_a, pose_b, out):
    """Fill `out` (12,) with the pose of b in the frame of a, both (12,) in one frame."""
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = pose_a[i] * pose_b[j] + pose_a[3 + i] * pose_b[3 + j] + pose_a[6 + i] * pose_b[6 + j]
        out[9 + i] = (
            pose_a[i] * (pose_b[9] - pose_a[9])
            + pose_a[3 + i] * (pose_b[10] - pose_a[10])
            + pose_a[6 + i] * (pose_b[11] - pose_a[11])
        )


@kernel
def relative_poses(pose, pairs, out):
    """Fill `out` (k, 12) with the pose of the second of each pair (k, 2) in the frame of the first; pose: (n, 12)."""
    for k in range(len(pairs)):
        relative_pose(pose[pairs[k, 0]], pose[pairs[k, 1]], out[k])


@inner_kernel
def screw_pose(screw, t, out):
    """Fill `out` (12,) with the pose at time t on a screw (18,): the pose at t = 0, then the body twist (v, w) per unit
    of time (Rodrigues' formula)."""
    pose, twist = screw[:12], screw[12:]
    wx, wy, wz = twist[3] * t, twist[4] * t, twist[5] * t
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    if angle < 1e-4:  # the series, to the last bit at this size
        s, c, e = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0
    else:
        s = np.sin(angle) / angle
        half = np.sin(0.5 * angle) / angle
        c = 2.0 * half * half
        e = (1.0 - s) / (angle * angle)
    vx, vy, vz = twist[0] * t, twist[1] * t, twist[2] * t
    cx, cy, cz = wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx
    dx, dy, dz = wy * cz - wz * cy, wz * cx - wx * cz, wx * cy - wy * cx
    p = (vx + c * cx + e * dx, vy + c * cy + e * dy, vz + c * cz + e * dz)
    r = (
        (1.0 - c * (wy * wy + wz * wz), c * wx * wy - s * wz, c * wx * wz + s * wy),
        (c * wx * wy + s * wz, 1.0 - c * (wx * wx + wz * wz), c * wy * wz - s * wx),
        (c * wx * wz - s * wy, c * wy * wz + s * wx, 1.0 - c * (wx * wx + wy * wy)),
    )
    for i in range(3):
        x, y, z = pose[3 * i], pose[3 * i + 1], pose[3 * i + 2]
        out[9 + i] = pose[9 + i] + x * p[0] + y * p[1] + z * p[2]
        for j in range(3):
            out[3 * i + j] = x * r[0][j] + y * r[1][j] + z * r[2][j]
